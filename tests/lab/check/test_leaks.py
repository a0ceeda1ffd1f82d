"""Jitter in vectors that fill the picture, declared in another unit or sign: what is prescribed mends both."""

from __future__ import annotations

import shlex
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.inputs.open import open_input
from cltaa.inputs.profile import Jitter
from cltaa.io.sequence import open_sequence
from cltaa.lab.check.camera import ROUNDED_PX
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.motion import resting_offset, without_leak
from cltaa.lab.check.registration import Shot
from cltaa.lab.check.report import check_folder, check_frames
from cltaa_capture.sequence import Request, capture_sequence
from tests.inputs.foreign import write_own
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, Plant, full_motion, jitter, jitter_delayed, motion_jittered
from tests.sequence_factory import make_camera, make_frame

DECLARED: dict[str, Plant] = {
    "units-ndc": MISTAKES["jitter-units-ndc"].plant,
    "units-uv": MISTAKES["jitter-units-uv"].plant,
    "negated": jitter(-np.eye(2)),
    "y-flipped": jitter(np.diag([1, -1])),
    "late": jitter_delayed(1),
}


CASES = [*product(DECLARED, (1.0, -1.0), ["corridor"]), ("units-ndc", 1.0, "spinner"), ("negated", -1.0, "spinner")]
# Each takes 15 seconds: one of each sign and scene.
USUAL = ("units-ndc", 1.0, "corridor"), ("negated", -1.0, "spinner")


