"""The record of trials: what a search that ended early, or whose files failed, goes on from."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.core.presets import LADDER, Preset
from cltaa.errors import OutputError, StorageError
from cltaa.lab.tune import Record, Trial
from tests.sequence_factory import write_sequence

OTHERS = len(LADDER) - 1  # presets that are tried as they are, beside the default, where the search begins


def test_a_search_that_was_interrupted_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tried: list[Preset] = []
    stop_at = 3

    def error(_: object, preset: Preset) -> float:
        if len(tried) == stop_at:
            raise KeyboardInterrupt
        tried.append(preset)
        return 1.0 + preset.settings.box_scale_static

    monkeypatch.setattr("cltaa.lab.tune.Bench.error", error)
    monkeypatch.setattr("cltaa.lab.tune.Bench.milliseconds", lambda *_: 1.0)
    folder, output = write_sequence(tmp_path / "a", 2, reference=True), tmp_path / "t.toml"
    arguments = ["tune", str(folder), "--budget", "5ms", "--device", "numpy", "--trials", "8", "-o", str(output)]
    assert main(arguments) == 130
    assert "kept, run the same again to go on" in capsys.readouterr().err
    record = tmp_path / ".t.toml.trials"
    record.write_text(record.read_text() + '{"values": {"box": "var')  # and killed while it wrote
    stop_at = 100
    assert main(arguments) == 0
    continued, whole = output.read_text(), tried.copy()
    assert len(whole) == 8 + OTHERS  # none was measured twice
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "t.toml"]
    tried.clear()
    assert main(arguments) == 0
    assert tried == whole  # what it would have been without the interruption
    assert output.read_text() == continued


def test_trials_outlive_an_output_that_fails_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[Preset] = []

    def error(_: object, preset: Preset) -> float:
        measured.append(preset)
        if len(measured) == 3 + OTHERS:
            output.mkdir()
        return 1.0

    monkeypatch.setattr("cltaa.lab.tune.Bench.error", error)
    monkeypatch.setattr("cltaa.lab.tune.Bench.milliseconds", lambda *_: 1.0)
    folder, output = write_sequence(tmp_path / "a", 2, reference=True), tmp_path / "t.toml"
    arguments = ["tune", str(folder), "--budget", "5ms", "--device", "numpy", "--trials", "3", "-o", str(output)]
    assert main(arguments) == OutputError.exit_code
    output.rmdir()
    assert main(arguments) == 0
    assert len(measured) == 3 + OTHERS  # none of them twice
    assert output.is_file()


def test_trials_outlive_a_record_that_cannot_be_written_again(tmp_path: Path) -> None:
    output = tmp_path / "t.toml"
    trials = [Trial(values={"box": "variance"}, error=float(n), milliseconds=1.0) for n in range(3)]
    record = Record(output, "one")
    for trial in trials:
        record.add(trial)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        with pytest.raises(StorageError):
            Record(output, "one")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    again = Record(output, "one")
    assert [again.replay(trial.values) for trial in trials] == trials


def test_trials_behind_another_do_not_hide_what_is_measured_then(tmp_path: Path) -> None:
    """As of an optuna that asks for other settings from some trial on."""
    first, old, new = (Trial(values={"box": box}, error=1.0, milliseconds=1.0) for box in ("a", "b", "c"))
    record = Record(tmp_path / "t.toml", "one")
    for trial in (first, old):
        record.add(trial)
    again = Record(tmp_path / "t.toml", "one")
    assert again.replay(first.values) == first
    assert again.replay(new.values) is None
    again.add(new)
    third = Record(tmp_path / "t.toml", "one")
    assert [third.replay(trial.values) for trial in (first, new)] == [first, new]


def test_trials_of_another_search_count_for_nothing(tmp_path: Path) -> None:
    trial = Trial(values={"box": "variance"}, error=1.0, milliseconds=1.0)
    output = tmp_path / "t.toml"
    Record(output, "one").add(trial)
    assert Record(output, "one").replay({"box": "variance"}) == trial
    assert Record(output, "one").replay({"box": "extremes"}) is None
    assert Record(output, "another").replay({"box": "variance"}) is None
