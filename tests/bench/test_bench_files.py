"""``cltaa bench files``: the table of compressions, and the command against its stages."""

from __future__ import annotations

import json
from pathlib import Path

import OpenEXR
import pytest

from cltaa.cli import main
from tests.inputs.foreign import frames, side_text, write_blender
from tests.sequence_factory import write_sequence


def test_every_compression_and_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, before = write_sequence(tmp_path / "in", 4), OpenEXR.global_thread_count()
    arguments = ["--compressions", "none,zip", "--threads", "1,2", "--commands", "zip,none:half", "--rounds", "3"]
    assert main(["bench", "files", str(folder), *arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    ways = [(row["codec"], row["half"], row["threads"]) for row in found["packings"]]
    assert sorted(ways) == sorted((c, h, t) for c in ("none", "zip") for h in (False, True) for t in (1, 2))
    size = {way: row["megabytes"] for way, row in zip(ways, found["packings"], strict=True)}
    assert size["zip", False, 1] < size["none", False, 1]
    assert size["none", True, 1] < size["none", False, 1]
    assert [(stage["codec"], stage["half"]) for stage in found["stages"]] == [("zip", False), ("none", True)]
    for stage in found["stages"]:
        assert all(stage[name]["median"] > 0 for name in ("read", "resolve", "write", "whole", "processor"))
        assert 1 <= stage["at_best"]["median"] <= max(1, 1.01 * stage["over_slowest"]["median"])
    assert OpenEXR.global_thread_count() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_a_log_has_one_line_of_progress_for_the_rounds_of_a_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--compressions", "", "--commands", "none", "--rounds", "3", "--json"]
    assert main(["bench", "files", str(write_sequence(tmp_path / "in", 2)), *arguments]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("timing none: 4 of 4 rounds, ")  # the first warms up


def test_nothing_is_deleted_within_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deleted: list[Path] = []
    monkeypatch.setattr("cltaa.resolve.output._clear", deleted.append)
    arguments = ["--compressions", "none", "--threads", "1", "--commands", "none", "--rounds", "3", "--json"]
    assert main(["bench", "files", str(write_sequence(tmp_path / "in", 2)), *arguments]) == 0
    assert deleted == []


@pytest.mark.parametrize(
    ("option", "value", "code"),
    [("--compressions", "b44", 64), ("--threads", "x", 2), ("--threads", "1025", 64), ("--commands", "zip:full", 64)],
)
def test_nonsense(tmp_path: Path, option: str, value: str, code: int) -> None:
    assert main(["bench", "files", str(write_sequence(tmp_path, 1)), option, value]) == code


def test_what_is_not_timed_has_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "files", str(write_sequence(tmp_path, 1)), "--compressions", "", "--commands"]
    assert main([*arguments, ""]) == 64
    assert "nothing to time" in capsys.readouterr().err
    assert main([*arguments, "none", "--rounds", "3"]) == 0
    assert "a resolved frame" not in capsys.readouterr().out


def test_files_of_other_tools(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(2)
    folder = write_blender(tmp_path / "shot", made)
    (tmp_path / "camera.txt").write_text(side_text(made))
    how = ["--profile", "blender", "--camera", str(tmp_path / "camera.txt"), "--input", "motion.scale=1,1"]
    options = ["--compressions", "none", "--threads", "1", "--commands", "none", "--rounds", "3", "--json"]
    assert main(["bench", "files", str(folder), *how, *options]) == 0
    out, notes = capsys.readouterr()
    assert json.loads(out)["frames"] == 2
    assert "profile blender" in notes


def test_the_oracle_is_timed_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--compressions", "none", "--threads", "1", "--commands", "none", "--rounds", "3", "--device", "numpy"]
    assert main(["bench", "files", str(write_sequence(tmp_path / "in", 1)), *options]) == 0
    assert "\nNumPy (float32 oracle); " in capsys.readouterr().out
