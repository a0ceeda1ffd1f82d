"""``cltaa inspect --profile`` on files of another tool."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

import cltaa
from cltaa.cli import root
from cltaa.core.build import Steps
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.inputs.open import open_input
from cltaa.lab.check.report import check_folder
from cltaa.pipeline.folder import of_whole
from cltaa.pipeline.memory import DevicePlanes, of_sequence
from tests.inputs.foreign import write_blender, write_colour, write_depth, write_parts
from tests.sequence_factory import make_frame

BLENDER = Path(__file__).parents[1] / "thirdparty" / "recorded" / "blender"


def test_it_says_how_blender_would_be_read() -> None:
    done = CliRunner().invoke(root, ["inspect", str(BLENDER), "--json"])
    found = json.loads(done.stdout)
    assert done.exit_code == 0
    assert (found["profile"], found["frames"], found["width"], found["height"]) == ("blender", 6, 64, 36)
    assert found["channels"]["motion"] == ["ViewLayer.Vector.X", "ViewLayer.Vector.Y"]
    assert "ViewLayer.Vector.Z" in found["unused"]
    assert [note.split(":")[0] for note in found["notes"]] == ["no matrices", "no jitter"]
    assert json.loads(msgspec.json.encode(cltaa.inspect(BLENDER))) == found


def test_it_prints_a_table_and_takes_a_side_file() -> None:
    arguments = ["inspect", str(BLENDER), "--profile", "blender", "--camera", str(BLENDER / "camera.json")]
    done = CliRunner().invoke(root, arguments)
    assert done.exit_code == 0
    assert "ViewLayer.Depth.Z" in done.stdout
    assert "without" not in done.stdout


def test_exposure_and_cuts_of_a_side_file_are_shown(tmp_path: Path) -> None:
    side = tmp_path / "camera.csv"
    side.write_text("frame,exposure,cut\n" + "".join(f"{n},{n / 2},{int(n == 4)}\n" for n in range(1, 7)))
    done = CliRunner().invoke(root, ["inspect", str(BLENDER), "--camera", str(side)])
    rows = dict(line.split(None, 1) for line in done.stdout.splitlines() if line.split()[1:])
    assert (rows["exposure"].strip(), rows["cuts"].strip()) == ("0.5 to 3", "4")


def test_the_plan_of_another_tools_files_is_that_of_their_resolve() -> None:
    arguments = ["inspect", str(BLENDER), "--plan", "--device", "numpy", "--json"]
    for options, fits in (([], True), (["--input", "camera.source=none"], False)):
        done = CliRunner().invoke(root, [*arguments, *options])
        assert done.exit_code == 0, done.stderr
        assert "no matrices" in done.stderr  # as a resolve says it
        steps = {step["name"]: step["on"] for step in json.loads(done.stdout)["sections"][-1]["steps"]}
        assert (steps["own motion"], steps["reprojection"], steps["alpha"]) == (True, fits, True)
    # What --camera tells is part of the plan.
    done = CliRunner().invoke(root, [*arguments, "--camera", str(BLENDER / "camera.json")])
    assert "no matrices" not in done.stderr
    steps = {step["name"]: step["on"] for step in json.loads(done.stdout)["sections"][-1]["steps"]}
    assert steps["reprojection"]


def test_pixels_of_another_tools_files_are_looked_at_as_a_resolve_takes_them() -> None:
    for named in ([], ["--profile", "blender"]):
        done = CliRunner().invoke(root, ["inspect", str(BLENDER), "--pixels", "--json", *named])
        found = json.loads(done.stdout)
        assert (done.exit_code, found["problems"]) == (0, [])
        assert sorted(found["statistics"]) == ["A", "B", "G", "R", "Z", "backward.u", "backward.v"]
    done = CliRunner().invoke(root, ["inspect", str(BLENDER), "--pixels"])
    assert "backward.u" in done.stdout
    assert "no problem found" in done.stdout


def test_depth_that_no_channel_holds_is_not_counted(tmp_path: Path) -> None:
    write_colour(tmp_path, [make_frame(1)])
    done = CliRunner().invoke(root, ["inspect", str(tmp_path), "--pixels", "--json"])
    assert sorted(json.loads(done.stdout)["statistics"]) == ["B", "G", "R"]


def test_what_is_wrong_with_another_tools_pixels_is_listed(tmp_path: Path) -> None:
    frames = [make_frame(number) for number in (1, 2, 3)]
    frames[1].colour[3, 4] = np.nan
    for frame in frames:
        frame.depth[:2] = np.inf
    colour = {f"ViewLayer.Combined.{name}": frames[2].colour[..., place] for place, name in enumerate("RGB")}
    write_parts(write_blender(tmp_path, frames) / "shot.0003.exr", {"ViewLayer.Combined": colour}, {})
    done = CliRunner().invoke(root, ["inspect", str(tmp_path), "--pixels", "--json"])
    found = json.loads(done.stdout)
    problems, depth = found["problems"], found["statistics"]["Z"]
    assert done.exit_code == 65
    assert any("shot.0003.exr" in text and "channel is missing" in text for text in problems), problems
    assert any("channel R: 1 of" in text for text in problems), problems
    assert depth["highest"] < 1e9  # Blender's 1e10 is the sky
    assert depth["infinite"] == 2 * 2 * frames[0].width


def test_a_pass_of_another_size_is_told_before_any_frame_is_read(tmp_path: Path) -> None:
    write_depth(tmp_path, [make_frame(number, width=20 if number == 2 else 37) for number in (1, 2, 3)])
    write_colour(tmp_path, [make_frame(number) for number in (1, 2, 3)], "beauty")
    said = "depth.0002.exr frame 2: shows another picture than the colour"
    assert [said in line for line in problems(tmp_path)] == [True]
    with pytest.raises(DataError, match=said):
        open_input(tmp_path)


def test_memory_counts_what_another_tools_frames_hold() -> None:
    source = open_input(BLENDER)
    assert source.holds == {"alpha", "motion"}
    planes = DevicePlanes(Steps(own_motion=True, alpha=True), changes=True, staged=True)
    assert of_whole(source, Resolver(device="numpy"), half=False, layers={}) == of_sequence(source, planes)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def problems(folder: Path, *more: str) -> list[str]:
    done = CliRunner().invoke(root, ["inspect", str(folder), "--json", *more])
    assert (done.exit_code, done.stderr) == (65, "")
    found: list[str] = json.loads(done.stdout)["problems"]
    return found


def test_every_damaged_file_of_another_tool_is_listed(tmp_path: Path) -> None:
    folder = write_blender(tmp_path, [make_frame(number, width=40 if number == 5 else 37) for number in range(1, 9)])
    for number in (1, 2, 6):
        truncate(folder / f"shot.{number:04d}.exr")
    (folder / "shot.0004.exr").write_bytes(b"")
    (folder / "shot.0007.exr").unlink()
    for more in ([], ["--profile", "blender"]):
        missing, truncated, empty, size = problems(folder, *more)
        assert missing == "frames missing: 7"
        assert "shot.0001.exr: the file is truncated" in truncated
        assert truncated.endswith("the same in frames 2, 6")
        assert "shot.0004.exr: the file is empty" in empty
        assert "shot.0005.exr frame 5: size differs (expected 37 x 23, found 40 x 23)" in size


def test_the_pass_that_a_frame_lacks_is_named(tmp_path: Path) -> None:
    """By inspect and by check: the frame's other files are there."""
    frames = [make_frame(number) for number in range(1, 8)]
    write_colour(tmp_path, frames)
    write_depth(tmp_path, frames)
    for name in ("picture.0003", "depth.0003", "depth.0005", "depth.0006"):
        (tmp_path / f"{name}.exr").unlink()
    assert problems(tmp_path) == ["frames missing: 3; depth of 5-6"]
    found = check_folder(tmp_path)[0].findings
    (said,) = [finding.what for finding in found if finding.name == "frames-missing"]
    assert said.startswith("frames are missing: 3; depth of 5-6; render them again")


