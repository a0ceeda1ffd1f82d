"""Frames whose camera stands, and a camera that is moved by whole pixels."""

from __future__ import annotations

from dataclasses import replace

from cltaa.frame import Camera, Effect, Frame
from tests.sequence_factory import make_camera, make_frame

STILL = frozenset({Effect.SKY})


def still_frame(index: int, **changes: object) -> Frame:
    """A frame whose camera stands; its colours are new in every frame, as if each had another jitter."""
    camera = make_camera()
    return replace(make_frame(index, camera=camera, effects=STILL), **changes)  # type: ignore[arg-type]


def panned(camera: Camera, pixels: int, width: int) -> Camera:
    """The camera shifted off-axis so that everything moves by whole pixels, whatever its depth."""
    clip = camera.view_to_clip.copy()
    clip[0, 2] += 2.0 * pixels / width
    return Camera(camera.world_to_view, clip)
