"""Gathered samples at a depth edge: each of its two surfaces from samples of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.parameters import Settings
from cltaa.core.planes import Layout
from cltaa.core.record import frame_record
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.reference.gather_sides import layers_of, side_of
from cltaa.reference.neighbourhood import nearest_surface
from cltaa.reference.planes import read_rows
from cltaa.reference.real import Run
from tests.core.test_gather_fit import gathering
from tests.kernels.hard_planes import padded
from tests.sequence_factory import make_camera, make_frame


def bar_before_stripes(index: int, x: int) -> Frame:
    """A white bar at column x, a step further left than in the frame before, and a still wall of coloured columns."""
    frame = make_frame(
        index, motion=True, camera=make_camera(), effects=frozenset({Effect.MOTION, Effect.DISOCCLUSION})
    )
    colour, depth = np.zeros_like(frame.colour), np.full_like(frame.depth, 5.0)
    motion = np.full((*depth.shape, 2), np.nan, np.float32)
    colour[:, :, 0] = (np.arange(colour.shape[1]) * 5 % 8)[None, :] / 8
    colour[:, x : x + 3], depth[:, x : x + 3], motion[:, x : x + 3] = 1.0, 2.0, (1.0, 0.0)
    return replace(frame, colour=colour, depth=depth, motion=motion, jitter_px=(0.0, 0.0))


def test_the_wall_beside_a_moving_bar_is_not_smeared() -> None:
    resolver = Resolver(gathering(), "numpy")
    for index in range(6):
        frame = bar_before_stripes(index, 14 - index)
        resolved = resolver.resolve(frame)
    beside = 14 - 5 - 1  # not covered in any frame so far
    wrong = np.abs(resolved[:, beside] - frame.colour[:, beside]).max()
    # Six samples of the wall there, and one for what is seen of it around: half of the column before.
    around = 0.5 * np.abs(frame.colour[0, beside - 1] - frame.colour[0, beside]).max() / 7
    assert wrong == pytest.approx(around, abs=1e-6)


def test_another_thing_that_comes_before_a_surface_ends_its_way_back() -> None:
    # The wall tells its motion, and the bar, which comes from nowhere in frame 3, tells another at the wall's place.
    resolver = Resolver(gathering(), "numpy")
    for index in range(6):
        frame = bar_before_stripes(index, 14 - index if index >= 3 else 1000)
        assert frame.motion is not None
        motion = np.where(np.isnan(frame.motion), np.float32(0.0), frame.motion)
        resolved = resolver.resolve(replace(frame, motion=motion))
    behind = 14 - 3 + 2  # where the bar stood in frame 3, and never again
    assert (resolved[:, behind] == frame.colour[:, behind]).all()


def test_a_side_of_an_edge_is_the_plane_of_its_own_samples() -> None:
    layout, build = Layout(9, 7), Build(steps=Steps(own_motion=False))
    y, x = np.mgrid[:7, :9].astype(np.float32)
    near, far = 0.5 + 0.01 * x + 0.02 * y, 0.1 - 0.004 * x + 0.001 * y
    planes = np.where(x < 4, near, far).astype(np.float32)[None]
    inverse_depth, current = padded(planes, layout), padded(np.repeat(planes, 3, axis=0), layout)
    settings = settings_record(Settings(fit_ridge=2.0**-10))
    frame = frame_record(make_frame(0, width=9, height=7), None, layout)
    run = Run(build, layout, frame, settings)
    rows = read_rows(current, inverse_depth, None, run)
    s = nearest_surface(*rows, run)
    layers = layers_of(*rows, s, run)
    assert layers.edge[1:-1, 3:5].all()
    inside, none = slice(1, -1), np.zeros_like(near)
    black = np.stack((none, none, none))
    for is_far, own, beside, slope in ((False, 3, 4, (0.01, 0.02)), (True, 4, 3, (-0.004, 0.001))):
        side = side_of(s, layers, black, current, inverse_depth, None, run, far=is_far)
        for column in (own, beside):
            # The nearest of its samples: the pixel's own, or the one beside it in its row.
            at = (inside, column)
            assert (side.surface.x[at] == own - column).all()
            assert (side.surface.y[at] == 0).all()
            assert (side.surface.inverse_depth[at] == planes[0, inside, own]).all()
            # All of a side's samples lie in one column for the pixel beside it: they tell no slope along rows. The
            # ridge holds back 2^-10 in at least two samples' worth; inverse depth is rounded to 2^-25.
            across = slope[0] if column == own else 0.0
            assert np.abs(side.layers.slope[0][at] - across).max() <= 2.0**-11 * abs(across) + 2.0**-23
            assert np.abs(side.layers.slope[1][at] - slope[1]).max() <= 2.0**-11 * slope[1] + 2.0**-23
            assert np.abs(side.mean[0][at] - planes[0, inside, own]).max() <= abs(slope[0])
