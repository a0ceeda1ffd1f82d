"""Jitter in a projection, one that turns the picture over, and the words and numbers of findings about matrices."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.lab.check.camera import (
    MOST_PAIRS,
    camera_residual,
    check_structure,
    check_travel,
    check_upside_down,
    moving_pairs,
)
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.projection_jitter import check_projection_jitter
from cltaa.lab.check.registration import Pair, Shot
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import FLIP_Y, MISTAKES, camera_delayed, camera_jittered, full_motion
from tests.numerics.exact_cameras import orthographic
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

OFFSETS = [(0.1, -0.4), (-0.3, 0.2), (0.4, 0.45), (-0.15, -0.05), (0.25, -0.2)]
PARALLEL = Camera(np.eye(4), orthographic(2.0, 1.5))


def shot(frames: Sequence[Frame]) -> Shot:
    return Shot(frames, (WIDTH, HEIGHT))


def found(frames: Sequence[Frame]) -> list[str]:
    return [finding.name for finding in check_projection_jitter(shot(frames))]


def frames_of(camera: Camera) -> list[Frame]:
    return [make_frame(index, camera=camera, jitter_px=jitter) for index, jitter in enumerate(OFFSETS)]


def with_clip(change: Callable[[np.ndarray], np.ndarray], camera: Camera) -> Camera:
    return Camera(camera.world_to_view, change(camera.view_to_clip))


@pytest.mark.parametrize("camera", [make_camera(), PARALLEL], ids=["perspective", "parallel"])
def test_a_centre_that_follows_the_jitter_is_named(camera: Camera) -> None:
    frames = frames_of(camera)
    assert found(frames) == []
    jittered = [camera_jittered(frame) for frame in frames]
    assert found(jittered) == ["camera-jittered"]
    assert found(jittered[:3]) == ["camera-jittered"]
    assert found(jittered[:2]) == []  # a difference of two frames follows anything


def test_it_does_so_about_a_centre_that_lies_elsewhere() -> None:
    shift = np.eye(4)
    shift[0, 3], shift[1, 3] = 0.3, -0.2
    frames = [camera_jittered(frame) for frame in frames_of(with_clip(lambda clip: shift @ clip, make_camera()))]
    assert found(frames) == ["camera-jittered"]


@pytest.mark.parametrize(("share", "names"), [(0.5, []), (0.95, ["camera-jittered"]), (1.5, [])])
def test_a_centre_that_moves_by_another_length_does_not_follow(share: float, names: list[str]) -> None:
    frames = []
    for frame in frames_of(make_camera()):
        x, y = frame.jitter_px
        frames.append(replace(camera_jittered(replace(frame, jitter_px=(share * x, share * y))), jitter_px=(x, y)))
    assert found(frames) == names


@pytest.mark.parametrize(("size", "names"), [(0.02, ["camera-jittered"]), (0.2, [])])
def test_a_centre_that_also_moves_on_its_own_does_not_follow(size: float, names: list[str]) -> None:
    """By more than a twentieth of a pixel, in a way that has nothing in common with the jitter."""
    beside = np.linalg.svd(np.column_stack([np.ones(len(OFFSETS)), OFFSETS]))[0][:, -1]  # of length 1, over 5 frames
    frames = []
    for frame, down in zip(frames_of(make_camera()), size * beside, strict=True):
        x, y = frame.jitter_px
        frames.append(replace(camera_jittered(replace(frame, jitter_px=(x, y + float(down)))), jitter_px=(x, y)))
    assert found(frames) == names


def test_an_upside_down_projection_is_found() -> None:
    """An upright one is jittered the wrong way, of which nothing is said."""
    flipped = with_clip(lambda clip: FLIP_Y @ clip, make_camera())
    for camera, expected in ((flipped, ["camera-y-flipped"]), (make_camera(), [])):
        frames = []
        for frame in frames_of(camera):
            x, y = frame.jitter_px
            frames.append(replace(camera_jittered(replace(frame, jitter_px=(x, -y))), jitter_px=(x, y)))
        assert found(frames) == expected


@pytest.mark.parametrize(("by", "name", "which"), [(1, "late", "next"), (-1, "early", "previous")])
def test_matrices_of_another_frame_are_reported_with_their_delay(by: int, name: str, which: str, scene: Scene) -> None:
    (finding,) = check_travel(shot(camera_delayed(by)(scene("dolly"))))
    assert (finding.name, finding.fix) == (f"camera-{name}", {"camera": {"delay": by}})
    assert finding.what == f"each frame's true matrices are those of the {which} frame"
    # Both residuals are said to three digits, of about 0.3 and 0.5.
    right, declared = (float(number) for number in re.findall(r"0\.\d{3}", finding.evidence))
    assert right < declared
    assert finding.settled == finding  # sure enough to be no question


def test_matrices_that_nobody_declared_are_not_judged(scene: Scene) -> None:
    frames = MISTAKES["camera-late"].plant(scene("dolly"))
    assert check_travel(Shot(frames, (frames[0].width, frames[0].height), has_camera=False)) == []


def test_of_matrices_that_are_no_cameras_the_last_rows_are_shown() -> None:
    camera = make_camera((1.0, 2.0, 5.0))
    wrong = [make_frame(n, camera=Camera(camera.world_to_view.T, camera.view_to_clip.T)) for n in range(2)]
    (finding,), _ = check_structure(wrong)
    assert finding.name == "camera-transposed"
    rows = (
        "last rows -1 -2 -5 1 and 0 0 -0.2002 0 as read are no camera's, and are one's if the matrices are transposed"
    )
    assert finding.evidence.startswith(rows)
    nowhere: list[Finding]
    nowhere, change = check_structure([make_frame(n, camera=Camera(np.zeros((4, 4)), np.eye(4))) for n in (3, 4)])
    assert [(finding.name, change) for finding in nowhere] == [("camera-wrong", None)]
    assert nowhere[0].evidence.startswith("frame 3: ")


@pytest.mark.parametrize("name", ["world_to_view", "view_to_clip"])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_no_pixel_moves_by_matrices_without_an_inverse(name: str, value: float) -> None:
    frames = [make_frame(index) for index in range(3)]
    frames[1] = replace(frames[1], camera=replace(frames[1].camera, **{name: np.full((4, 4), value)}))
    to_it, from_it = shot(frames).pairs
    assert np.isnan(to_it.camera_motion()).all()
    from_it.camera_motion()  # means nothing, but raises nothing


@pytest.mark.parametrize(("frames", "looked_at"), [(2, 1), (7, 6), (8, 4), (13, 6), (20, 5)])
def test_of_many_pairs_some_are_looked_at_evenly_apart(frames: int, looked_at: int) -> None:
    pairs = moving_pairs(shot([make_frame(index) for index in range(frames)]))
    assert len(pairs) == looked_at <= MOST_PAIRS
    assert pairs[0].frame.index == 1
    assert len({second.frame.index - first.frame.index for first, second in pairwise(pairs)}) <= 1
    assert moving_pairs(shot([make_frame(index, camera=make_camera()) for index in range(frames)])) == []


@pytest.mark.parametrize(
    ("declared", "otherwise", "named"),
    [
        ((0.9, 0.9, 0.9, 0.9), (0.2, 0.2, 0.2, 0.2), True),
        ((0.9, 0.1, 0.1, 0.1), (0.1, 0.12, 0.12, 0.12), False),  # less in the mean, but by one pair of four
        ((0.9, 0.9, 0.1, 0.1), (0.2, 0.2, 0.105, 0.105), True),  # two that say next to nothing do not count
    ],
)
def test_most_of_the_pairs_that_tell_must_agree(
    declared: Sequence[float], otherwise: Sequence[float], named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def residual(pair: Pair, motion: np.ndarray) -> float:
        as_declared = not motion.any() or np.array_equal(motion, pair.camera_motion(), equal_nan=True)
        return (declared if as_declared else otherwise)[pair.frame.index - 1]

    monkeypatch.setattr("cltaa.lab.check.camera.camera_residual", residual)
    places = [(0.0, 0.0, 5.0), (0.3, 0.2, 5.1), (0.4, 0.6, 5.4), (1.0, 0.5, 5.5), (1.1, 0.9, 5.2)]
    frames = [make_frame(index, camera=make_camera(place)) for index, place in enumerate(places)]
    assert bool(check_travel(shot(frames))) is named


@pytest.mark.parametrize("columns", [0, WIDTH // 2, WIDTH])
def test_cameras_are_judged_by_what_has_no_vector_or_else_by_all(columns: int) -> None:
    """Pictures that are the same but in the columns with vectors; where all have one, the same throughout."""
    before, other = make_frame(0), make_frame(9)
    colour, motion = before.colour.copy(), np.full((HEIGHT, WIDTH, 2), np.nan, np.float32)
    motion[:, :columns] = 1.0
    if columns < WIDTH:
        colour[:, : max(columns - 12, 0)] = other.colour[:, : max(columns - 12, 0)]  # farther than the signal's blur
    (pair,) = shot([before, replace(before, index=1, colour=colour, motion=motion)]).pairs
    assert camera_residual(pair, np.zeros((2, len(pair.x)))) < 0.1


FLIP_X = np.diag([-1.0, 1.0, 1.0, 1.0])


def climbing(flip: np.ndarray = FLIP_Y) -> list[Frame]:
    """Three frames of a camera that climbs, whose projection is turned over by ``flip``."""
    cameras = [make_camera((0.0, 0.2 * index, 5.0)) for index in range(3)]
    return [make_frame(n, camera=Camera(c.world_to_view, flip @ c.view_to_clip)) for n, c in enumerate(cameras)]


def turned_over(frames: Sequence[Frame]) -> list[Finding]:
    return check_upside_down(Shot(frames, (WIDTH, HEIGHT)))


def test_nothing_bears_it_out() -> None:
    (finding,) = turned_over(climbing())
    assert finding.name == "camera-y-flipped"
    assert finding.fix == {"camera": {"flip_y": True}}
    assert finding.evidence == "it scales y by -1.73 and x by 1.08: the world would be seen mirrored"


@pytest.mark.parametrize("flip", [np.eye(4), FLIP_X, FLIP_X @ FLIP_Y], ids=["upright", "mirrored", "half-a-turn"])
def test_what_keeps_y_or_turns_both_is_not_looked_at(flip: np.ndarray) -> None:
    assert turned_over(climbing(flip)) == []


def between(share: float) -> list[Frame]:
    """Vectors in every pixel, ``share`` of the way from the declared camera's to those of the camera turned over."""
    frames = climbing()
    ways = zip(frames, full_motion(frames), full_motion(climbing(np.eye(4))), strict=True)
    out = []
    for frame, declared, turned in ways:
        assert declared.motion is not None
        assert turned.motion is not None
        vectors = declared.motion + np.float32(share) * (turned.motion - declared.motion)
        out.append(replace(frame, motion=vectors))
    return out


@pytest.mark.parametrize(("share", "names"), [(0.0, []), (0.15, []), (0.3, ["camera-y-flipped"])])
def test_vectors_that_fill_the_picture_bear_it_out_where_they_are_clearly_its_own(
    share: float, names: list[str]
) -> None:
    """A quarter as far from the declared motion as from the other, which 0.2 of the way is."""
    assert [finding.name for finding in turned_over(between(share))] == names


def test_they_must_do_so_in_every_pair() -> None:
    assert len(turned_over([*between(0.0)[:2], between(1.0)[2]])) == 1


@pytest.mark.parametrize(("rows", "count"), [(HEIGHT, 0), (HEIGHT // 2 + 2, 0), (HEIGHT // 2 - 2, 1)])
def test_vectors_of_less_than_half_the_picture_do_not_bear_it_out(rows: int, count: int) -> None:
    frames = between(0.0)
    for frame in frames:
        assert frame.motion is not None
        frame.motion[rows:] = np.nan
    assert len(turned_over(frames)) == count
