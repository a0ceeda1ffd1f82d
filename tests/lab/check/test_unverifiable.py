"""What the check says that it cannot tell, and the y of a projection that nothing but its sign gives away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cltaa.cli import root
from cltaa.frame import Camera, Frame
from cltaa.lab.check.registration import Shot
from cltaa.lab.check.report import check_frames
from cltaa.lab.check.unverifiable import unverifiable
from tests.inputs.foreign import write_own
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import FLIP_Y, MISTAKES, full_motion, mistakes, not_told
from tests.numerics.exact_cameras import orthographic, rotation, view_at
from tests.sequence_factory import make_camera, make_frame

FLAT = "no plane in view lies aslant, and the camera's motion does not tell"
STANDS = "matrices: their direction, their y, a delay; and the unit of depth: the camera stands"


@cache
def told_of(name: str, scene: Scene) -> list[str]:
    """What several tests look at."""
    return not_told(scene(name))


def rows_up(frames: list[Frame]) -> list[Frame]:
    """The same pictures with the last row first, as a buffer of OpenGL is read."""
    return [
        replace(
            frame,
            colour=frame.colour[::-1].copy(),
            depth=frame.depth[::-1].copy(),
            motion=None,
            object_id=None,
            jitter_px=(frame.jitter_px[0], -frame.jitter_px[1]),
        )
        for frame in frames
    ]


def turned(frame: Frame) -> Frame:
    return replace(frame, camera=Camera(frame.camera.world_to_view, FLIP_Y @ frame.camera.view_to_clip))


@pytest.mark.parametrize("name", ["still", "pan"])
def test_a_projection_that_turns_the_picture_over_is_named_where_no_motion_tells(name: str, scene: Scene) -> None:
    assert mistakes(MISTAKES["camera-y-flipped"].plant(scene(name))) == ["camera-y-flipped"]


def test_a_picture_whose_rows_go_up_is_named_by_its_motion(scene: Scene) -> None:
    assert mistakes(rows_up(scene("orbit"))) == ["camera-y-flipped"]


def test_a_projection_that_turns_such_a_picture_over_is_right(scene: Scene) -> None:
    assert mistakes([turned(frame) for frame in rows_up(scene("orbit"))]) == []


def test_vectors_that_fill_such_a_picture_bear_the_projection_out(scene: Scene) -> None:
    """Where its pixels match about as well either way: else what mends it would be taken for the next mistake."""
    drawn = scene("starry")
    vectors = [frame.motion for frame in full_motion(drawn)]
    up = [
        replace(frame, motion=motion[::-1] * np.array((1, -1), np.float32))
        for frame, motion in zip(rows_up(drawn), vectors, strict=True)
        if motion is not None
    ]
    assert mistakes(up) == ["camera-y-flipped"]
    assert mistakes([turned(frame) for frame in up]) == []


def test_a_picture_whose_rows_go_up_before_a_level_camera_is_said_to_be_unverifiable(scene: Scene) -> None:
    frames = rows_up(scene("corridor"))
    assert mistakes(frames) == []
    (line,) = [line for line in not_told(frames) if line.startswith("matrices: ")]
    assert "their y" in line


@pytest.mark.parametrize(
    ("name", "hidden", "shown"),
    [
        ("still", [STANDS], []),
        ("corridor", ["their y", "a delay"], ["direction", "unit of depth", "the jitter"]),
        ("pan", ["their y", "unit of depth"], []),
        ("orbit", [], ["their y", "direction"]),
        ("dolly", ["their y"], ["a delay"]),
        ("occluder", ["the sign of y"], ["the sign of x", "none is longer"]),
        ("spinner", [], ["the sign of"]),
    ],
)
def test_what_is_unverifiable(name: str, hidden: list[str], shown: list[str], scene: Scene) -> None:
    text = "\n".join(told_of(name, scene))
    assert [words for words in hidden if words not in text] == []
    assert [words for words in shown if words in text] == []


@pytest.mark.parametrize("name", ["corridor", "pan", "orbit"])
@pytest.mark.parametrize("mistake", ["camera-inverse", "depth-scaled"])
def test_what_is_not_named_is_said_to_be_unverifiable(mistake: str, name: str, scene: Scene) -> None:
    words = {"camera-inverse": "their direction", "depth-scaled": "the unit of depth"}[mistake]
    named = mistakes(MISTAKES[mistake].plant(scene(name))) == [mistake]
    assert named != any(words in line for line in told_of(name, scene))


def test_vectors_that_fill_the_picture_tell_the_direction_of_matrices(small: Scene) -> None:
    assert any("their direction" in line for line in not_told(small("far_off")))
    assert not any("their direction" in line for line in not_told(full_motion(small("far_off"))))


def test_vectors_in_a_few_pixels_and_depth_without_slant_are_unverifiable(small: Scene) -> None:
    assert "the vectors' sign, axes and unit: too few pixels hold one" in not_told(small("sparks"))
    assert f"the kind of depth: {FLAT}" in not_told(small("charts_drift"))
    assert not any("kind of depth" in line for line in not_told(small("sparks")))


def test_halves_and_not_what_is_in_view_hide_the_kind_of_depth(small: Scene) -> None:
    halves = [replace(f, depth=f.depth.astype(np.float16).astype(np.float32)) for f in small("sparks")]
    (line,) = [line for line in not_told(halves) if line.startswith("the kind of depth")]
    assert line == "the kind of depth: half precision rounds off by what planes of another kind would bend"


def test_a_camera_that_lags_at_a_cut_is_late(small: Scene) -> None:
    """Where it stands before and after, an early one would do as well."""
    assert mistakes(MISTAKES["camera-late"].plant(small("cut"))) == ["camera-late"]


def test_other_meanings_of_matrices_under_which_pictures_match_are_said(small: Scene) -> None:
    (finding,) = check_frames(MISTAKES["camera-mirrored"].plant(small("exposure")))
    assert {finding.name, "or mirrored" in finding.evidence} == {"camera-z-forward", True}
    assert finding.mistake
    (finding,) = check_frames(MISTAKES["camera-mirrored"].plant(small("corridor")))
    assert (finding.name, finding.confidence, " or " in finding.evidence) == ("camera-mirrored", 0.95, False)


def noise(cameras: Sequence[Camera]) -> list[Frame]:
    """Pictures in which nothing matches anything, each seen by one of ``cameras``."""
    return [make_frame(index, camera=camera) for index, camera in enumerate(cameras)]


def test_a_camera_that_moves_once_does_not_tell_a_delay() -> None:
    """The pairs before and behind its step would show one, if anything did."""
    here, there = make_camera(), make_camera((0.3, 0.1, 4.8))
    (line,) = [line for line in not_told(noise([here, here, there, there])) if line.startswith("matrices: ")]
    assert line == "matrices: their direction, their y, a delay: the pictures match about as well either way"


def test_of_what_was_not_declared_nothing_is_unverifiable() -> None:
    frames = noise([make_camera((0.1 * index, 0.0, 5.0)) for index in range(4)])
    size = frames[0].width, frames[0].height
    assert sum("of depth" in line for line in not_told(frames)) == 2  # its unit, and its kind
    assert not any("of depth" in line for line in unverifiable(Shot(frames, size, has_depth=False)))
    assert not any(
        "of depth" in line or "matrices" in line for line in unverifiable(Shot(frames, size, has_camera=False))
    )


def test_a_parallel_camera_that_turns_does_not_tell_the_unit_of_depth() -> None:
    """Vectors that fill the picture would; but such a camera's depth is not compared with them."""
    clip = orthographic(2.0, 1.5)
    frames = full_motion(
        noise([Camera(view_at(np.zeros(3), rotation((0.0, 1.0, 0.0), index)), clip) for index in range(4)])
    )
    assert any(line.startswith("the unit of depth") for line in not_told(frames))


