"""Declarations against pixels: broken promises are problems, idle ones are named, and sound scenes raise neither."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.frame import Effect, Frame
from cltaa.lab.inspect import changes
from cltaa.lab.inspect.findings import Inspection, inspect_folder
from tests.sequence_factory import make_camera, make_frame, write_frames

CHANGING = "camera, disocclusion, exposure, illumination, motion, reactive"
JITTERS = ((0.25, -0.25), (-0.25, 0.25))


def still(index: int, effects: set[Effect], **changes: object) -> Frame:
    """A slope whose depth and colour move with the sample, as those of a still scene do."""
    frame = make_frame(index, camera=make_camera(), effects=frozenset(effects), jitter_px=JITTERS[index % 2])
    x, y = np.meshgrid(np.arange(frame.width), np.arange(frame.height))
    depth = (3.0 + 0.1 * (x + frame.jitter_px[0]) + 0.2 * (y + frame.jitter_px[1])).astype(np.float32)
    colour = np.repeat(depth[..., None] / 20.0, 3, axis=-1)
    return replace(frame, depth=depth, colour=colour, **changes)  # type: ignore[arg-type]


def inspected(tmp_path: Path, *frames: Frame) -> Inspection:
    return inspect_folder(write_frames(tmp_path, frames), pixels=True)


@pytest.fixture(autouse=True)
def small_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """These frames have no texture that is finer than their pixels."""
    monkeypatch.setattr(changes, "SMALLEST", 0)


def test_a_still_scene_agrees_with_its_declaration(tmp_path: Path) -> None:
    found = inspected(tmp_path, *(still(index, set()) for index in range(5)))
    assert found.problems == []
    assert found.idle == []


@pytest.mark.parametrize("frame", [2, 3], ids=["same jitter as the first", "another jitter"])
def test_depth_that_changes_under_a_still_camera(tmp_path: Path, frame: int) -> None:
    frames = [still(index, {Effect.ILLUMINATION}) for index in range(5)]
    moved = frames[frame].depth.copy()
    moved[5:15, 5:20] = 1.5
    frames[frame] = replace(frames[frame], depth=moved)
    (problem,) = inspected(tmp_path, *frames).problems
    assert (
        problem == f"depth changes at frame {frame}, but no effect out of camera, cut, disocclusion, motion is declared"
    )


@pytest.mark.parametrize(("frames", "at"), [(5, 2), (2, 1)], ids=["a jitter that was there", "another jitter"])
def test_colour_that_changes_in_a_still_scene(tmp_path: Path, frames: int, at: int) -> None:
    """A shadow over half of the picture, in frames that show what frames before them showed."""
    shown = [still(index, {Effect.SKY}) for index in range(frames)]
    assert inspected(tmp_path, *shown).problems == []
    for frame in shown[at:]:
        frame.colour[:, :19] *= 0.7
    (problem,) = inspected(tmp_path, *shown).problems
    assert problem == f"colour changes at frame {at}, but no effect out of {CHANGING} is declared"
    lit = [replace(frame, effects=frozenset({Effect.SKY, Effect.ILLUMINATION})) for frame in shown]
    assert inspected(tmp_path, *lit).problems == []


def test_small_frames_of_different_jitter_are_not_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    frames = [sliding(index, {Effect.MOTION}, 2.0, by_camera=False) for index in range(2)]
    assert inspected(tmp_path, *frames).problems == []
    shown = [still(index, set()) for index in range(2)]
    shown[1].colour[:, :19] *= 0.7
    shown[1].depth[5:15, 5:20] = 1.5
    assert inspected(tmp_path / "still", *shown).problems == []


def test_one_step_of_light_that_no_eight_bits_show_is_none(tmp_path: Path) -> None:
    frames = [still(index, set()) for index in range(5)]
    frames[4].colour[:] *= 1.001
    assert inspected(tmp_path, *frames).problems == []
    frames[4].colour[:] *= 1.002
    assert len(inspected(tmp_path, *frames).problems) == 1


def sliding(index: int, effects: set[Effect], speed: float, *, by_camera: bool) -> Frame:
    """A card before a wall, which slides by itself, or because the camera travels: the wall is four times as far."""
    camera = make_camera((-0.2 * index * speed if by_camera else 0.0, 0.0, 5.0), 80 / 45)
    jitter = JITTERS[index % 2]
    frame = make_frame(index, width=80, height=45, camera=camera, effects=frozenset(effects), jitter_px=jitter)
    per_unit = camera.view_to_clip[0, 0] * 80 / 2  # pixels at distance 1
    shift = 0.2 * index * speed * per_unit / 3.0
    x, y = np.meshgrid(np.arange(80) + 0.5 + jitter[0], np.arange(45) + 0.5 + jitter[1])
    card = (x > 10 + shift) & (x < 30 + shift) & (y > 12) & (y < 34)
    motion = np.full((45, 80, 2), np.nan, np.float32)
    motion[card] = -0.2 * speed * per_unit / 3.0, 0.0
    depth = np.where(card, 3.0, 12.0).astype(np.float32)
    return replace(frame, depth=depth, colour=frame.colour / 4.0, motion=None if by_camera else motion)


@pytest.mark.parametrize("by_camera", [False, True], ids=["own motion", "camera"])
def test_what_comes_into_view_undeclared(tmp_path: Path, by_camera: bool) -> None:
    moves = Effect.CAMERA if by_camera else Effect.MOTION
    speed = 0.25 if by_camera else 2.0  # the camera disoccludes half a pixel a frame: told by eight frames together
    hidden = [sliding(index, {moves}, speed, by_camera=by_camera) for index in range(9)]
    (problem,) = inspected(tmp_path, *hidden).problems
    at = 8 if by_camera else 1
    assert problem == f"something comes into view at frame {at}, but effect disocclusion is not declared"
    told = [replace(frame, effects=frozenset({moves, Effect.DISOCCLUSION})) for frame in hidden]
    assert inspected(tmp_path, *told).problems == []
    apart = [replace(frame, cut=True) for frame in hidden]  # nothing was hidden before a cut
    assert inspected(tmp_path, *apart).problems == ["effect cut is there but not declared"]


@pytest.mark.parametrize("by_camera", [False, True], ids=["own motion", "camera"])
def test_jitter_alone_disoccludes_nothing(tmp_path: Path, by_camera: bool) -> None:
    """The card's edges come and go with the sample."""
    still_card = [
        sliding(index, {Effect.CAMERA if by_camera else Effect.MOTION}, 0.0, by_camera=by_camera) for index in range(9)
    ]
    assert inspected(tmp_path, *still_card).problems == []


def test_highlights_that_are_not_declared(tmp_path: Path) -> None:
    frames = [still(index, set()) for index in range(3)]
    frames[1].colour[4, 4, 1] = 900.0
    assert inspected(tmp_path, *frames).problems == ["effect hdr shows in the pixels (up to 900) but is not declared"]


def test_what_is_declared_and_never_shows(tmp_path: Path) -> None:
    declared = {Effect.REACTIVE, Effect.ALPHA, Effect.MOTION, Effect.HDR, Effect.SKY, Effect.ILLUMINATION}
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
