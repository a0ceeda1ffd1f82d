"""Pairs of frames: which are neighbours, which points count, what moves, and where the cameras say it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.lab.check.registration import Pair, Shot
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

Two = tuple[float, float]
STANDS, NOWHERE = make_camera(), (np.nan, np.nan)


def shot(*frames: Frame) -> Shot:
    return Shot(frames, (WIDTH, HEIGHT))


def pair_of(now: Frame, before: Frame) -> Pair:
    (pair,) = shot(before, now).pairs
    return pair


def test_a_cut_and_a_gap_part_two_frames() -> None:
    frames = [make_frame(0), make_frame(1), make_frame(2, cut=True), make_frame(3), make_frame(5), make_frame(6)]
    found = [(pair.previous.index, pair.frame.index) for pair in shot(*frames).pairs]
    assert found == [(0, 1), (2, 3), (5, 6)]
    apart = [replace(make_frame(index), step=3) for index in (0, 3, 9, 12)]
    assert [(pair.previous.index, pair.frame.index) for pair in shot(*apart).pairs] == [(0, 3), (9, 12)]


def test_reactive_and_non_finite_pixels_are_not_used() -> None:
    frame = make_frame(1)
    colour, reactive = frame.colour.copy(), np.zeros((HEIGHT, WIDTH), np.float32)
    colour[4, 7, 1] = np.nan  # one channel is enough
    colour[5, 8, 2] = np.inf
    reactive[6, 9], reactive[7, 10] = 0.05, 0.2
    pair = pair_of(replace(frame, colour=colour, reactive=reactive), make_frame(0))
    unused = {(int(pair.y[n]), int(pair.x[n])) for n in np.flatnonzero(~pair.usable)}
    assert unused == {(4, 7), (5, 8), (7, 10)}


def test_the_scale_is_twice_the_deviation_of_the_signal() -> None:
    pair = pair_of(make_frame(1), make_frame(0))
    assert pair.scale == 2 * np.std(pair.now)
    flat = replace(make_frame(1), colour=np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    assert pair_of(flat, replace(flat, index=0)).scale >= 1e-6  # nothing is divided by 0


def with_motion(motion: np.ndarray, camera: Camera = STANDS) -> Pair:
    frame = replace(make_frame(1, camera=camera), motion=motion.astype(np.float32))
    return pair_of(frame, make_frame(0, camera=STANDS))


def moving(pair: Pair) -> list[bool]:
    """Of each column, where all its rows agree."""
    rows: np.ndarray = pair.moving.reshape(HEIGHT, WIDTH)
    assert (rows == rows[0]).all()
    return [bool(column) for column in rows[0]]


def columns(rest: Two, move: Two, few: int) -> np.ndarray:
    """Vectors [H, W, 2] that are ``rest``, and in the first ``few`` columns ``move``."""
    motion = np.empty((HEIGHT, WIDTH, 2))
    motion[:], motion[:, :few] = rest, move
    return motion


def test_what_has_a_vector_moves() -> None:
    """Where few have one, and wherever the camera travels."""
    assert moving(with_motion(columns(NOWHERE, (0.0, 0.0), 10))) == [True] * 10 + [False] * (WIDTH - 10)
    assert moving(with_motion(columns((1.0, 0.0), (3.0, 0.0), 10), make_camera((0.1, 0.0, 5.0)))) == [True] * WIDTH


@pytest.mark.parametrize("rest", [(0.0, 0.0), (2.0, -1.0)])
def test_in_a_picture_full_of_vectors_that_moves_which_goes_another_way_than_most(rest: tuple[float, float]) -> None:
    """Before a camera that stands; what is off by less than a thousandth of the fastest was rounded."""
    right, down = rest
    motion = columns(rest, (right, down + 4.0), 10)
    motion[:, 10] = right + 0.002, down
    motion[:, 11] = right + 0.02, down
    assert moving(with_motion(motion)) == [True] * 10 + [False, True] + [False] * (WIDTH - 12)


def test_where_all_have_one_vector_nothing_moves() -> None:
    assert moving(with_motion(columns((2.0, -1.0), (2.0, -1.0), 10))) == [False] * WIDTH


def test_where_less_than_half_rests_all_that_has_a_vector_moves() -> None:
    motion = columns((0.0, 0.0), (1.0, 0.0), WIDTH // 3)
    motion[:, -(WIDTH // 3) :] = -1.0, 0.0
    assert moving(with_motion(motion)) == [True] * WIDTH


def test_the_cameras_motion_is_that_of_the_projected_points() -> None:
    """A few dozen operations on numbers below 100, of which an inverse may cost three digits: 50 * 1e5 * 2^-53."""
    jitter = (0.375, -0.25)
    frame = make_frame(1, camera=make_camera((0.3, -0.2, 4.5)), jitter_px=jitter)
    pair = pair_of(frame, make_frame(0, camera=STANDS, jitter_px=(-0.5, 0.125)))
    size = np.array([[WIDTH], [-HEIGHT]]) / 2
    px = np.stack([pair.x + 0.5 + jitter[0] - WIDTH / 2, pair.y + 0.5 + jitter[1] - HEIGHT / 2])
    seen = np.isfinite(frame.depth.ravel())
    depth = frame.depth.ravel()[seen].astype(np.float64)
    view = np.concatenate([px[:, seen] / size * depth, [-depth, np.ones_like(depth)]])
    view[:2] /= np.diag(frame.camera.view_to_clip)[:2, None]
    world = np.linalg.inv(frame.camera.world_to_view) @ view
    clip = STANDS.view_to_clip @ STANDS.world_to_view @ world
    before = clip[:2] / clip[3] * size
    np.testing.assert_allclose(pair.camera_motion()[:, seen], before - px[:, seen], rtol=0, atol=6e-10)
    # The sky does not move before a camera that does not turn.
    assert np.abs(pair.camera_motion()[:, ~seen]).max() < 6e-10
    assert not pair_of(frame, replace(frame, index=0)).camera_motion().any()


def test_the_declared_motion_is_the_channel_and_elsewhere_the_cameras() -> None:
    pair = with_motion(columns(NOWHERE, (0.25, -4.0), 10), make_camera((0.3, -0.2, 4.5)))
    declared, given = pair.declared_motion(), pair.x < 10
    assert (declared[:, given] == [[0.25], [-4.0]]).all()
    np.testing.assert_array_equal(declared[:, ~given], pair.camera_motion()[:, ~given])


def test_a_point_that_was_behind_the_camera_has_no_motion() -> None:
    """The camera went back by 5: what is 4 before it now was 1 behind it then."""
    pair = pair_of(
        make_frame(1, camera=make_camera((0.0, 0.0, 5.0))), make_frame(0, camera=make_camera((0.0, 0.0, 0.0)))
    )
    for distance, seen in ((4.0, False), (10.0, True)):
        motion = pair.camera_motion(inverse_depth=np.full(len(pair.x), 1.0 / distance))
        assert np.isfinite(motion).all() == np.isfinite(motion).any() == seen


def test_the_change_of_jitter_is_this_frames_minus_the_last_ones() -> None:
    pair = pair_of(make_frame(1, jitter_px=(0.5, -0.25)), make_frame(0, jitter_px=(0.125, 0.25)))
    assert pair.jitter_change.tolist() == [0.375, -0.5]
