"""Names of linear maps, and what is said of numbers that they mend."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.lab.check.hypotheses import affine_maps, linear_maps, regress, spoken


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


def test_messages_of_numbers_that_must_be_halved() -> None:
    """True = 0.5 x declared, so that the declared are twice the right size."""
    assert linear_maps(160, 90)["scaled-0.5 y-flipped"].tolist() == [[0.5, 0.0], [0.0, -0.5]]
    assert spoken("scaled-0.5 y-flipped") == "twice the right size, of the other sign in y"
    assert spoken("scaled-0.333") == "3 times the right size"
    assert spoken("scaled-1.5 negated") == "1/1.5 of the right size, of the other sign"


@pytest.mark.parametrize(
    ("unit", "expected"),
    [("uv", (40, 22.5)), ("uv negated", (-40, -22.5)), ("ndc", (40, -22.5)), ("ndc negated", (-40, 22.5))],
)
def test_vectors_around_a_half(unit: str, expected: tuple[float, float]) -> None:
    meant = affine_maps(160, 90)[f"centred-on-half-{unit}"]
    assert meant(np.array([[0.75], [0.75]])).ravel().tolist() == list(expected)
    assert meant.fix == {"scale": [4 * number for number in expected], "offset": [0.5, 0.5]}


@pytest.mark.parametrize("unit", [(1.0, 1.0), (160, 90), (80, -45), (37, 23)])
def test_vectors_of_a_unit_with_y_before_x_are_swapped_before_the_unit(unit: tuple[float, float]) -> None:
    stored = np.array([[0.25], [0.5]])
    meant = affine_maps(160, 90, unit)["swapped x-negated"]
    pixels, signs = np.array([unit]).T, np.array([[-1.0], [1.0]])
    declared, true = stored * pixels, stored[::-1] * pixels * signs
    np.testing.assert_allclose(meant(declared), true, rtol=4 * 2.0**-53)
    assert meant.fix == {"scale": [-1.0, 1.0], "swap": True}


def test_a_regression_of_numbers_under_a_map_is_the_map() -> None:
    """The system is well-posed and of 40 numbers below 2, so that little but their rounding is left."""
    random = np.random.default_rng(0)
    declared, matrix = random.uniform(-1, 1, (20, 2)), np.array([[0.0, 2.0], [-1.0, 0.5]])
    found = regress(declared @ matrix.T, declared, random.uniform(0.5, 1.0, 20))
    np.testing.assert_allclose(found.matrix, matrix, rtol=0, atol=40 * 2 * 2.0**-52)
    assert found.left <= 40 * 2 * 2.0**-52
