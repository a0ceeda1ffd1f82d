"""Sequences of other writers that break off: gaps, steps between frames, depths that are missing, another size."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.inputs.intake import open_intake
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from tests.inputs.foreign import frames, side_text, write_blender, write_colour, write_depth


def resolved(folder: Path, *more: str) -> int:
    return main(["resolve", str(folder), "-o", f"{folder}-out", "--device", "numpy", *more])


def test_a_gap_is_an_error_or_a_new_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(5)
    write_blender(tmp_path / "gap", [made[0], made[1], made[3], made[4]])
    assert resolved(tmp_path / "gap") == 66
    assert "frame 2: the frame is missing" in capsys.readouterr().err
    assert resolved(tmp_path / "gap", "--gaps", "reset") == 0
    write_blender(tmp_path / "behind", made[3:])
    assert resolved(tmp_path / "behind") == 0
    for number in (3, 4):
        name = f"shot.{number:04d}.exr"
        ours, theirs = (read_image(tmp_path / folder / name)[0] for folder in ("gap-out", "behind-out"))
        for channel in "RGB":
            np.testing.assert_array_equal(ours[channel], theirs[channel])


@pytest.mark.parametrize("step", [1, 2])
def test_a_gap_is_reported_and_the_other_frames_are_checked(
    step: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the frames lie apart besides, the step is asked for first."""
    made = [replace(frame, index=step * frame.index) for frame in frames(7)]
    write_blender(tmp_path, [*made[:4], *made[5:]])
    for command in ("inspect", "check"):
        if step > 1:
            assert main([command, str(tmp_path)]) == 66
            assert "the frames are 2 apart: --step 2" in capsys.readouterr().err
        assert main([command, str(tmp_path), "--step", str(step), "--json"]) == 65
        said = json.loads(capsys.readouterr().out)
        told = f"missing: {4 * step}"
        if command == "inspect":
            assert said["problems"] == [f"frames {told}"]
        else:
            (finding,) = [finding for finding in said["findings"] if finding["name"] == "frames-missing"]
            assert told in finding["what"]
            assert all(" " not in finding["name"] and len(finding["name"]) < 30 for finding in said["findings"])