def test_damage_in_files_beside_the_colour_is_listed(tmp_path: Path) -> None:
    frames = [make_frame(number) for number in (1, 2, 3)]
    write_colour(tmp_path / "beauty", frames)
    write_depth(tmp_path / "depth", frames)
    truncate(tmp_path / "beauty" / "picture.0002.exr")
    truncate(tmp_path / "depth" / "depth.0003.exr")
    (found,) = problems(tmp_path)
    assert "picture.0002.exr: the file is truncated" in found
    assert found.endswith("the same in frame 3")


def test_what_is_wrong_with_all_of_another_tools_files_hides_no_damage(tmp_path: Path) -> None:
    write_colour(tmp_path, [make_frame(number) for number in (1, 2, 3)])
    truncate(tmp_path / "picture.0003.exr")
    asked = ("--input", "depth.channels=Zed")
    damage, asked_for = problems(tmp_path, *asked)
    assert "picture.0003.exr: the file is truncated" in damage
    assert "no such channels" in asked_for
    words = CliRunner().invoke(root, ["inspect", str(tmp_path), *asked]).stdout
    assert words.count("✗") == 2
    for path in tmp_path.iterdir():
        path.write_bytes(b"")
    (found,) = problems(tmp_path, *asked)
    assert found.endswith("the same in frames 2-3")
