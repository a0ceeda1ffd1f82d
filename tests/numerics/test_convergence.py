"""Convergence to the truth for any jitter: a Z-test a pixel, as rendering systems test."""

from __future__ import annotations

from functools import cache
from statistics import NormalDist

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.opencl.launcher import DeviceLauncher
from tests.numerics.still_frames import accumulator, grey, still_frame

HEIGHT, WIDTH = 12, 18
SEEDS, FRAMES = 64, 64
SIGNIFICANCE = 0.01
SHARE = 0.9975  # of the pixels that have to pass
LEAST_VARIANCE = 1e-4  # of a pixel over the seeds; below it the estimate of the variance means nothing


def scene(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slanted bars and a disc, hard-edged, in pixels from the top left corner."""
    bars = (0.31 * x + 0.17 * y) % 1.9 > 0.8
    disc = (x - 9.3) ** 2 + (y - 5.7) ** 2 < 11.0
    return 0.2 + 0.5 * bars + 1.3 * disc


@cache
def truth() -> NDArray[np.float64]:
    """The mean over each pixel, of 64 x 64 samples."""
    y, x = ((np.arange(64 * size) + 0.5) / 64 for size in (HEIGHT, WIDTH))
    mean: NDArray[np.float64] = scene(x[None], y[:, None]).reshape(HEIGHT, 64, WIDTH, 64).mean(axis=(1, 3))
    return mean


def converged(launcher: DeviceLauncher, shift: float = 0.0, resolution: int = 2**24) -> NDArray[np.float64]:
    """[SEEDS, H, W] after FRAMES frames, every seed with its own jitter, side by side in one picture."""
    random = np.random.default_rng(61)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    resolver = accumulator(launcher)
    for index in range(FRAMES):
        jitter = np.floor(random.random((2, SEEDS, 1, 1)) * resolution) / resolution + shift
        tiles = scene(x + jitter[0], y + jitter[1])
        resolved = resolver.resolve(still_frame(index, grey(tiles.reshape(SEEDS * HEIGHT, WIDTH))))
    return resolved[..., 0].astype(np.float64).reshape(SEEDS, HEIGHT, WIDTH)


def passing(results: NDArray[np.float64]) -> float:
    """Share of pixels whose mean over the seeds is not significantly off the truth (Sidak's correction)."""
    error = results.mean(axis=0) - truth()
    deviation = np.sqrt(np.maximum(results.var(axis=0, ddof=1), LEAST_VARIANCE) / SEEDS)
    per_pixel = 1 - (1 - SIGNIFICANCE) ** (1 / error.size)
    return float((np.abs(error / deviation) <= NormalDist().inv_cdf(1 - per_pixel / 2)).mean())


def test_e4_the_resolve_converges_to_the_truth_for_any_jitter(launcher: DeviceLauncher) -> None:
    assert passing(converged(launcher)) >= SHARE


@pytest.mark.parametrize(("shift", "resolution"), [(0.05, 2**24), (0.0, 4)])
def test_e4_the_test_finds_a_biased_jitter(launcher: DeviceLauncher, shift: float, resolution: int) -> None:
    # A twentieth of a pixel off centre, or only the corners of quarter pixels.
    assert passing(converged(launcher, shift, resolution)) < SHARE
