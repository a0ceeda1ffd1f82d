"""Cameras fitted to vectors and depth, where no matrices tell them, and why none are."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.camera import displacement, is_still, reprojected
from cltaa.cli import main
from cltaa.core.constants import value
from cltaa.frame import Camera, Effect, Frame, Image
from cltaa.inputs.fitted_camera import fit_cameras, lacks_camera
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import frame_planes
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_images
from cltaa.lab.inspect.plan import plan
from tests.inputs.foreign import side_text, write_blender, write_own
from tests.lab.check.conftest import Scene, sixteen
from tests.lab.check.mistakes import full_motion

BLENDER = Path(__file__).parents[1] / "thirdparty" / "recorded" / "blender"
Change = Callable[[list[Frame]], list[Frame]]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Frames of a scene, 16 of 160 x 90."""
    return sixteen(tmp_path_factory.mktemp("fitted"), 160, 90)


def as_it_is(frames: list[Frame]) -> list[Frame]:
    return frames


def in_halves(frames: list[Frame]) -> list[Frame]:
    """Vectors and depth as files of half precision hold them, wrong by up to 1/2048 of their size."""
    return [replace(frame, motion=half(frame.motion), depth=half(frame.depth)) for frame in frames]


def half(image: Image | None) -> Image:
    return np.asarray(image).astype(np.float16).astype(np.float32)


def two_fifths_moving(frames: list[Frame]) -> list[Frame]:
    """The left two fifths of each picture have motion of their own, the same everywhere."""
    out = [frames[0]]
    for frame in frames[1:]:
        motion = np.array(frame.motion)
        motion[:, : 2 * frame.width // 5] += np.array([1.5, -0.75], np.float32)
        out.append(replace(frame, motion=motion))
    return out


def jitter_of(frames: list[Frame], file: Path) -> Path:
    """A side file with the jitter of ``frames``."""
    file.write_text(json.dumps({"frames": {frame.index: {"jitter_px": frame.jitter_px} for frame in frames}}))
    return file


def moved(camera: Camera, previous: Camera, frame: Frame) -> np.ndarray:
    """Motion of all pixels in pixels, and their inverse depth in the frame before, [3, H, W]."""
    y, x = np.mgrid[: frame.height, : frame.width]
    near = 1.0 / np.asarray(frame.depth, np.float64)
    by = displacement(camera, previous, frame.width, frame.height)
    u, v, expected, _ = reprojected(x + 0.5 - frame.width / 2, y + 0.5 - frame.height / 2, near, by, parallel=False)
    return np.stack([u, v, expected])


def fitted(folder: Path, *, side_file: Path | None = None, profile: str = "auto") -> dict[int, Camera]:
    found = fit_cameras(opened(folder, side_file=side_file, profile=profile))
    assert not found.faults
    return found.cameras


def opened(folder: Path, **reading: Any) -> ForeignSequence:
    sequence = open_input(folder, **reading)
    assert lacks_camera(sequence, "auto")
    return sequence


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("dolly", as_it_is),
        ("pan", in_halves),
        ("wires", in_halves),
        ("everything", as_it_is),
        ("corridor", two_fifths_moving),
        ("zoom", as_it_is),
    ],
)
def test_fitted_cameras_move_all_surfaces_as_the_true_ones(
    name: str, change: Change, scene: Scene, tmp_path: Path
) -> None:
    frames = change(full_motion(scene(name)))
    cameras = fitted(write_blender(tmp_path / "in", frames), side_file=jitter_of(frames, tmp_path / "jitter.json"))
    for before, frame in pairwise(frames):
        if frame.cut:
            continue
        true = moved(frame.camera, before.camera, frame)
        found = moved(cameras[frame.index], cameras[before.index], frame)
        on = np.isfinite(frame.depth)
        apart, true, found = np.abs(found - true)[:, on], true[:, on], found[:, on]
        # A vector within this counts as the camera's (docs/algorithm.md, Gathering); a mean of thousands is nearer.
        longest = np.abs(true[:2]).max(0)
        assert (apart[:2].max(0) <= value("CAMERA_TOLERANCE") + value("CAMERA_SHARE") * longest).all()
        # Halves of depth are wrong by up to 1/2048.
        np.testing.assert_allclose(found[2], true[2], rtol=1 / 2048, atol=1e-12)


