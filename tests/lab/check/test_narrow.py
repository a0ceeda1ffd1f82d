"""Pictures of a few columns or rows: what takes two of them to be matched is not told, and nothing is accused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.lab.check.report import check_frames
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, camera_jittered, full_motion, not_told
from tests.lab.check.test_close_up import close_up

HIDDEN = "matrices, the unit of depth, vectors, jitter: "


def cut_out(frames: Sequence[Frame], left: int, top: int, width: int, height: int) -> list[Frame]:
    """A window of ``frames`` with the camera that sees it."""
    made = []
    for frame in frames:
        across, down = frame.width / width, frame.height / height
        window = np.diag([across, down, 1.0, 1.0])
        window[:2, 3] = across - 2 * left / width - 1, 1 - down + 2 * top / height
        rows, columns = slice(top, top + height), slice(left, left + width)
        planes = [name for name in ("colour", "depth", "motion") if getattr(frame, name) is not None]
        there = {name: getattr(frame, name)[rows, columns].copy() for name in planes}
        camera = Camera(frame.camera.world_to_view, window @ frame.camera.view_to_clip)
        made.append(replace(frame, camera=camera, alpha=None, reactive=None, object_id=None, normal=None, **there))
    return made


def accused(frames: Sequence[Frame]) -> list[str]:
    found = [finding.name for finding in check_frames(frames) if finding.mistake or finding.question]
    return [name for name in found if not name.startswith("colour")]


@pytest.mark.parametrize("vectors", [False, True], ids=["no vectors", "vectors"])
@pytest.mark.parametrize("width", [4, 9, 16])
def test_narrow_pictures_are_too_small_to_tell(width: int, vectors: bool, scene: Scene) -> None:
    """Of one that moves on its own, without vectors, a wider one would be accused."""
    frames = close_up(scene("corridor"), 0.25, vectors=vectors)
    narrow, flat = cut_out(frames, 110, 0, width, 90), cut_out(frames, 80, 40, 80, width)
    assert (accused(narrow), accused(flat)) == ([], [])
    size = f"{width} x 90 pixels are too small to tell, 17 on each side do"
    assert not_told(narrow)[0] == f"{HIDDEN if vectors else HIDDEN.replace('vectors, ', '')}{size}"
    assert vectors or accused(cut_out(frames, 80, 0, 40, 90)) != []


def test_numbers_tell_of_narrow_pictures_too(scene: Scene) -> None:
    narrow = cut_out(full_motion(scene("corridor")), 40, 0, 8, 90)
    assert accused([camera_jittered(frame) for frame in narrow]) == ["camera-jittered"]
    assert accused(MISTAKES["jitter-biased"].plant(narrow)) == ["jitter-biased"]
    assert accused(MISTAKES["camera-transposed"].plant(narrow)) == ["camera-transposed"]
