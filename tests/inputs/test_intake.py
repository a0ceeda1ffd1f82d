"""Sequences of other writers: what they become, what is said about them, and what is missing."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, InputMissing
from cltaa.exr.channels import Pixels
from cltaa.exr.write import write_image
from cltaa.frames import Camera, Frame
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.opening import open_input
from cltaa.sequences.sources import Sequence
from tests.inputs.foreign import frames, side_text, write_blender, write_colour, write_own, write_parts
from tests.sequence_factory import make_camera, write_sequence


def read(folder: Path, *assignments: str, profile: str = "auto", side: Path | None = None) -> list[Frame]:
    sequence = open_input(folder, profile=profile, assignments=assignments, side_file=side)
    assert isinstance(sequence, ForeignSequence)
    return list(sequence)


def test_own_sequences_are_opened_as_ever(tmp_path: Path) -> None:
    sequence = open_input(write_sequence(tmp_path, 2))
    assert type(sequence) is Sequence


def assert_the_same(ours: Frame, theirs: Frame) -> None:
    np.testing.assert_array_equal(theirs.colour, ours.colour)
    np.testing.assert_array_equal(theirs.depth, ours.depth)
    np.testing.assert_array_equal(theirs.motion, ours.motion)
    np.testing.assert_array_equal(theirs.camera.view_to_clip, ours.camera.view_to_clip)
    assert theirs.jitter_px == ours.jitter_px


def test_own_sequences_read_the_same_through_their_profile(tmp_path: Path) -> None:
    made = frames()
    for ours, theirs in zip(made, read(write_own(tmp_path, made), "motion.swap=false"), strict=True):
        assert_the_same(ours, theirs)
        np.testing.assert_array_equal(theirs.camera.world_to_view, ours.camera.world_to_view)


def test_blender_multi_part_with_a_text_side_file(tmp_path: Path) -> None:
    made = frames()
    write_blender(tmp_path / "shot", made)
    side = tmp_path / "camera.txt"
    side.write_text(side_text(made))
    for ours, theirs in zip(made, read(tmp_path / "shot", side=side), strict=True):
        assert_the_same(ours, theirs)


def test_without_matrices_and_jitter_it_says_so(tmp_path: Path) -> None:
    intake = open_intake(write_blender(tmp_path, frames()))
    lines = list(intake_lines(intake))
    assert lines[0] == "profile blender: header attribute Software is Blender 5.0.1"
    assert "motion ViewLayer.Vector.X ViewLayer.Vector.Y" in lines[1]
    assert any(line.startswith("no matrices: motion vectors alone") for line in lines)
    assert any(line.startswith("no jitter") for line in lines)
    frame = read(tmp_path)[1]
    assert frame.jitter_px == (0.0, 0.0)
    np.testing.assert_array_equal(frame.camera.world_to_view, np.eye(4))


def test_colour_alone(tmp_path: Path) -> None:
    for frame in frames():
        channels = {name: frame.colour[..., place] for place, name in enumerate("RGB")}
        write_image(tmp_path / f"picture.{frame.index:04d}.exr", channels)
    lines = list(intake_lines(open_intake(tmp_path)))
    assert any(line.startswith("no depth") for line in lines)
    assert any("the camera is taken to stand still" in line for line in lines)
    assert any(line.startswith("no motion vectors: whatever moves") for line in lines)
    frame = read(tmp_path)[0]
    assert np.isinf(frame.depth).all()
    assert frame.motion is None


@pytest.mark.parametrize("names", ["velocity.R velocity.G", "mv.X mv.Y", "motionVectors.u motionVectors.v"])
def test_channels_that_sound_like_vectors_are_pointed_out(names: str, tmp_path: Path) -> None:
    """What their numbers mean nobody knows, so that they are named, and taken when they are asked for."""
    across, down = names.split()
    for frame in frames():
        assert frame.motion is not None
        planes = {across: frame.motion[..., 0], down: frame.motion[..., 1], f"{across[:-1]}A": frame.depth}
        channels = {name: frame.colour[..., place] for place, name in enumerate("RGB")}
        write_image(tmp_path / f"picture.{frame.index:04d}.exr", channels | planes)
    (line,) = [line for line in intake_lines(open_intake(tmp_path)) if line.startswith("no motion")]
    told = f"--input motion.channels='{names}', which cltaa check judges"
    assert line.endswith(told)
    motion = read(tmp_path, *shlex.split(told.replace(",", ""))[1:2])[0].motion
    assert motion is not None
    np.testing.assert_array_equal(motion, frames()[0].motion)


def test_parts_of_an_unknown_writer(tmp_path: Path) -> None:
    made = frames()
    for frame in made:
        colour: dict[str, Pixels] = {c: frame.colour[..., place].astype(np.float16) for place, c in enumerate("RGB")}
        write_parts(tmp_path / f"shot_{frame.index:03d}.exr", {"rgba": colour, "depth": {"Z": frame.depth}}, {})
    intake = open_intake(tmp_path)
    assert (intake.profile.name, [*intake.roles]) == ("parts", ["colour", "depth"])
    np.testing.assert_array_equal(read(tmp_path)[1].depth, made[1].depth)


def test_files_of_an_engine(tmp_path: Path) -> None:
    """Each buffer in files of its own, all of them with R, G and B; nothing is put together from two of them."""
    made = frames()
    for frame in made:
        for name, planes in (
            ("depth", [frame.depth] * 3),
            ("image", np.moveaxis(frame.colour, -1, 0)),
            ("a", [frame.depth]),
        ):
            write_image(tmp_path / f"{name}_{frame.index:04d}.exr", dict(zip("RGB", planes, strict=False)))
    intake = open_intake(tmp_path)
    assert list(intake_lines(intake))[1] == "channels: colour image.R image.G image.B; depth depth.R"
    np.testing.assert_array_equal(read(tmp_path)[1].colour, made[1].colour)
    np.testing.assert_array_equal(read(tmp_path)[1].depth, made[1].depth)


def test_a_folder_for_each_channel_set(tmp_path: Path) -> None:
    made = frames()
    for frame in made:
        name = f"shot.{frame.index:04d}.exr"
        for folder in ("beauty", "depth", "reference"):
            (tmp_path / folder).mkdir(exist_ok=True)
        colour = {channel: frame.colour[..., place] for place, channel in enumerate("RGB")}
        write_image(tmp_path / "beauty" / name, colour)
        write_image(tmp_path / "reference" / name, {c: plane + 1 for c, plane in colour.items()})
        write_image(tmp_path / "depth" / name, {"Z": frame.depth})
    intake = open_intake(tmp_path)
    assert {place.files for places in intake.roles.values() for place in places} == {"beauty/shot", "depth/shot"}
    np.testing.assert_array_equal(read(tmp_path)[2].depth, made[2].depth)
    (tmp_path / "depth" / "shot.0001.exr").unlink()
    with pytest.raises(InputMissing, match="frame 1"):
        open_intake(tmp_path)


def test_what_was_resolved_into_the_folder_is_no_input(tmp_path: Path) -> None:
    made = frames()
    for frame in made:
        channels = {name: frame.colour[..., place] for place, name in enumerate("RGB")}
        write_image(tmp_path / f"shot_{frame.index:04d}.exr", channels)
    for _ in range(2):  # "aa" comes before "shot" in the alphabet, and the second run finds it there
        assert main(["resolve", str(tmp_path), "-o", str(tmp_path / "aa"), "--device", "numpy"]) == 0
        np.testing.assert_array_equal(read(tmp_path)[2].colour, made[2].colour)


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


def test_standard_matrices_of_two_writers(tmp_path: Path) -> None:
    ours = make_camera((1.0, 2.0, 5.0))
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


@pytest.mark.parametrize("name", ["distance.R", "linearDepth.x", "view_Z", "ZDepthBuffer.x"])
def test_a_channel_that_sounds_like_depth_is_pointed_out(name: str, tmp_path: Path) -> None:
    others = {other: np.ones((4, 4), np.float32) for other in ("R", "G", "B", "N.Z", "position.Z")}
    write_image(tmp_path / "a.0001.exr", {**others, name: np.full((4, 4), 3.0, np.float32)})
    (line,) = [line for line in intake_lines(open_intake(tmp_path)) if line.startswith("no depth")]
    told = f"--input depth.channels={name}"
    assert line.endswith(f"{told}, which cltaa check judges")
    assert read(tmp_path, told.split()[1])[0].depth[0, 0] == 3.0


def test_a_colour_is_of_one_layer(tmp_path: Path) -> None:
    names = ["flow.R", "flow.G", "distance.R", "final.R", "final.G", "final.B"]
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in names})
    intake = open_intake(tmp_path)
    assert [place.channel for place in intake.roles["colour"]] == ["final.R", "final.G", "final.B"]
    assert intake.profile.name == "parts"  # and not mitsuba, whose depth lies along the ray


def test_no_colour_names_what_is_there(tmp_path: Path) -> None:
    write_image(tmp_path / "a.0001.exr", {"Y": np.ones((4, 4), np.float32)})
    with pytest.raises(DataError, match=r"no colour channels.*found Y.*--input colour.channels='Y Y Y'"):
        open_intake(tmp_path)


@pytest.mark.parametrize(
    ("there", "cure"),
    [
        (["b", "g", "r"], "r g b"),
        (
            ["a.r", "a.b", "blue.r", "diffuse.Blue", "diffuse.Green", "diffuse.Red"],
            "diffuse.Red diffuse.Green diffuse.Blue",
        ),
        (["u", "v", "w"], "RED GREEN BLUE"),
    ],
)
def test_no_colour_asks_for_names_that_are_there(tmp_path: Path, there: list[str], cure: str) -> None:
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in there})
    with pytest.raises(DataError, match=f"no colour channels.*name them: --input colour.channels='{cure}'"):
        open_intake(tmp_path)


def test_no_colour_of_a_stereo_picture_is_told_with_its_own_names(tmp_path: Path) -> None:
    planes: dict[str, Pixels] = {
        f"ViewLayer.Combined.{eye}.{c}": np.ones((2, 3), np.float32) for eye in ("left", "right") for c in "RGB"
    }
    write_image(tmp_path / "shot.0001.exr", planes, {"Software": "Blender 4.2"})
    names = "ViewLayer.Combined.left.R ViewLayer.Combined.left.G ViewLayer.Combined.left.B"
    with pytest.raises(DataError, match=rf"--input colour.channels='{names}'"):
        read(tmp_path)
    assert len(read(tmp_path, f"colour.channels={names}")) == 1


def test_whole_numbers_are_no_light(tmp_path: Path) -> None:
    write_image(tmp_path / "shot.0001.exr", {c: np.full((2, 3), 200, np.uint32) for c in "RGB"})
    with pytest.raises(DataError, match=r"channel R: wrong channel type \(expected half or float, found uint\)"):
        read(tmp_path)


def test_a_picture_in_greys_beside_its_depth_is_told_how_it_is_read(tmp_path: Path) -> None:
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in "YZ"})
    with pytest.raises(DataError, match=r"found Y Z\); name them: --input colour.channels='Y Y Y'"):
        open_intake(tmp_path)


def test_of_several_pictures_none_is_taken_for_the_colour(tmp_path: Path) -> None:
    """A beauty beside an albedo is told by its name; of two takes nobody can say which is meant."""
    made = frames(2)
    for name in ("albedo", "beauty"):
        write_colour(tmp_path / "layers" / name, made)
    intake = open_intake(tmp_path / "layers")
    assert {place.files for place in intake.roles["colour"]} == {"beauty/picture"}
    write_colour(tmp_path / "shot", made, "shot")
    write_colour(tmp_path / "shot" / "backup", made)
    assert {place.files for place in open_intake(tmp_path / "shot").roles["colour"]} == {"shot"}
    for name in ("take1", "take2"):
        write_colour(tmp_path / "takes" / name, made)
    with pytest.raises(
        DataError, match=r"several sets of files.*found take1/picture, take2/picture.*take1\.R take1\.G"
    ):
        open_intake(tmp_path / "takes")
    read(tmp_path / "takes", "colour.channels=take2.R take2.G take2.B")
