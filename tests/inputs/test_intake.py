"""Sequences of other writers: what they become, what is said about them, and what of them is missing, or a half."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.frame import Frame
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.open import open_input
from cltaa.inputs.roles import Place, describe
from cltaa.io.exr_frame import Pixels, frame_attributes
from cltaa.io.exr_write import write_image
from tests.inputs.foreign import (
    frames,
    read,
    side_text,
    write_blender,
    write_colour,
    write_depth,
    write_own,
    write_parts,
)
from tests.sequence_factory import make_frame, write_images


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
    assert list(open_input(tmp_path / "shot", side_file=side).select(1, 1).numbers) == [1]


def test_without_matrices_and_jitter_it_says_so(tmp_path: Path) -> None:
    intake = open_intake(write_blender(tmp_path, frames()))
    lines = list(intake_lines(intake))
    assert lines[0] == "profile blender: header attribute Software is Blender 5.0.1"
    assert "motion ViewLayer.Vector.X ViewLayer.Vector.Y" in lines[1]
    assert any(
        line.startswith("no matrices: vectors and depth may tell the camera; give them with --camera") for line in lines
    )
    assert any(line.startswith("no jitter") for line in lines)
    frame = read(tmp_path)[1]
    assert frame.jitter_px == (0.0, 0.0)
    np.testing.assert_array_equal(frame.camera.world_to_view, np.eye(4))


BOX = np.array([0.1, 0.2], np.float32), np.array([0.3, 0.4], np.float32)


@pytest.mark.parametrize("jitter", ["text", 0.25, [0.25], np.eye(3) / 4, np.eye(4, dtype=np.float32) / 4, BOX])
def test_an_invalid_jitter_is_reported(jitter: object, tmp_path: Path) -> None:
    folder = write_own(tmp_path, frames(), **{"cltaa:jitterPx": jitter})
    with pytest.raises(DataError, match=r"own.0000.exr frame 0: attribute cltaa:jitterPx is no jitter"):
        read(folder, "motion.swap=false")
    assert [frame.jitter_px for frame in read(folder, "jitter.source=none")] == [(0.0, 0.0)] * 3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cltaa:exposure", 0.0),
        ("cltaa:exposure", "1"),
        ("cltaa:cut", 2),
        ("cltaa:jitterPx", np.array([np.nan, 0.0])),
        ("cltaa:worldToView", np.eye(3)),
    ],
)
@pytest.mark.parametrize("command", [["check"], ["inspect", "--plan"], ["resolve", "--device", "numpy", "-o", "out"]])
def test_an_attribute_that_means_nothing_is_told_by_every_command(
    command: list[str], name: str, value: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_own(tmp_path / "in", frames(), **{name: value})
    assert main([command[0], str(tmp_path / "in"), *command[1:]]) == 65
    (line,) = capsys.readouterr().err.splitlines()
    assert f"own.0000.exr{'' if 'is wrong' in line else ' frame 0'}: attribute {name} is " in line


@pytest.mark.parametrize(
    "assignments",
    [
        ("camera.standard=true", "camera.view=worldToCamera", "camera.projection=worldToNDC"),
        ("camera.sense=camera-to-world",),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_matrix_without_an_inverse_is_reported(assignments: tuple[str, ...], tmp_path: Path) -> None:
    """As some writers leave it where they have no camera: all zeros."""
    none = {name: np.zeros((4, 4), np.float32) for name in ("worldToCamera", "worldToNDC")}
    folder = write_own(tmp_path, frames(), **none, **{"cltaa:worldToView": np.zeros((4, 4))})
    with pytest.raises(DataError, match=r"own.0000.exr frame 0: a matrix of the camera has no inverse.*source=none"):
        read(folder, *assignments)
    del none["worldToCamera"]  # or of the two only one
    write_own(tmp_path, frames(), **none, worldToCamera=np.eye(4), **{"cltaa:worldToView": np.zeros((4, 4))})
    with pytest.raises(DataError, match=r"own.0000.exr frame 0: a matrix of the camera has no inverse.*source=none"):
        read(folder, *assignments)
    assert len(read(folder, *assignments, "camera.source=none")) == 3


def test_colour_alone(tmp_path: Path) -> None:
    write_colour(tmp_path, frames())
    lines = list(intake_lines(open_intake(tmp_path)))
    assert any(line.startswith("no depth") for line in lines)
    assert any("the camera is taken to stand still" in line for line in lines)
    assert any(line.startswith("no motion vectors: whatever moves") for line in lines)
    frame = read(tmp_path)[0]
    assert np.isinf(frame.depth).all()
    assert frame.motion is None


def test_matrices_of_the_standard_are_pointed_out(tmp_path: Path) -> None:
    """Writers disagree about them, so that they are taken when they are asked for."""
    for frame in frames():
        channels = {name: frame.colour[..., place] for place, name in enumerate("RGB")}
        header = {name: value for name, value in frame_attributes(frame).items() if name.startswith("worldTo")}
        write_image(tmp_path / f"picture.{frame.index:04d}.exr", channels, header)
    (line,) = [line for line in intake_lines(open_intake(tmp_path)) if line.startswith("no matrices")]
    asked = shlex.split(line.rpartition("judges: ")[2])[1::2]
    assert read(tmp_path, *asked)[0].has_camera


@pytest.mark.parametrize(
    "names", ["velocity.R velocity.G", "mv.X mv.Y", "motionVectors.u motionVectors.v", "flow.h flow.v"]
)
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
    made, other = frames(), {"Software": "Another 1.0"}
    for frame in made:
        colour: dict[str, Pixels] = {c: frame.colour[..., place].astype(np.float16) for place, c in enumerate("RGB")}
        write_parts(tmp_path / f"shot_{frame.index:03d}.exr", {"rgba": colour, "depth": {"Z": frame.depth}}, other)
    intake = open_intake(tmp_path)
    assert (intake.profile.name, [*intake.roles]) == ("parts", ["colour", "depth"])
    np.testing.assert_array_equal(read(tmp_path)[1].depth, made[1].depth)


def test_files_of_an_engine(tmp_path: Path) -> None:
    """Each buffer in files of its own, all of them with R, G and B; nothing is put together from two of them."""
    made = frames()
    write_colour(tmp_path, made, "image")
    write_depth(tmp_path, made, channels="RGB")
    write_depth(tmp_path, made, "a", channels="R")
    intake = open_intake(tmp_path)
    assert list(intake_lines(intake))[1] == "channels: colour image.R image.G image.B; depth depth.R"
    np.testing.assert_array_equal(read(tmp_path)[1].colour, made[1].colour)
    np.testing.assert_array_equal(read(tmp_path)[1].depth, made[1].depth)


def test_a_folder_for_each_channel_set(tmp_path: Path) -> None:
    made = frames()
    write_colour(tmp_path / "beauty", made, "shot")
    write_images(tmp_path / "reference", [frame.colour + 1 for frame in made], name="shot")
    write_depth(tmp_path / "depth", made, "shot")
    intake = open_intake(tmp_path)
    assert {place.files for places in intake.roles.values() for place in places} == {"beauty/shot", "depth/shot"}
    np.testing.assert_array_equal(read(tmp_path)[2].depth, made[2].depth)
    (tmp_path / "depth" / "shot.0001.exr").unlink()
    with pytest.raises(InputMissing, match="frame 1"):
        open_intake(tmp_path)
    for path in sorted((tmp_path / "depth").glob("*.exr")):
        path.rename(path.with_name(path.name.replace("shot.000", "shot.001")))
    with pytest.raises(InputMissing, match=r"shot\.0000\.exr: no frame has all of its files; render them again"):
        open_intake(tmp_path)


def test_folders_of_one_name_hold_different_files(tmp_path: Path) -> None:
    for light, shot in enumerate(("a", "b"), start=1):
        (tmp_path / shot / "beauty").mkdir(parents=True)
        write_image(tmp_path / shot / "beauty" / "x.0001.exr", dict.fromkeys("RGB", np.full((4, 4), light, np.float32)))
    pattern = tmp_path / "*" / "beauty" / "x.####.exr"
    with pytest.raises(DataError, match=r"several sets .*found a\.beauty/x, b\.beauty/x") as error:
        open_input(pattern)
    option = shlex.split(str(error.value).partition("--input ")[2])[0]
    assert option == "colour.channels=a.beauty.R a.beauty.G a.beauty.B"
    for light, shot in enumerate(("a", "b"), start=1):
        found = open_input(pattern, assignments=[option.replace("a.beauty", f"{shot}.beauty")])
        assert found.frame(1).colour[0, 0, 0] == light


@pytest.mark.parametrize("first", ["damaged", "other names", "no depth"])
def test_a_frame_that_is_not_asked_for_decides_nothing(first: str, tmp_path: Path) -> None:
    for number in range(3):
        write_image(tmp_path / f"a.{number:04d}.exr", dict.fromkeys("RGBZ", np.full((4, 4), 2.0, np.float32)))
    path = tmp_path / "a.0000.exr"
    if first == "damaged":
        path.write_bytes(path.read_bytes()[:100])
    else:
        names = "RGB" if first == "no depth" else ("foo.R", "foo.G", "foo.B")
        write_image(path, dict.fromkeys(names, np.full((4, 4), 2.0, np.float32)))
    found = open_input(tmp_path, frames=(1, 2))
    assert [(frame.index, frame.depth[0, 0]) for frame in found] == [(1, 2.0), (2, 2.0)]
    with pytest.raises(UsageError, match="invalid range of frames"):
        open_input(tmp_path, frames=(1,))


def test_passes_that_share_a_folder_are_called_by_their_names(tmp_path: Path) -> None:
    """Of several sets of files in a subfolder its name tells none: depth.Z, and not passes.Z."""
    made = frames()
    write_colour(tmp_path / "passes", made, "beauty")
    write_depth(tmp_path / "passes", made, "dist", channels="RG")
    write_depth(tmp_path / "passes", made)
    intake = open_intake(tmp_path)
    assert describe(intake.roles, intake.sets) == "colour beauty.R beauty.G beauty.B; depth depth.Z"
    assert intake.unused == ["dist.G", "dist.R"]
    asked = open_intake(tmp_path, assignments=["depth.channels=dist.R"])
    assert asked.roles["depth"] == (Place("passes/dist", "R"),)


def test_hidden_folders_are_no_input(tmp_path: Path) -> None:
    """What a file browser or a backup keeps there is nobody's frame, and may be cut off."""
    write_colour(tmp_path / "beauty", frames(), "shot")
    write_depth(tmp_path / ".thumbs", frames(), "shot", channels="RGB")
    (tmp_path / ".backup").mkdir()
    (tmp_path / ".backup" / "Z.0000.exr").write_bytes(b"half")
    assert [*open_intake(tmp_path).sets] == ["beauty/shot"]
    assert main(["inspect", str(tmp_path)]) == 0


