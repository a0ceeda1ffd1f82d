"""Many frames, one after another: rounding does not build up in the history."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cltaa.core.build import Build, Real
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from tests.kernels.test_resolve import turned
from tests.sequence_factory import make_frame

U = 2.0**-24
# 64 u M for the stages of one frame, and a gain of 1.41 an axis of what the history hands on (Catmull-Rom and the blend
# together). Worst seen over the 39 frames: 3.2 u M, and 1.05 u of the mean for the root of the mean square.
MOST = 2 * 64 * U
MOST_ON_AVERAGE = 16 * U


def bright_frames(count: int, width: int = 96, height: int = 64) -> Iterator[Frame]:
    """A slope under light of 200 to 5000 that moves, seen by a camera that turns, zooms, travels and jitters."""
    y, x = np.mgrid[:height, :width]
    for index in range(count):
        noise = np.random.default_rng(index).normal(1.0, 0.02, (height, width, 1))
        light = 2600 + 2400 * np.sin(x / 5 + y / 7 + index / 9)
        frame = make_frame(
            index,
            width=width,
            height=height,
            camera=turned(index % 9, width, height),
            effects=None,
            jitter_px=(0.25 * (index % 4) - 0.375, 0.25 * (index // 4 % 4) - 0.375),
        )
        colour = light[..., None] * np.array([1.0, 0.8, 0.6]) * noise
        yield replace(frame, colour=colour.astype(np.float32), depth=(5 + 0.01 * x + 0.02 * y).astype(np.float32))


def test_thirty_nine_frames_stay_near_those_of_float64() -> None:
    device, oracle = Resolver(), Resolver(device="numpy", build=Build(real=Real.DOUBLE))
    for frame in bright_frames(39):
        found, exact = (resolver.resolve(frame).astype(np.float64) for resolver in (device, oracle))
        error = np.abs(found - exact)
        assert error.max() <= MOST * np.abs(exact).max()
        assert np.sqrt((error**2).mean()) <= MOST_ON_AVERAGE * exact.mean()
        if frame.index:
            assert not np.array_equal(found.astype(np.float32), frame.colour)  # there is a history to be wrong about
