"""The one display transform, and the pictures made with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.errors import OutputError
from cltaa.io.display import (
    GAP,
    error_map,
    heat,
    label,
    luma,
    shown_light,
    side_by_side,
    to_display,
    to_picture,
    write_png,
)
from tests.sequence_factory import special_values

FLOAT32_ULP = 2.0**-23  # of values in [0.5, 1)


def test_srgb_against_its_definition_in_double_precision() -> None:
    linear = np.linspace(0, 1, 4001, dtype=np.float32)
    exact = linear.astype(np.float64)
    expected = np.where(exact <= 0.0031308, 12.92 * exact, 1.055 * exact ** (1 / 2.4) - 0.055)
    # A power (4 ulp at most), a product and a difference in float32, values up to 1.055.
    np.testing.assert_allclose(to_display(linear), expected, rtol=0, atol=8 * FLOAT32_ULP)


def test_mid_grey_becomes_128_and_white_255() -> None:
    grey = ((128 / 255 + 0.055) / 1.055) ** 2.4
    levels = np.array([-1.0, 0.0, grey, 1.0, 70.0], np.float32)[:, None, None].repeat(3, axis=2)
    np.testing.assert_array_equal(to_picture(levels)[:, 0, 0], [0, 0, 128, 255, 255])


def test_stops_are_powers_of_two() -> None:
    linear = np.linspace(0, 1, 97, dtype=np.float32)
    np.testing.assert_array_equal(to_display(linear, 2.0), to_display(4 * linear))
    np.testing.assert_array_equal(shown_light(linear, -1.0), linear / 2)
    np.testing.assert_array_equal(shown_light(linear), linear)


def test_stops_reach_every_picture() -> None:
    """One stop is twice the light, whichever way a picture is made; no stops are what is left out."""
    linear = np.linspace(0, 0.4, 60, dtype=np.float32).reshape(4, 5, 3)
    brighter, other = 2 * linear, np.float32(0.25)
    assert not np.array_equal(to_picture(linear), to_picture(brighter))
    np.testing.assert_array_equal(to_picture(linear, 1.0), to_picture(brighter))
    constant = np.full_like(linear, other)
    assert not np.array_equal(error_map(linear, constant), error_map(brighter, 2 * constant))
    np.testing.assert_array_equal(error_map(linear, constant, 1.0), error_map(brighter, 2 * constant))


def test_any_bit_pattern_gives_a_picture() -> None:
    shown = to_display(special_values())
    assert np.isfinite(shown).all()
    assert shown.min() >= 0
    assert shown.max() <= 1


def test_luma_of_white_and_primaries() -> None:
    white_and_green = np.array([[[1, 1, 1], [0, 1, 0]]], np.float32)
    np.testing.assert_allclose(luma(white_and_green), [[1.0, 0.7152]], rtol=0, atol=2 * FLOAT32_ULP)


def test_png_round_trip(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (9, 7, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", picture[::-1])
    with Pillow.open(tmp_path / "a.png") as read:
        np.testing.assert_array_equal(np.asarray(read), picture[::-1])
    with pytest.raises(OutputError):
        write_png(tmp_path / "nowhere" / "a.png", picture)


def test_side_by_side_keeps_both_pictures_outside_the_labels() -> None:
    before, after = np.full((80, 120, 3), 0.1, np.float32), np.full((80, 120, 3), 0.7, np.float32)
    both = side_by_side(before, after)
    assert both.shape == (80, 240 + GAP, 3)
    lower = both[40:]
    assert (lower[:, :120] == to_picture(before)[0, 0]).all()
    assert (lower[:, 120 : 120 + GAP] == 255).all()
    assert (lower[:, 120 + GAP :] == to_picture(after)[0, 0]).all()
    assert (both[:20, :60] > 200).any()  # letters of the label


@pytest.mark.parametrize("size", [(1, 1), (2, 400), (400, 2)])
def test_label_on_pictures_too_small_for_it(size: tuple[int, int]) -> None:
    picture = np.zeros((*size, 3), np.uint8)
    assert label(picture, "before").shape == picture.shape
    assert not picture.any()  # the given picture is not painted on


def test_heat_runs_from_black_to_white_and_never_darkens() -> None:
    colours = heat(np.linspace(0, 1, 256, dtype=np.float32)[None])[0].astype(int)
    assert colours[0].tolist() == [0, 0, 0]
    assert colours[-1].tolist() == [255, 255, 255]
    assert (np.diff(colours, axis=0) >= 0).all()
    assert heat(np.array([[0.25, 9.0]], np.float32), white=0.25).min() == 255


def test_error_map_is_the_largest_channel_difference() -> None:
    reference = np.zeros((2, 2, 3), np.float32)
    test = reference.copy()
    test[0, 1] = (0.001, 0.002, 0.0)
    expected = np.zeros((2, 2))
    expected[0, 1] = 12.92 * 0.002
    np.testing.assert_allclose(error_map(test, reference), expected, rtol=4 * FLOAT32_ULP)