def test_what_was_resolved_into_the_folder_is_no_input(tmp_path: Path) -> None:
    made = frames()
    write_colour(tmp_path, made, "shot")
    for _ in range(2):  # "aa" comes before "shot" in the alphabet, and the second run finds it there
        assert main(["resolve", str(tmp_path), "-o", str(tmp_path / "aa"), "--device", "numpy"]) == 0
        np.testing.assert_array_equal(read(tmp_path)[2].colour, made[2].colour)


@pytest.mark.parametrize("name", ["distance.R", "linearDepth.x", "view_Z", "ZDepthBuffer.x"])
def test_a_channel_that_sounds_like_depth_is_pointed_out(name: str, tmp_path: Path) -> None:
    others = {other: np.ones((4, 4), np.float32) for other in ("R", "G", "B", "N.Z", "position.Z")}
    write_image(tmp_path / "a.0001.exr", {**others, name: np.full((4, 4), 3.0, np.float32)})
    (line,) = [line for line in intake_lines(open_intake(tmp_path)) if line.startswith("no depth")]
    told = f"--input depth.channels={name}"
    assert line.endswith(f"{told}, which cltaa check judges")
    assert read(tmp_path, told.split()[1])[0].depth[0, 0] == 3.0


@pytest.mark.parametrize("first", ["RGB", "RGBZ"])
def test_a_channel_that_only_later_frames_have_is_reported(first: str, tmp_path: Path) -> None:
    for number, names in enumerate((first, "RGBZ", "RGBZ")):
        write_image(tmp_path / f"a.{number:04d}.exr", {name: np.ones((4, 4), np.float32) for name in names})
    told = "not in the first frame: Z; left out of all, for a channel is read of every frame"
    assert (told in intake_lines(open_intake(tmp_path))) == ("Z" not in first)
    assert np.isinf(read(tmp_path)[2].depth).all() == ("Z" not in first)


