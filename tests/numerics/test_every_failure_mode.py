"""The list of failure modes is covered, and docs/numerics.md and its tables name only what is there."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

TOP = Path(__file__).parents[2]
PAGE = TOP / "docs" / "numerics.md"
TABLES = TOP / "docs" / "generated" / "numerics-tables.md"
EXCEPTIONS = TOP / "docs" / "lab-notes" / "numerics.md"

# Letter -> entries of the list, A no numbers and overflow to G platforms.
LIST = {"a": 7, "b": 5, "c": 2, "d": 3, "e": 7, "f": 9, "g": 6}
ENTRIES = [f"{letter}{number}" for letter, last in LIST.items() for number in range(1, last + 1)]


def names_in(folder: Path) -> dict[str, set[str]]:
    """Module -> the names of its tests."""
    found = defaultdict(set)
    for path in folder.rglob("test_*.py"):
        found[path.relative_to(TOP).as_posix()] = set(re.findall(r"^def (test_\w+)", path.read_text("utf-8"), re.M))
    return found


def rows(page: Path) -> dict[str, str]:
    """Entry -> the rest of its row in a page's table."""
    found = {}
    for line in page.read_text("utf-8").splitlines():
        match = re.fullmatch(r"\| ((?:[A-G]\d(?:, )?)+) \|(.*)\|", line)
        if match:
            found.update(dict.fromkeys(match[1].lower().split(", "), match[2]))
    return found


def uncovered(entries: list[str], names: set[str], excepted: set[str]) -> list[str]:
    """Entries with neither a test of their own nor a line that says why there is none."""
    covered = {entry for name in names for entry in re.findall(r"(?<=_)[a-g]\d(?=_)", name)}
    return [entry for entry in entries if entry not in covered | excepted]


def test_every_entry_has_a_test_or_a_reason() -> None:
    names = set().union(*names_in(TOP / "tests" / "numerics").values())
    assert uncovered(ENTRIES, names, set(rows(EXCEPTIONS))) == []


def test_an_entry_without_either_is_seen() -> None:
    assert uncovered(["a1", "a2", "b1"], {"test_a1_nan", "test_f4_f5_b"}, {"b1"}) == ["a2"]


def test_every_entry_has_its_row() -> None:
    assert sorted(rows(PAGE)) == ENTRIES


def test_the_pages_name_only_what_is_there() -> None:
    files = names_in(TOP / "tests")
    names = set().union(*files.values())
    text = PAGE.read_text("utf-8") + TABLES.read_text("utf-8")
    named = re.findall(r"`((?:tests/[\w/]+/)?test_\w+(?:\.py)?)`", text)
    assert len(named) > 80
    assert [name for name in named if name not in names and name not in files] == []
