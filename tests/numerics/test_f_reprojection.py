"""Failure modes of reprojection and depth: docs/numerics.md, F1 to F6."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.camera import displacement
from cltaa.core.backend import Launcher
from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.constants import CONSTANTS
from cltaa.core.parameters import Choices, Dilation, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import override
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Frame
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import Work, run_stage
from tests.numerics.exact_cameras import displacement_of, orthographic, perspective, rotation, view_at
from tests.numerics.still_frames import unfiltered
from tests.sequence_factory import make_frame

# A few rows of a picture that is 3840 pixels and 93 degrees wide, with square pixels.
WIDE, ROWS = 3840, 28
LENS = perspective(WIDE / ROWS, zoom=0.95 * WIDE / ROWS)
TOLERANCE = 2.0**-20  # pixels, and of displacements longer than a pixel
TURN = rotation((0.3, 1.0, -0.2), 25.0)


def measured(
    camera: Camera, previous: Camera, depth: NDArray[Any], launcher: Launcher, jitter: tuple[float, float] = (0.0, 0.0)
) -> tuple[NDArray[np.float32], Work]:
    """Planes u, v, scale, shift, visible, ... [7, H, W] that the stage gives for ``depth`` [H, W]."""
    height, width = depth.shape
    layout = Layout(width, height)
    frames = [
        Frame(index=i, colour=np.zeros((height, width, 3), np.float32), depth=depth, camera=c, jitter_px=jitter)
        for i, c in enumerate((previous, camera))
    ]
    near = (-depth if camera.orthographic else 1 / depth).astype(np.float32)
    planes = {name: layout.zeros(count) for name, count in (("current", 3), ("alpha", 1), ("motion", 2))}
    planes["inverse_depth"] = padded(near[None], layout)
    steps = Steps(own_motion=False, orthographic=camera.orthographic)
    build = launcher.build(Build(choices=Choices(dilation=Dilation.NONE), steps=steps, strict=True))
    work = Work(layout, planes, frame_record(frames[1], Past.of(frames[0]), layout), settings_record(Settings()))
    return layout.inside(run_stage("surface_motion", build, work, launcher)["motion_out"]), work


def compared(
    camera: Camera, previous: Camera, depth: NDArray[Any], launcher: Launcher | None = None
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Error and length of the exact displacement in pixels, and where the previous frame shows the point, [H, W] each.

    The length is that of the displacement or of its part by turning, whichever is longer: travel may cancel turning.
    """
    height, width = depth.shape
    jitter = (0.21, -0.37)
    found, work = measured(camera, previous, depth, launcher or NumpyLauncher(), jitter)
    y, x = np.mgrid[:height, :width]
    px, py = x + 0.5 + jitter[0] - width / 2, y + 0.5 + jitter[1] - height / 2
    u, v, w = displacement_of(
        px, py, work.layout.inside(work.planes["inverse_depth"])[0], camera, previous, width, height
    )
    shown = (w > 0) & (np.abs(px + u) < width / 2) & (np.abs(py + v) < height / 2)
    error = np.hypot((found[0] - u).astype(float), (found[1] - v).astype(float))
    turned = displacement_of(px, py, np.zeros((height, width)), camera, previous, width, height)
    by_turning = 0.0 if camera.orthographic else np.hypot(turned[0], turned[1]).astype(float)
    return error, np.maximum(np.hypot(u, v).astype(float), by_turning), shown


def depths(height: int = ROWS, width: int = WIDE) -> NDArray[np.float32]:
    """1 to 1000 metres, some sky."""
    random = np.random.default_rng(31)
    depth = (10 ** random.uniform(0, 3, (height, width))).astype(np.float32)
    depth[random.random((height, width)) < 0.05] = np.inf
    return depth


def worst(error: NDArray[Any], exact: NDArray[Any], shown: NDArray[Any]) -> float:
    """Largest error among the points that the previous frame shows, in tolerances."""
    return float((error / (TOLERANCE * np.maximum(1.0, exact)))[shown].max())


def walk(position: NDArray[Any], step: float = 0.05, turned: float = 0.4) -> tuple[Camera, Camera]:
    """Camera and previous camera of somebody who walks and looks around."""
    before = view_at(position, TURN)
    after = view_at(position + step * np.array([0.4, 0.1, -1.0]), rotation((0, 1, 0.1), turned) @ TURN)
    return Camera(after, LENS), Camera(before, LENS)