def test_what_is_wrong_outside_the_frames_asked_for_does_not_count(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = frames(7)
    write_blender(tmp_path / "in", [made[0], made[2], made[3], made[4], made[6]])
    assert resolved(tmp_path / "in", "--frames", "2-4") == 0
    write_blender(tmp_path / "alone", made[2:5])
    assert resolved(tmp_path / "alone") == 0
    for number in (2, 3, 4):
        name = f"shot.{number:04d}.exr"
        ours, theirs = (read_image(tmp_path / folder / name)[0] for folder in ("in-out", "alone-out"))
        np.testing.assert_array_equal(ours["G"], theirs["G"])
    capsys.readouterr()
    assert resolved(tmp_path / "in", "--frames", "3-6") == 66
    assert "frame 5: the frame is missing" in capsys.readouterr().err


def test_a_step_of_blender_is_one_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The picture before is that of the step before; the jitter of vectors that hold it is taken from there too."""
    made = frames(4)
    write_blender(tmp_path / "one", made)
    stepped = [replace(frame, index=1 + 7 * frame.index) for frame in made]
    write_blender(tmp_path / "apart", stepped)
    for command in (["check"], ["inspect", "--plan"], ["resolve", "-o", str(tmp_path / "refused")]):
        assert main([*command, str(tmp_path / "apart")]) == 66
        assert "the frames are 7 apart: --step 7" in capsys.readouterr().err
    assert main(["inspect", str(tmp_path / "apart"), "--step", "7"]) == 0
    assert "frames 7 apart: vectors are taken to lead as far back" in " ".join(capsys.readouterr().out.split())
    without = open_intake(tmp_path / "apart", step=7, assignments=["motion.channels='none none'"])
    assert "motion" not in without.roles
    film = ["--step", "7", "--frames", "1-8", "--preview", str(tmp_path / "two.mp4")]
    assert resolved(tmp_path / "apart", *film, "--restart") == 0
    assert (tmp_path / "two.mp4").exists()
    shutil.rmtree(tmp_path / "apart-out")
    for name, made_so in (("one", made), ("apart", stepped)):
        (tmp_path / f"{name}.txt").write_text(side_text(made_so))
        more = ["--camera", str(tmp_path / f"{name}.txt"), "--input", "motion.jittered=1"]
        assert resolved(tmp_path / name, *more, *(["--step", "7"] if name == "apart" else [])) == 0
    for number in range(4):
        ours, theirs = (
            read_image(tmp_path / f"{name}-out" / f"shot.{at:04d}.exr")[0]["G"]
            for name, at in (("one", number), ("apart", 1 + 7 * number))
        )
        np.testing.assert_array_equal(ours, theirs)


def test_a_depth_that_is_missing_is_a_gap(tmp_path: Path) -> None:
    made = frames(4)
    write_colour(tmp_path / "shot", made, "beauty")
    write_depth(tmp_path / "shot", [made[0], made[2], made[3]])
    assert resolved(tmp_path / "shot") == 66
    assert resolved(tmp_path / "shot", "--gaps", "reset") == 0
    assert len(list(Path(f"{tmp_path}/shot-out").glob("*.exr"))) == 3


def test_another_size_is_an_error_or_a_new_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(4)
    write_colour(tmp_path / "shot", made[:2])
    write_colour(tmp_path / "shot", made[2:], rows=12)
    for command in ("resolve", "check", "inspect"):
        more = ["-o", str(tmp_path / "out")] if command == "resolve" else []
        assert main([command, str(tmp_path / "shot"), *more]) == 65
        said = " ".join("".join(capsys.readouterr()).split())
        assert "frame 2: size differs (expected 37 x 23, found 37 x 12)" in said
    assert resolved(tmp_path / "shot", "--on-resize", "reset", "--set", "current_filter=none") == 0
    np.testing.assert_array_equal(
        read_image(tmp_path / "shot-out" / "picture.0002.exr")[0]["R"], made[2].colour[:12, :, 0]
    )


def test_a_sequence_that_grows_is_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(5)
    side = tmp_path / "camera.txt"
    side.write_text(side_text(made))
    for folder, rendered in (("grown", made[:3]), ("whole", made)):
        write_blender(tmp_path / folder, rendered)
        assert resolved(tmp_path / folder, "--camera", str(side)) == 0
    first = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "grown-out").glob("*.exr")}
    write_blender(tmp_path / "grown", made[3:])
    assert resolved(tmp_path / "grown", "--camera", str(side)) == 0
    for path in (tmp_path / "whole-out").glob("*.exr"):
        other = tmp_path / "grown-out" / path.name
        assert path.read_bytes() == other.read_bytes()
        assert first.get(path.name, other.stat().st_mtime_ns) == other.stat().st_mtime_ns
    side.write_text(side_text([replace(frame, jitter_px=(0.0, 0.25)) for frame in made]))
    assert resolved(tmp_path / "grown", "--camera", str(side)) == 65
    assert (
        "its other files, matrices, jitter or exposure are not those that it was made from" in capsys.readouterr().err
    )
    assert resolved(tmp_path / "grown") == 64  # no camera at all is another reading


def test_another_depth_beside_a_finished_frame_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(3)
    write_colour(tmp_path / "shot", made, "beauty")
    write_depth(tmp_path / "shot", made)
    assert resolved(tmp_path / "shot") == 0
    write_image(tmp_path / "shot" / "depth.0001.exr", {"Z": made[2].depth + np.float32(1)})
    assert resolved(tmp_path / "shot") == 65
    assert "beauty.0001.exr frame 1: its other files" in capsys.readouterr().err


def test_channels_asked_for_by_name_must_be_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_colour(tmp_path / "shot", frames(2))
    assert resolved(tmp_path / "shot", "--input", "motion.channels=velocity.r velocity.g") == 64
    assert "velocity.r velocity.g: no such channels (found B G R); do without by" in capsys.readouterr().err
    assert resolved(tmp_path / "shot", "--input", "motion.channels=none none") == 0


@pytest.mark.parametrize("key", ["jitter.attribute", "camera.view", "camera.projection"])
def test_an_attribute_asked_for_by_name_must_be_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str
) -> None:
    write_colour(tmp_path / "shot", frames(2))
    assert resolved(tmp_path / "shot", "--input", f"{key}=nope") == 64
    cure = f"--input {key.partition('.')[0]}.source=none"
    told = capsys.readouterr().err
    assert f"--input {key}=nope: no such attribute" in told
    assert told.rstrip().endswith(f"do without by {cure}")
    assert resolved(tmp_path / "shot", "--input", f"{key}=nope", *cure.split()) == 0


def test_a_channel_that_one_frame_lacks_may_be_done_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "shot").mkdir()
    for number, names in enumerate(("RGBZ", "RGB", "RGBZ")):
        write_image(tmp_path / "shot" / f"a.{number:04d}.exr", dict.fromkeys(names, np.ones((4, 4), np.float32)))
    assert resolved(tmp_path / "shot") == 65
    assert "do without: --input depth.channels='none'" in capsys.readouterr().err
    assert resolved(tmp_path / "shot", "--input", "depth.channels=none", "--restart") == 0


def test_files_without_a_number_are_reported(tmp_path: Path) -> None:
    write_colour(tmp_path, frames(2))
    shutil.copy(tmp_path / "picture.0001.exr", tmp_path / "picture.0001 (copy).exr")
    (note,) = [note for note in open_intake(tmp_path).notes if note.startswith("ignored")]
    assert note.endswith("as the frames are: picture.0001 (copy).exr")
