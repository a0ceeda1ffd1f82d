"""What engines write, several mistakes at once: vectors in every pixel, reversed depth, matrices of Vulkan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.inputs.convert import correct, device_planes, mended_camera, planes_of
from cltaa.inputs.profile import Depth, DepthKind, Profile
from cltaa.lab.check.hypotheses import COMBINED, MEANINGS
from cltaa.lab.check.report import check_frames
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import (
    FLIP_Y,
    MISTAKES,
    camera,
    camera_jittered,
    depth,
    each,
    found_in,
    full_motion,
    mistakes,
    motion,
    then,
)
from tests.sequence_factory import make_camera

VULKAN = camera(lambda c: Camera(np.asarray(np.linalg.inv(c.world_to_view)), FLIP_Y @ c.view_to_clip))
Y_DOWN = camera(lambda c: Camera(c.world_to_view, FLIP_Y @ c.view_to_clip))


def reversed_projection(c: Camera, near: float = 0.1) -> Camera:
    clip = c.view_to_clip.copy()
    clip[2] = 0, 0, 0, near
    return Camera(c.world_to_view, clip)


@pytest.mark.parametrize("name", ["corridor", "spinner", "starry"])
def test_vectors_of_fractions_in_every_pixel_are_named(name: str, scene: Scene) -> None:
    spoilt = then(full_motion, MISTAKES["motion-units-uv"].plant)(scene(name))
    assert mistakes(spoilt) == ["motion-units-uv"]


@pytest.mark.parametrize("name", ["starry", "spinner"])
def test_vectors_of_pictures_that_lead_from_the_last_frame_are_named(name: str, scene: Scene) -> None:
    """As Unreal writes them: around 0.5, this position minus the one before, y up."""
    spoilt = then(full_motion, motion(np.diag([-1 / 160, 1 / 90]), 0.5))(scene(name))
    (finding,) = found_in(spoilt)
    assert finding.name == "motion-centred-on-half-ndc-negated"
    assert finding.fix == {"motion": {"scale": [-160.0, 90.0], "offset": [0.5, 0.5]}}


def test_matrices_unit_and_vectors_that_are_all_wrong_are_named_at_once(scene: Scene) -> None:
    spoilt = then(full_motion, MISTAKES["motion-units-uv"].plant, VULKAN, MISTAKES["depth-scaled"].plant)
    found = mistakes(spoilt(scene("starry")))
    assert found == ["camera-inverse-y-flipped", "depth-scaled", "motion-units-uv"]


@pytest.mark.parametrize("name", ["foliage", "pan"])
def test_inverse_matrices_are_not_taken_for_vectors_to_the_next_frame(name: str, scene: Scene) -> None:
    """The two agree as well; which of them it is the pictures say. A camera that goes level hides its y."""
    found = mistakes(then(full_motion, MISTAKES["motion-units-uv"].plant, VULKAN)(scene(name)))
    assert found == ["camera-inverse", "motion-units-uv"]


def test_wrong_vectors_in_every_pixel_are_no_mistake_of_the_jitter(scene: Scene) -> None:
    assert mistakes(then(full_motion, MISTAKES["motion-units-uv"].plant)(scene("zoom"))) == ["motion-units-uv"]


def test_a_reversed_projection_tells_its_depth_before_the_matrices_are_right(scene: Scene) -> None:
    spoilt = depth(lambda _, z: (0.1 / z).astype(np.float32))(camera(reversed_projection)(scene("corridor")))
    (finding,) = check_frames(VULKAN(spoilt))
    assert finding.fix == {"depth": {"kind": "device-reversed"}}


@pytest.mark.parametrize("prepare", [list, full_motion])
def test_one_over_distance_under_a_reversed_projection_is_what_the_pictures_say(
    prepare: Callable[[list[Frame]], list[Frame]], scene: Scene
) -> None:
    """No near/Z of another unit: a plane at 0.1 would put everything ten times too far away."""
    spoilt = depth(lambda _, z: (1 / np.maximum(z, 1)).astype(np.float32))(prepare(scene("corridor")))
    found = check_frames(camera(reversed_projection)(spoilt))
    assert [finding.fix for finding in found] == [{"depth": {"kind": "inverse"}}]


def test_numbers_above_1_are_no_device_depth(scene: Scene) -> None:
    """Though the projection is reversed, and the parallax of what is far away tells nothing."""
    spoilt = depth(lambda _, z: (1 / z).astype(np.float32))(camera(reversed_projection)(scene("depth_range")))
    assert max(frame.depth.max() for frame in spoilt) > 1.0
    assert [finding.fix for finding in check_frames(spoilt)] == [{"depth": {"kind": "inverse"}}]


def test_a_clip_space_that_begins_at_0_is_told_by_parallax(scene: Scene) -> None:
    near, far = 0.1, 200.0

    def from_zero(c: Camera) -> Camera:
        clip = c.view_to_clip.copy()
        clip[2] = 0, 0, -far / (far - near), -near * far / (far - near)
        return Camera(c.world_to_view, clip)

    spoilt = MISTAKES["depth-device"].plant(camera(from_zero)(scene("corridor")))
    (finding,) = check_frames(spoilt)
    assert finding.fix["depth"] == {"kind": "device", "near": pytest.approx(near)}


@pytest.mark.parametrize("name", ["corridor", "spinner"])
def test_planar_depth_in_halves_is_not_taken_for_another_kind(name: str, scene: Scene) -> None:
    halves = depth(lambda _, z: (100 * z.astype(np.float16).astype(np.float32) / 100).astype(np.float32))(scene(name))
    assert mistakes(halves) == []


def test_jitter_in_a_projection_whose_y_points_down(scene: Scene) -> None:
    assert mistakes(then(each(camera_jittered), Y_DOWN)(scene("spinner"))) == ["camera-y-flipped"]


def test_jitter_from_the_corner_of_a_pixel_is_moved_by_a_half(scene: Scene) -> None:
    (finding,) = check_frames(MISTAKES["jitter-biased"].plant(scene("still")))
    assert finding.fix == {"jitter": {"offset": [-0.5, -0.5]}}


@pytest.mark.parametrize("factor", [(8, 8), (320, 180)])
def test_a_jitter_that_no_resolve_takes_is_named(factor: tuple[float, float], scene: Scene) -> None:
    planted = [
        replace(frame, jitter_px=(frame.jitter_px[0] * factor[0], frame.jitter_px[1] * factor[1]))
        for frame in scene("corridor")
    ]
    (finding,) = found_in(planted)
    assert finding.name == "jitter-size"
    assert finding.what.endswith("; to go on without it: --input jitter.source=none")


def projection(a: float, b: float) -> np.ndarray:
    return np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, a, b], [0, 0, -1, 0]], np.float64)


def test_planes_of_a_projection() -> None:
    near = 0.25
    for far in [50.0, np.inf]:
        for z_near, z_far, from_zero in [(-1, 1, False), (0, 1, True), (1, 0, False)]:  # OpenGL, Direct3D, reversed
            b = (z_near - z_far) / (1 / near - 1 / far)  # z = b / Z - a at both
            found = planes_of(projection(b / near - z_near, b), from_zero=from_zero)
            assert found == pytest.approx((1 / near, 1 / far), abs=1e-12), (z_near, z_far, far)
            # Unless --input depth.near says more clip space is taken to begin at -1.
            declared = device_planes(Depth(kind=DepthKind.DEVICE), Camera(np.eye(4), projection(b / near - z_near, b)))
            assert (declared == found) == (not from_zero), (z_near, z_far, far)
    assert planes_of(projection(-1.0, 0.0)) == (0.0, 0.0)  # none can be read


def test_a_correction_on_top_of_another_reads_the_camera_that_it_was_found_for() -> None:
    for before in [name for name in COMBINED if "transposed" not in name]:
        stored = make_camera((1.0, 2.0, 5.0))
        for name in ("inverse", "inverse-z-forward", "y-flipped", "mirrored"):
            meant = COMBINED[name]
            first = correct(Profile(), {"camera": COMBINED[before].fix})
            converted = mended_camera(stored.world_to_view, stored.view_to_clip, first.camera, (0, 0), 1, 1)
            both = correct(first, {"camera": meant.fix})
            found = mended_camera(stored.world_to_view, stored.view_to_clip, both.camera, (0, 0), 1, 1)
            expected = meant.change(converted)
            np.testing.assert_allclose(found.world_to_view, expected.world_to_view, atol=1e-12)
            np.testing.assert_allclose(found.view_to_clip, expected.view_to_clip, atol=1e-12)


def test_what_is_transposed_twice_is_not() -> None:
    fix = {"camera": MEANINGS["transposed"].fix}
    assert correct(correct(Profile(), fix), fix) == Profile()
