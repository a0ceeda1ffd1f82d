"""What ``cltaa resolve`` says of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.inputs.intake import OPAQUE
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_image
from cltaa.pipeline.run import ResolveReport, StageTimes
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_frame, write_sequence


def outcome(**changes: Any) -> ResolveReport:
    seconds = StageTimes(read=0.001, upload=0.002, kernels=0.003, read_back=0.004, write=0.005, whole=0.0125)
    made: dict[str, Any] = {
        "output": "/out",
        "frames": 5,
        "resolved": 5,
        "repaired": 0,
        "missing": [],
        "opaque": 0,
        "saturated": 0,
        "cuts_found": [],
        "width": 37,
        "height": 23,
        "device": "a device",
        "preset": "default",
        "seconds": seconds,
    }
    return ResolveReport(**made | changes)


@pytest.mark.parametrize(
    ("changes", "options", "said"),
    [
        ({}, [], []),
        ({"resolved": 4}, [], ["1 frame finished already"]),
        (
            {"resolved": 2, "repaired": 1},
            [],
            ["3 frames finished already", "1 missing sample: the history stands in, or else what lies around"],
        ),
        (
            {"repaired": 7, "saturated": 9},
            [],
            [
                "7 missing samples: the history stands in, or else what lies around",
                "9 pixels saturated at 65504, the largest half",
            ],
        ),
        ({}, ["--debug", "count"], ["debug views in /out/debug"]),
        ({}, ["--preview", "a [b].mp4"], ["film a [b].mp4"]),
        ({"cuts_found": [7, 12]}, [], ["cut found at frame 7, 12, which nothing declares: a new history"]),
        ({"opaque": 5}, [], []),  # of cltaa's own files
    ],
)
def test_what_is_said_of_a_run(
    changes: dict[str, Any],
    options: list[str],
    said: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("cltaa.pipeline.folder.resolve_sequence", lambda *_, **__: outcome(**changes))
    command = ["resolve", str(write_sequence(tmp_path / "in", 1)), "-o", str(tmp_path / "out"), "--device", "numpy"]
    assert main([*command, *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if "│" in line]
    times = {"read": 1, "upload": 2, "kernels": 3, "read back": 4, "write": 5, "whole": 12.5}
    assert table == [[name, f"{milliseconds:.1f}"] for name, milliseconds in times.items()]
    behind = [line for line in lines[1:] if line.strip() and line[0] not in "┏┃┡│├└"]
    assert lines[0] == "5 frames, 37 x 23, preset default"
    whole = "stages: medians, side by side; whole: the clock over all frames, with building kernels"
    assert sorted(behind) == sorted([whole, *said, "on a device", "written to /out"])


@pytest.mark.parametrize(("opaque", "told"), [(5, True), (4, False), (0, False)])
def test_an_alpha_of_1_in_every_frame_of_another_tool_is_reported(
    opaque: int, told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cltaa.pipeline.folder.resolve_sequence", lambda *_, **__: outcome(opaque=opaque))
    folder = write_blender(tmp_path / "in", [make_frame(0, motion=True)])
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    assert (OPAQUE in " ".join(capsys.readouterr().out.split())) is told


def test_of_negative_depth_the_way_to_an_option_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = make_frame(0, motion=True)
    (tmp_path / "in").mkdir()
    frame = replace(frame, depth=-np.where(np.isinf(frame.depth), np.float32(9), frame.depth))
    path = tmp_path / "in" / "x.0000.exr"
    write_image(path, frame_planes(frame, path), frame_attributes(frame))  # write_frame refuses it
    run = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]
    assert main(run) == 65
    assert "before the camera: cltaa check tells whether an option" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "in")]) == 65
    assert "--input depth.scale=-1" in capsys.readouterr().out
    assert main([*run, "--input", "depth.scale=-1"]) == 0
