"""Declarations against pixels: broken promises are problems, idle ones are named, and sound scenes raise neither."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.exr import write_frame
from cltaa.frames import Effect, Frame
from cltaa.inspection import Inspection, inspect_folder
from tests.sequence_factory import make_camera, make_frame

JITTERS = ((0.25, -0.25), (-0.25, 0.25))


def still(index: int, effects: set[Effect], **changes: object) -> Frame:
    """A slope whose depth moves with the sample, as that of a still scene does."""
    frame = make_frame(index, camera=make_camera(), effects=frozenset(effects), jitter_px=JITTERS[index % 2])
    x, y = np.meshgrid(np.arange(frame.width), np.arange(frame.height))
    depth = (3.0 + 0.1 * (x + frame.jitter_px[0]) + 0.2 * (y + frame.jitter_px[1])).astype(np.float32)
    return replace(frame, depth=depth, colour=frame.colour / 4.0, **changes)  # type: ignore[arg-type]


def inspected(tmp_path: Path, *frames: Frame) -> Inspection:
    for frame in frames:
        write_frame(tmp_path / f"a.{frame.index:04d}.exr", frame)
    return inspect_folder(tmp_path, pixels=True)


def test_a_still_scene_keeps_its_promise(tmp_path: Path) -> None:
    found = inspected(tmp_path, *(still(index, set()) for index in range(5)))
    assert found.problems == []
    assert found.idle == []


@pytest.mark.parametrize("frame", [2, 3], ids=["same jitter as the first", "another jitter"])
def test_depth_that_changes_under_a_still_camera(tmp_path: Path, frame: int) -> None:
    frames = [still(index, {Effect.SHADING}) for index in range(5)]
    moved = frames[frame].depth.copy()
    moved[5:15, 5:20] = 1.5
    frames[frame] = replace(frames[frame], depth=moved)
    (problem,) = inspected(tmp_path, *frames).problems
    assert problem == f"depth changes at frame {frame}, but no effect out of camera, cut, motion, uncover is declared"


def test_highlights_that_are_not_declared(tmp_path: Path) -> None:
    frames = [still(index, set()) for index in range(3)]
    frames[1].colour[4, 4, 1] = 900.0
    assert inspected(tmp_path, *frames).problems == ["effect hdr shows in the pixels (up to 900) but is not declared"]


def test_what_is_declared_and_never_shows(tmp_path: Path) -> None:
    declared = {Effect.REACTIVE, Effect.ALPHA, Effect.MOTION, Effect.HDR, Effect.SKY, Effect.SHADING}
    nothing = np.zeros((23, 37), np.float32)
    channels = {"reactive": nothing, "alpha": nothing + 1, "motion": np.full((23, 37, 2), np.nan, np.float32)}
    found = inspected(tmp_path, *(still(index, declared, **channels) for index in range(3)))
    assert found.problems == []
    assert [line.split(",")[0] for line in found.idle] == [
        f"effect {name} is declared" for name in ("motion", "reactive", "alpha", "hdr", "sky")
    ]


def test_what_is_declared_and_shows(tmp_path: Path) -> None:
    effects = {Effect.CAMERA, Effect.MOTION, Effect.ALPHA, Effect.REACTIVE, Effect.SKY, Effect.HDR}
    frames = [
        make_frame(
            index, motion=True, alpha=True, reactive=True, effects=frozenset(effects), jitter_px=JITTERS[index % 2]
        )
        for index in range(3)
    ]
    found = inspected(tmp_path, *frames)
    assert found.problems == []
    assert found.idle == []