PLANE = np.ones((5, 7), np.float32)
VECTORS = [
    ("mvec.X", "beside mvec.X is no mvec.Y: write both"),
    ("velocity.y", "beside velocity.y is no velocity.x: write both"),
    ("backward.v", "beside backward.v is no backward.u: write both"),
    ("Vector.R", "beside Vector.R is no Vector.G: write both"),
    ("motion_u", "beside motion_u is no motion_v: write both"),
    ("mvec.X mvec.Y", "to take those in mvec.X mvec.Y: --input motion.channels='mvec.X mvec.Y', which cltaa check"),
]
COLOURS = [
    ("R Z", "beside R is no G B: write all"),
    ("beauty.R beauty.G", "beside beauty.R beauty.G is no beauty.B: write all"),
    ("Red Green", "beside Red Green is no Blue: write all"),
    ("mvec.X Z", "none of them is a picture: write R G B beside; beside mvec.X is no mvec.Y: write all"),
    ("Z", "none of them is a picture: write R G B beside"),
]


def written(folder: Path, channels: str) -> Path:
    write_image(folder / "x.0000.exr", dict.fromkeys(channels.split(), PLANE))
    return folder


@pytest.mark.parametrize(("channels", "line"), VECTORS)
def test_a_component_that_vectors_lack_is_named(channels: str, line: str, tmp_path: Path) -> None:
    lines = intake_lines(open_intake(written(tmp_path, f"R G B {channels}")))
    assert [line in each for each in lines if each.startswith("no motion vectors: ")] == [True]


@pytest.mark.parametrize(("channels", "line"), COLOURS)
def test_a_component_that_a_colour_lacks_is_named(channels: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(DataError) as told:
        open_intake(written(tmp_path, channels))
    assert str(told.value).partition("); ")[2] == line


def test_a_matrix_without_the_other_is_named(tmp_path: Path) -> None:
    for name, other in (("worldToView", "viewToClip"), ("viewToClip", "worldToView")):
        kept = {f"cltaa:{name}": frame_attributes(make_frame(0))[f"cltaa:{name}"]}
        write_image(tmp_path / "x.0000.exr", dict.fromkeys("RGB", PLANE), kept)
        lines = [*intake_lines(open_intake(tmp_path, profile="parts"))]
        assert any(f"; beside attribute cltaa:{name} is no cltaa:{other}: write both" in line for line in lines)
