"""The faults of ``scripts/mutate`` and ``scripts/memcheck`` have their places; running these shows who notices."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cltaa.core.build import Build
from tests.kernels.stage_chain import variants
from tests.numerics.memory import EDITS, PLANTED
from tests.numerics.mutations import MUTATIONS, TOP, chosen_by, main, occurrences


def test_every_fault_still_has_its_place() -> None:
    planted = [*MUTATIONS, *EDITS, *(fault for fault, _ in PLANTED)]
    assert {fault.fault: fault.file for fault in planted if occurrences(fault) != 1 or fault.right == fault.wrong} == {}


def is_there(name: str) -> bool:
    """Whether a test of the table can be run."""
    chosen = re.fullmatch(r"(?:gpu )?(?:bound|twin) of (\w+)-(.+)", name)
    if chosen:
        # The twin of every choice leaves the default out.
        left_out = name.startswith("twin of") and chosen[2] == "default"
        return not left_out and chosen[2] in variants(chosen[1], Build(strict=True, lanes=1))
    path, _, function = name.split("[")[0].partition("::")
    return f"def {function}" in (TOP / path).read_text(encoding="utf-8")


def test_faults_name_tests_that_there_are() -> None:
    named = ((fault.fault, test) for fault in MUTATIONS for test in (*fault.values, *fault.bits))
    assert [(fault, test) for fault, test in named if not is_there(test)] == []


def test_faults_are_distinguished() -> None:
    assert len({mutation.fault for mutation in MUTATIONS}) == len(MUTATIONS) >= 20


def test_the_page_lists_every_fault() -> None:
    page = (Path(__file__).parents[2] / "docs" / "generated" / "numerics-tables.md").read_text(encoding="utf-8")
    listed = re.search("<!-- mutations -->(.*)<!-- end of mutations -->", page, re.DOTALL)
    assert listed
    rows = re.findall(r"^\| (.+?) \| ((?:kernels|cltaa)/\S+) \|", listed[1], re.MULTILINE)
    assert sorted(rows) == sorted((mutation.fault, mutation.file) for mutation in MUTATIONS)
    assert f"The table holds {len(rows)} faults." in listed[1]


@pytest.mark.parametrize(
    ("part", "file"),
    [
        ("variance as the mean of squares", "kernels/taa/neighbourhood.h"),
        ("neighbourhood.h", "kernels/taa/neighbourhood.h"),
        ("kernels/taa/neighbourhood.h", "kernels/taa/neighbourhood.h"),
        ("./kernels/taa/neighbourhood.h", "kernels/taa/neighbourhood.h"),
        (str(TOP / "kernels" / "taa" / "neighbourhood.h"), "kernels/taa/neighbourhood.h"),
    ],
)
def test_faults_are_chosen_by_description_or_file(part: str, file: str, capsys: pytest.CaptureFixture[str]) -> None:
    chosen = chosen_by([part])
    assert chosen
    assert {mutation.file for mutation in chosen} == {file}
    assert chosen_by([]) == MUTATIONS
    main(["--list", part])
    assert capsys.readouterr().out.splitlines()[2:] == [f"| {each.fault} | {each.file} |" for each in chosen]


def test_parts_that_choose_no_fault_are_named() -> None:
    with pytest.raises(SystemExit, match=r"^no fault and no file of one holds nowhere.h; see --list$"):
        chosen_by(["neighbourhood.h", "nowhere.h"])