@pytest.mark.parametrize(
    ("declared", "sign", "name"),
    [pytest.param(*case, marks=() if case in USUAL else pytest.mark.big) for case in CASES],
)
def test_vectors_with_jitter_and_a_wrong_jitter_are_both_mended(
    declared: str, sign: float, name: str, scene: Scene, tmp_path: Path
) -> None:
    frames = full_motion(scene(name))
    write_own(tmp_path, DECLARED[declared](motion_jittered(sign)(frames)))
    report, _ = check_folder(tmp_path)
    found = [finding.name for finding in report.mistakes]
    assert found == [f"jitter-{declared}", "motion-jittered" if sign > 0.0 else "motion-jittered-reversed"]
    given = shlex.split(report.options)[3::2]
    again, _ = check_folder(tmp_path, assignments=given)
    assert (again.mistakes, again.questions) == ([], [])
    both = list(zip(frames, open_input(tmp_path, assignments=given), strict=True))
    # Of a delay the last frame's jitter is not known, nor what it left in the first one's vectors.
    for ours, theirs in both[1:-1]:
        assert ours.motion is not None
        assert theirs.motion is not None
        # Numbers of an option have six digits.
        np.testing.assert_allclose(theirs.jitter_px, ours.jitter_px, rtol=0, atol=1e-5)
        np.testing.assert_allclose(theirs.motion, ours.motion, rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", ["corridor", "spinner"])
@pytest.mark.parametrize("given", [(), ("camera.source=none",)], ids=["matrices", "bare"])
@pytest.mark.parametrize(("stored", "declared"), [(1, -1), (-1, 1), (0, 1)])
def test_another_value_of_the_profile_is_named_and_not_the_jitter(
    stored: int, declared: int, given: tuple[str, ...], name: str, scene: Scene, tmp_path: Path
) -> None:
    """Vectors from which it takes the jitter twice, or which hold none, move the pixels as a wrong jitter does."""
    write_own(tmp_path, motion_jittered(float(stored))(full_motion(scene(name))))
    report, mended = check_folder(tmp_path, assignments=[f"motion.jittered={declared}", *given])
    (finding,) = report.mistakes
    assert finding.name == f"motion-{ {1: 'jittered', 0: 'not-jittered', -1: 'jittered-reversed'}[stored] }"
    assert finding.option == f"--input motion.jittered={stored}"
    assert (mended.motion.jittered, mended.jitter) == (stored, Jitter())
    assert report.questions == []


@pytest.mark.parametrize(
    ("held", "declared", "name", "words"),
    [
        (1, 0, "jitter-absent", "or the vectors contain the change of jitter"),
        (-1, 0, "jitter-scaled-2", "or the vectors contain the change of jitter, with the other sign"),
        (1, -1, "jitter-negated", "or the vectors contain the change of jitter"),
        (0, -1, "jitter-absent", "or the vectors do not contain the change of jitter, which motion.jittered takes out"),
    ],
)
def test_jitter_in_the_vectors_of_few_frames_does_not_accuse_the_declared_jitter(
    held: int, declared: int, name: str, words: str, scene: Scene
) -> None:
    """Vectors with the jitter leave no shift, as if there were no jitter; six frames are too few to tell which."""
    frames = motion_jittered(float(held - declared))(full_motion(scene("corridor")))[:6]
    found = check_frames(frames, jittered=declared)
    assert [finding.name for finding in found if finding.mistake] == []
    asked = next(finding for finding in found if finding.name == name)
    assert asked.question
    assert words in asked.evidence
    assert asked.evidence.endswith(", which takes 7 frames to tell")


def bare(frames: list[Frame]) -> list[Finding]:
    """Return what is found of ``frames`` alone."""
    found = check_frames(frames, has_camera=False, has_depth=False, has_jitter=False)
    return [finding for finding in found if finding.mistake or finding.question]


def undeclared(frames: list[Frame]) -> list[Frame]:
    """Without jitter, matrices and depth, as EEVEE writes them but for its jitter."""
    return [replace(frame, jitter_px=(0.0, 0.0), camera=make_camera()) for frame in frames]


@pytest.mark.parametrize("name", ["still", "spinner"])
def test_undeclared_jitter_in_vectors_is_named_where_the_camera_stands(name: str, scene: Scene) -> None:
    (finding,) = bare(undeclared(motion_jittered(1.0)(full_motion(scene(name)))))
    assert (finding.name, finding.mistake) == ("jitter-missing", True)
    assert "the vectors contain it" in finding.what


@pytest.mark.parametrize("name", ["corridor", "pan"])
def test_undeclared_jitter_in_vectors_of_a_camera_that_moves_is_asked_about(name: str, scene: Scene) -> None:
    """It shakes, or they contain jitter: the pictures match either way."""
    (finding,) = bare(undeclared(motion_jittered(1.0)(full_motion(scene(name)))))
    assert (finding.name, finding.question) == ("jitter-missing", True)
    assert finding.what.startswith("without matrices and depth nobody can tell whether the vectors contain jitter")
    assert "give them with --camera FILE, or the jitter itself" in finding.what


def test_undeclared_jitter_in_the_vectors_of_few_frames_is_asked_about(scene: Scene) -> None:
    frames = motion_jittered(1.0)(full_motion(scene("corridor")))
    frames = [replace(frame, jitter_px=(0.0, 0.0)) for frame in frames]
    assert "jitter-missing" in [finding.name for finding in check_frames(frames, has_jitter=False) if finding.mistake]
    (asked,) = [found for found in check_frames(frames[:6], has_jitter=False) if found.name.startswith("jitter")]
    assert asked.question
    assert asked.what.startswith("in fewer than 7 frames nobody can tell")


@pytest.mark.parametrize("name", ["dolly", "pan", "roll"])
def test_vectors_of_a_camera_that_moves_are_not_asked_for_jitter(name: str, tmp_path: Path) -> None:
    request = Request(name, tmp_path, frames=12, width=96, height=54, jitter="none", fps=12.0, seed=1)
    capture_sequence(request)
    assert bare(undeclared(full_motion(list(open_sequence(tmp_path))))) == []


def test_what_moves_on_its_own_is_no_jitter_in_vectors(scene: Scene) -> None:
    """Most of the picture in every other frame, by more or less."""
    frames = full_motion(scene("corridor"))
    for frame in frames[::2]:
        assert frame.motion is not None
        frame.motion[:, int(0.4 * frame.width) :] *= np.float32(4)
    shot = Shot(frames, (frames[0].width, frames[0].height))
    assert without_leak(shot) is shot
    shot = Shot(motion_jittered(1.0)(frames), (frames[0].width, frames[0].height))
    less = without_leak(shot)
    rests = less.pairs[0].x < 0.4 * frames[0].width
    left = [np.median((pair.own - pair.camera_motion())[:, rests], axis=1) for pair in less.pairs]
    # But for the mean of what was taken out, since what fills a picture may move on.
    np.testing.assert_allclose(left - np.mean(left, 0), 0.0, rtol=0, atol=ROUNDED_PX)


def test_resting_vectors_agree_to_their_rounding_and_no_farther() -> None:
    """A third rests, rounded by half of what a vector may be off. The rest drifts one way by 5 to 25 times that, as
    near as the square root of it."""
    camera, random = make_camera(), np.random.default_rng(0)
    frames = [make_frame(index, width=40, height=30, camera=camera) for index in range(2)]
    drift = np.repeat([0.0, 5.0, 10.0, 15.0, 25.0], [400, 200, 200, 200, 200]) * ROUNDED_PX
    vectors = np.array([0.3, -0.2]) + random.uniform(-0.5, 0.5, (1200, 2)) * ROUNDED_PX
    vectors[:, 0] += drift
    told = random.permutation(vectors).reshape(30, 40, 2).astype(np.float32)
    (pair,) = Shot([frames[0], replace(frames[1], motion=told)], (40, 30)).pairs
    np.testing.assert_allclose(resting_offset(pair), [0.3, -0.2], rtol=0, atol=ROUNDED_PX / 2)
