"""Names of linear maps, and what is said of numbers that they mend."""

from __future__ import annotations

import pytest

from cltaa.checking.gains import affine_maps, linear_maps, spoken


def test_every_map_is_said_in_words_of_its_own() -> None:
    names = [name for name in affine_maps(160, 90) if name]
    assert len({spoken(name) for name in names}) == len(names)
    assert set(linear_maps(160, 90)) <= {"", *names}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("y-flipped", [[1, 0], [0, -1]]),
        ("swapped x-negated", [[0, -1], [1, 0]]),
        ("units-uv negated", [[-160, 0], [0, -90]]),
        ("units-ndc", [[80, 0], [0, -45]]),
    ],
)
def test_maps_are_what_their_names_say(name: str, expected: list[list[float]]) -> None:
    assert linear_maps(160, 90)[name].tolist() == expected


def test_what_is_said_of_numbers_that_must_be_halved() -> None:
    """True = 0.5 x declared, so that the declared are twice the right size."""
    assert linear_maps(160, 90)["scaled-0.5 y-flipped"].tolist() == [[0.5, 0.0], [0.0, -0.5]]
    assert spoken("scaled-0.5 y-flipped") == "twice the right size, of the other sign in y"
