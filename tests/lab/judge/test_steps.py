"""Frames whose numbers lie several apart, each continuing the last: judged as if they were numbered 0, 1, 2."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cltaa.cli import main
from cltaa.core.presets import load_preset
from cltaa.inputs.open import Reading
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.bench.accuracy.measurement import tasks_of
from cltaa.lab.bench.cells import Judging, run, task_of
from cltaa.lab.bench.variants import ladder
from cltaa.lab.timing import timed_frames, timed_numbers
from tests.sequence_factory import make_frame, write_frames, write_images, write_sequence

STEP, COUNT = 7, 5


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """Frames with vectors, and a truth that is not flat."""
    folder = write_sequence(tmp_path / "plain", COUNT, motion=True)
    truth = [make_frame(number, seed=1).colour for number in range(COUNT)]
    write_images(folder / "reference", truth, name="synthetic")
    return folder


@pytest.fixture
def stepped(plain: Path, tmp_path: Path) -> Path:
    """The same, ``STEP`` apart."""
    folder = tmp_path / "stepped"
    for number, truth in zip(range(COUNT), open_images(plain / "reference"), strict=True):
        write_images(folder / "reference", [truth], name="synthetic", first=STEP * number)
    return write_frames(folder, (replace(frame, index=STEP * frame.index) for frame in open_sequence(plain)))


def found(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Any:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_compare_follows_each_frame_to_the_next(plain: Path, stepped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    expected = found(capsys, "compare", plain, "--video", "--metrics", "mse")["video"]
    assert expected["flicker"] > 0
    assert found(capsys, "compare", stepped, "--video", "--metrics", "mse", "--step", str(STEP))["video"] == expected
    assert main(["compare", str(stepped), "--video"]) == 64
    message = capsys.readouterr().err
    assert message.endswith("(expected frames 1 apart, found 7 apart); say --step 7 if each continues the last\n")
    assert main(["compare", str(stepped), "--metrics", "mse"]) == 0  # single images need no step


def test_quality_is_that_of_the_same_frames(
    plain: Path, stepped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = f"--preset fast --settled 2 --work {tmp_path / 'work'} --device numpy".split()
    expected = found(capsys, "bench", "quality", "--sequence", plain, *common)["rows"][0]["presets"]
    write_images(
        stepped / "reference", [make_frame(9).colour], name="synthetic", first=STEP + 1
    )  # more than is asked for
    (row,) = found(capsys, "bench", "quality", "--sequence", stepped, "--step", str(STEP), *common)["rows"]
    scores = row["presets"]
    for name, judged in expected.items():
        assert scores[name]["scores"] == judged["scores"]
    assert main(["bench", "quality", "--sequence", str(stepped), *common]) == 66
    assert "the frames are 7 apart: --step 7 takes each" in capsys.readouterr().err


def test_accuracy_is_that_of_the_same_frames(plain: Path, stepped: Path) -> None:
    variants, judging = ladder(load_preset())[:1], Judging(metrics=("mse",))
    tasks = [
        task_of(open_sequence(folder, step=step), variants, "numpy", judging, Reading(step=step))
        for folder, step in ((plain, 1), (stepped, STEP))
    ]
    expected, errors = (run(task)["default"].errors for task in tasks)
    assert errors == expected
    assert len({task.path(plain, variants[0]) for task in tasks}) == 2


def test_two_frames_that_belong_together_are_timed(stepped: Path) -> None:
    sequence = open_sequence(stepped, step=STEP)
    assert timed_numbers(sequence) == [STEP * (COUNT - 2), STEP * (COUNT - 1)]
    assert [frame.step for frame in timed_frames(sequence)] == [STEP, STEP]


def test_tune_and_bench_files_take_the_step(
    stepped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.lab.tune.LADDER", ("accumulate",))  # the others take long on NumPy
    asked = f"--budget 9999ms --trials 2 --device numpy --step {STEP} -o {tmp_path / 't.toml'}".split()
    assert found(capsys, "tune", stepped, *asked)["trials"] == 2
    asked = f"--compression none --rounds 3 --step {STEP} --device numpy".split()
    assert found(capsys, "bench", "files", stepped, *asked)["frames"] == COUNT
    (task, *_) = tasks_of([stepped], ladder(load_preset())[:1], None, Judging(metrics=("mse",)), Reading(step=STEP))
    assert task.open().step == STEP
