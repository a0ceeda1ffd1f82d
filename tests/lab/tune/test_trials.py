"""Trials that are kept: what a search that ended early, or whose files failed, goes on from."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.core.presets import LADDER, Preset
from cltaa.errors import OutputError
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
    assert len(list((tmp_path / ".t.toml.trials").iterdir())) == stop_at
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


def test_trials_of_another_search_count_for_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By another metric, or on other frames; of the same a preset is measured once."""
    measured: list[str] = []
    monkeypatch.setattr("cltaa.lab.tune.Bench.milliseconds", lambda *_: 1.0)

    def error(_: object, preset: Preset) -> float:
        measured.append(preset.name)
        return 1.0

    monkeypatch.setattr("cltaa.lab.tune.Bench.error", error)
    monkeypatch.setattr("cltaa.lab.tune.shutil.rmtree", lambda _: None)  # as if none had ended
    one, other = (str(write_sequence(tmp_path / name, 2, reference=True, seed=seed)) for seed, name in enumerate("ab"))
    for folder, metric in ((one, "mse"), (one, "mse"), (one, "mse-linear"), (other, "mse")):
        arguments = ["tune", folder, "--budget", "5ms", "--metric", metric, "--device", "numpy", "--trials", "2"]
        assert main([*arguments, "-o", str(tmp_path / "t.toml")]) == 0
    assert len(measured) == 3 * (2 + OTHERS)