@pytest.mark.parametrize("distance", [0.0, 1e3, 1e5, 1e6])
def test_f1_a_camera_far_from_the_origin_is_as_precise_as_one_at_it(distance: float) -> None:
    camera, previous = walk(distance * np.array([0.6, -0.5, 0.6]))
    error, exact, shown = compared(camera, previous, depths())
    assert shown.mean() > 0.3
    assert worst(error, exact, shown) <= 1.0
    assert error[shown].max() <= 1e-4


def test_f1_at_ten_million_metres_the_matrices_themselves_are_rounded() -> None:
    # Half a unit of the last place of 10^7 is 1e-9 m: at 1 m and 3,000 pixels a metre that is seen as 3e-6 pixels.
    camera, previous = walk(1e7 * np.array([0.6, -0.5, 0.6]))
    error, _, shown = compared(camera, previous, depths())
    assert error[shown].max() <= 1e-4


def test_f1_float32_world_space_would_be_wrong_by_pixels() -> None:
    camera, previous = walk(1e6 * np.array([0.6, -0.5, 0.6]))
    single = np.float32
    world = np.linalg.inv(camera.world_to_view) @ np.array([0.3, 0.001, -4.0, 1.0])

    def seen(c: Camera, kind: Any) -> float:
        x, _, _, w = (c.view_to_clip @ c.world_to_view).astype(kind) @ world.astype(kind)
        return float(x / w) * WIDE / 2

    moved, true = (seen(camera, kind) - seen(previous, kind) for kind in (single, np.longdouble))
    assert abs(moved - true) > 1.0


@pytest.mark.parametrize("motion", ["creep", "pan", "walk", "zoom", "roll"])
def test_f2_displacements_are_right_to_a_millionth_of_a_pixel(launcher: DeviceLauncher, motion: str) -> None:
    position = np.array([3.0, 2.0, 50.0])
    zoomed = LENS * np.array([1.02, 1.02, 1, 1])[:, None]
    before = view_at(position, TURN)
    after = {
        "creep": view_at(position + np.array([1e-4, 0, 0]), TURN),
        "pan": view_at(position, rotation((0, 1, 0), 0.03) @ TURN),
        "walk": view_at(position + np.array([0.1, 0, -0.3]), rotation((0.1, 1, 0), 1.0) @ TURN),
        "zoom": before,
        "roll": view_at(position, rotation((0, 0, 1), 0.5) @ TURN),
    }[motion]
    camera = Camera(after, zoomed if motion == "zoom" else LENS)
    error, exact, shown = compared(camera, Camera(before, LENS), depths(), launcher)
    assert shown.mean() > 0.2
    assert worst(error, exact, shown) <= 1.0
    assert exact[shown].max() > 0.01


@pytest.mark.parametrize("beyond", [0.0, 2.0**-20])
def test_f2_a_point_at_the_least_previous_w_was_not_seen(launcher: DeviceLauncher, beyond: float) -> None:
    """All of it exact: 4 m away now, and 1/16 m before."""
    before = view_at(np.array([0.0, 0.0, 4.0 * (CONSTANTS["LEAST_W"].value - 1.0 + beyond)]), np.eye(3))
    camera, previous = Camera(view_at(np.zeros(3), np.eye(3)), LENS), Camera(before, LENS)
    for run in (launcher, NumpyLauncher()):
        found, _ = measured(camera, previous, np.full((4, 6), 4.0, np.float32), run)
        assert (found[4] == (beyond > 0)).all()


def test_f2_a_still_camera_moves_nothing() -> None:
    camera = Camera(view_at(np.array([1e6, -2e6, 3e5]), TURN), LENS)
    again = Camera(camera.world_to_view.copy(), camera.view_to_clip.copy())
    found, _ = measured(camera, again, depths(), NumpyLauncher())
    assert (found[:2] == 0).all()