def test_the_camera_of_recorded_blender_frames() -> None:
    true = open_input(BLENDER, side_file=BLENDER / "camera.json")
    cameras = fitted(BLENDER)
    for before, frame in pairwise(true):
        on = np.isfinite(frame.depth)
        apart = np.abs(
            moved(cameras[frame.index], cameras[before.index], frame) - moved(frame.camera, before.camera, frame)
        )
        # No jitter is known, so a point is up to half a pixel beside its vector, and the camera's motion differs by up
        # to 1/50 from pixel to pixel.
        assert apart[:2, on].max() <= 0.01


def test_a_camera_that_stands_has_the_same_matrices_in_all_frames(scene: Scene, tmp_path: Path) -> None:
    """To the bit, so that the plan knows that it stands; whatever moves in front of it."""
    frames = full_motion(scene("swaying"))
    cameras = fitted(write_blender(tmp_path / "in", frames)).values()
    assert all(is_still(*pair) for pair in pairwise(cameras))


def test_a_region_of_the_picture_has_the_camera_of_the_whole(scene: Scene, tmp_path: Path) -> None:
    """Matrices are of the display window."""
    frames, windows = full_motion(scene("dolly")), ((24, 18, 151, 80), (0, 0, 159, 89))
    (tmp_path / "in").mkdir()
    for frame in frames:
        path = tmp_path / "in" / f"shot.{frame.index:04d}.exr"
        cut = {name: plane[18:81, 24:152] for name, plane in frame_planes(frame, path).items()}
        write_image(path, cut, windows=windows)
    cameras = fitted(tmp_path / "in", side_file=jitter_of(frames, tmp_path / "jitter.json"), profile="cltaa")
    for before, frame in pairwise(frames):
        true = moved(frame.camera, before.camera, frame)
        found = moved(cameras[frame.index], cameras[before.index], frame)
        # The picture reaches 1.4 times as far from the region's centre as the region, and the error of its motion grows
        # with the square of that at most.
        allowed = 2 * (value("CAMERA_TOLERANCE") + value("CAMERA_SHARE") * np.abs(true[:2]).max(0))
        assert (np.abs(found - true)[:2].max(0) <= allowed).all()


def resolved(folder: Path, output: Path, *options: object) -> list[bytes]:
    """Resolve with gather-8; the results."""
    asked = ["resolve", folder, "-o", output, "--preset", "gather-8", *options]
    assert main([*map(str, asked)]) == 0
    return [path.read_bytes() for path in sorted(output.glob("*.exr"))]


