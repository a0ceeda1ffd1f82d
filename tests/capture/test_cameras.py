"""Camera matrices against points whose picture is known, and depth against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.frame import Camera
from cltaa_capture.cameras import (
    clip_to_world_direction,
    jitter_ndc,
    planar_depth,
    reversed_projection,
    view_to_clip,
)
from cltaa_datasets.animation import look_at
from cltaa_datasets.scene import Orthographic, Perspective

LENS = Perspective(field_of_view=np.radians(50.0), near=0.25)
PARALLEL = Orthographic(half_height=3.0, near=1.0, far=9.0)
ROUNDING = 2.0**-48  # a dozen float64 operations on numbers of size 1


def test_perspective_maps_the_corner_of_the_view_to_the_corner_of_ndc() -> None:
    up = np.tan(np.radians(25.0)) * 7.0
    clip = view_to_clip(LENS, 2.0) @ [2.0 * up, up, -7.0, 1.0]
    assert np.abs(clip[:2] / clip[3] - 1.0).max() <= ROUNDING
    assert clip[3] == 7.0


def test_near_plane_is_minus_one_and_infinity_is_one() -> None:
    matrix = view_to_clip(LENS, 1.0)
    near, far = matrix @ [0.0, 0.0, -0.25, 1.0], matrix @ [0.0, 0.0, -1.0, 0.0]
    assert near[2] / near[3] == -1.0
    assert far[2] / far[3] == 1.0


def test_parallel_lens_maps_its_box_to_ndc() -> None:
    matrix = view_to_clip(PARALLEL, 1.5)
    assert np.abs(matrix @ [4.5, 3.0, -1.0, 1.0] - [1.0, 1.0, -1.0, 1.0]).max() <= ROUNDING
    assert np.abs(matrix @ [-4.5, -3.0, -9.0, 1.0] - [-1.0, -1.0, 1.0, 1.0]).max() <= ROUNDING


@pytest.mark.parametrize("lens", [LENS, PARALLEL])
def test_reversed_depth_and_back(lens: Perspective | Orthographic) -> None:
    planar = np.array([lens.near, 1.5, 2.0, 8.0])
    clip = reversed_projection(lens, 1.0) @ np.stack([0 * planar, 0 * planar, -planar, 0 * planar + 1.0])
    device = (clip[2] / clip[3]).astype(np.float32)
    assert device[0] == 1.0
    assert np.all(np.diff(device) < 0.0)
    # One rounding of the device depth, relative (perspective) or to the range of 8 metres (parallel), and one here.
    assert np.abs(planar_depth(device, lens) - planar).max() <= 2.0 * 8.0 * 2.0**-24


@pytest.mark.parametrize("lens", [LENS, PARALLEL])
def test_nothing_drawn_is_infinitely_far(lens: Perspective | Orthographic) -> None:
    assert planar_depth(np.zeros((2, 3), np.float32), lens).tolist() == [[np.inf] * 3] * 2


def test_jitter_moves_the_picture_against_the_sample() -> None:
    # A quarter of a pixel right and an eighth down: in NDC of 64 x 16 pixels, y up, the picture goes left and up.
    assert jitter_ndc((0.25, 0.125), 64, 16) == (-2.0 * 0.25 / 64, 2.0 * 0.125 / 16)


def test_direction_seen_at_a_point_of_the_picture() -> None:
    camera = Camera(look_at((1.0, 2.0, 3.0), (0.0, 1.5, -4.0)), view_to_clip(LENS, 1.5))
    direction = np.array([0.3, -0.2, -0.9])
    clip = camera.view_to_clip @ camera.world_to_view @ np.append(direction, 0.0)  # a point at infinity
    found = clip_to_world_direction(camera) @ [clip[0] / clip[3], clip[1] / clip[3], 1.0]
    assert np.abs(found / np.linalg.norm(found) - direction / np.linalg.norm(direction)).max() <= ROUNDING


def test_parallel_lens_sees_one_direction() -> None:
    camera = Camera(look_at((0.0, 2.0, 3.0), (0.0, 2.0, -4.0)), view_to_clip(PARALLEL, 1.5))
    assert (clip_to_world_direction(camera) @ [0.7, -0.4, 1.0]).tolist() == [0.0, 0.0, -1.0]
