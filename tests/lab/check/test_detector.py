"""The detector on correct sequences of every scene, and on each mistake planted into scenes that can show it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera
from cltaa.inputs.convert import FLIP_Z
from cltaa.lab.check.camera import check_structure, sound
from cltaa.lab.check.report import check_frames
from cltaa.lab.inspect.findings import inspect_folder
from cltaa_datasets.scenes import registered
from tests.lab.check.conftest import MOTIONS, Scene
from tests.lab.check.mistakes import MISTAKES, camera_delayed, found_in, full_motion, mistakes, motion_delayed
from tests.sequence_factory import make_camera, make_frame

SCENES = [*(entry.name for entry in registered()), *MOTIONS]
PLANTED = [
    pytest.param(name, scene, marks=[] if scene == mistake.scenes[0] else pytest.mark.big)
    for name, mistake in MISTAKES.items()
    for scene in mistake.scenes
]
# Too little shows these for more than a question.
ASKED = {("jitter-scaled-2", "still"), ("colour-encoded", "occluder")}


def test_there_are_enough_of_both() -> None:
    assert len(MISTAKES) >= 24
    assert len(SCENES) >= 20


@pytest.mark.parametrize("name", SCENES)
def test_correct_sequences_raise_no_alarm(name: str, scene: Scene) -> None:
    frames = scene(name)
    assert mistakes(frames) == []
    assert frames[0].path is not None
    assert inspect_folder(frames[0].path.parent, pixels=True).problems == []  # nor does what is declared


# In smoke all of them are 0.
@pytest.mark.parametrize("name", ["corridor", "everything", "occluder", "smoke", "spinner", "starry"])
def test_vectors_for_every_pixel_raise_no_alarm(name: str, scene: Scene) -> None:
    assert mistakes(full_motion(scene(name))) == []


@pytest.mark.parametrize(("mistake", "name"), PLANTED)
def test_the_mistake_is_named(mistake: str, name: str, scene: Scene) -> None:
    found = check_frames(MISTAKES[mistake].plant(scene(name)))
    asked = (mistake, name) in ASKED
    assert [finding.name for finding in found if (finding.question if asked else finding.mistake)] == [mistake]
    assert all(finding.evidence and 0 < finding.confidence <= 1 for finding in found)


def test_two_mistakes_are_both_named(scene: Scene) -> None:
    spoilt = MISTAKES["jitter-negated"].plant(MISTAKES["motion-negated"].plant(scene("occluder")))
    assert set(mistakes(spoilt)) == {"jitter-negated", "motion-negated"}


@pytest.mark.parametrize("factor", [0.3048, 0.5, 6.0])
def test_any_unit_of_depth_is_measured(factor: float, scene: Scene) -> None:
    spoilt = [replace(frame, depth=np.asarray(frame.depth * factor, np.float32)) for frame in scene("corridor")]
    (finding,) = found_in(spoilt)
    assert finding.name == "depth-scaled"
    assert finding.fix["depth"]["scale"] * factor == pytest.approx(1.0, abs=0.1)  # worst seen: 0.036


@pytest.mark.parametrize("name", ["corridor", "orbit"])
@pytest.mark.parametrize("factor", [0.3048, 1.3, 20.0])
def test_vectors_in_every_pixel_tell_the_unit_of_depth(factor: float, name: str, scene: Scene) -> None:
    """To rounding, and however little the camera travels: feet for metres too."""
    frames = full_motion(scene(name))
    spoilt = [replace(frame, depth=np.asarray(frame.depth * factor, np.float32)) for frame in frames]
    (finding,) = found_in(spoilt)
    assert finding.name == "depth-scaled"
    assert finding.fix["depth"]["scale"] * factor == pytest.approx(1.0, rel=1e-3)


def test_a_factor_of_depth_that_the_pictures_do_not_tell_is_a_question(scene: Scene) -> None:
    """Depth of a twentieth makes all move too fast; far away, the pictures match by any factor."""
    near = [replace(frame, depth=np.asarray(frame.depth * 0.05, np.float32)) for frame in scene("orbit")]
    (finding,) = [finding for finding in check_frames(near) if finding.name == "depth-scaled"]
    assert (finding.question, finding.fix) == (True, {})


def test_a_unit_of_depth_near_a_power_of_ten_is_that(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Centimetres, and not 0.95 of them, where none of the scales that are tried is nearer."""
    monkeypatch.setattr("cltaa.lab.check.depth.SCALES", (0.0095,))
    monkeypatch.setattr("cltaa.lab.check.depth.STEPS", ())
    spoilt = [replace(frame, depth=np.asarray(frame.depth * 100, np.float32)) for frame in scene("corridor")]
    (finding,) = found_in(spoilt)
    assert finding.fix == {"depth": {"scale": 0.01}}


