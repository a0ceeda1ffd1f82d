"""What the classes of one frame promise beside their numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cltaa.frame import Frame
from tests.sequence_factory import make_frame


def test_a_frame_of_its_light_alone_declares_nothing() -> None:
    frame = Frame(3, np.ones((4, 6, 3), np.float32))
    names = ("jitter_px", "cut", "exposure", "scene", "effects", "step", "path", "found")
    declared = [getattr(frame, name) for name in names]
    assert declared == [(0.0, 0.0), False, 1.0, "", None, 1, None, None]


def test_frames_and_cameras_are_equal_to_themselves_alone() -> None:
    """Arrays change and may hold NaN: which of them are equal nobody could say."""
    frame = make_frame(0)
    for one, other in ((frame, replace(frame)), (frame.camera, replace(frame.camera))):
        assert one == one
        assert one != other
        assert other not in [one]
        assert len({one, other, one}) == 2
    assert np.array_equal(frame.colour, replace(frame).colour)
