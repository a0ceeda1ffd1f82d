"""What the numbers of other writers mean: kinds of depth, units of motion, layouts of matrices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.frame import Camera, Frame
from cltaa.inputs.convert import ray_length
from tests.inputs.foreign import frames, read, write_own, write_parts
from tests.numerics.exact_cameras import orthographic
from tests.sequence_factory import HEIGHT, WIDTH, make_camera


def depth_as(stored: Callable[[np.ndarray, Frame], np.ndarray], folder: Path) -> list[Frame]:
    made = frames(2)
    spoilt = [replace(f, depth=stored(f.depth.astype(np.float64), f).astype(np.float32)) for f in made]
    write_own(folder, spoilt)
    return made


@pytest.mark.parametrize(
    ("kind", "stored"),
    [
        ("inverse", lambda z, _: 1 / z),
        ("device", lambda z, _: (10.0 - 1 / z) / (10.0 - 0.01)),
        ("device-reversed", lambda z, _: (1 / z - 0.01) / (10.0 - 0.01)),
    ],
)
def test_kinds_of_depth(kind: str, stored: Callable[[np.ndarray, Frame], np.ndarray], tmp_path: Path) -> None:
    made = depth_as(stored, tmp_path)
    given = [] if kind == "inverse" else ["depth.near=0.1", "depth.far=100"]
    for ours, theirs in zip(made, read(tmp_path, f"depth.kind={kind}", *given), strict=True):
        finite = np.isfinite(ours.depth)
        # One rounding of the stored number, and 1 / (1 - d) multiplies it by Z / near.
        worst = 2.0**-24 * (4 + ours.depth[finite].max() / 0.1)
        np.testing.assert_allclose(theirs.depth[finite], ours.depth[finite], rtol=worst)


@pytest.mark.parametrize(
    ("asked", "stored"),
    [
        ("kind=planar sky=1e10", [1e10, 2e10, 7.0]),
        ("kind=device sky=0.7 near=0.1 far=100", [0.7, 1.0, 0.5]),  # whose float is less than the double
        ("scale=-1 sky=-1e4", [-1e4, -2e4, -7.0]),
        ("scale=-1 sky=1e10", [1e10, 2e10, -7.0]),
        ("kind=inverse sky=0.01", [0.01, 0.01, 0.5]),
        ("kind=inverse sky=1e10", [0.0, 0.0, 0.5]),  # as a profile has it for planar depth
        ("kind=device-reversed sky=0 near=0.1 far=100", [0.0, 0.0, 0.5]),
    ],
)
def test_the_sky_lies_behind_the_surfaces_whatever_the_kind(asked: str, stored: list[float], tmp_path: Path) -> None:
    write_own(
        tmp_path,
        [replace(frame, depth=np.resize(np.array(stored, np.float32), frame.depth.shape)) for frame in frames(1)],
    )
    (frame,) = read(tmp_path, *(f"depth.{each}" for each in asked.split()))
    assert np.isinf(frame.depth.ravel()[:3]).tolist() == [True, True, False]


@pytest.mark.parametrize("kind", ["device", "device-reversed"])
def test_device_depth_of_an_orthographic_camera_is_refused(kind: str, tmp_path: Path) -> None:
    camera = Camera(np.eye(4), orthographic(2.0, 1.5))
    write_own(tmp_path, [replace(frame, camera=camera) for frame in frames(2)])
    said = rf"frame 0: device depth of an orthographic camera is not read \(expected depth.kind planar, found {kind}\)"
    with pytest.raises(DataError, match=said):
        read(tmp_path, f"depth.kind={kind}", "depth.near=0.1", "depth.far=100")
    assert len(read(tmp_path, "depth.kind=planar")) == 2


def test_rays_of_an_orthographic_camera_are_as_long_as_they_reach() -> None:
    assert (ray_length((3, 4), Camera(np.eye(4), orthographic(2.0, 1.5)), (0.2, 0.1)) == np.ones((3, 4))).all()


def test_units_signs_and_jitter_of_motion(tmp_path: Path) -> None:
    made = frames()
    height, width = made[0].colour.shape[:2]
    stored = []
    for place, frame in enumerate(made):
        change = np.subtract(frame.jitter_px, made[max(place - 1, 0)].jitter_px)
        assert frame.motion is not None
        vectors = (frame.motion + change) / (width / 2, -height / 2)
        stored.append(replace(frame, motion=(vectors[..., ::-1] * -1 + 0.5).astype(np.float32)))
    write_own(tmp_path, stored)
    keys = ("motion.units=ndc", "motion.scale=-1,-1", "motion.offset=0.5,0.5", "motion.swap=true", "motion.jittered=1")
    for ours, theirs in zip(made, read(tmp_path, *keys), strict=True):
        assert theirs.motion is not None
        assert ours.motion is not None
        # Stored near 0.5: half an ulp there, 2^-25, is worth width / 2 of it in pixels.
        np.testing.assert_allclose(theirs.motion, ours.motion, rtol=0, atol=2.0**-24 * width)


def moved_by(jitter: tuple[float, float]) -> np.ndarray:
    """What a projection is multiplied by from the left so that pixels are sampled beside their middle."""
    moved = np.eye(4)
    moved[:2, 3] = -2 * jitter[0] / WIDTH, 2 * jitter[1] / HEIGHT
    return moved


def test_jitter_is_taken_out_of_the_projection_or_not_read(tmp_path: Path) -> None:
    made = frames()
    jittered = [Camera(f.camera.world_to_view, moved_by(f.jitter_px) @ f.camera.view_to_clip) for f in made]
    write_own(tmp_path, [replace(frame, camera=camera) for frame, camera in zip(made, jittered, strict=True)])
    read_so = read(tmp_path, "camera.jittered=true", "motion.swap=false")
    without = read(tmp_path, "jitter.source=none", "motion.swap=false")
    for ours, mended, plain in zip(made, read_so, without, strict=True):
        # A few roundings of numbers up to 2.
        np.testing.assert_allclose(mended.camera.view_to_clip, ours.camera.view_to_clip, rtol=0, atol=2.0**-50)
        assert (mended.jitter_px, plain.jitter_px) == (ours.jitter_px, (0.0, 0.0))


@pytest.mark.parametrize("lens", [(0.0, 0.0), (40.5, -3.25)], ids=["centred", "shifted"])
@pytest.mark.parametrize("clip", [make_camera().view_to_clip, orthographic(2.0, 1.5)], ids=["perspective", "parallel"])
@pytest.mark.parametrize("turned", [1.0, -1.0], ids=["up", "down"])
def test_jitter_is_read_from_the_projection(
    clip: np.ndarray, lens: tuple[float, float], turned: float, tmp_path: Path
) -> None:
    """About its mean, so that a lens shift stays; what is left is one matrix, as of a camera that stands."""
    made, whole = frames(4), np.diag([1.0, turned, 1.0, 1.0])
    flip, view = f"camera.flip_y={str(turned < 0).lower()}", made[0].camera.world_to_view
    told = np.array([frame.jitter_px for frame in made])
    stored = [Camera(view, whole @ moved_by((x + lens[0], y + lens[1])) @ clip) for x, y in told]
    write_own(
        tmp_path, [replace(f, camera=camera, jitter_px=(9.0, 9.0)) for f, camera in zip(made, stored, strict=True)]
    )
    read_so = read(tmp_path, "jitter.source=projection", flip)
    mean = told.mean(0)
    steady = moved_by((mean[0] + lens[0], mean[1] + lens[1])) @ clip
    for frame, jitter in zip(read_so, told - mean, strict=True):
        # A few roundings of numbers up to 3, half a picture wide.
        np.testing.assert_allclose(frame.jitter_px, jitter, rtol=0, atol=2.0**-50 * WIDTH)
        np.testing.assert_allclose(frame.camera.view_to_clip, steady, rtol=0, atol=2.0**-50)
        np.testing.assert_array_equal(frame.camera.view_to_clip, read_so[0].camera.view_to_clip)
    scaled = read(tmp_path, "jitter.source=projection", "jitter.scale=2,-2", flip)
    for frame, plain in zip(scaled, read_so, strict=True):
        assert frame.jitter_px == (2 * plain.jitter_px[0], -2 * plain.jitter_px[1])
        np.testing.assert_array_equal(frame.camera.view_to_clip, plain.camera.view_to_clip)


@pytest.mark.parametrize(
    ("options", "turns", "of_sky", "of_surfaces"),
    [
        (("motion.zero=still",), True, True, False),
        (("motion.zero=still",), False, False, False),  # the sky rests
        (("motion.zero=camera",), True, True, True),
        (("camera.source=none",), True, False, False),
    ],
)
def test_a_vector_of_zero_leaves_the_sky_to_a_camera_that_turns(
    options: tuple[str, ...], turns: bool, of_sky: bool, of_surfaces: bool, tmp_path: Path
) -> None:
    """Cycles draws no vectors of the sky."""
    made = []
    for frame in frames(3):
        depth, motion = frame.depth.copy(), np.full((HEIGHT, WIDTH, 2), 0.25, np.float32)
        depth[0, :4], depth[1, :4] = np.inf, 7.0
        motion[:2, 1:3] = 0.0  # two of the sky, two of a surface
        motion[0, 2, 1] = -1.0
        view, angle = np.eye(4), frame.index / 100 if turns else 0.0
        view[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        camera = replace(frame.camera, world_to_view=view @ frame.camera.world_to_view)
        made.append(replace(frame, depth=depth, motion=motion, camera=camera))
    write_own(tmp_path, made)
    for frame in read(tmp_path, *options)[1:]:
        assert frame.motion is not None
        expected = np.zeros((HEIGHT, WIDTH), bool)
        expected[0, 1], expected[1, 1:3] = of_sky, of_surfaces
        np.testing.assert_array_equal(np.isnan(frame.motion).all(-1), expected)


def test_an_invalid_projection_is_reported_with_its_own_frame(tmp_path: Path) -> None:
    made = frames()
    none = Camera(made[1].camera.world_to_view, np.zeros((4, 4)))
    write_own(tmp_path, [made[0], replace(made[1], camera=none), made[2]])
    with pytest.raises(DataError, match="frame 1"):
        read(tmp_path, "jitter.source=projection")


LENS = make_camera().view_to_clip


@pytest.mark.parametrize("clip", [LENS, moved_by((2.0, -1.0)) @ LENS, moved_by((2.0, -1.0)) @ orthographic(2.0, 1.5)])
def test_standard_matrices_of_two_writers(clip: np.ndarray, tmp_path: Path) -> None:
    ours = Camera(make_camera((1.0, 2.0, 5.0)).world_to_view, clip)
    flip = np.diag([1.0, 1.0, -1.0, 1.0])
    half = np.array([[0.5, 0, 0, 0.5], [0, -0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1.0]])
    for name, to_ndc in (("text", half @ ours.view_to_clip), ("mantra", -ours.view_to_clip)):
        frame = replace(frames(1)[0], camera=ours)
        header = {
            "worldToCamera": np.ascontiguousarray((flip @ ours.world_to_view).T, np.float32),
            "worldToNDC": np.ascontiguousarray((to_ndc @ ours.world_to_view).T, np.float32),
        }
        write_parts(tmp_path / name / "a.0000.exr", {"rgba": _beauty(frame)}, header)
        keys = ("camera.standard=true", "camera.view=worldToCamera", "camera.projection=worldToNDC")
        colour = "colour.channels=*.R *.G *.B"
        camera = read(tmp_path / name, *keys, colour)[0].camera
        # float32 matrices of numbers up to 10.
        np.testing.assert_allclose(camera.world_to_view, ours.world_to_view, atol=1e-5)
        np.testing.assert_allclose(camera.view_to_clip[[0, 1, 3]], ours.view_to_clip[[0, 1, 3]], atol=1e-5)


def _beauty(frame: Frame) -> dict[str, np.ndarray]:
    return {name: frame.colour[..., place] for place, name in enumerate("RGB")} | {"Z": frame.depth}


def test_wrong_matrices_are_refused_for_a_resolve(tmp_path: Path) -> None:
    spoilt = [replace(f, camera=Camera(f.camera.world_to_view.T, f.camera.view_to_clip)) for f in frames()]
    write_own(tmp_path, spoilt)
    with pytest.raises(DataError, match="last row"):
        read(tmp_path, "motion.swap=false")
    assert len(read(tmp_path, "camera.view_layout=column")) == 3