def test_without_matrices_jitter_and_motion_are_still_checked(scene: Scene) -> None:
    frames = [replace(frame, camera=scene("occluder")[0].camera) for frame in full_motion(scene("occluder"))]
    assert mistakes(frames, has_camera=False, has_depth=False) == []
    for name in ("jitter-y-flipped", "motion-negated"):
        spoilt = MISTAKES[name].plant(frames)
        assert mistakes(spoilt, has_camera=False, has_depth=False) == [name]


@pytest.mark.parametrize(("mistake", "name"), [("camera-late", "dolly"), ("jitter-late", "corridor")])
def test_a_frame_late_is_a_step_late(mistake: str, name: str, scene: Scene) -> None:
    """Where numbers lie apart and each continues the last."""
    spoilt = MISTAKES[mistake].plant(scene(name))
    apart = [replace(frame, index=5 * frame.index, step=5) for frame in spoilt]
    assert mistakes(apart) == [mistake]


def test_vectors_of_the_frame_before_are_named_beside_other_mistakes(scene: Scene) -> None:
    """If matrices and depth tell them to rounding, in four pairs or more."""
    late = motion_delayed(full_motion(scene("corridor")))
    (finding,) = found_in(late)
    assert (finding.name, finding.fix) == ("motion-late", {})
    assert mistakes(late[:5]) == []
    late = motion_delayed(full_motion(scene("foliage")))
    assert mistakes(MISTAKES["jitter-negated"].plant(late)) == ["motion-late", "jitter-negated"]


def test_right_vectors_beside_early_matrices_are_not_called_late(scene: Scene) -> None:
    """Before a sky they agree like late ones."""
    assert "motion-late" not in mistakes(camera_delayed(-1)(full_motion(scene("foliage"))))


def test_a_camera_that_stands_may_have_been_meant_in_several_ways() -> None:
    """And nothing that moves tells which."""
    camera = make_camera()
    wrong = Camera(FLIP_Z @ camera.world_to_view, camera.view_to_clip)
    (finding,), change = check_structure([make_frame(index, camera=wrong) for index in range(3)])
    assert finding.name in ("camera-z-forward", "camera-mirrored")
    assert change is not None
    assert sound(make_frame(0, camera=wrong), change)


def test_one_frame_is_no_error(scene: Scene) -> None:
    assert mistakes(scene("still")[:1]) == []


@pytest.mark.parametrize("step", [(0.6, 0.0), (-0.3, 0.4)])
@pytest.mark.parametrize("faster", [0.0, 0.1])
def test_a_picture_that_moves_on_is_not_taken_for_jitter(faster: float, step: tuple[float, float]) -> None:
    y, x = np.mgrid[:72, :128].astype(np.float64)
    frames = []
    for index in range(8):
        place = index * (1.0 + faster * index)
        right, down = x - place * step[0], y - place * step[1]
        colour = np.stack([np.sin(right / 5), np.cos(down / 4), np.sin((right + down) / 7)], -1) * 0.4 + 0.5
        frame = make_frame(index, width=128, height=72, jitter_px=(0.0, 0.0))
        depth = np.full(frame.depth.shape, np.inf, np.float32)
        frames.append(replace(frame, colour=colour.astype(np.float32), depth=depth))
    (finding,) = found_in(frames, has_camera=False, has_depth=False, has_jitter=False)
    assert finding.name == "motion-missing"
    numbers = [float(number) for number in re.findall(r"-?\d\.\d\d", finding.evidence)[:2]]
    np.testing.assert_allclose(numbers, np.multiply(step, 1.0 + faster * 7), atol=0.1)
