"""Jitter: where it lies, that it is centred, and that the reference's pattern integrates as promised."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cltaa.errors import UsageError
from cltaa.presets import load_preset, preset_names
from cltaa_capture.jitter import PUBLISHED, centred, halton, hammersley, jitter_sequence, radical_inverse
from tests.presets.transcriptions import babylon, simvx, vireo

# 0.5 is exact and an offset has at most 53 bits: the mean of N offsets is off by N/2 roundings of 2^-54 at the most.
MEAN_ERROR = 2.0**-50


@pytest.mark.parametrize("pattern", ["halton", "r2", "hammersley", "grid"])
@pytest.mark.parametrize("count", [1, 4, 8, 16, 64, 256, 1024])
def test_offsets_are_centred_and_inside_the_pixel(pattern: str, count: int) -> None:
    if pattern == "grid" and round(count**0.5) ** 2 != count:
        count = 2 * count  # 8 is no square, 16 is
    offsets = jitter_sequence(f"{pattern}:{count}")
    assert offsets.shape == (count, 2)
    assert np.all((offsets >= -0.5) & (offsets < 0.5))
    assert np.abs(offsets.mean(axis=0)).max() <= MEAN_ERROR
    assert len(np.unique(offsets, axis=0)) == count


@given(st.lists(st.floats(0.0, 1.0, exclude_max=True, width=32), min_size=1, max_size=40))
def test_any_points_can_be_centred(points: list[float]) -> None:
    offsets = centred(np.array(points))
    # A turn by whole rounds is no turn: the points keep their distances on the circle.
    turned = (offsets - offsets[0] - (np.array(points) - points[0]) + 0.5) % 1.0 - 0.5
    assert np.abs(turned).max() <= 2.0**-50
    assert abs(offsets.mean()) <= MEAN_ERROR
    assert np.all((offsets >= -0.5) & (offsets <= 0.5))


def test_none_is_the_centre() -> None:
    assert jitter_sequence("none").tolist() == [[0.0, 0.0]]


def test_halton_by_hand() -> None:
    assert halton(4)[:, 0].tolist() == [1 / 2, 1 / 4, 3 / 4, 1 / 8]
    assert np.allclose(halton(4)[:, 1], [1 / 3, 2 / 3, 1 / 9, 4 / 9], rtol=0, atol=2.0**-52)


def test_radical_inverse_mirrors_digits() -> None:
    assert radical_inverse(0b1101, 2) == 0b1011 / 16


@pytest.mark.parametrize("power", [2, 4, 6])
def test_hammersley_has_one_point_in_every_dyadic_box(power: int) -> None:
    points, count = hammersley(2**power), 2**power
    for columns in (2**k for k in range(power + 1)):
        rows = count // columns
        box = np.floor(points[:, 0] * columns) * rows + np.floor(points[:, 1] * rows)
        assert sorted(box) == list(range(count))


@pytest.mark.parametrize("text", ["halton", "halton:0", "halton:-3", "halton:x", "sobol:16", "", "r2:1.5", "grid:8"])
def test_nonsense_is_refused(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        jitter_sequence(text)
    assert "use" in str(caught.value)


@pytest.mark.parametrize(("name", "published"), [("vireo", vireo), ("babylon", babylon), ("simvx", simvx)])
def test_published_jitter_is_that_of_the_article(name: str, published: ModuleType) -> None:
    offsets = jitter_sequence(name)
    assert np.array_equal(offsets, [published.jitter_px(index) for index in range(len(offsets))])
    assert np.array_equal(offsets[0], published.jitter_px(len(offsets)))


def test_every_preset_names_a_jitter_that_can_be_drawn() -> None:
    named = {load_preset(name).jitter for name in preset_names()} - {""}
    assert named >= PUBLISHED.keys()
    for text in named:
        jitter_sequence(text)
