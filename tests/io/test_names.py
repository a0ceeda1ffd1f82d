"""Numbers in the names of files, and what is left of the names."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.io.names import name_of, number_of, renumbered


@pytest.mark.parametrize(
    ("name", "number", "sequence", "seventh"),
    [
        ("shot.0012.exr", 12, "shot", "shot.0007.exr"),
        ("shot_12.png", 12, "shot", "shot_07.png"),
        ("shot3-1.exr", 1, "shot3", "shot3-7.exr"),
        ("0999.exr", 999, "", "0007.exr"),
        ("a\nb.123456789.exr", 123456789, "a\nb", "a\nb.000000007.exr"),
        ("shot.1234567890.exr", None, "shot.1234567890", None),  # more digits than an int holds
        ("shot.-001.exr", None, "shot.-001", None),  # below 0
        ("-1.exr", None, "-1", None),
        ("shot.exr", None, "shot", None),
        ("shot.0001.txt", None, "shot.0001", None),
    ],
)
def test_a_name_and_its_number(name: str, number: int | None, sequence: str, seventh: str | None) -> None:
    path = Path("in") / name
    assert (number_of(path), name_of(path)) == (number, sequence)
    assert renumbered(path, 7) == Path("in") / (seventh or name)