@pytest.mark.parametrize(("down", "said"), [(0.03, True), (0.05, False)])
def test_a_sign_that_turns_vectors_by_less_than_matters_is_unverifiable(down: float, said: bool) -> None:
    """By twice what they have on that axis; 0.08 px matter."""
    frames = noise([make_camera((0.1 * index, 0.0, 5.0)) for index in range(3)])
    vectors = np.broadcast_to(np.array((1.0, down), np.float32), (frames[0].height, frames[0].width, 2))
    text = not_told([replace(frame, motion=vectors.copy()) for frame in frames])
    assert ("the vectors: the sign of y: nothing moves that way" in text) is said
    assert sum("the sign of y" in line for line in text) == 1


def test_vectors_that_say_nothing_are_unverifiable(scene: Scene) -> None:
    assert any("the vectors' sign, axes and unit" in line for line in not_told(full_motion(scene("still"))))


def test_vectors_that_are_all_one_before_a_camera_that_stands_are_not_called_short(scene: Scene) -> None:
    frames = [replace(f, motion=np.full((f.height, f.width, 2), 2.0, np.float32)) for f in scene("still")]
    assert "the vectors' sign, axes and unit: before a camera that stands all are alike" in not_told(frames)
    assert not any("longer than" in line for line in not_told(frames))


