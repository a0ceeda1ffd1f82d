"""Depth and motion against planes whose every pixel is worked out in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.errors import InternalError
from cltaa.frame import Effect
from cltaa_datasets.animation import rotation
from cltaa_datasets.scene import Matrix, Part, Scene, Shape
from tests.capture.analytic_scenes import (
    HEIGHT,
    LENS,
    PIXELS,
    WHITE,
    WIDTH,
    drawing,
    instant,
    place,
    quad,
    sample_ndc,
    scene,
    seen_points,
    to_pixels,
)

U = 2.0**-24
# Reversed depth near/Z is a plane over the picture, evaluated in float32 as a + bx + cy: four roundings of terms not
# larger than the depth of the nearest point, and as many for the vertices. Relative to the depth of a point Z that is
# 8 u Z / Z_nearest; worst seen 4.3 u.
DEPTH_ROUNDINGS = 8
# Bound of the resolve's own reprojection (docs/conventions.md); worst seen half of it, at 48 x 32 and at 1920 x 1080.
MOTION_ERROR = 2.0**-20  # pixels, times the motion where that is above one pixel

STILL = np.eye(4)
TILTED = place(0.0, 0.0, -6.0) @ rotation((1.0, 0.4, 0.0), -1.2)
TILTED_BEFORE = place(0.1, 0.05, -6.1) @ rotation((1.0, 0.5, 0.0), -1.22)
PANNED, PANNED_BEFORE = rotation((0.0, 1.0, 0.0), 0.02), rotation((0.0, 1.0, 0.0), 0.05) @ place(0.0, 0.1, 0.2)
FAR_OFF = (1e6, 3e5, -1e6)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), FAR_OFF])
@pytest.mark.parametrize(
    ("pose", "before", "view", "view_before"),
    [
        (place(0.0, 0.0, -4.0), place(0.1, 0.0, -4.0), STILL, STILL),
        (TILTED, TILTED_BEFORE, STILL, STILL),
        (TILTED, TILTED_BEFORE, PANNED, PANNED_BEFORE),
    ],
    ids=["slides", "tumbles", "tumbles under a moving camera"],
)
def test_depth_and_motion_of_a_plane(
    pose: Matrix, before: Matrix, view: Matrix, view_before: Matrix, origin: tuple[float, float, float]
) -> None:
    there, back = place(*origin), place(-origin[0], -origin[1], -origin[2])
    pose, before, view, view_before = there @ pose, there @ before, view @ back, view_before @ back
    jitter = (0.3, -0.2)
    now, earlier = instant(pose, lens=LENS, view=view), instant(before, lens=LENS, view=view_before)
    with drawing(scene(lambda _: now, (quad(12.0), WHITE), effects="motion camera")) as renderer:
        drawn = renderer.draw(now, earlier, jitter)
    points, hit = seen_points(pose, view, LENS, jitter), np.isfinite(drawn.depth)
    assert hit.mean() > 0.7
    planar = -(points @ (view @ pose).T)[..., 2]
    bound = DEPTH_ROUNDINGS * U * planar / planar[hit].min()
    assert np.all((np.abs(drawn.depth - planar) <= bound * planar)[hit])
    assert drawn.motion is not None
    motion = to_pixels(points, before, view_before, LENS) - to_pixels(points, pose, view, LENS)
    error = np.abs(drawn.motion - motion)[hit]
    assert error.max() <= MOTION_ERROR * max(1.0, np.abs(motion[hit]).max())
    assert np.isnan(drawn.motion[~hit]).all()


def test_motion_is_in_pixels_right_and_down() -> None:
    # It came from two pixels left of and three above where it is now.
    now, before = instant(STILL), instant(place(-2.0, 3.0, 0.0))
    with drawing(scene(lambda _: now, (quad(4.0), WHITE), effects="motion")) as renderer:
        drawn = renderer.draw(now, before, (0.4, 0.1))
    assert drawn.motion is not None
    assert drawn.motion[HEIGHT // 2, WIDTH // 2].tolist() == [-2.0, -3.0]


def test_motion_does_not_depend_on_the_jitter() -> None:
    now, before = instant(place(0.0, 0.0, -4.0), lens=LENS), instant(place(0.3, -0.1, -4.0), lens=LENS)
    with drawing(scene(lambda _: now, (quad(12.0), WHITE), effects="motion")) as renderer:
        one, other = (renderer.draw(now, before, jitter).motion for jitter in ((0.0, 0.0), (-0.4, 0.3)))
    assert one is not None
    assert other is not None
    assert np.abs(one - other).max() <= 2.0 * MOTION_ERROR * np.abs(one).max()


def test_what_stands_still_is_no_vector_even_before_what_moves() -> None:
    now = instant(place(0.0, 0.0, 1.0), STILL)
    before = instant(place(0.0, 0.0, 1.0), place(1.0, 0.0, 0.0), view=place(3.0, 0.0, -5.0))
    what = scene(lambda _: now, (quad(4.0), WHITE), (quad(12.0), WHITE), effects="motion camera")
    with drawing(what) as renderer:
        motion = renderer.draw(now, before, (0.0, 0.0)).motion
    assert motion is not None
    middle = motion[HEIGHT // 2, WIDTH // 2 - 12 : WIDTH // 2 + 12]
    assert np.isnan(middle[8:16]).all()
    assert middle[:8].tolist() == middle[16:].tolist() == [[4.0, 0.0]] * 8  # own motion 1 and the camera's 3
    assert np.isnan(motion[0]).all()


def test_a_point_that_was_behind_the_camera_leads_out_of_the_picture() -> None:
    now, before = instant(place(0.0, 0.0, -1.0), lens=LENS), instant(place(0.0, 0.0, 2.0), lens=LENS)
    with drawing(scene(lambda _: now, (quad(12.0), WHITE), effects="motion")) as renderer:
        motion = renderer.draw(now, before, (0.0, 0.0)).motion
    assert motion is not None
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    previous = np.stack([x, y], -1) + motion
    assert np.isfinite(previous).all()
    outside = ((previous < 0.0) | (previous > (WIDTH, HEIGHT))).any(axis=-1)
    assert outside.all()


def test_depth_is_planar() -> None:
    now = instant(place(0.0, 0.0, -7.5), lens=LENS)
    with drawing(scene(lambda _: now, (quad(40.0), WHITE))) as renderer:
        depth = renderer.draw(now, now, (0.1, 0.2)).depth
    assert len(np.unique(depth)) == 1  # the same at the corners, where the ray is longer
    assert abs(depth[0, 0] / 7.5 - 1.0) <= DEPTH_ROUNDINGS * U


def test_nearer_surfaces_hide_farther_ones_at_any_distance() -> None:
    # Two planes a ten-thousandth apart, 10 km off: float32 distance itself resolves 5e-8 of it.
    now = instant(place(0.0, 0.0, -1e4), place(0.0, 0.0, -1e4 * 1.0001), lens=LENS)
    parts = (quad(2e4), WHITE), (quad(2e4), WHITE)
    with drawing(scene(lambda _: now, *parts)) as renderer:
        assert np.unique(renderer.draw(now, now, (0.0, 0.0)).depth).tolist() == [1e4]


def test_parallel_lens_has_even_depth() -> None:
    tilt = rotation((0.0, 1.0, 0.0), 0.1)
    now = instant(tilt)
    with drawing(scene(lambda _: now, (quad(10.0), WHITE))) as renderer:
        depth = renderer.draw(now, now, (0.0, 0.0)).depth
    x = sample_ndc()[..., 0] * WIDTH / 2.0
    expected = 5.0 + x * np.tan(0.1)
    hit = np.isfinite(depth)
    assert hit.sum() == 20 * 20
    # Reversed depth of a parallel lens is even over its range of 8 metres.
    assert np.abs(depth - expected)[hit].max() <= DEPTH_ROUNDINGS * U * (PIXELS.far - PIXELS.near)


def test_channels_that_the_scene_does_not_call_for_are_not_drawn() -> None:
    now = instant(STILL)
    with drawing(scene(lambda _: now, (quad(4.0), WHITE), effects="camera")) as renderer:
        drawn = renderer.draw(now, now, (0.0, 0.0))
    assert drawn.motion is None
    assert drawn.reactive is None


def test_a_broken_promise_of_stillness_is_an_error() -> None:
    now, before = instant(STILL), instant(place(1.0, 0.0, 0.0))
    with (
        drawing(scene(lambda _: now, (quad(4.0), WHITE), effects="camera")) as renderer,
        pytest.raises(InternalError, match="declares no motion, but part 0 moves"),
    ):
        renderer.draw(now, before, (0.0, 0.0))


def test_motion_of_a_shape_that_deforms() -> None:
    # A quad whose corners go their own ways: its motion is bilinear over the quad, linear over each triangle.
    mesh, up = quad(8.0), np.tile([0.0, 0.0, 1.0], (4, 1))
    rest = np.asarray(mesh.vertices, np.float64)
    step = np.array([[0.5, -0.25, 0.0], [0.5, -0.25, 0.0], [2.0, 1.0, 0.0], [2.0, 1.0, 0.0]])
    part = Part("sheet", mesh, WHITE, deforms=True)
    now, before = (replace(instant(STILL), shapes={"sheet": Shape(positions, up)}) for positions in (rest, rest + step))
    with drawing(Scene("analytic", frozenset({Effect.MOTION}), (part,), lambda _: now)) as renderer:
        motion = renderer.draw(now, before, (0.0, 0.0)).motion
    assert motion is not None
    rows, columns = np.nonzero(np.isfinite(motion[..., 0]))
    assert len(rows) == 16 * 16
    # Vertices 0 and 1 are the lower ones of ``meshes.sheet``: the share of the upper pair grows upwards.
    share = (HEIGHT / 2.0 + 8.0 - (rows + 0.5)) / 16.0
    expected = np.stack([0.5 + 1.5 * share, -(-0.25 + 1.25 * share)], -1)
    assert np.abs(motion[rows, columns] - expected).max() <= 2.0 * MOTION_ERROR


def test_a_shape_that_stays_has_no_motion_of_its_own() -> None:
    mesh = quad(8.0)
    shape = Shape(np.asarray(mesh.vertices) / 3.0, np.tile([0.0, 0.0, 1.0], (4, 1)))
    part = Part("sheet", mesh, WHITE, deforms=True)
    now = replace(instant(STILL), shapes={"sheet": shape})
    same = Shape(shape.positions.copy(), shape.normals)
    before = replace(instant(STILL), shapes={"sheet": same})
    with drawing(Scene("analytic", frozenset({Effect.MOTION}), (part,), lambda _: now)) as renderer:
        motion = renderer.draw(now, before, (0.0, 0.0)).motion
    assert motion is not None
    assert np.all(np.isnan(motion) | (motion == 0.0))


def test_a_deforming_part_without_a_shape_is_an_error() -> None:
    part = Part("sheet", quad(), WHITE, deforms=True)
    with (
        drawing(Scene("analytic", frozenset(), (part,), lambda _: instant(STILL))) as renderer,
        pytest.raises(InternalError, match="part sheet deforms, but an instant does not say how it stands"),
    ):
        renderer.draw(instant(STILL), instant(STILL), (0.0, 0.0))
