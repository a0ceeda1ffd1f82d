"""Sub-pixel features, which the gathered samples show and the current ones may miss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from tests.core.test_gather_fit import gathering
from tests.sequence_factory import make_camera, make_frame


def wire(index: int) -> Frame:
    """A white wire that every other frame's samples hit, before a black wall."""
    frame = make_frame(index, camera=make_camera(), effects=frozenset({Effect.CAMERA, Effect.THIN}))
    colour, depth = np.zeros_like(frame.colour), np.full_like(frame.depth, 5.0)
    if index % 2 == 0:
        colour[:, 10], depth[:, 10] = 1.0, 2.0
    return replace(frame, colour=colour, depth=depth, jitter_px=(0.0, 0.0))


@pytest.mark.parametrize(("subpixel_frames", "share"), [(1, 0.5), (0, 0.0)])
def test_a_wire_that_this_frame_misses_is_still_there(subpixel_frames: int, share: float) -> None:
    resolver = Resolver(gathering(subpixel_frames=subpixel_frames), "numpy")
    for index in range(8):  # the last one misses it
        resolved = resolver.resolve(wire(index))
    assert resolved[:, 10] == pytest.approx(share, abs=1e-6)
    assert (np.delete(resolved, 10, axis=1) == 0.0).all()
    hit = resolver.resolve(wire(8))
    assert hit[:, 10] == pytest.approx(0.5, abs=1e-6)


def test_a_surface_wider_than_a_line_is_not_restored_once_it_has_left() -> None:
    resolver = Resolver(gathering(), "numpy")
    for index in range(6):
        frame = wire(1)
        colour, depth = frame.colour.copy(), frame.depth.copy()
        if index < 5:
            colour[4:9, 6:12], depth[4:9, 6:12] = 1.0, 2.0
        resolved = resolver.resolve(replace(frame, index=index, colour=colour, depth=depth))
    assert (resolved[5:8, 7:11] == 0.0).all()
