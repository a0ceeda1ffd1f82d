"""Failure modes of moving the history into the neighbourhood's box: docs/numerics.md, D."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.backend import Launcher
from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.constants import value
from cltaa.core.parameters import Box, BoxSpace, Choices, Rectify, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import Work, run_stage
from tests.numerics.still_frames import CAMERA, UNIT_ROUNDOFF, grey, still_frame
from tests.numerics.test_c_statistics import box_space
from tests.sequence_factory import make_frame

Planes = NDArray[np.float32]
SETTINGS = Settings(box_scale_static=1.0, box_scale_moving=1.0)
BOXES = (300, 400)  # boxes at once, [H, W]


def rectified(
    launcher: Launcher,
    history: Planes,
    mean: Planes,
    deviation: Planes,
    kind: Rectify,
    space: BoxSpace,
    box: Box = Box.VARIANCE,
    strict: bool = True,
    lanes: int = 0,
) -> Planes:
    """RGB history [3, H, W] after the stage moved it into mean +- deviation [3, H, W] of the box space.

    A box of extremes has the same ends, as float32.
    """
    layout = Layout(history.shape[2], history.shape[1])
    zero = np.zeros_like(history[:1])
    planes = {
        "statistics_out": padded(np.concatenate([mean, deviation, mean - deviation, mean + deviation, mean]), layout),
        "motion_out": padded(np.repeat(zero, 10, axis=0), layout),
        "history_at": padded(np.concatenate([history, np.repeat(zero, 5, axis=0)]), layout),
    }
    frame = make_frame(width=layout.width, height=layout.height, camera=CAMERA)
    choices = Choices(box=box, box_space=space, rectify=kind)
    build = launcher.build(Build(choices=choices, steps=Steps(), strict=strict, lanes=lanes))
    work = Work(layout, planes, frame_record(frame, Past.of(frame), layout), settings_record(SETTINGS))
    change = layout.inside(run_stage("rectify_history", build, work, launcher)["change_out"])
    return history + change[:3]


def random_boxes() -> tuple[Planes, Planes, Planes]:
    """History, mean and deviation: needles and slabs (extents 0 to 1 of the mean) with the history around them."""
    random = np.random.default_rng(21)
    mean = random.random((3, *BOXES))
    deviation = mean * random.choice([0.0, 1e-7, 1e-5, 1e-3, 0.1, 0.5, 1.0], (3, *BOXES))
    history = mean + deviation * random.choice([0.0, 0.5, 1.0, 1.5, 4.0], (3, *BOXES)) * random.normal(size=(3, *BOXES))
    return history.astype(np.float32), mean.astype(np.float32), deviation.astype(np.float32)


def moved_by_one_ulp(launcher: DeviceLauncher, kind: Rectify, space: BoxSpace) -> NDArray[np.float64]:
    """How far the result moves beyond the history's own step, in u of the largest value of each box, [3 * H * W]."""
    history, mean, deviation = random_boxes()
    if space is BoxSpace.YCOCG:
        mean = box_space(mean).astype(np.float32)
    largest = np.maximum(np.abs(history).max(axis=0), np.abs(mean).max(axis=0)).astype(np.float64)
    before = rectified(launcher, history, mean, deviation, kind, space).astype(np.float64)
    moved = []
    for channel in range(3):
        step = history.copy()
        step[channel] = np.nextafter(step[channel], np.float32(np.inf))
        after = rectified(launcher, step, mean, deviation, kind, space)
        own = (step[channel].astype(np.float64) - history[channel])[None]
        moved.append(((np.abs(after - before) - own) / (UNIT_ROUNDOFF * largest)).max(axis=0))
    return np.array(moved).ravel()


@pytest.mark.parametrize("kind", [k for k in Rectify if k is not Rectify.NONE])
def test_d1_a_flat_neighbourhood_divides_nothing_by_nothing(kind: Rectify) -> None:
    resolver = Resolver(override(load_preset(), {"rectify": kind, "weighting": "none"}), "numpy")
    random = np.random.default_rng(22)
    flat = np.broadcast_to(np.array([0.3, 0.7, 0.1], np.float32), (12, 20, 3))
    first = flat.copy()
    first[3:9, 3:17] = random.random((6, 14, 3))
    first[5, 5:15, 1:] = flat[5, 5:15, 1:]  # the history equals the centre in some channels, and in all of them
    resolver.resolve(still_frame(0, first, effects=None))
    resolved = resolver.resolve(still_frame(1, flat, effects=None))
    assert np.isfinite(resolved).all()
    # What the box allows: nothing but rounding, or its floored extent, which YCoCg's way back adds up three times.
    allowed = 3 * load_preset().settings.box_floor if kind in (Rectify.CLIP, Rectify.ELLIPSOID) else 0.0
    assert np.abs(resolved - flat).max() <= (allowed + 8 * UNIT_ROUNDOFF) * 0.7


