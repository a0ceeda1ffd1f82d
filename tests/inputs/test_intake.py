"""Sequences of other writers: what they become, what is said about them, and what is missing."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.exr import write_image
from cltaa.exr_channels import Pixels
from cltaa.frames import Camera, Frame
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.opening import open_input
from cltaa.inputs.profile import load_profile, profile_names
from cltaa.inputs.profile_text import override, toml_text
from cltaa.inputs.side_file import read_side_file
from cltaa.sources import Sequence
from tests.inputs.foreign import side_text, write_blender, write_own, write_parts
from tests.sequence_factory import make_camera, make_frame, write_sequence


def frames(count: int = 3) -> list[Frame]:
    """Frames with every vector given and a camera whose numbers need all of a double."""
    made = []
    for index in range(count):
        camera = make_camera((index / 3, 0.1, 5.0))
        frame = make_frame(index, motion=True, camera=camera, jitter_px=(0.3 - index / 7, index / 9), effects=None)
        assert frame.motion is not None
        made.append(replace(frame, motion=np.nan_to_num(frame.motion, nan=0.25)))
    return made


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


def test_side_files_hold_exact_doubles_in_each_format(tmp_path: Path) -> None:
    made = frames()
    text = tmp_path / "camera.txt"
    text.write_text(side_text(made))
    content = {
        str(f.index): {
            "world_to_view": f.camera.world_to_view.tolist(), "view_to_clip": f.camera.view_to_clip.tolist(),
            "jitter_px": f.jitter_px,
        }
        for f in made
    }  # fmt: skip
    (tmp_path / "camera.json").write_text(json.dumps({"frames": content}))
    with (tmp_path / "camera.csv").open("w") as file:
        writer = csv.writer(file)
        names = [
            f"{key}.{n}"
            for key, count in (("world_to_view", 16), ("view_to_clip", 16), ("jitter_px", 2))
            for n in range(count)
        ]
        writer.writerow(["frame", *names])
        for f in made:
            writer.writerow([f.index, *f.camera.world_to_view.ravel(), *f.camera.view_to_clip.ravel(), *f.jitter_px])
    for name in ("camera.txt", "camera.json", "camera.csv"):
        side = read_side_file(tmp_path / name)
        for frame in made:
            found = side[frame.index]
            assert found.world_to_view is not None
            assert found.view_to_clip is not None
            np.testing.assert_array_equal(found.world_to_view, frame.camera.world_to_view)
            np.testing.assert_array_equal(found.view_to_clip, frame.camera.view_to_clip)
            assert found.jitter_px == frame.jitter_px


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"), ("a.json", "[]"), ("a.json", '{"frames": {"1": {"jitter_px": [1]}}}'), ("a.csv", "a,b\n1,2\n"),
        ("a.txt", "world_to_view 1"), ("a.txt", "frame 1\njitter_px x y"), ("a.txt", "frame 1\nnear 1"), ("a.txt", ""),
    ],
)  # fmt: skip
def test_damaged_side_files(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=name):
        read_side_file(tmp_path / name)


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


@pytest.mark.parametrize("name", profile_names())
def test_profiles_survive_toml(name: str, tmp_path: Path) -> None:
    profile = load_profile(name)
    (tmp_path / f"{name}.toml").write_text(toml_text(profile))
    assert load_profile(str(tmp_path / f"{name}.toml")) == profile


def test_a_profile_can_build_on_another(tmp_path: Path) -> None:
    path = tmp_path / "studio.toml"
    path.write_text('profile = "blender"\n[depth]\nscale = 100.0\n')
    assert load_profile(str(path)).depth.scale == 100.0
    assert load_profile(str(path)).motion == load_profile("blender").motion


@pytest.mark.parametrize(
    ("assignment", "error"),
    [
        ("depth", UsageError),
        ("depth.colour=1", UsageError),
        ("depth.kind=deep", DataError),
        ("motion.scale=1", DataError),
    ],
)
def test_wrong_assignments(assignment: str, error: type[CltaaError]) -> None:
    with pytest.raises(error):
        override(load_profile("cltaa"), [assignment])


def test_wrong_profiles(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="known profiles: auto, arnold"):
        load_profile("maya")
    with pytest.raises(InputMissing):
        load_profile(str(tmp_path / "a.toml"))
    for text in ("[", "[depth]\nkin = 1", 'speed = "x"'):
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(DataError):
            load_profile(str(tmp_path / "a.toml"))


def test_no_colour_names_what_is_there(tmp_path: Path) -> None:
    write_image(tmp_path / "a.0001.exr", {"Y": np.ones((4, 4), np.float32)})
    with pytest.raises(DataError, match=r"no colour channels.*found Y"):
        open_intake(tmp_path)
