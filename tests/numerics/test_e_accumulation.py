"""Failure modes of blending and accumulation: docs/numerics.md, E."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, repeat
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.build import Build, Storage, settings_record
from cltaa.core.parameters import Box, Rectify, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import override
from cltaa.core.resolver import Resolver
from cltaa.frame import Image
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.accumulate import blend, fold_luminance_weights
from cltaa.reference.real import Run
from tests.numerics.still_frames import UNIT_ROUNDOFF, accumulator, grey, last_of, looped, still_frame, unfiltered
from tests.sequence_factory import bits


def pictures(count: int, height: int = 16, width: int = 16) -> list[Image]:
    """Random light of six orders of magnitude."""
    random = np.random.default_rng(40)
    return [(10.0 ** random.uniform(-3, 3, (height, width, 3))).astype(np.float32) for _ in range(count)]


@pytest.mark.parametrize("count", [2000, pytest.param(100_000, marks=pytest.mark.big)])
@pytest.mark.parametrize("weight", [0.0, 0.1, 0.02])
def test_e1_equal_frames_are_a_fixed_point(launcher: DeviceLauncher, weight: float, count: int) -> None:
    image = pictures(1)[0]
    assert np.array_equal(bits(looped(accumulator(launcher, weight), [image], count)), bits(image))


def test_e1_the_convex_form_would_drift() -> None:
    # (1 - a) h + a x, the usual way to write it: what the tests above would catch.
    image = pictures(1)[0]
    history, weight = image.copy(), np.float32(0.02)
    for _ in range(2000):
        history = (np.float32(1) - weight) * history + weight * image
    assert (np.abs(history / image - 1) > 4 * UNIT_ROUNDOFF).mean() > 0.1


@pytest.mark.parametrize("rectify", [Rectify.NONE, Rectify.CLAMP, Rectify.CLIP, Rectify.CLIP_CURRENT])
def test_e1_equal_frames_give_equal_bits(rectify: Rectify) -> None:
    # Whatever the picture: history that equals the sample lies inside its own neighbourhood and is left alone.
    random = np.random.default_rng(41)
    image = (10.0 ** random.uniform(-4, 4, (20, 26, 3))).astype(np.float32)
    share = random.random((20, 26)).astype(np.float32)
    for box in [Box.EXTREMES, Box.UNIT]:
        resolver = Resolver(override(unfiltered(), {"rectify": rectify, "box": box}), "numpy")
        for index in range(12):
            resolved = resolver.resolve(still_frame(index, image, effects=None, alpha=share))
            assert np.array_equal(bits(resolved), bits(np.dstack([image, share]))), box


@pytest.mark.parametrize("level", [1.0, 1e3, 1e6, 1e8])
def test_e2_luminance_weights_are_exact_at_any_level(level: float) -> None:
    random = np.random.default_rng(42)
    x, h = ((level * 10.0 ** random.uniform(-2, 0, (3, 200, 200))).astype(np.float32) for _ in range(2))
    share = random.random((200, 200)).astype(np.float32)
    run = Run(Build(), Layout(200, 200), settings=settings_record(Settings()))

    def mixed(kind: Any) -> NDArray[Any]:
        now, then = x.astype(kind), h.astype(kind)
        return blend(then, now, fold_luminance_weights(share.astype(kind), now, then, run))

    largest = np.maximum(np.abs(x), np.abs(h))
    assert (np.abs(mixed(np.float32) - mixed(np.float64)) <= 12 * UNIT_ROUNDOFF * largest).all()


def test_e2_a_tone_curve_and_back_would_not_be() -> None:
    # y = L / (1 + L) and L = y / (1 - y) lose u (1 + L): why the weights have no inverse.
    level = np.array([1.0, 1e3, 1e6, 1e8], np.float32)
    one = np.float32(1.0)
    with np.errstate(divide="ignore"):
        y = level / (one + level)
        error = np.abs(y / (one - y) / level - 1)
    assert error[1] > 100 * UNIT_ROUNDOFF
    assert error[2] > 0.01
    assert np.isinf(error[3])


def test_e4_the_mean_converges_as_it_should(launcher: DeviceLauncher) -> None:
    random, resolver = np.random.default_rng(43), accumulator(launcher)
    errors: list[float] = []
    counts = [10, 20, 50, 100, 200, 500, 1000]
    for index in range(counts[-1]):
        resolved = resolver.resolve(still_frame(index, random.normal(4.0, 1.0, (48, 64, 3)).astype(np.float32)))
        if index + 1 in counts:
            errors.append(float(np.sqrt(np.mean((resolved.astype(np.float64) - 4.0) ** 2))))
    assert errors == pytest.approx([1 / np.sqrt(n) for n in counts], rel=0.05)
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(slope + 0.5) <= 0.05


@pytest.mark.parametrize("weight", [0.1, 0.05])
def test_e4_the_exponential_mean_has_its_floor(launcher: DeviceLauncher, weight: float) -> None:
    random, resolver = np.random.default_rng(44), accumulator(launcher, weight)
    seen = []
    for index in range(round(20 / weight)):
        resolved = resolver.resolve(still_frame(index, random.normal(4.0, 1.0, (48, 64, 3)).astype(np.float32)))
        if index >= 10 / weight:
            seen.append(resolved.astype(np.float64) - 4.0)
    assert np.sqrt(np.mean(np.square(seen))) == pytest.approx(np.sqrt(weight / (2 - weight)), rel=0.05)


def rounding(launcher: DeviceLauncher, count: int, distinct: int) -> float:
    """RMS error of the mean of ``count`` frames over its exact value, for samples in [1, 2)."""
    random = np.random.default_rng(45)
    images = [random.uniform(1, 2, (16, 16, 3)).astype(np.float32) for _ in range(distinct)]
    exact = np.mean(images, axis=0, dtype=np.float64)
    assert count % distinct == 0
    return float(np.sqrt(np.mean((looped(accumulator(launcher), images, count) / exact - 1) ** 2)))


def test_e4_rounding_of_a_long_mean(launcher: DeviceLauncher) -> None:
    # Were the roundings independent: each step is off by u / sqrt(3) and what came before shrinks by n / (n + 1), so
    # that their squares add up to N / 9. Four times that.
    assert rounding(launcher, 2000, 100) <= 4 * UNIT_ROUNDOFF * np.sqrt(2000 / 9)


@pytest.mark.big
def test_e4_a_million_frames(launcher: DeviceLauncher) -> None:
    # Late updates are a few ulps and their roundings are alike, so that they add up to more: worst seen 1.7e-4, what a
    # running mean in float32 was measured to lose 5.4e-4. The million samples' own noise is 1.9e-4.
    assert rounding(launcher, 1_000_000, 250) <= 5.4e-4


@pytest.mark.parametrize("storage", [Storage.FLOAT, Storage.HALF_STOCHASTIC])
def test_e6_black_becomes_zero_and_not_a_denormal(launcher: DeviceLauncher, storage: Storage) -> None:
    resolver = accumulator(launcher, 0.1, storage)
    white, black = np.ones((8, 16), np.float32), np.zeros((8, 16), np.float32)
    resolver.resolve(still_frame(0, grey(white), alpha=white))
    smallest = np.inf
    for index in range(1, 1000):
        resolved = resolver.resolve(still_frame(index, grey(black), alpha=black))
        lit = resolved[resolved > 0]
        smallest = min(smallest, lit.min() if lit.size else np.inf)
    assert np.array_equal(bits(resolved), np.zeros(resolved.shape, np.uint32))  # +0 in colour and alpha
    assert smallest < 2.0**-13  # it went down by itself
    assert smallest >= np.finfo(np.float32).smallest_normal


@pytest.mark.parametrize("storage", list(Storage))
def test_e6_no_denormal_and_no_negative_zero_is_ever_stored(launcher: DeviceLauncher, storage: Storage) -> None:
    words = [0x80000000, 0x00000001, 0x807FFFFF, 0x00400000, 0x0D800000, 0x8D7FFFFF, 0x32000000, 0xB2FFFFFF]
    values = np.array([words], np.uint32).view(np.float32)
    resolver = accumulator(launcher, 0.1, storage)
    for index in range(3):
        resolved = bits(resolver.resolve(still_frame(index, grey(values), alpha=np.abs(values)))).view(np.uint32)
        assert not (resolved == 0x80000000).any()
        exponent = resolved & 0x7F800000
        assert ((exponent > 0) | (resolved == 0)).all()


def test_e6_a_half_history_of_black_ends_within_its_own_law(launcher: DeviceLauncher) -> None:
    # E3 for the smallest halves: ulp / (2 weight) of 2^-24, rounded to the nearest.
    images = chain([grey(np.ones((8, 16)))], repeat(grey(np.zeros((8, 16))), 300))
    assert last_of(accumulator(launcher, 0.1, Storage.HALF), images).max() <= 5 * 2.0**-24


def test_e7_alpha_and_colour_share_one_weight() -> None:
    # Premultiplied: what one colour of changing coverage leaves is that colour times the coverage that it leaves.
    random = np.random.default_rng(48)
    colour = random.uniform(0.5, 2.0, (12, 14, 3)).astype(np.float32)
    resolver = Resolver(override(unfiltered(), {"rectify": "none"}), "numpy")
    for index in range(30):
        share = random.random((12, 14)).astype(np.float32)
        resolved = resolver.resolve(still_frame(index, colour * share[..., None], effects=None, alpha=share))
    # Each of 30 steps rounds three times, the product once.
    assert np.abs(resolved[..., :3] - colour * resolved[..., 3:]).max() <= 2 * (3 * 30 + 1) * UNIT_ROUNDOFF


def test_e7_light_without_coverage_passes() -> None:
    resolver = Resolver(unfiltered(), "numpy")
    glow, none = pictures(1, 9, 11)[0], np.zeros((9, 11), np.float32)
    for index in range(4):
        resolved = resolver.resolve(still_frame(index, glow, effects=None, alpha=none))
        assert np.array_equal(bits(resolved), bits(np.dstack([glow, none])))


def test_e7_coverage_stays_a_share_through_the_filter() -> None:
    # Catmull-Rom overshoots a step to 1.07; alpha is limited after the filter.
    resolver = Resolver(override(unfiltered(), {"rectify": "none", "reject": "none"}), "numpy")
    motion = np.full((12, 40, 2), 0.5, np.float32)
    share = (np.arange(40) % 8 > 3).astype(np.float32)[None].repeat(12, 0)
    for index in range(8):
        frame = still_frame(index, grey(share), effects=None, alpha=np.roll(share, index, 1))
        resolved = resolver.resolve(replace(frame, motion=motion))
        assert resolved[..., 3].min() >= 0.0
        assert resolved[..., 3].max() <= 1.0
