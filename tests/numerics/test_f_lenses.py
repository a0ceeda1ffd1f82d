"""Failure modes of reprojection where the axis of the lens is not the picture's centre; see docs/numerics.md."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.camera import SKY_ORTHOGRAPHIC, SKY_PERSPECTIVE, displacement, inverse_depth
from cltaa.frame import Camera
from cltaa.lab.check.registration import planar_inverse_depth
from tests.numerics.exact_cameras import orthographic, perspective, rotation, view_at
from tests.numerics.test_f_reprojection import TURN, compared, worst
from tests.sequence_factory import make_camera

HEIGHT, WIDTH = 36, 48
PERSPECTIVE, PARALLEL = perspective(WIDTH / HEIGHT), orthographic(2.0, 1.5)


def moved_by(clip: NDArray[np.float64], column: int, x: float, y: float) -> NDArray[np.float64]:
    """A projection whose picture lies elsewhere: by as much everywhere, or by the more the farther off."""
    other = clip.copy()
    other[:2, column] = x, y
    return other


@pytest.mark.parametrize(
    "clip",
    [
        moved_by(PERSPECTIVE, 2, 0.3, -0.2),  # shifted, as a part of a larger picture is
        moved_by(PERSPECTIVE, 3, 0.05, -0.02),  # an eye beside the middle, as for two of them
        moved_by(PARALLEL, 3, 0.4, -0.3),
        moved_by(PARALLEL, 2, 0.01, 0.02),  # sheared
    ],
    ids=["shifted", "beside", "parallel-shifted", "parallel-sheared"],
)
def test_f6_a_lens_off_the_centre_shows_where_things_were(clip: NDArray[np.float64]) -> None:
    depth = np.random.default_rng(34).uniform(1, 90, (HEIGHT, WIDTH)).astype(np.float32)
    position = np.array([10.0, 2.0, -3.0])
    after = view_at(position + np.array([0.01, 0.02, -0.1]), rotation((1, 1, 0), 0.05) @ TURN)
    error, exact, shown = compared(Camera(after, clip), Camera(view_at(position, TURN), clip), depth)
    assert shown.mean() > 0.5
    assert exact[shown].max() > 0.01
    assert worst(error, exact, shown) <= 1.0


@pytest.mark.parametrize("clip", [PARALLEL, moved_by(PARALLEL, 3, 0.4, -0.3)])
def test_f6_a_turn_brings_things_closer_to_an_orthographic_camera(clip: NDArray[np.float64]) -> None:
    turn = rotation((0.2, 1.0, 0.0), 3.0)
    camera, previous = Camera(np.eye(4), clip), Camera(view_at(np.array([0.0, 0.0, 2.0]), turn), clip)
    place = np.array([0.3, -0.4, -7.0])  # x right, y up, -distance
    n = clip[:2, :2] @ place[:2] + clip[:2, 3]
    p = np.array([n[0] * WIDTH / 2, -n[1] * HEIGHT / 2, place[2], 1.0])
    change = displacement(camera, previous, WIDTH, HEIGHT).inverse_depth @ p
    assert change == pytest.approx((turn @ (place - [0.0, 0.0, 2.0]))[2] - place[2], abs=1e-12)
    assert abs(change) > 1.0


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        (make_camera(), [SKY_PERSPECTIVE] * 5 + [0.5]),
        (Camera(np.eye(4), PARALLEL), [SKY_ORTHOGRAPHIC] * 3 + [-0.0, 1.0, -2.0]),
    ],
    ids=["perspective", "parallel"],
)
def test_f5_depth_that_is_no_distance_is_sky(camera: Camera, expected: list[Any]) -> None:
    depth, out = np.array([[np.nan, np.inf, -np.inf, 0.0, -1.0, 2.0]], np.float32), np.empty((1, 6), np.float32)
    inverse_depth(depth, out, parallel=camera.orthographic)
    assert out.tolist() == planar_inverse_depth(depth, camera).tolist() == [expected]  # the latter for cltaa check
    for place, value in enumerate(expected):  # each in a picture of its own, too
        inverse_depth(depth[:, place : place + 1], out[:, :1], parallel=camera.orthographic)
        assert out[0, 0] == value
