"""``cltaa bench accuracy``: the frames that are timed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa.lab.bench.accuracy.measurement import enlarged
from cltaa.lab.timing import resolve_job
from tests.kernels.test_resolve import hard_frames
from tests.last_frame import last_planes
from tests.sequence_factory import bits, make_frame


@pytest.mark.parametrize("preset", ["gather-8", "gather-48"])
def test_what_is_timed_gathers_from_as_many_frames_as_it_keeps(preset: str) -> None:
    few = override(load_preset(preset), {"history_frames": 3})
    *_, frame, last = hard_frames(24, 14, count=5)
    _, image = resolve_job(Resolver(few, "numpy"), [frame, last])
    resolver = Resolver(few, "numpy")
    for ago in (3, 2, 1, 0):
        resolver.resolve(dataclasses.replace(frame, index=frame.index - ago))
    assert (bits(image) == bits(resolver.resolve(last))).all()
    fresh = Resolver(few, "numpy")
    fresh.resolve(frame)
    assert (bits(image) != bits(fresh.resolve(last))).any()


def test_what_is_timed_looks_as_far_ahead_as_it_does() -> None:
    few = override(load_preset("gather-8+8"), {"history_frames": 2, "look_ahead": 2})
    *_, frame, last = hard_frames(24, 14, count=5)
    resolver = Resolver(few, "numpy")
    job, image = resolve_job(resolver, [frame, last])
    before = [dataclasses.replace(frame, index=frame.index - ago) for ago in (2, 1)]
    ahead = [dataclasses.replace(last, index=last.index + later) for later in (1, 2)]
    expected = [*Resolver(few, "numpy").images([*before, frame, last, *ahead])][3]
    assert (bits(image) == bits(expected)).all()
    job()
    assert (bits(np.moveaxis(last_planes(resolver, "output"), 0, -1)) == bits(expected)).all()


def test_an_enlarged_frame_moves_as_far_in_pictures() -> None:
    frame = make_frame(1, motion=True, alpha=True)
    large = enlarged(frame, 3)
    assert (large.width, large.height) == (3 * frame.width, 3 * frame.height)
    np.testing.assert_array_equal(large.colour[1::3, 1::3], frame.colour)
    assert large.motion is not None
    assert frame.motion is not None
    np.testing.assert_array_equal(large.motion[::3, ::3], 3 * frame.motion)
    assert large.alpha is not None
    assert large.alpha.shape == large.depth.shape
    assert large.has_depth
    bare = enlarged(Frame(index=0, colour=frame.colour), 3)  # an enlarged stand-in would be tested for disocclusions
    assert (bare.has_depth, bare.has_camera, bare.depth.shape) == (False, False, large.depth.shape)
