"""Failure modes of reading the history between its texels: docs/numerics.md, B."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.backend import Launcher
from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.parameters import Choices, HistoryFilter, Reject, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.opencl.launcher import DeviceLauncher
from tests.core.standing import panned
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import Work, run_stage
from tests.numerics.still_frames import CAMERA, UNIT_ROUNDOFF, grey, still_frame, unfiltered
from tests.sequence_factory import bits, make_camera, make_frame

Plane = NDArray[np.float32]
SHARP = HistoryFilter.CATMULL_ROM
CROSS = HistoryFilter.CROSS_20


def sampled(launcher: Launcher, history: Plane, u: Any, v: Any, kind: HistoryFilter = SHARP) -> Plane:
    """What the stage reads from ``history`` [H, W] displaced by (u, v), numbers or [H, W]."""
    height, width = history.shape
    layout = Layout(width, height)
    one, zero = np.ones_like(history), np.zeros_like(history)
    moved = [np.broadcast_to(np.asarray(part, np.float32), history.shape) for part in (u, v)]
    planes = {
        "motion_out": padded(np.array([*moved, one, zero, one, one, one, one, zero, zero]), layout),
        "current": padded(np.array([history] * 3), layout),
        "alpha": padded(one[None], layout),
        "history": padded(np.array([history] * 3), layout),
        "history_count": padded(one[None], layout),
        "previous_inverse_depth": padded(one[None], layout),
    }
    frame = make_frame(width=width, height=height, camera=CAMERA)
    choices = Choices(history_filter=kind, reject=Reject.NONE)
    build = Build(choices=choices, steps=Steps(own_motion=False, exposure=False), strict=True)
    work = Work(layout, planes, frame_record(frame, Past.of(frame), layout), settings_record(Settings()))
    read: Plane = layout.inside(run_stage("sample_history", launcher.build(build), work, launcher)["history_at"])[0]
    return read


def weights(kind: HistoryFilter, f: float) -> dict[int, float]:
    """Tap -> weight at fraction ``f`` along an axis, in float64 (Catmull and Rom 1974, Laakso et al. 1996)."""
    if kind is HistoryFilter.BILINEAR:
        return {0: 1 - f, 1: f}
    if kind is CROSS:
        left, right = ((f - f**2) * (0.105 - 0.0376 * at) for at in (f, 1 - f))
        near_left, near_right = ((f - f**2) * (0.3342 * at - 0.6758) for at in (f, 1 - f))
        second = f + 2 * left + near_left - 2 * near_right - 3 * right  # so that a ramp is kept
        first = 1 - (left + near_left + second + near_right + right)
        return {-2: left, -1: near_left, 0: first, 1: second, 2: near_right, 3: right}
    return {
        -1: -0.5 * f + f**2 - 0.5 * f**3,
        0: 1 - 2.5 * f**2 + 1.5 * f**3,
        1: 0.5 * f + 2 * f**2 - 1.5 * f**3,
        2: -0.5 * f**2 + 0.5 * f**3,
    }


def plane_weights(kind: HistoryFilter, fx: Any, fy: Any) -> dict[tuple[int, int], Any]:
    """(row, column) of each tap -> its weight at the fractions, in float64, as the filters are published."""
    if kind is HistoryFilter.NEAREST:
        at_x, at_y = ({0: f < 0.5, 1: f >= 0.5} for f in (fx, fy))
    elif kind is CROSS:  # all but the product of what the filters of both axes add to a linear one
        (six_x, pair_x), (six_y, pair_y) = (
            ({tap: weights(CROSS, f)[tap] for tap in range(-2, 4)}, {0: 1 - f, 1: f}) for f in (fx, fy)
        )
        none = 0 * fx * fy
        return {
            (j, i): none + six_x[i] * pair_y.get(j, 0) + pair_x.get(i, 0) * (six_y[j] - pair_y.get(j, 0))
            for j in six_y
            for i in six_x
            if {i, j} & {0, 1}
        }
    else:
        shape = HistoryFilter.BILINEAR if kind is HistoryFilter.BILINEAR else SHARP
        at_x, at_y = weights(shape, fx), weights(shape, fy)
    raw = kind is HistoryFilter.CATMULL_ROM_5_RAW  # not made to sum to 1
    corners = {-1, 2} if raw or kind is HistoryFilter.CATMULL_ROM_5 else set()
    taps = {(j, i): w * v for j, w in at_y.items() for i, v in at_x.items() if not {i, j} <= corners}
    total = 1.0 if raw else sum(taps.values())
    return {tap: weight / total for tap, weight in taps.items()}


def least_sum(kind: HistoryFilter) -> float:
    """How much the negative weights come to, at the worst fractions of a grid."""
    fx, fy = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
    return float(-np.sum([np.minimum(w, 0) for w in plane_weights(kind, fx, fy).values()], axis=0).min())


def response(kind: HistoryFilter, f: float, omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Magnitude of the filter's transfer function."""
    terms = [w * np.exp(1j * omega * tap) for tap, w in weights(kind, f).items()]
    magnitude: NDArray[np.float64] = np.abs(np.sum(terms, axis=0))
    return magnitude


