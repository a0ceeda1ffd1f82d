"""``cltaa bench accuracy`` from the outside: what it writes, goes on with and refuses."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.lab.judge.metrics import mean_psnr
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.printable import printable
from tests.lab.bench.accuracy_tasks import FRAMES
from tests.sequence_factory import make_frame, write_frames, write_images, write_sequence

# The least work; of ``basic`` the kernels are built soonest.
SHORT = ["--preset", "basic", "--rounds", "3", "--patience", "0", "--pixels", "1", "--pictured", "0"]
SHORT += ["--rounding-frames", "0", "--metrics", "mse"]


def test_command(sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "accuracy", str(sequence), "-o", str(tmp_path), *SHORT, "--only", "storage"]
    arguments += ["--metrics", "mse,psnr", "--rounding-frames", "2", "--pixels", "3000"]
    assert main([*arguments, "--json"]) == 0
    out, told = capsys.readouterr()
    result = json.loads(out)
    assert "measuring errors: 4 of 4 tasks, " in told
    assert f"timing {sequence.name}: 3 of 3 rounds, " in told
    assert result == json.loads((tmp_path / "accuracy.json").read_text())
    (measured,) = result["sequences"]
    kept_in = ["half", "half-stochastic", "double"]
    assert [cell["variant"] for cell in measured["cells"]] == ["basic", *(f"storage: {kind}" for kind in kept_in)]
    assert [yard["samples"] for yard in measured["yardstick"]] == [1, 2]
    assert measured["cells"][0]["ratio"]["median"] == 1.0
    assert measured["timed_pixels"] == 2 * 37 * 2 * 23
    assert set(measured["stages"]) >= {"upload", "resolve", "read back"}
    # In milliseconds a megapixel, as the copy of what it moves; another unit is off by a million million.
    assert measured["stages"]["resolve"] > measured["floor"] / 100
    for cell in measured["cells"]:
        assert cell["errors"]["mse"]["p5"] <= cell["errors"]["mse"]["mean"] <= cell["errors"]["mse"]["largest"]
        assert len(cell["errors"]["psnr"]["frames"]) == FRAMES
    if measured["noisy"]:
        assert not any(cell["dominated_by"] for cell in measured["cells"])
    rows = list(csv.DictReader((tmp_path / "accuracy.csv").read_text().splitlines()))
    assert [row["group"] for row in rows] == ["default", *["storage"] * 3, *["supersampling"] * 2]
    assert float(rows[0]["mse"]) == measured["cells"][0]["errors"]["mse"]["mean"]

    finished = {path: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    assert main(arguments) == 0
    assert "basic" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()} == finished


def test_frames_without_error_are_measured(tmp_path: Path) -> None:
    """A PSNR is infinite where a frame is the truth, as in one that is black, and null in JSON."""
    folder = write_sequence(tmp_path / "black", 3, reference=True)
    black = np.zeros_like(make_frame().colour)
    write_frames(folder, (replace(make_frame(number), colour=black) for number in range(2)))
    write_images(folder / "reference", [black, black], name="synthetic")
    arguments = ["bench", "accuracy", str(folder), "-o", str(tmp_path / "report"), *SHORT, "--only", "storage: half"]
    assert main([*arguments, "--metrics", "psnr,mse"]) == 0
    written = json.loads((tmp_path / "report" / "accuracy.json").read_text())
    found = written["sequences"][0]["cells"][0]["errors"]["psnr"]
    assert found["frames"][:2] == [None] * 2
    assert found["mean"] == pytest.approx(mean_psnr([math.inf, math.inf, found["frames"][2]]), rel=1e-12)
    assert found["p5"] == found["frames"][2] < found["mean"]
    assert found["p95"] is None


def test_a_file_of_parameters_may_have_another_name_now(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And what rich takes for a style in one is part of it."""
    asked = ["bench", "accuracy", str(sequence), "-o", str(tmp_path / "out"), *SHORT, "--only", "storage: half"]
    for name in ("a.toml", "[bold]b.toml"):
        (tmp_path / name).write_text("sample_limit = 4\n")
        assert main([*asked, "--config", str(tmp_path / name)]) == 0
        assert f"│ {name} over basic " in capsys.readouterr().out
    quality = ["bench", "quality", "--sequence", str(sequence), "--settled", "1", "--work", str(tmp_path / "work")]
    assert main([*quality, "--device", "numpy", "--config", str(tmp_path / name)]) == 0
    assert f"│ {name} " in capsys.readouterr().out


STORED = [*SHORT, "--only", "storage: half"]


@pytest.fixture(scope="module")
def measured_before(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of ``sequence``."""
    folder = tmp_path_factory.mktemp("report")
    assert main(["bench", "accuracy", str(sequence), "-o", str(folder), *STORED]) == 0
    return folder


@pytest.mark.parametrize("name", [r"a$\foo$b", os.fsdecode(b"bad\xff")])
def test_frames_are_reported_by_the_name_that_they_have_now(
    sequence: Path, measured_before: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """Whatever it is, beside the frames themselves, and though they were measured under another."""
    asked = ["-o", str(shutil.copytree(measured_before, tmp_path, dirs_exist_ok=True)), *STORED]
    moved = shutil.copytree(sequence, tmp_path / name)
    capsys.readouterr()
    assert main(["bench", "accuracy", str(moved), *asked, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "accuracy.json").read_text())
    (measured,) = json.loads((tmp_path / "accuracy.json").read_text())["sequences"]
    assert (measured["name"], measured["folder"]) == (printable(name), printable(moved))
    assert len(list((tmp_path / "times").iterdir())) == 1


def test_what_was_timed_is_not_timed_again(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    other = write_sequence(tmp_path / "other", 3, reference=True)
    both = ["bench", "accuracy", str(sequence), str(other), "-o", str(tmp_path / "out"), *SHORT]
    both += ["--only", "reject", "--json"]
    assert main([*both, "--jobs", "2"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [measured["name"] for measured in result["sequences"]] == [sequence.name, "other"]
    assert result["environment"]["units"] == DeviceLauncher(None).device.cl_device.max_compute_units
    before = set((tmp_path / "out" / "times").iterdir())
    assert main(both) == 0
    assert json.loads(capsys.readouterr().out)["sequences"] == result["sequences"]
    assert set((tmp_path / "out" / "times").iterdir()) == before
    monkeypatch.setattr("cltaa.lab.bench.accuracy.measurement.CORES", 77)  # what was timed on others is no answer here
    assert main(both) == 0
    assert len(set((tmp_path / "out" / "times").iterdir()) - before) == 2