@pytest.mark.parametrize(("space", "most"), [(BoxSpace.RGB, 2), (BoxSpace.YCOCG, 12)])
def test_d2_clamp_moves_no_further_than_the_history(launcher: DeviceLauncher, space: BoxSpace, most: int) -> None:
    # Each channel's clamp is 1-Lipschitz and so is the sum of the three; what is left is rounding: 2 u,
    # worst seen 1.2, and of the box space at most 2 u in and 2 u out, 1 u for the difference and the sum, twice: worst
    # seen 4.6.
    assert moved_by_one_ulp(launcher, Rectify.CLAMP, space).max() <= most


@pytest.mark.parametrize("kind", [Rectify.CLIP, Rectify.ELLIPSOID])
@pytest.mark.parametrize("space", list(BoxSpace))
def test_d2_clip_moves_within_its_bound(launcher: DeviceLauncher, kind: Rectify, space: BoxSpace) -> None:
    # The point moves by e_j (de_k / e_k + dd_k / d_k) with d_k >= e_k >= floor * M, e_j <= M: 1 / floor times the error
    # of d, which is the step (2 u) and the rounding of the coordinates (3 u), twice. Worst seen 1010 of 10240.
    moved = moved_by_one_ulp(launcher, kind, space)
    bound = 2 * (2 + 3) / SETTINGS.box_floor
    assert moved.max() <= bound
    assert moved.max() > bound / 100


def test_d2_the_popular_clip_jumps(launcher: DeviceLauncher) -> None:
    # A box that is flat in one channel: one ulp in that channel, and the whole history is thrown away.
    mean, deviation = (np.array(v, np.float32)[:, None, None] for v in ((1.0, 0.2, 4.0), (0.5, 0.3, 0.0)))
    inside = mean + np.array((0.4, 0.2, 0.0), np.float32)[:, None, None]
    beside = inside.copy()
    beside[2] = np.nextafter(inside[2], np.float32(1.0))

    def clipped(history: Planes, kind: Rectify) -> list[float]:
        result = rectified(launcher, history, mean, deviation, kind, BoxSpace.RGB)
        return [float(v) for v in result.ravel()]

    left = value("ADDED_EXTENT") / 2.0**-22  # of the way from the centre: 4 %, for a step of 2e-7
    assert clipped(inside, Rectify.CLIP_UNGUARDED) == pytest.approx([1.4, 0.4, 4.0])
    assert clipped(beside, Rectify.CLIP_UNGUARDED) == pytest.approx([1.0 + 0.4 * left, 0.2 + 0.2 * left, 4.0])
    for kind in (Rectify.CLIP, Rectify.CLAMP):
        assert clipped(inside, kind) == pytest.approx([1.4, 0.4, 4.0])
        assert clipped(beside, kind) == pytest.approx([1.4, 0.4, 4.0])


def test_d2_the_popular_clip_jumps_for_many_boxes(launcher: DeviceLauncher) -> None:
    moved = moved_by_one_ulp(launcher, Rectify.CLIP_UNGUARDED, BoxSpace.RGB)
    assert moved.max() > 1e6  # more than a tenth of the whole signal
    assert (moved > 1e6).mean() > 1e-3


@pytest.mark.parametrize("kind", [k for k in Rectify if k is not Rectify.NONE])
def test_d2_grey_in_grey_out(kind: Rectify) -> None:
    for box, space in product(Box, BoxSpace):
        random = np.random.default_rng(23)
        preset = override(load_preset(), {"rectify": kind, "box": box, "box_space": space})
        resolver = Resolver(preset, "numpy")
        for index in range(4):
            image = grey(10.0 ** random.uniform(-3, 3, (14, 18)))
            resolved = resolver.resolve(still_frame(index, image, effects=None))
            assert np.array_equal(resolved[..., 0], resolved[..., 1]), (box, space)
            assert np.array_equal(resolved[..., 0], resolved[..., 2]), (box, space)


@pytest.mark.parametrize("kind", list(Rectify))
def test_d3_no_light_turns_negative_through_chroma(kind: Rectify) -> None:
    for box in Box:
        random = np.random.default_rng(24)
        resolver = Resolver(override(load_preset(), {"rectify": kind, "box": box}), "numpy")
        for index in range(8):
            colour: Any = np.where(random.random((20, 24, 3)) < 0.5, 0.0, 10.0 ** random.uniform(-2, 3, (20, 24, 3)))
            resolved = resolver.resolve(still_frame(index, colour.astype(np.float32), effects=None))
            assert resolved.min() >= 0.0, box