def fireflies(height: int = 60, width: int = 90) -> Plane:
    random = np.random.default_rng(1)
    return np.where(random.random((height, width)) < 0.1, 1e5, random.random((height, width))).astype(np.float32)


class Filtered(NamedTuple):
    """A history read at other places, and its texels around each, which may be asked for by row and column."""

    read: NDArray[np.float64]
    u: Plane
    v: Plane
    texels: Callable[[int, int], NDArray[np.float64]]
    inside: NDArray[np.bool_]


def filtered(launcher: DeviceLauncher, kind: HistoryFilter, *, alike: bool = False) -> Filtered:
    """Fireflies read with ``kind`` at random places; ``alike``: all moved by the same, which lanes read otherwise."""
    history, random = fireflies(), np.random.default_rng(2)
    moved = random.uniform(-2, 2, (2, 1, 1) if alike else (2, *history.shape))
    u, v = np.broadcast_to(moved, (2, *history.shape)).astype(np.float32)
    read = sampled(launcher, history, u, v, kind).astype(np.float64)
    y, x = np.mgrid[: history.shape[0], : history.shape[1]]
    around = np.pad(history, 8, mode="edge").astype(np.float64)
    rows, columns = y + np.floor(v).astype(int) + 8, x + np.floor(u).astype(int) + 8
    inside = (x + u >= -0.5) & (x + u <= x.max() + 0.5) & (y + v >= -0.5) & (y + v <= y.max() + 0.5)
    return Filtered(read, u, v, lambda j, i: around[rows + j, columns + i], inside)


