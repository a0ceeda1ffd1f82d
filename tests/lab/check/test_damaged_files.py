"""Files that cannot be read are named beside the frames that are not there, and the check looks at the others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from cltaa.cli import root
from cltaa.io.exr_write import write_image
from tests.inputs.foreign import write_colour, write_own
from tests.lab.check.conftest import Scene
from tests.sequence_factory import make_frame


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def spoil_pixels(path: Path) -> None:
    """Damage the last chunk; the header, and where the chunks lie, stay right."""
    content = path.read_bytes()
    path.write_bytes(content[:-200] + bytes(byte ^ 0x55 for byte in content[-200:-10]) + content[-10:])


def checked(folder: Path, *more: str) -> dict[str, Any]:
    done = CliRunner().invoke(root, ["check", str(folder), "--json", *more])
    assert done.exit_code == 65
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def damage(report: dict[str, Any]) -> list[str]:
    return [found["what"] for found in report["findings"] if found["name"] == "file-unreadable" and found["mistake"]]


def missing(report: dict[str, Any]) -> list[str]:
    return [found["what"].split(";")[0] for found in report["findings"] if found["name"] == "frames-missing"]


def refused(folder: Path, *more: str) -> str:
    """The one line of a check that has nothing to look at."""
    done = CliRunner().invoke(root, ["check", str(folder), *more], standalone_mode=False)
    assert done.stdout == ""
    return str(done.exception)


def write_shot(folder: Path, count: int = 8) -> Path:
    frames = [make_frame(number, effects=None) for number in range(1, count + 1)]
    for frame in frames:
        frame.depth[...] = 4.0  # compressible: every chunk has a checksum
        frame.colour[..., 1:] = 0.5
    return write_own(folder, frames)


def test_damaged_and_missing_frames_are_all_named_and_the_rest_is_looked_at(tmp_path: Path) -> None:
    write_shot(tmp_path)
    for number in (1, 6):
        truncate(tmp_path / f"own.{number:04d}.exr")
    spoil_pixels(tmp_path / "own.0003.exr")
    (tmp_path / "own.0004.exr").write_bytes(b"")
    (tmp_path / "own.0007.exr").unlink()
    report = checked(tmp_path)
    truncated, empty, spoilt = damage(report)
    assert "own.0001.exr: the file is truncated" in truncated
    assert truncated.endswith("the same in frame 6")
    assert "own.0004.exr: the file is empty" in empty
    assert "own.0003.exr" in spoilt
    assert "pixels are damaged" in spoilt
    assert missing(report) == ["frames are missing: 7"]
    assert report["frames"] == 3


def test_a_convention_that_is_wrong_is_found_beside_damage(scene: Scene, tmp_path: Path) -> None:
    """What is found is read again as it is right, without the files that cannot be read."""
    write_own(tmp_path, scene("still"))
    files = sorted(tmp_path.glob("*.exr"))
    truncate(files[2])
    spoil_pixels(files[-1])
    report = checked(tmp_path, "--input", "jitter.scale=-1,-1")
    assert [found["name"] for found in report["findings"] if found["mistake"]][-1] == "jitter-negated"
    assert len(damage(report)) == 2
    assert report["frames"] == len(files) - 2


def test_only_damage_in_files_that_are_read_counts(tmp_path: Path) -> None:
    for frame in (make_frame(number, effects=None) for number in (1, 2, 3, 4)):
        write_colour(tmp_path / "beauty", [frame])
        for name, channel in (("depth", "Z"), ("matte", "mask")):
            (tmp_path / name).mkdir(exist_ok=True)
            write_image(tmp_path / name / f"{name}.{frame.index:04d}.exr", {channel: frame.depth})
    truncate(tmp_path / "matte" / "matte.0002.exr")
    assert damage(json.loads(CliRunner().invoke(root, ["check", str(tmp_path), "--json"]).stdout)) == []
    truncate(tmp_path / "depth" / "depth.0003.exr")
    (found,) = damage(checked(tmp_path))
    assert "depth.0003.exr: the file is truncated" in found
    for path in (tmp_path / "depth").iterdir():
        path.write_bytes(b"")  # whose channels nobody can tell
    (found,) = damage(checked(tmp_path))
    assert "depth.0001.exr: the file is empty" in found


def test_damage_outside_the_frames_that_are_asked_for_is_none(tmp_path: Path) -> None:
    write_shot(tmp_path)
    for number in (1, 4, 8):
        truncate(tmp_path / f"own.{number:04d}.exr")
    (found,) = damage(checked(tmp_path, "--frames", "3-7"))
    assert "own.0004.exr" in found
    assert "same in" not in found


@pytest.mark.parametrize("spoil", [truncate, spoil_pixels])
def test_where_all_files_are_damaged_that_is_the_error(spoil: Any, tmp_path: Path) -> None:
    for path in sorted(write_shot(tmp_path, 3).iterdir()):
        spoil(path)
    assert "own.0001.exr" in refused(tmp_path)


def test_a_damaged_end_of_the_frames_that_are_asked_for_is_the_error(tmp_path: Path) -> None:
    write_shot(tmp_path)
    truncate(tmp_path / "own.0001.exr")
    truncate(tmp_path / "own.0005.exr")
    assert "own.0005.exr: the file is truncated" in refused(tmp_path, "--frames", "2-5")
    assert "no such key" in refused(tmp_path, "--input", "motion.sclae=1")  # what was asked wrong is told first