def test_jitter_that_nothing_shows_is_unverifiable(scene: Scene) -> None:
    flat = [replace(frame, colour=np.full_like(frame.colour, 0.5)) for frame in scene("still")]
    assert any(line.startswith("the jitter") for line in not_told(flat))
    assert not any(line.startswith("the jitter") for line in not_told(scene("still")))
    assert not any(line.startswith("the jitter") for line in not_told([replace(f, jitter_px=(0.0, 0.0)) for f in flat]))


def test_a_plane_that_the_camera_moves_along_has_one_vector(small: Scene) -> None:
    frames = full_motion(small("charts_drift")[:8])
    assert mistakes(frames) == []
    assert mistakes(MISTAKES["motion-negated"].plant(frames)) == ["motion-negated"]
    assert "motion-zero-is-camera" in mistakes([replace(frame, motion=np.zeros_like(frame.motion)) for frame in frames])
    assert any("the unit of depth" in line for line in not_told(frames))  # no perspective


@pytest.mark.parametrize(
    ("name", "count", "mistake", "words"),
    [
        ("cloth", 8, "motion-swapped", "which is x"),
        ("spinner", 8, "motion-scaled-2", "their size"),
        ("pan", 8, "motion-y-flipped", "the sign of y"),
        ("everything", 16, "motion-negated", "their sign"),
        ("everything", 16, "motion-jittered-reversed", "jitter in them"),
    ],
)
def test_wrong_vectors_that_are_not_named_are_said_to_be_unverifiable(
    name: str, count: int, mistake: str, words: str, small: Scene
) -> None:
    """By spoilt frames as by right ones."""
    frames = full_motion(small(name)[:count]) if name == "pan" else small(name)[:count]
    spoilt = MISTAKES[mistake].plant(frames)
    assert mistakes(spoilt) == []
    assert any("the vectors: " in line and words in line for line in not_told(spoilt))
    assert any("the vectors: " in line and words in line for line in not_told(frames))


def test_vectors_that_fill_the_picture_of_a_camera_that_travels_tell_all_of_themselves(small: Scene) -> None:
    """Where the pictures alone, slow and coarse, would not (``tells_map``)."""
    assert not any("the vectors" in line for line in not_told(full_motion(small("everything"))))


def test_it_is_printed(scene: Scene, tmp_path: Path) -> None:
    write_own(tmp_path, scene("still"))
    done = CliRunner().invoke(root, ["check", str(tmp_path)])
    assert f"? cannot tell {STANDS}" in done.stdout
    assert done.exit_code == 0


ALONE = "no frame here follows another; give 8 or more in a row"


def test_a_single_frame_gets_no_finding_that_needs_two(scene: Scene) -> None:
    """No mistake is found, whatever is wrong with its vectors: silence must not be taken for a yes."""
    first = scene("occluder")[:1]
    assert mistakes(MISTAKES["motion-negated"].plant(first)) == []
    assert not_told(first)[0] == f"matrices, the unit of depth, vectors, jitter: {ALONE}"
    window = (first[0].width, first[0].height)
    assert not_told([make_frame(0)])[-1] == f"the kind of depth: {FLAT}"  # it is noise
    bare = [replace(first[0], motion=None)]
    assert unverifiable(Shot(bare, window, has_camera=False, has_depth=False, has_jitter=False)) == [f"jitter: {ALONE}"]


def test_nor_of_frames_with_a_gap_or_a_cut_between_each_and_the_next(scene: Scene) -> None:
    frames = scene("corridor")
    for apart in (frames[::2], [replace(frame, cut=True) for frame in frames]):
        (line,) = [line for line in not_told(apart) if "jitter" in line]
        assert line == f"matrices, the unit of depth, jitter: {ALONE}"
