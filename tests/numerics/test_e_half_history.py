"""Failure modes of a history in halves: docs/numerics.md, E3."""

from __future__ import annotations

from itertools import chain, repeat

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.build import Storage
from cltaa.core.planes import Layout
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from cltaa.reference.planes import stochastic_half, storage_dither
from tests.numerics.still_frames import UNIT_ROUNDOFF, accumulator, grey, last_of, still_frame
from tests.sequence_factory import bits

pytestmark = pytest.mark.optimised  # of hundreds of frames: kernels take longer than their builds

HEIGHT, WIDTH = 96, 128
HALF_ULP = 2.0**-10


def goals() -> NDArray[np.float32]:
    """Values in [1.1, 1.9): they and what stalls around them have the same half ulp, 2^-10."""
    return np.random.default_rng(3).uniform(1.1, 1.9, (HEIGHT, WIDTH)).astype(np.float32)


def stalled(launcher: DeviceLauncher, start: float, weight: float, storage: Storage) -> NDArray[np.float64]:
    """What is missing, goal - history, long after a step from ``start`` to ``goals``."""
    goal = goals()
    frames = int(12 / weight)  # e^-12 of the step is 1/160 half ulp
    images = chain([grey(np.full_like(goal, start))], repeat(grey(goal), frames))
    return (goal - last_of(accumulator(launcher, weight, storage), images)[..., 0]).astype(np.float64)


@pytest.mark.parametrize("weight", [0.1, 0.05, 0.02])
def test_e3_half_history_stalls_by_its_law(launcher: DeviceLauncher, weight: float) -> None:
    # An update smaller than half an ulp of the history is lost: |x - h| <= ulp(h) / (2 weight), where the float32 sum
    # before the rounding may be off by u (of at most 2). One step before, the history still moved by its ulp, so that
    # at least half of the bound is left.
    bound = (HALF_ULP / 2 + 2 * UNIT_ROUNDOFF) / weight
    from_below = stalled(launcher, 0.0, weight, Storage.HALF)
    assert from_below.max() <= bound
    assert from_below.min() >= bound / 2
    from_above = -stalled(launcher, 4.0, weight, Storage.HALF)
    assert from_above.max() <= bound
    assert from_above.min() >= bound / 2


@pytest.mark.parametrize("start", [0.0, 4.0])
@pytest.mark.parametrize("weight", [0.1, 0.05])
def test_e3_stochastic_rounding_does_not_stall(launcher: DeviceLauncher, start: float, weight: float) -> None:
    missing = stalled(launcher, start, weight, Storage.HALF_STOCHASTIC) / HALF_ULP
    # The history is one of the two halves around the goal, the upper one as often as the goal is near to it: noise of
    # variance f (1 - f) ulp^2, on average 1/6, whatever the weight. Its mean over the image: 5 standard errors.
    deviation = np.sqrt(1 / 6)
    assert abs(missing.mean()) <= 5 * deviation / np.sqrt(missing.size)
    assert abs(missing.std() - deviation) <= 0.05 * deviation


@pytest.mark.parametrize("start", [0.0, 4.0])
def test_e3_float_history_ends_within_its_own_law(launcher: DeviceLauncher, start: float) -> None:
    weight = 0.1
    goal = goals()
    images = chain([grey(np.full_like(goal, start))], repeat(grey(goal), 250))
    missing = goal - last_of(accumulator(launcher, weight), images)[..., 0]
    assert np.abs(missing).max() <= 2 * UNIT_ROUNDOFF / weight * goal.max()


def test_e3_stochastic_rounding_is_unbiased() -> None:
    # Every dither that there can be, once: the mean of the rounded values is the value itself.
    random = np.random.default_rng(5)
    values = np.concatenate(
        [
            random.uniform(-3, 3, 40),
            10.0 ** random.uniform(-8, 4.5, 40),
            [2.0**-24 * 0.3, 65503.9, -65503.9, 2047.5],
        ]
    ).astype(np.float32)
    dither = (np.arange(2**13, dtype=np.float32) + np.float32(0.5)) * np.float32(2.0**-13)
    rounded = stochastic_half(values[:, None], dither[None, :]).astype(np.float64)
    assert np.array_equal(rounded, rounded.astype(np.float16))  # both neighbours are halves
    step = np.maximum(2.0 ** np.floor(np.log2(np.abs(values.astype(np.float64)))), 2.0**-14) * 2.0**-10
    assert (np.abs(rounded - values[:, None]) < step[:, None]).all()
    assert (np.abs(rounded.mean(axis=1) - values) <= step * 2.0**-13).all()


def test_e3_stochastic_rounding_keeps_halves(launcher: DeviceLauncher) -> None:
    every = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32).reshape(124, 256)
    resolver = accumulator(launcher, 0.1, Storage.HALF_STOCHASTIC)
    for index in range(3):
        assert np.array_equal(bits(resolver.resolve(still_frame(index, grey(every)))), bits(grey(every)))


def test_e3_dither_is_even_and_new_in_every_frame() -> None:
    layout = Layout(WIDTH, HEIGHT)
    record = np.zeros((), [("number", np.int32)])
    fields = []
    for number in range(8):
        record["number"] = number
        fields.append(storage_dither(layout, record).astype(np.float64))
    drawn = np.array(fields)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    counts = np.histogram(drawn, bins=64, range=(0, 1))[0]
    expected = drawn.size / 64
    assert ((counts - expected) ** 2 / expected).sum() < 63 + 5 * np.sqrt(2 * 63)  # chi squared: mean 63, variance 126
    centred = drawn - 0.5
    for other in (np.roll(centred, 1, 0), np.roll(centred, 1, 1), np.roll(centred, 1, 2)):
        # The correlation of independent numbers has the standard deviation 1 / sqrt(n).
        assert abs((centred * other).mean() * 12) < 5 / np.sqrt(drawn.size)


def test_e3_stochastic_storage_is_the_same_every_time_and_keeps_greys_grey(launcher: DeviceLauncher) -> None:
    images = [grey(goals() + np.float32(0.1 * index)) for index in range(5)]
    first, again = (last_of(accumulator(launcher, 0.1, Storage.HALF_STOCHASTIC), images) for _ in range(2))
    twin = last_of(accumulator(NumpyLauncher(), 0.1, Storage.HALF_STOCHASTIC), images)
    assert np.array_equal(bits(first), bits(again))
    assert np.array_equal(bits(first), bits(twin))
    assert np.array_equal(first[..., 0], first[..., 1])
    assert np.array_equal(first[..., 0], first[..., 2])
