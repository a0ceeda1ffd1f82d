"""``cltaa bench files``: the command against its stages."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from cltaa.cli import main
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa.lab.bench.files import FilesBench
from cltaa.lab.timing import Interval, environment
from tests.inputs.foreign import frames, side_text, write_blender
from tests.sequence_factory import make_frame, write_frames, write_sequence


def test_the_command_and_its_stages_are_timed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 4)
    assert main(["bench", "files", str(folder), "--compression", "rle", "--half", "--rounds", "3", "--json"]) == 0
    out, told = capsys.readouterr()
    found = json.loads(out)
    assert "timing: 4 of 4 rounds, " in told
    assert (found["compression"], found["half"]) == ("rle", True)
    assert all(found[name]["median"] > 0 for name in ("read", "resolve", "write", "whole", "processor"))
    assert 1 <= found["at_best"]["median"] <= max(1, 1.01 * found["over_slowest"]["median"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_within_a_time_nothing_is_deleted_and_frames_are_finished_as_a_run_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deleted, finished = list[Path](), list[str]()
    monkeypatch.setattr("cltaa.pipeline.output._clear", deleted.append)
    monkeypatch.setattr("cltaa.pipeline.output.OutputFolder.finish", lambda _, done: finished.append(done.name))
    arguments = ["--compression", "none", "--rounds", "3", "--json"]
    assert main(["bench", "files", str(write_sequence(tmp_path / "in", 2)), *arguments]) == 0
    assert deleted == []
    assert {"alone.0000.exr", "alone.0001.exr"} <= {*finished}


def test_the_history_goes_on_where_numbers_are_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also in the frames that are resolved alone, which are numbered anew."""
    write_frames(tmp_path / "in", map(make_frame, (0, 2, 4)))
    numbers: list[int] = []
    resolve = Resolver.resolve

    def noted(resolver: Resolver, frame: Frame, **options: Any) -> Any:
        numbers.append(frame.index)
        return resolve(resolver, frame, **options)

    monkeypatch.setattr("cltaa.lab.bench.files.Resolver.resolve", noted)
    options = ["--step", "2", "--compression", "none", "--rounds", "3", "--device", "numpy"]
    assert main(["bench", "files", str(tmp_path / "in"), *options]) == 0
    assert {*numbers} == {0, 2, 4}
    assert "\nNumPy (float32 oracle); " in capsys.readouterr().out


def test_files_of_other_tools_are_timed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = frames(2)
    folder = write_blender(tmp_path / "shot", made)
    (tmp_path / "camera.txt").write_text(side_text(made))
    how = ["--profile", "blender", "--camera", str(tmp_path / "camera.txt"), "--input", "motion.scale=1,1"]
    options = ["--compression", "none", "--rounds", "3", "--json"]
    assert main(["bench", "files", str(folder), *how, *options]) == 0
    out, notes = capsys.readouterr()
    assert json.loads(out)["frames"] == 2
    assert "profile blender" in notes


def between(low: float, median: float, high: float) -> Interval:
    return Interval(low=low, median=median, high=high)


def test_what_is_printed_are_the_numbers_that_were_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each under its heading; seconds as milliseconds."""
    found = FilesBench(
        width=37,
        height=23,
        frames=1,
        rounds=3,
        environment=environment("a device", 0.0),
        compression="piz",
        half=True,
        read=between(0.010, 0.011, 0.012),
        resolve=between(0.020, 0.021, 0.022),
        write=between(0.030, 0.031, 0.032),
        whole=between(0.040, 0.041, 0.042),
        processor=between(0.050, 0.051, 0.052),
        over_slowest=between(1.25, 1.5, 1.75),
        at_best=between(1.0, 1.125, 1.25),
    )
    monkeypatch.setattr("cltaa.commands.bench_times.bench_files", lambda *_, **__: found)
    assert main(["bench", "files", str(write_sequence(tmp_path, 1))]) == 0
    said = capsys.readouterr().out
    rows = [[cell.strip() for cell in re.split("[│┃]", line)[1:-1]] for line in said.splitlines()]
    rows = [row for row in rows if row]
    assert rows == [
        [
            "compression",
            "read alone",
            "resolve alone",
            "write alone",
            "whole",
            "processor",
            "over slowest",
            "95 %",
            "at best",
        ],
        ["piz, half", "11", "21", "31", "41", "51", "1.50", "1.25–1.75", "1.12"],
    ]
    assert "cltaa resolve, 1 frame, milliseconds a frame" in said