def test_a_resolve_fits_the_camera_and_is_like_one_with_matrices(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = full_motion(scene("dolly")[:8])
    folder, jitter = write_blender(tmp_path / "in", frames), jitter_of(frames, tmp_path / "jitter.json")
    (tmp_path / "true.txt").write_text(side_text(frames))
    resolved(folder, tmp_path / "true", "--camera", tmp_path / "true.txt")
    assert "camera fitted" not in capsys.readouterr().err
    resolved(folder, tmp_path / "vectors", "--camera", jitter, "--input", "camera.source=none")
    assert "camera fitted" not in capsys.readouterr().err
    resolved(folder, tmp_path / "fitted", "--camera", jitter)
    said = capsys.readouterr().err
    assert "no matrices: vectors and depth may tell the camera" in said
    assert (
        "camera fitted to vectors and depth: 100% of the surfaces follow it in frame 1, no less in others (8 " in said
    )
    true, by_vectors, by_fit = (open_images(tmp_path / name).image(4) for name in ("true", "vectors", "fitted"))
    assert np.abs(by_fit - true).mean() < np.abs(by_vectors - true).mean() / 10


def forget(output: Path, kept: int) -> None:
    """Leave what a run that is killed after ``kept`` frames leaves."""
    for path in sorted(output.glob("*.exr"))[kept:]:
        path.unlink()
    manifest = output / "manifest.jsonl"
    lines = manifest.read_text().splitlines(keepends=True)
    manifest.write_text("".join(lines[: 1 + kept]))


def test_a_resumed_or_split_run_has_the_bits_of_a_whole_one(scene: Scene, tmp_path: Path) -> None:
    folder = write_blender(tmp_path / "in", full_motion(scene("dolly")[:8]))
    whole = resolved(folder, tmp_path / "whole")
    assert resolved(folder, tmp_path / "split", "--jobs", 2) == whole
    forget(tmp_path / "split", 3)
    assert resolved(folder, tmp_path / "split") == whole


def test_frames_rendered_anew_have_a_camera_of_their_own(scene: Scene, tmp_path: Path) -> None:
    frames, options = full_motion(scene("dolly")[:8]), ("--effects", "all")
    folder, output = write_blender(tmp_path / "in", frames), tmp_path / "out"
    resolved(folder, output, *options)
    forget(output, 4)
    write_blender(folder, full_motion(scene("pan")[:8])[5:])
    assert resolved(folder, output, *options) == resolved(folder, tmp_path / "whole", *options)


def test_a_frame_that_no_camera_fits_is_taken_to_stand(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = full_motion(scene("dolly")[:8])
    frames = [*frames[:4], *random_motion(frames[4:5]), *frames[5:]]
    folder = write_blender(tmp_path / "in", frames)
    found = fit_cameras(opened(folder))
    assert [*found.faults] == [4]
    assert is_still(found.cameras[4], found.cameras[3])
    assert not is_still(found.cameras[5], found.cameras[4])
    begun = resolved(folder, tmp_path / "out")
    said = capsys.readouterr().err
    assert "(8 frames, " in said
    assert "s; not in frame 4: too few vectors are of one camera)" in said
    forget(tmp_path / "out", 3)
    assert resolved(folder, tmp_path / "out") == begun


def test_a_damaged_frame_is_the_resolves_to_report(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The frames before it are resolved as if it were sound, so that the mended sequence goes on."""
    frames, options = full_motion(scene("dolly")[:8]), ["--preset", "gather-8", "--effects", "all"]
    folder, output = write_blender(tmp_path / "in", frames), tmp_path / "out"
    whole = resolved(folder, tmp_path / "whole", *options)
    damaged = folder / "shot.0005.exr"
    sound = damaged.read_bytes()
    damaged.write_bytes(sound[:-200] + bytes(99) + sound[-101:])  # among the pixels
    assert main(["resolve", str(folder), "-o", str(output), *options]) == 65
    assert f"cltaa: error: {damaged}: a part is damaged" in capsys.readouterr().err.splitlines()[-1]
    assert [path.read_bytes() for path in sorted(output.glob("*.exr"))] == whole[:5]
    damaged.write_bytes(sound)
    assert resolved(folder, output, *options) == whole


def test_a_run_that_began_without_a_camera_goes_on_without(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames, options = full_motion(scene("dolly")[:8]), ("--effects", "all")
    folder, output = write_blender(tmp_path / "in", random_motion(frames)), tmp_path / "out"
    resolved(folder, output, *options)
    assert "no camera is fitted, vectors alone tell what moves (8 frames, " in capsys.readouterr().err
    forget(output, 2)
    write_blender(folder, frames[3:])
    resolved(folder, output, *options)
    assert "camera fitted" not in capsys.readouterr().err


def test_a_run_that_began_with_a_camera_goes_on_with_it(scene: Scene, tmp_path: Path) -> None:
    """Though most of the frames that came since tell none."""
    frames, options = full_motion(scene("dolly")[:8]), ("--effects", "all")
    folder, output = write_blender(tmp_path / "in", frames[:4]), tmp_path / "out"
    begun = resolved(folder, output, *options)
    write_blender(folder, random_motion(frames[4:]))
    assert resolved(folder, output, *options)[:4] == begun


def test_a_matrix_that_no_camera_has_is_none(tmp_path: Path, scene: Scene) -> None:
    """All vectors lead to one point, as if the picture had been that point before."""
    frames = full_motion(scene("dolly")[:8])
    row, column = np.mgrid[:90, :160]
    to_centre = np.stack([80 - column - 0.5, 45 - row - 0.5], -1).astype(np.float32)
    folder = write_blender(tmp_path / "in", [replace(frame, motion=to_centre) for frame in frames])
    found = fit_cameras(opened(folder))
    assert not found.fits
    assert {fault.what for fault in found.faults.values()} == {"no camera moves as vectors and depth say"}
    resolved(folder, tmp_path / "out")


def test_a_picture_of_one_column_tells_no_camera_or_one(scene: Scene, tmp_path: Path) -> None:
    frames = list[Frame]()
    for frame in full_motion(scene("dolly")[:8]):
        column: dict[str, Any] = {
            name: np.asarray(getattr(frame, name))[:, 79:80] for name in ("colour", "depth", "motion")
        }
        frames.append(replace(frame, **column))
    found = fit_cameras(opened(write_blender(tmp_path / "in", frames)))
    assert len(found.shares) + len(found.faults) == 7


@pytest.mark.parametrize("slant", [0.0, 1e-6])
def test_a_wall(slant: float, scene: Scene, tmp_path: Path) -> None:
    """1/Z then tells nothing, or next to nothing, that the position does not."""
    frames = list[Frame]()
    for frame in scene("dolly"):
        frames.append(replace(frame, depth=(4.0 + slant * np.mgrid[:90, :160][1]).astype(np.float32)))
    frames = full_motion(frames)
    cameras = fitted(write_blender(tmp_path / "in", frames), side_file=jitter_of(frames, tmp_path / "jitter.json"))
    for before, frame in pairwise(frames):
        true = moved(frame.camera, before.camera, frame)
        apart = np.abs(moved(cameras[frame.index], cameras[before.index], frame) - true)[:2].max(0)
        assert (apart <= value("CAMERA_TOLERANCE") + value("CAMERA_SHARE") * np.abs(true[:2]).max(0)).all()


def test_a_published_preset_takes_what_the_files_tell(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    resolved(write_blender(tmp_path / "in", full_motion(scene("dolly")[:8])), tmp_path / "out", "--preset", "karis")
    assert "camera fitted" not in capsys.readouterr().err


def test_a_plan_is_that_of_the_resolve(scene: Scene, tmp_path: Path) -> None:
    frames = full_motion(scene("dolly")[:8])
    folder = write_blender(tmp_path / "in", frames)
    planned = plan(folder, "gather-8", rounds=0)
    assert any(step.why == "the camera moves" for section in planned.sections for step in section.steps)


def without_motion(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, motion=None) for frame in frames]


def sky_alone(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, depth=np.full_like(frame.depth, np.inf)) for frame in frames]


def random_motion(frames: list[Frame]) -> list[Frame]:
    random = np.random.default_rng(1)
    return [
        replace(frame, motion=random.uniform(-9, 9, (*frame.depth.shape, 2)).astype(np.float32)) for frame in frames
    ]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (sky_alone, "too few pixels have depth and a vector (expected 60, found 0)"),
        (random_motion, "too few vectors are of one camera (expected 25% or more, found "),
    ],
)
def test_what_tells_no_camera(change: Change, why: str, scene: Scene, tmp_path: Path) -> None:
    found = fit_cameras(opened(write_blender(tmp_path / "in", change(full_motion(scene("dolly"))))))
    assert [*found.faults] == [*range(1, 16)]
    assert f"shot.0001.exr frame 1: {why}" in str(found.faults[1])


def test_what_is_not_looked_at(scene: Scene, tmp_path: Path) -> None:
    frames = full_motion(scene("dolly"))
    folder = write_blender(tmp_path / "in", frames)
    told, alone = write_own(tmp_path / "own", frames), write_blender(tmp_path / "alone", without_motion(frames))
    assert not lacks_camera(open_input(told), "auto")
    assert not lacks_camera(open_input(alone), "auto")
    assert not lacks_camera(open_input(folder, assignments=["camera.source=none"]), "auto")
    assert not lacks_camera(open_input(folder), frozenset({Effect.MOTION}))
    assert lacks_camera(open_input(folder), frozenset({Effect.MOTION, Effect.CAMERA}))