def held(texels: Callable[[int, int], NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The range that the cross keeps: of the four texels in the middle, and a quarter of it more on either side, below
    at most a quarter of the darkest."""
    middle = np.array([texels(j, i) for j in (0, 1) for i in (0, 1)])
    low, high = middle.min(0), middle.max(0)
    return low - 0.25 * np.minimum(high - low, np.abs(low)), high + 0.25 * (high - low)


@pytest.mark.parametrize("kind", list(HistoryFilter))
def test_b1_every_tap_weighs_what_the_filter_says(launcher: DeviceLauncher, kind: HistoryFilter) -> None:
    for alike in [False, True]:
        read, u, v, texels, inside = filtered(launcher, kind, alike=alike)
        expected, size = np.zeros(read.shape), np.zeros(read.shape)
        for (j, i), weight in plane_weights(kind, u - np.floor(u), v - np.floor(v)).items():
            tap = texels(j, i)
            expected += weight * tap
            size = np.maximum(size, np.abs(tap))
        if kind is CROSS:
            low, high = held(texels)
            assert 0.1 < (expected == np.clip(expected, low, high))[inside].mean() < 0.9, alike  # both are tried
            expected = np.clip(expected, low, high)
        # 32 u M for 4 x 4 taps, and for 20, whose weights come to less.
        assert (np.abs(read - expected) <= 32 * UNIT_ROUNDOFF * size)[inside].all(), alike


@pytest.mark.parametrize("kind", list(HistoryFilter))
def test_b1_negative_lobes_stay_inside_their_bound(launcher: DeviceLauncher, kind: HistoryFilter) -> None:
    read, _, _, texels, inside = filtered(launcher, kind)
    places = [(j, i) for j in (0, 1) for i in (0, 1)] if kind is CROSS else list(plane_weights(kind, 0.5, 0.5))
    taps = np.array([texels(j, i) for j, i in places])
    low, high = taps.min(0), taps.max(0)
    # Negative weights come to 0.28125 of the taps' range at most for Catmull-Rom, and to more or less for the others.
    lobes = 0.25 if kind is CROSS else least_sum(kind)
    slack = 1.001 * lobes * (high - low) + 32 * UNIT_ROUNDOFF * np.maximum(abs(low), abs(high))
    assert ((read >= low - slack) & (read <= high + slack))[inside].all()
    undershoot = ((low - read) / np.maximum(high - low, 1e-9))[inside].max()
    assert undershoot > 0.5 * lobes if lobes else undershoot < 1e-5  # the bound is not idle


def test_b1_negative_weights_of_the_filters() -> None:
    found = {kind: least_sum(kind) for kind in HistoryFilter}
    assert found[SHARP] == pytest.approx(0.28125)
    assert found[HistoryFilter.CATMULL_ROM_5] == pytest.approx(2 / 7, rel=1e-3)
    assert found[HistoryFilter.BILINEAR] == found[HistoryFilter.NEAREST] == 0.0


def test_b1_the_six_taps_are_the_least_squares_that_keep_parabolas() -> None:
    # |response - displacement|^2 over fractions and frequencies, in the middle of equal parts, is least, the second
    # moment held; half a unit of the last digit is rounded away.
    taps, omega = np.arange(-2, 4), 2 * np.pi * 0.3 * (np.arange(301) + 0.5) / 301
    rows, wanted, kept, moments = [], [], [], []
    for t in (np.arange(41) + 0.5) / 41:
        u, both = 1 - t, t * (1 - t)
        outer = both * np.array([[1, t, 0, 0], [0, 0, 1, t], [0, 0, 1, u], [1, u, 0, 0]])  # taps -2, -1, 2, 3
        second = 2 * outer[0] + outer[1] - 2 * outer[2] - 3 * outer[3]
        matrix = np.array([outer[0], outer[1], -(outer.sum(0) + second), second, outer[2], outer[3]])
        linear = np.array([0, 0, u, t, 0, 0])
        waves = np.exp(1j * np.outer(omega, taps))
        off = np.exp(1j * omega * t) - waves @ linear
        rows += [(waves @ matrix).real, (waves @ matrix).imag]
        wanted += [off.real, off.imag]
        kept.append((taps - t) ** 2 @ matrix)
        moments.append(-((taps - t) ** 2) @ linear)
    equation = np.concatenate([*rows, 1e3 * np.array(kept)]), np.concatenate([*wanted, 1e3 * np.array(moments)])
    found = np.linalg.lstsq(*equation, rcond=None)[0]
    assert found == pytest.approx([0.105, -0.0376, -0.6758, 0.3342], abs=0.5001e-4)


@pytest.mark.parametrize("rectify", ["clamp", "none"])
def test_b1_light_never_turns_negative(rectify: str) -> None:
    resolver = Resolver(override(load_preset(), {"rectify": rectify, "reject": "none"}), "numpy")
    for index in range(6):
        frame = still_frame(index, grey(np.roll(fireflies(), index, 1)), effects=None)
        motion = np.full((60, 90, 2), 0.5, np.float32)
        assert resolver.resolve(replace(frame, motion=motion)).min() >= 0.0


# The published filter whose weights do not sum to 1 keeps no level.
@pytest.mark.parametrize("kind", [kind for kind in HistoryFilter if kind is not HistoryFilter.CATMULL_ROM_5_RAW])
def test_b2_a_flat_history_stays_flat_to_the_bit(launcher: DeviceLauncher, kind: HistoryFilter) -> None:
    random = np.random.default_rng(3)
    u, v = random.uniform(-2, 2, (2, 40, 50)).astype(np.float32)
    for level in (1.0, 0.1, 1e-3, 1e6, 2.0**-99, 3.0**30, -0.7):
        flat = np.full((40, 50), level, np.float32)
        assert np.array_equal(bits(sampled(launcher, flat, u, v, kind)), bits(flat))


@pytest.mark.parametrize("kind", [HistoryFilter.BILINEAR, SHARP, CROSS])
def test_b3_resampling_blurs_by_the_filters_response(launcher: DeviceLauncher, kind: HistoryFilter) -> None:
    omega, steps = np.pi / 2, 10
    x = np.arange(192)
    slope = 8.0 if kind is CROSS else 0.0  # which it keeps, and on which nothing rings by a quarter of the contrast
    for f in [0.5, 0.1, 0.25]:
        history = np.broadcast_to((2 + slope * x + np.cos(omega * x)).astype(np.float32), (4, 192))
        for _ in range(steps):
            history = sampled(launcher, np.ascontiguousarray(history), f, 0.0, kind)
        middle = slice(64, 128)  # whole periods, further from the edge than ten steps reach
        wave = np.exp(1j * omega * x[middle])
        contrast = 2 * abs(((history[1] - slope * (x + steps * f))[middle] * wave).mean())
        expected = response(kind, f, np.array([omega]))[0] ** steps
        assert contrast == pytest.approx(expected, rel=0.01), f


def test_b3_the_sharp_filter_keeps_what_the_soft_one_loses() -> None:
    at = np.array([np.pi / 2])
    kept = {kind: response(kind, 0.5, at)[0] ** 10 for kind in (HistoryFilter.BILINEAR, SHARP, CROSS)}
    assert kept[HistoryFilter.BILINEAR] == pytest.approx(0.031, abs=1e-3)
    assert kept[SHARP] == pytest.approx(0.291, abs=1e-3)
    assert kept[CROSS] == pytest.approx(1.06, abs=1e-2)


def test_b4_no_frequency_is_amplified() -> None:
    omega = np.linspace(0, np.pi, 513)
    assert max(response(SHARP, f, omega).max() for f in np.linspace(0, 1, 101)) <= 1 + 1e-12


def test_b4_the_current_samples_limit_what_the_cross_filter_amplifies() -> None:
    # A history of n samples keeps n / (n + 1) of itself, and resampling limits n; whatever the fraction, what all
    # frames together add of a wave is 1 / (n + 1) / (1 - n g / (n + 1)) of it, with g the filter's response.
    settings, omega = load_preset().settings, np.linspace(0, np.pi, 65)
    assert load_preset().choices.history_filter is CROSS
    for fx, fy in np.ndindex(21, 21):
        at = plane_weights(CROSS, fx / 20, fy / 20)
        waves = [np.exp(1j * omega * tap) for tap in range(-2, 4)]
        for down in (waves, np.conj(waves)):
            g = np.abs(sum(weight * np.outer(down[j + 2], waves[i + 2]) for (j, i), weight in at.items())).max()
            between = sum(f / 20 * (1 - f / 20) for f in (fx, fy))
            n = 1 / (1 / settings.sample_limit + settings.resampling_penalty * between)
            assert g <= 1.0156
            assert 1 / (n + 1) / (1 - n * g / (n + 1)) <= 1.09


def test_b4_energy_never_grows(launcher: DeviceLauncher) -> None:
    history = np.zeros((64, 64), np.float32)
    history[24:40, 24:40] = np.random.default_rng(4).normal(size=(16, 16))
    energy = float((history.astype(np.float64) ** 2).sum())
    for step in range(20):
        history = sampled(launcher, history, 0.5 if step % 2 else -0.5, 0.1)
        now = float((history.astype(np.float64) ** 2).sum())
        assert now <= energy * (1 + 64 * UNIT_ROUNDOFF)
        energy = now


def drifting(count: int) -> float:
    """Largest distance from the middle of inputs in [2, 4] over ``count`` frames of half-pixel motion, unrectified."""
    preset = override(
        load_preset(),
        {
            "history_filter": "catmull-rom",
            "rectify": "none",
            "reject": "none",
            "weighting": "none",
            "accumulate": "exponential",
            "resampling_penalty": 0.0,
        },
    )
    resolver, random, worst = Resolver(preset, "numpy"), np.random.default_rng(5), 0.0
    motion = np.broadcast_to(np.array([0.5, 0.1], np.float32), (16, 24, 2))
    for index in range(count):
        image = grey(random.choice(np.array([2.0, 4.0]), (16, 24)))
        resolved = resolver.resolve(replace(still_frame(index, image, effects=None), motion=motion))
        worst = max(worst, float(np.abs(resolved - 3.0).max()))
    return worst


def test_b4_unrectified_history_stays_bounded() -> None:
    # The gain of all frames together is at most 1.41 an axis (numerics.md, B4), 2 in the plane; asserted: twice that.
    assert 1.0 < drifting(600) <= 4.0


@pytest.mark.big
def test_b4_unrectified_history_stays_bounded_for_long() -> None:
    assert drifting(10_000) <= 4.0


@pytest.mark.parametrize("kind", list(HistoryFilter))
def test_b5_whole_displacements_are_lossless(launcher: DeviceLauncher, kind: HistoryFilter) -> None:
    for size in [(1, 1), (1, 7), (31, 17), (4, 16384)]:
        random, (height, width) = np.random.default_rng(6), size
        history = (10.0 ** random.uniform(-20, 14, size)).astype(np.float32)
        y, x = np.mgrid[:height, :width]
        to_y, to_x = random.integers(0, height, size), random.integers(0, width, size)
        read = sampled(launcher, history, to_x - x, to_y - y, kind)
        assert np.array_equal(bits(read), bits(history[to_y, to_x])), size


@pytest.mark.parametrize("width", [37, 640, 1919])
def test_b5_a_camera_that_pans_by_whole_pixels_is_lossless(width: int) -> None:
    preset = override(unfiltered(), {"rectify": "none", "reject": "none", "sample_limit": 2.0**20})
    resolver, shift = Resolver(preset, "numpy"), 3
    first, second = (make_frame(i, width=width, height=9, camera=make_camera(aspect=width / 9)) for i in (0, 1))
    resolver.resolve(first)
    resolved = resolver.resolve(replace(second, camera=panned(second.camera, shift, width)))
    history, current = first.colour[:, shift:], second.colour[:, :-shift]
    assert np.array_equal(bits(resolved[:, :-shift]), bits(history + np.float32(0.5) * (current - history)))


@pytest.mark.parametrize("distance", [0.0, 1e6])
def test_b5_a_still_camera_is_lossless_whatever_the_jitter(distance: float) -> None:
    resolver = Resolver(override(unfiltered(), {"rectify": "none"}), "numpy")
    camera = make_camera((distance, -distance, 3 * distance))
    first = make_frame(0, camera=camera, jitter_px=(0.4, -0.4), effects=None)
    resolver.resolve(first)
    frame = make_frame(1, camera=camera, jitter_px=(-0.3, 0.2), effects=None, seed=0)
    resolved = resolver.resolve(replace(frame, colour=first.colour, depth=first.depth))
    assert np.array_equal(bits(resolved), bits(first.colour))  # any resampling would change random colours
