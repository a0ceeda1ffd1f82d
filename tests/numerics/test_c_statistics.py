"""Failure modes of the neighbourhood's statistics: docs/numerics.md, C."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.parameters import BoxSpace, Choices, Neighbourhood, Settings, Variance
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import padded, tiles
from tests.kernels.stage_chain import Work, run_stage
from tests.numerics.still_frames import CAMERA, UNIT_ROUNDOFF, accumulator, grey, still_frame
from tests.sequence_factory import bits, make_frame

Planes = NDArray[np.float32]
HEIGHT, WIDTH = 240, 320


@cache
def patches() -> Planes:
    """[3, H, W]: tiles of means 1 to 10^6 and relative spreads 10^-6 to 1, flat ones and lone fireflies among them."""
    random = np.random.default_rng(11)
    shape = (HEIGHT, WIDTH)
    mean = 10 ** np.round(tiles(random, shape, -0.5, 6.5))
    spread = 10 ** np.round(tiles(random, shape, -6.5, 0.5))
    spread[tiles(random, shape, 0, 1) < 0.1] = 0.0
    image = mean * (1 + spread * random.normal(size=(3, *shape)))
    image[:, random.random(shape) < 0.002] *= 1e5
    return image.astype(np.float32)


def measured(launcher: DeviceLauncher, image: Planes, **choices: Any) -> tuple[Planes, Planes]:
    """Mean and deviation [3, H, W] that the stage gives."""
    layout = Layout(image.shape[2], image.shape[1])
    frame = make_frame(width=layout.width, height=layout.height, camera=CAMERA)
    zero = layout.zeros(2)
    planes = {"current": padded(image, layout), "alpha": zero[:1], "inverse_depth": zero[:1], "motion": zero}
    build = launcher.build(Build(choices=Choices(**choices), steps=Steps(own_motion=False), strict=True))
    work = Work(layout, planes, frame_record(frame, Past.of(frame), layout), settings_record(Settings()))
    found = layout.inside(run_stage("neighbourhood_statistics", build, work, launcher)["statistics_out"])
    return found[:3], found[3:6]


def windows(image: NDArray[Any]) -> NDArray[Any]:
    """[9, C, H, W]: the texels around each, edges repeated."""
    around = np.pad(image, ((0, 0), (1, 1), (1, 1)), mode="edge")
    height, width = image.shape[1:]
    return np.array([around[:, y : y + height, x : x + width] for y in range(3) for x in range(3)])


def box_space(image: NDArray[Any]) -> NDArray[Any]:
    """RGB [3, ...] as Y, Co, Cg in the precision of ``image``."""
    r, g, b = image
    return np.array([r / 4 + g / 2 + b / 4, r / 2 - b / 2, g / 2 - r / 4 - b / 4])


@pytest.mark.parametrize("space", list(BoxSpace))
def test_c1_deviation_is_right_at_any_mean(launcher: DeviceLauncher, space: BoxSpace) -> None:
    # Weights by luminance and by jitter are held to the shaders that they are of (tests/core/test_seed_presets.py).
    image = patches()
    mean, deviation = measured(launcher, image, box_space=space)
    exact = image.astype(np.float64)
    taps = windows(exact if space is BoxSpace.RGB else box_space(exact))
    largest = np.abs(windows(exact)).max(axis=(0, 1))
    # numerics.md, C1: 60 u of the deviation whatever the mean, and 2 u of the largest value for YCoCg's own rounding.
    rounding = 0.0 if space is BoxSpace.RGB else 2 * UNIT_ROUNDOFF * largest
    error = np.abs(deviation - taps.std(axis=0))
    bound = 60 * UNIT_ROUNDOFF * taps.std(axis=0) + rounding
    assert (error <= bound).all()
    assert (np.abs(mean - taps.mean(axis=0)) <= 4 * UNIT_ROUNDOFF * largest).all()
    assert (error / np.maximum(bound, 1e-30)).max() > 0.05  # the bound means something


@pytest.mark.parametrize("neighbourhood", list(Neighbourhood))
def test_c1_a_flat_patch_has_no_deviation_at_all(launcher: DeviceLauncher, neighbourhood: Neighbourhood) -> None:
    image = patches()
    taps = windows(image)
    flat = (taps == taps[0]).all(axis=(0, 1))
    _, deviation = measured(launcher, image, neighbourhood=neighbourhood)
    assert flat.sum() > 1000
    assert (deviation[:, flat] == 0).all()
    assert (deviation >= 0).all()  # and no NaN


def test_c1_the_usual_form_would_fail() -> None:
    # E[x^2] - E[x]^2 in float32, which half of the published code uses: the patches do tell it from the shifted form.
    taps = windows(patches())
    ninth = np.float32(1 / 9)
    mean = taps.sum(axis=0, dtype=np.float32) * ninth
    naive = (taps * taps).sum(axis=0, dtype=np.float32) * ninth - mean * mean
    true = taps.astype(np.float64).std(axis=0)
    assert (naive < 0).mean() > 0.05
    off = np.abs(np.sqrt(np.maximum(naive, 0)) - true) > 60 * UNIT_ROUNDOFF * true
    assert off.mean() > 0.3


def test_c1_the_naive_variance_fails_as_it_is_known_to(launcher: DeviceLauncher) -> None:
    # The option: what it gives is E[x^2] - E[x]^2 within its own rounding, and most of it is not the deviation.
    image = patches()
    mean, deviation = measured(launcher, image, box_space=BoxSpace.RGB, variance=Variance.NAIVE)
    taps = windows(image.astype(np.float64))
    true, size = taps.std(axis=0), (taps**2).mean(axis=0)
    assert (np.abs(mean - taps.mean(axis=0)) <= 12 * UNIT_ROUNDOFF * np.abs(taps).max(axis=0)).all()
    # numerics.md, C1: (n + 2) u of the mean square, in the variance.
    assert (np.abs(deviation**2 - true**2) <= (len(taps) + 2) * 2 * UNIT_ROUNDOFF * size).all()
    assert np.isfinite(deviation).all()
    assert (np.abs(deviation - true) > 60 * UNIT_ROUNDOFF * true).mean() > 0.3


def after_a_firefly(weight: float, **changes: Any) -> float:
    """Excess over a background of 1 after one frame of a pixel that is 10^6 times brighter."""
    resolver = accumulator(NumpyLauncher(), weight, sample_limit=2.0**20, **changes)
    calm = np.ones((9, 9), np.float32)
    for index in range(2 * round(1 / weight)):
        resolver.resolve(still_frame(index, grey(calm), effects=None))
    calm[4, 4] = 1e6
    return float(resolver.resolve(still_frame(index + 1, grey(calm), effects=None))[4, 4, 0]) - 1.0


@pytest.mark.parametrize("knee", [1.0, 4.0])
@pytest.mark.parametrize("weight", [0.1, 0.02])
def test_c2_the_excess_of_one_firefly_is_bounded(weight: float, knee: float) -> None:
    # With w = a / (k + Y) for both, the excess is below a (1 + k) / (1 - a) however bright it is (0.22 for 0.1 and 1).
    excess = after_a_firefly(weight, luminance_knee=knee, rectify="none")
    bound = weight * (1 + knee) / (1 - weight)
    assert 0.9 * bound < excess <= bound


def test_c2_without_luminance_weights_it_does() -> None:
    assert after_a_firefly(0.1, weighting="none", rectify="none") == pytest.approx(1e5, rel=1e-4)


def test_c2_of_a_firefly_a_share_of_its_knee_is_left() -> None:
    """By luminance weights: of 1e6 among n samples of luminance 1 at most (knee + 1) / n, and less with each frame."""
    resolver, left = Resolver(device="numpy"), []
    for index in range(14):
        calm = grey(np.ones((9, 9)))
        calm[4, 4] = 1e6 if index == 10 else 1.0
        left.append(float(resolver.resolve(still_frame(index, calm, effects=None))[4, 4, 0]) - 1.0)
    knee = resolver.preset.settings.luminance_knee
    assert 0.0 < left[13] < left[12] < left[11] < left[10] < 1.01 * (knee + 1.0) / 10


def test_c2_with_a_box_a_firefly_is_gone_with_the_next_frame() -> None:
    resolver = Resolver(override(load_preset(), {"rectify": "clamp"}), device="numpy")
    calm = grey(np.ones((9, 9)))
    struck = calm.copy()
    struck[4, 4] = 1e6
    for index in range(12):
        resolved = resolver.resolve(still_frame(index, struck if index == 10 else calm, effects=None))
        if index != 10:
            assert np.array_equal(bits(resolved), bits(calm))
    # In its own frame it stays in its own pixel: its neighbours' boxes are wider, and their history needs no more.