def test_f3_points_behind_the_previous_camera_have_no_history() -> None:
    # Backing away by 5 metres: what lies nearer than that was behind the camera, where a division would mirror it.
    height, width = 24, 32
    clip = perspective(width / height)
    views = [view_at(np.array([0.0, 0.0, z]), np.eye(3)) for z in (0.0, 5.0)]
    depth = np.geomspace(0.2, 50.0, height * width, dtype=np.float32).reshape(height, width)
    resolver = Resolver(override(unfiltered(), {"disocclusion_blur": 0.0, "dilation": "none"}), "numpy")
    frames = [
        replace(make_frame(i, width=width, height=height, effects=None), camera=Camera(view, clip), depth=depth)
        for i, view in enumerate(views)
    ]
    resolver.resolve(frames[0])
    resolved = resolver.resolve(frames[1])
    behind = depth - 5.0 <= 2.0**-6 * depth
    assert 0.3 < behind.mean() < 0.7
    assert np.array_equal(resolved[behind], frames[1].colour[behind])
    found, _ = measured(frames[1].camera, frames[0].camera, depth, NumpyLauncher())
    assert np.array_equal(found[4] > 0.5, ~behind)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_f4_travel_does_not_move_the_sky(turn: NDArray[np.float64]) -> None:
    there, here = (Camera(view_at(np.array(at), turn), LENS) for at in ((8.0, 0.0, 2.0), (5.0, 1.0, -7.0)))
    found, _ = measured(there, here, np.full((ROWS, WIDE), np.inf, np.float32), NumpyLauncher())
    assert (found[:2] == 0).all()
    assert (found[4] == 1).all()


def test_f4_turning_moves_the_sky_as_a_direction() -> None:
    camera, previous = walk(np.array([1e3, 0.0, 0.0]), turned=0.7)
    error, exact, shown = compared(camera, previous, np.full((ROWS, WIDE), np.inf, np.float32))
    assert shown.mean() > 0.5
    assert worst(error, exact, shown) <= 1.0


@pytest.mark.parametrize(
    "clip",
    [perspective(1.5), perspective(1.5, far=np.inf), perspective(1.5, near=1000.0, far=0.1), perspective(1.5, far=1e9)],
    ids=["standard", "infinite", "reversed", "far"],
)
def test_f4_f5_the_kind_of_depth_buffer_changes_nothing(clip: NDArray[np.float64]) -> None:
    # Depth is planar distance; of the projection, only what is seen where takes part.
    (camera, previous), usual = walk(np.zeros(3)), perspective(1.5)
    found, expected = (
        displacement(replace(camera, view_to_clip=c), replace(previous, view_to_clip=c), 300, 200)
        for c in (clip, usual)
    )
    assert np.array_equal(found.rows, expected.rows)


def test_f5_inverse_depth_keeps_the_precision_of_depth() -> None:
    # 1/Z in float32 is within 1 u of exact wherever Z is: no plane near or far spoils it.
    depth = (10.0 ** np.random.default_rng(32).uniform(-3, 8, (64, 64))).astype(np.float32)
    from cltaa.camera import inverse_depth

    out = np.empty_like(depth)
    inverse_depth(depth, out, parallel=False)
    assert (np.abs(out * depth.astype(np.float64) - 1) <= 2.0**-24 * (1 + 1e-6)).all()


@pytest.mark.parametrize("by", ["camera", "lens"])
def test_f6_an_orthographic_pan_is_what_it_is(by: str) -> None:
    height, width, pixels = 36, 48, 3.0
    clip = orthographic(width / 64, height / 64)  # 32 pixels a unit
    shifted = clip.copy()
    camera = Camera(np.eye(4), clip)
    if by == "camera":
        previous = Camera(view_at(np.array([-pixels / 32, 0.0, 0.0]), np.eye(3)), clip)
    else:
        shifted[0, 3] += pixels * 2 / width
        previous = Camera(np.eye(4), shifted)
    found, _ = measured(camera, previous, depths(height, width), NumpyLauncher())
    assert np.abs(found[0] - pixels).max() <= TOLERANCE
    assert np.abs(found[1]).max() <= TOLERANCE
    assert (found[4] == 1).all()


def test_f6_an_orthographic_camera_may_turn_and_zoom() -> None:
    height, width = 36, 48
    depth = np.random.default_rng(33).uniform(1, 90, (height, width)).astype(np.float32)
    before, after = orthographic(2.0, 1.5), orthographic(2.02, 1.515)
    position = np.array([1e4, 2.0, -3.0])
    camera = Camera(view_at(position + np.array([0.01, 0.02, -0.4]), rotation((1, 1, 0), 0.05) @ TURN), after)
    previous = Camera(view_at(position, TURN), before)
    error, exact, shown = compared(camera, previous, depth)
    assert shown.mean() > 0.5
    # Inverse depth is -Z here: its rounding (1 u of up to 90) times 12 pixels a unit and the turn of 1e-3 is below
    # 1e-7.
    assert worst(error, exact, shown) <= 1.0
