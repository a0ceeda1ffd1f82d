"""Jitter that stands in the projection alone, or right only there, as most engines hand it over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.inputs.open import open_input
from cltaa.lab.check.report import check_folder, check_frames
from tests.inputs.foreign import write_own
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import (
    MISTAKES,
    Plant,
    camera_jittered,
    each,
    found_in,
    full_motion,
    jitter,
    jitter_delayed,
    mistakes,
    then,
)
from tests.sequence_factory import make_frame

FIX = {"jitter": {"source": "projection"}}
NONE = jitter(np.zeros((2, 2)))
# Before it is declared wrongly the projection is given the right one.
WRONG: dict[str, Plant] = {
    "y-flipped": jitter(np.diag([1, -1])),
    "negated": jitter(-np.eye(2)),
    "twice": jitter(2 * np.eye(2)),
    "units": MISTAKES["jitter-units-ndc"].plant,
    "late": jitter_delayed(1),
}


def in_projection(frames: Sequence[Frame], declared: Plant = NONE) -> list[Frame]:
    return then(each(camera_jittered), declared)(frames)


@pytest.mark.parametrize("name", ["corridor", "still", "spinner"])
@pytest.mark.parametrize("filled", [False, True], ids=["few vectors", "vectors"])
def test_a_jitter_that_only_the_projection_holds_is_named(name: str, filled: bool, scene: Scene) -> None:
    frames = full_motion(scene(name)) if filled else scene(name)
    (finding,) = found_in(in_projection(frames))
    assert (finding.name, finding.fix) == ("jitter-missing", FIX)
    assert "the projection's centre moves by" in finding.what
    assert mistakes(in_projection(frames, jitter(np.eye(2)))) == ["camera-jittered"]
    # As a root mean square from frame to frame, to the three digits that are told.
    moved = np.sqrt((np.diff([frame.jitter_px for frame in frames], axis=0) ** 2).mean(0))
    assert f"{moved[0]:.2f}, {moved[1]:.2f} pixels" in finding.what


@pytest.mark.parametrize("name", ["corridor", "still"])
@pytest.mark.parametrize("wrong", WRONG)
def test_a_jitter_that_is_right_only_in_the_projection_is_not_thrown_away(wrong: str, name: str, scene: Scene) -> None:
    (finding,) = found_in(in_projection(scene(name), WRONG[wrong]))
    assert (finding.name, finding.fix) == ("jitter-disagrees", FIX)


# Both are named with either, above.
@pytest.mark.parametrize(
    ("declared", "filled"), [(NONE, False), (WRONG["y-flipped"], True)], ids=["few vectors", "vectors"]
)
def test_it_is_mended(declared: Plant, filled: bool, scene: Scene, tmp_path: Path) -> None:
    frames = scene("corridor")
    write_own(tmp_path, in_projection(full_motion(frames) if filled else frames, declared))
    report, profile = check_folder(tmp_path)
    assert report.options == "--profile cltaa --input jitter.source=projection"
    assert len(report.mistakes) == 1
    again, _ = check_folder(tmp_path, assignments=["jitter.source=projection"])
    assert (again.mistakes, again.questions) == ([], [])
    told = np.array([frame.jitter_px for frame in frames])
    read = [frame.jitter_px for frame in open_input(tmp_path, assignments=["jitter.source=projection"])]
    np.testing.assert_allclose(read, told - told.mean(0), rtol=0, atol=1e-12)
    assert profile.jitter.source == "projection"


def moved(frame: Frame, x: float, y: float) -> Frame:
    """``frame``, whose projection's centre lies beside the middle by so many pixels, and which declares no jitter."""
    return replace(camera_jittered(replace(frame, jitter_px=(x, y))), jitter_px=(0.0, 0.0))


def test_a_centre_that_moves_where_the_pixels_tell_nothing_is_asked_about() -> None:
    rng = np.random.default_rng(0)
    frames = [moved(make_frame(n, width=96, height=54), *rng.uniform(-0.5, 0.5, 2)) for n in range(8)]
    found = [finding for finding in check_frames(frames) if finding.name.startswith("jitter")]
    assert [(finding.name, finding.question, finding.fix) for finding in found] == [("jitter-missing", True, {})]


@pytest.mark.parametrize("far", [0.05, 3.0], ids=["slowly", "far"])
def test_a_lens_that_shifts_is_no_jitter(far: float, scene: Scene) -> None:
    """It moves on, or by pixels; jitter goes to and fro within one."""
    frames = [moved(frame, far * n, 0.0) for n, frame in enumerate(scene("still"))]
    assert not [f for f in check_frames(frames) if f.name in ("jitter-missing", "jitter-disagrees") and f.fix]


def test_a_lens_shift_that_stays_is_no_jitter(scene: Scene) -> None:
    shift = np.eye(4)
    shift[0, 3] = 0.3
    shifted = each(lambda f: replace(f, camera=Camera(f.camera.world_to_view, shift @ f.camera.view_to_clip)))
    (finding,) = found_in(in_projection(shifted(scene("spinner"))))
    assert finding.fix == FIX
