"""A missing sample is no sample: docs/numerics.md, A."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Frame, Image
from cltaa.opencl.launcher import DeviceLauncher
from tests.last_frame import last_planes
from tests.sequence_factory import bits, make_frame

WIDTH, HEIGHT = 48, 40
HOLE = (slice(8, 29), slice(10, 37))  # in which no 3x3 of the inside holds a usable texel
WHOLE = (slice(None), slice(None))
RECURRENT = ["default", "fast", "karis"]  # a count, a mean with a least weight, and a weight that no count decides
# What a frame of nothing is told of.
pytestmark = pytest.mark.filterwarnings("ignore:frame . has no usable sample")


def strict(preset: str, launcher: DeviceLauncher) -> Resolver:
    """A resolver of the device for our own presets, and one of its twin, which has the same bits, for the others."""
    return Resolver(preset, launcher if preset in ("default", "gather-8") else "numpy", strict=True)


def counts(resolver: Resolver) -> Image:
    """The effective sample counts [H, W] that the last frame has left."""
    return np.asarray(last_planes(resolver, "output_count")[0])


def standing(index: int, hole: tuple[slice, slice] | None = None) -> Frame:
    """Light that stands on a wall that stands, seen by the pixels' centres: every frame is the first one."""
    frame = make_frame(0, width=WIDTH, height=HEIGHT, jitter_px=(0.0, 0.0), effects=None)
    colour = frame.colour + 1
    if hole is not None:
        colour[hole] = np.nan
    return replace(frame, index=index, colour=colour, depth=np.full_like(frame.depth, 4.0))


@pytest.mark.parametrize("hole", [HOLE, WHOLE], ids=["block", "whole"])
@pytest.mark.parametrize("preset", [*RECURRENT, "gather-8"])
def test_a_missing_sample_leaves_the_history_and_its_count(
    launcher: DeviceLauncher, preset: str, hole: tuple[slice, slice]
) -> None:
    resolver, without = (strict(preset, launcher) for _ in range(2))
    for index in range(4):
        before = resolver.resolve(standing(index))
        without.resolve(standing(index))
    count = counts(resolver)
    after = resolver.resolve(standing(4, hole))
    if preset == "gather-8":
        # Samples of one value: the fit's rounding. They are those of windows of three frames and of all four.
        np.testing.assert_allclose(after[hole], before[hole], rtol=2.0**-18)
        counted = counts(resolver)[hole]
        assert counted.min() >= 3 - 2.0**-18
        assert counted.max() <= 4 + 2.0**-18
        return
    assert np.array_equal(bits(after[hole]), bits(before[hole]))
    assert np.array_equal(bits(counts(resolver)[hole]), bits(count[hole]))
    # And the next frame goes on from there, as if the frame with the hole had not been.
    assert np.array_equal(bits(resolver.resolve(standing(5))[hole]), bits(without.resolve(standing(4))[hole]))


@pytest.mark.parametrize("preset", [*RECURRENT, "gather-8"])
def test_without_history_the_nearest_samples_stand_in_and_count_for_nothing(
    launcher: DeviceLauncher, preset: str
) -> None:
    resolver, anew = strict(preset, launcher), strict(preset, launcher)
    frame = standing(0, HOLE)
    filled = resolver.resolve(frame)[HOLE]
    assert filled.min() >= np.nanmin(frame.colour)
    assert filled.max() <= np.nanmax(frame.colour)
    assert (counts(resolver)[HOLE] == 0).all()
    inside = tuple(slice(side.start + 1, side.stop - 1) for side in HOLE)
    assert np.array_equal(bits(resolver.resolve(standing(1))[inside]), bits(anew.resolve(standing(1))[inside]))


def test_a_hole_is_filled_by_distance(launcher: DeviceLauncher) -> None:
    frame = standing(0)
    frame.colour[:] = np.where(np.arange(WIDTH)[None, :, None] < WIDTH // 2, 1.0, 3.0)
    frame.colour[HOLE] = np.nan
    row = Resolver("default", launcher, strict=True).resolve(frame)[HOLE][10, :, 0]
    assert row[0] < 1.5 < 2.5 < row[-1]
    assert (np.diff(row) >= 0).mean() > 0.9


def test_a_frame_of_nothing_alone_is_black_and_counts_for_nothing(launcher: DeviceLauncher) -> None:
    resolver = Resolver("default", launcher, strict=True)
    assert (resolver.resolve(standing(0, WHOLE)) == 0).all()
    assert (counts(resolver) == 0).all()


def with_alpha(index: int, colour: float = 0.0, alpha: float = 0.0, hole: tuple[slice, slice] = HOLE) -> Frame:
    """As ``standing``, with alpha from 0.2 to 0.7; in the hole NaN, or what is not 0 of ``colour`` and ``alpha``."""
    frame = standing(index)
    share = np.linspace(0.2, 0.7, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    share[hole] += np.float32(alpha)
    frame.colour[hole] += np.float32(colour)
    return replace(frame, alpha=share)


BAD = {"colour": (np.nan, 0.0), "alpha": (0.0, np.nan), "infinite alpha": (0.0, -np.inf), "huge": (0.0, 2.0**60)}


@pytest.mark.parametrize("hole", [HOLE, (slice(9, 10), slice(20, 21))], ids=["block", "texel"])
@pytest.mark.parametrize("history", [0, 4])
@pytest.mark.parametrize("preset", ["default", "fast", "basic", "gather-8"])
def test_a_sample_is_missing_with_its_alpha(
    launcher: DeviceLauncher, preset: str, history: int, hole: tuple[slice, slice]
) -> None:
    def resolved(colour: float, alpha: float, on: Resolver) -> list[Image]:
        before = [on.resolve(with_alpha(index)) for index in range(history)][-1:]
        frames = with_alpha(history, colour, alpha, hole), with_alpha(history + 1)
        return [*before, *(on.resolve(frame) for frame in frames)]

    *_, whole, after = expected = resolved(np.nan, np.nan, strict(preset, launcher))
    for name, bad in BAD.items():
        found = resolved(*bad, strict(preset, launcher))
        assert all(np.array_equal(bits(a), bits(b)) for a, b in zip(found, expected, strict=True)), name
    alpha = with_alpha(0).alpha
    assert alpha is not None
    if history:
        np.testing.assert_allclose(whole[hole], expected[0][hole], atol=2.0**-18)
    else:  # a fill, by the means of what lies around
        assert np.abs(whole[hole][..., 3] - alpha[hole]).max() < 0.1
    np.testing.assert_allclose(after[hole][..., 3], alpha[hole], atol=2.0**-18)
