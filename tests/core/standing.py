"""Frames whose camera stands, a camera that is moved by whole pixels, and runs that a checkpoint interrupts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cltaa.core.plan import Plan
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame
from cltaa.pipeline.checkpoint import Checkpoints
from tests.sequence_factory import bits, make_camera, make_frame

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


def plans_of_equal_runs(preset: str, frames: Sequence[Frame], folder: Path) -> list[Plan]:
    """Resolve frames 0, 1 ... at once, and with a checkpoint before the last two; returns the last plan of each run,
    whose last images have the same bits."""
    whole, begun, goes_on = (Resolver(preset, "numpy") for _ in range(3))
    checkpoints, last = Checkpoints(folder, "same"), len(frames) - 3
    *_, expected = whole.images(frames)
    for frame in frames[:-2]:
        begun.resolve(frame)
    checkpoints.save(begun, "inputs")
    assert checkpoints.restore(goes_on, dict.fromkeys(range(last + 1), "inputs")) == last
    *_, image = goes_on.images(frames[-2:])
    assert np.array_equal(bits(image), bits(expected))
    assert whole.plan is not None
    assert goes_on.plan is not None
    return [whole.plan, goes_on.plan]
