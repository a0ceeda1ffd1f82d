"""The detector on correct sequences of every scene, and on each mistake planted into scenes that can show it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cltaa.checking.detector import check_frames
from cltaa.checking.finding import Finding
from cltaa_datasets.scenes import registered
from tests.checking.conftest import Scene
from tests.checking.mistakes import MISTAKES, full_motion

SCENES = [*(entry.name for entry in registered()), "orbit", "turntable"]
FIRST = [(name, mistake.scenes[0]) for name, mistake in MISTAKES.items()]
OTHERS = [(name, scene) for name, mistake in MISTAKES.items() for scene in mistake.scenes[1:]]


def mistakes(found: list[Finding]) -> list[str]:
    return [finding.name for finding in found if finding.mistake]


def test_there_are_enough_of_both() -> None:
    assert len(MISTAKES) >= 24
    assert len(SCENES) >= 20


@pytest.mark.parametrize("name", SCENES)
def test_correct_sequences_raise_no_alarm(name: str, scene: Scene) -> None:
    assert mistakes(check_frames(scene(name))) == []


@pytest.mark.parametrize("name", ["corridor", "occluder"])
def test_vectors_for_every_pixel_raise_no_alarm(name: str, scene: Scene) -> None:
    assert mistakes(check_frames(full_motion(scene(name)))) == []


@pytest.mark.parametrize(("mistake", "name"), FIRST)
def test_the_mistake_is_named(mistake: str, name: str, scene: Scene) -> None:
    found = check_frames(MISTAKES[mistake].plant(scene(name)))
    assert mistakes(found) == [mistake]
    assert all(finding.evidence and 0 < finding.confidence < 1 for finding in found)


@pytest.mark.big
@pytest.mark.parametrize(("mistake", "name"), OTHERS)
def test_the_mistake_is_named_in_other_scenes(mistake: str, name: str, scene: Scene) -> None:
    assert mistakes(check_frames(MISTAKES[mistake].plant(scene(name)))) == [mistake]


def test_two_mistakes_are_both_named(scene: Scene) -> None:
    spoilt = MISTAKES["jitter-negated"].plant(MISTAKES["motion-negated"].plant(scene("occluder")))
    assert set(mistakes(check_frames(spoilt))) == {"jitter-negated", "motion-negated"}


def test_without_matrices_jitter_and_motion_are_still_checked(scene: Scene) -> None:
    frames = [replace(frame, camera=scene("occluder")[0].camera) for frame in full_motion(scene("occluder"))]
    assert mistakes(check_frames(frames, has_camera=False, has_depth=False)) == []
    for name in ("jitter-y-flipped", "motion-negated"):
        spoilt = MISTAKES[name].plant(frames)
        assert mistakes(check_frames(spoilt, has_camera=False, has_depth=False)) == [name]


def test_one_frame_is_no_error(scene: Scene) -> None:
    assert mistakes(check_frames(scene("still")[:1])) == []
