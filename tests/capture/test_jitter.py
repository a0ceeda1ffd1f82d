"""Jitter: where it lies, that it is centred, and that the reference's pattern integrates as promised."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cltaa.core.presets import load_preset, preset_names
from cltaa.errors import UsageError
from cltaa.lab.check.jitter import LARGEST_MEAN_PX
from cltaa_capture.cli import capture
from cltaa_capture.jitter import (
    LONGEST_LATTICE,
    PUBLISHED,
    centred,
    halton,
    hammersley,
    herded,
    jitter_sequence,
    lattice,
    radical_inverse,
)
from cltaa_capture.sequence import Request
from tests.core.transcriptions import babylon, simvx, vireo

# 0.5 is exact and an offset has at most 53 bits: the mean of N offsets is off by N/2 roundings of 2^-54 at the most.
MEAN_ERROR = 2.0**-50


@pytest.mark.parametrize("pattern", ["halton", "r2", "lattice", "hammersley", "grid"])
def test_offsets_are_centred_and_inside_the_pixel(pattern: str) -> None:
    for count in [1, 4, 8, 16, 64, 256, 1024]:
        if pattern == "grid" and round(count**0.5) ** 2 != count:
            count = 2 * count  # 8 is no square, 16 is
        offsets = jitter_sequence(f"{pattern}:{count}")
        assert offsets.shape == (count, 2), count
        assert np.all((offsets >= -0.5) & (offsets < 0.5)), count
        assert np.abs(offsets.mean(axis=0)).max() <= MEAN_ERROR, count
        assert len(np.unique(offsets, axis=0)) == count, count


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


def test_lattice_has_one_point_in_every_row_and_column() -> None:
    for count in [1, 2, 5, 16, 60, 64, 256]:
        index = np.floor(lattice(count) * count)
        assert (np.sort(index, axis=0) == np.arange(count)[:, None]).all(), count


def test_lattice_lies_in_most_squares() -> None:
    across, down = np.floor(lattice(64) * 8).T
    assert len(np.unique(8 * across + down)) == 56  # of 64; halton:64 is in 55 of them, r2:64 in 54


def test_points_of_a_lattice_keep_apart() -> None:
    squares = np.rint(64 * (lattice(64)[:, None] - lattice(64))).astype(int)
    apart = (((squares + 32) % 64 - 32) ** 2).sum(-1)
    # 74 squared would be that of equilateral triangles of this area, which no whole numbers make; 58 = 7^2 + 3^2.
    assert apart[apart > 0].min() == 58


def energy(points: np.ndarray) -> float:
    """How unevenly points [N, 2] cover the pixel: the variance of their mean for a covariance exp(-2 d), d in pixels.

    The square is summed up by 24 x 24 midpoints.
    """
    middles = (np.arange(24) + 0.5) / 24 - 0.5
    square = np.stack(np.meshgrid(middles, middles), -1).reshape(-1, 2)

    def mean(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.exp(-2 * np.hypot(*(a[:, None] - b).transpose(2, 0, 1))).mean())

    return mean(points, points) - 2 * mean(points, square) + mean(square, square)


def test_frames_of_a_lattice_are_more_even_than_those_of_other_sequences() -> None:
    counts = (4, 8, 16, 32, 64)
    lattice, halton, r2 = (
        np.array([energy(jitter_sequence(name)[:count]) for count in counts])
        for name in ("lattice:64", "halton:64", "r2:64")
    )
    # Means over the counts 0.78 of halton's and 0.94 of r2's; all 64 0.65 and 0.88.
    for other in (halton, r2):
        assert lattice[-1] < 0.9 * other[-1]
        assert np.log(lattice).mean() < np.log(other).mean() - 0.05


def test_no_steady_drift_lines_up_the_samples_of_a_lattice() -> None:
    """Of a lattice's last 48 frames, which a drift of the picture moves from each other; r2 has its own step as one."""
    waves = np.array([(a, b) for a in range(-4, 5) for b in range(-4, 5) if (a, b) > (0, 0)])
    drifts = np.random.default_rng(0).random((500, 2))

    def worst(name: str) -> float:
        points = jitter_sequence(f"{name}:64")[16:]
        moved = points + np.arange(48)[:, None] * drifts[:, None]
        power = abs(np.exp(2j * np.pi * moved @ waves.T).mean(axis=1)) ** 2
        return float((power / (waves**2).sum(1) ** 1.5).sum(axis=1).max())

    # Worst seen 0.24 against 1.03 of halton and 1.29 of r2.
    assert worst("lattice") < min(worst("halton"), worst("r2")) / 4


def test_the_default_is_centred_wherever_a_capture_of_it_is_cut() -> None:
    """Of 8 frames or more in a row, so that ``cltaa check`` takes none for a jitter that shifts the picture."""
    default = Request("still", Path("folder")).jitter
    assert default == next(option.default for option in capture.params if option.name == "jitter")
    points = np.tile(jitter_sequence(default), (2, 1))
    runs = (points[first : first + length] for first, length in product(range(len(points) // 2), range(8, 65)))
    assert max(np.abs(run.mean(axis=0)).max() for run in runs) < LARGEST_MEAN_PX  # worst seen 0.096


@pytest.mark.parametrize("count", [1, 7, 30])
def test_herding_takes_every_point_once_and_begins_in_the_middle(count: int) -> None:
    points = np.random.default_rng(count).random((count, 2))
    order = herded(points)
    assert sorted(map(tuple, order)) == sorted(map(tuple, points))
    nearness = np.exp(-2 * np.hypot(*(points[:, None] - points).transpose(2, 0, 1))).mean(0)
    assert (order[0] == points[nearness.argmax()]).all()


def test_a_lattice_too_long_to_put_in_order_is_refused() -> None:
    with pytest.raises(UsageError, match=f"lattice:{LONGEST_LATTICE}"):
        jitter_sequence(f"lattice:{LONGEST_LATTICE + 1}")


@pytest.mark.parametrize(
    "text", ["halton", "halton:0", "halton:08", "halton:-3", "halton:x", "sobol:16", "", "r2:1.5", "grid:8"]
)
def test_an_unknown_jitter_is_refused(text: str) -> None:
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
