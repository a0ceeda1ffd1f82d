"""The faults of ``scripts/mutate --python``: each kind is found, stands alone, and is tried on the tests next to it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.numerics import time_limit
from tests.numerics.mutations import TOP
from tests.numerics.python_faults import chosen, faults_of, faulty, is_python, main, nearest_tests, noticed_by

SAMPLE = '''
"""Text 1."""
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    import os

def f(a: int = 3, *, flag: bool = False) -> bool:
    """More than 1."""
    if a < 2 or flag:
        raise ValueError(f"{a + 1}")
    return a == 1

def pair(x): return g(x, 7, half=True, help="é"), x

@overload
def typed(x: int = 5) -> int: ...
'''


def test_every_kind_of_fault_is_found() -> None:
    found = {(fault.kind, fault.right, fault.wrong) for fault in faults_of("a.py", SAMPLE)}
    call = 'g(x, 7, half=True, help="é")'
    assert found == {
        ("default changed", "3", "4"),
        ("default changed", "False", "True"),
        ("branch negated", "a < 2 or flag", "(not (a < 2 or flag))"),
        ("operator swapped", "a < 2 or flag", "(a < 2 and flag)"),
        ("operator swapped", "a < 2", "(a <= 2)"),
        ("operator swapped", "a == 1", "(a != 1)"),
        ("constant changed", "2", "3"),
        ("constant changed", "1", "2"),
        ("constant changed", "7", "8"),
        ("constant changed", "True", "False"),
        ("raise removed", 'raise ValueError(f"{a + 1}")', "pass"),
        ("return replaced", "a == 1", "(not (a == 1))"),
        ("return replaced", f"{call}, x", "(x, g(x, 7, half=True, help='é'))"),
        ("argument dropped", call, "g(x, half=True, help='é')"),
        ("argument dropped", call, "g(x, 7, help='é')"),
    }


def test_a_fault_changes_nothing_but_its_place() -> None:
    content = SAMPLE.encode()
    for fault in faults_of("a.py", SAMPLE):
        assert content[fault.start : fault.end].decode() == fault.right
        changed = faulty(content, fault)
        assert changed != content
        assert len(changed) - len(content) == len(fault.wrong.encode()) - len(fault.right.encode())
        assert is_python(changed)


def test_a_seed_chooses_the_same_faults_again() -> None:
    first, again, other = (chosen(["cltaa/io/exr_r"], seed, 20) for seed in (3, 3, 4))
    assert first == again != other
    assert len({*first}) == 20
    assert len({fault.kind for fault in first}) >= 5
    assert {Path(fault.file).parent.as_posix() for fault in first} == {"cltaa/io"}


def test_faults_can_be_listed(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--list", "--seed", "3", "--count", "5", "cltaa/io/manifest"])
    assert capsys.readouterr().out.splitlines() == [str(fault) for fault in chosen(["cltaa/io/manifest"], 3, 5)]


def test_the_nearest_tests_come_first(tmp_path: Path) -> None:
    """Of a part of the tree: all of it takes seconds to read."""
    for folder in ("cltaa/io", "tests/io", "tests/core"):
        shutil.copytree(TOP / folder, tmp_path / folder)
    shutil.copy(TOP / "cltaa" / "process.py", tmp_path / "cltaa")
    assert Path(nearest_tests("cltaa/io/manifest.py", tmp_path)[0]).name == "test_manifest.py"
    nearest = {Path(path).name for path in nearest_tests("cltaa/process.py", tmp_path)}
    assert "test_copies.py" in nearest  # which quotes it alone


@pytest.mark.parametrize(
    ("first", "seconds", "noticed"),
    [
        ("assert True", 600.0, "tests/test_one.py::test_second"),
        ("assert True", 0.0, ""),
        ("assert False", 0.0, "tests/test_one.py::test_first"),
    ],
)
def test_who_notices_within_the_time(tmp_path: Path, first: str, seconds: float, noticed: str) -> None:
    (tmp_path / "tests" / "numerics").mkdir(parents=True)
    shutil.copy(time_limit.__file__, tmp_path / "tests" / "numerics")
    (tmp_path / "tests" / "test_one.py").write_text(
        f"def test_first():\n    {first}\n\ndef test_second():\n    assert False\n"
    )
    assert noticed_by(tmp_path, ["tests/test_one.py"], seconds) == noticed


def test_a_name_with_spaces_is_named_whole(tmp_path: Path) -> None:
    """Else the test by that name, run again without the fault, is not found."""
    (tmp_path / "tests" / "numerics").mkdir(parents=True)
    shutil.copy(time_limit.__file__, tmp_path / "tests" / "numerics")
    case = '@pytest.mark.parametrize("x", [[1]], ids=["-o out - more"])'
    (tmp_path / "tests" / "test_one.py").write_text(f"import pytest\n{case}\ndef test_one(x):\n    assert x == [2]\n")
    assert noticed_by(tmp_path, ["tests/test_one.py"]) == "tests/test_one.py::test_one[-o out - more]"
