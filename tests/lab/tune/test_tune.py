"""``cltaa tune``: goals, the search on a sequence whose answer is known, and the check elsewhere."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cltaa.cli import main
from cltaa.commands.tune import outcome_lines
from cltaa.core.backend import Launcher, launcher_for
from cltaa.core.presets import Preset, load_preset, override
from cltaa.errors import UsageError
from cltaa.io.preset_file import load_config
from cltaa.lab.tune import Goal, Trial, Tuned, overfits, parse_goal, preset_text
from tests.sequence_factory import write_images, write_sequence

FOUND = Tuned(
    goal=Goal(metric="flip", budget_ms=5.0),
    start=Trial(values={"rectify": "clip"}, error=0.25, milliseconds=4.0),
    best=Trial(values={"rectify": "none"}, error=0.125, milliseconds=3.0),
    trials=7,
    reached=True,
    searched_on=["a", "b"],
    checked_on=["c", "d"],
    gain=2.0,
    gain_elsewhere=1.5,
    overfits=False,
)


def test_goals_are_parsed() -> None:
    assert parse_goal("5ms", None, "flip") == Goal(metric="flip", budget_ms=5.0)
    assert parse_goal("0.25 ms", None) == Goal(metric="mse", budget_ms=0.25)
    assert parse_goal(None, "flip=0.02", "flip") == Goal(metric="flip", target=0.02)


@pytest.mark.parametrize(
    ("budget", "target", "metric"),
    [
        (None, None, "mse"),
        ("5ms", "mse=1", "mse"),
        ("five", None, "mse"),
        ("5s", None, "mse"),
        ("-1ms", None, "mse"),
        ("5ms", None, "psnr"),
        (None, "mse", None),
        (None, "ssim=0.9", None),
        (None, "mse=nan", None),
        (None, "flip=0.1", "mse"),
    ],
)
def test_wrong_goals_are_refused(budget: str | None, target: str | None, metric: str | None) -> None:
    with pytest.raises(UsageError):
        parse_goal(budget, target, metric)


def test_a_budget_without_a_unit_is_refused() -> None:
    with pytest.raises(UsageError, match="--budget 5 has no unit; in milliseconds it is --budget 5ms"):
        parse_goal("5", None)


def test_settings_beyond_the_limit_score_worse_than_those_within_it() -> None:
    goal = Goal(metric="mse", budget_ms=2.0)
    assert goal.score(1.0, 1.0) == goal.score(1.0, 2.0) == 1.0
    assert goal.score(0.5, 4.0) > goal.score(1.0, 2.0)
    assert goal.reached(9.0, 2.0)
    assert not goal.reached(0.0, 2.1)
    other = Goal(metric="mse", target=0.1)
    assert other.score(0.2, 1.0) > other.score(0.1, 2.0)
    assert other.reached(0.1, 99.0)


@pytest.mark.parametrize(
    ("gain", "elsewhere", "verdict"), [(2.0, 1.5, False), (2.0, 1.1, True), (1.0, 0.5, False), (2.0, 0.0, True)]
)
def test_a_gain_that_is_not_borne_out_is_over_fitting(gain: float, elsewhere: float, verdict: bool) -> None:
    assert overfits(gain, elsewhere) is verdict


@pytest.mark.parametrize(
    ("name", "called"), [*[(name, name) for name in ("default", "basic", "karis")], ("karis", "x over karis")]
)
def test_preset_text_is_toml_that_resolve_reads(name: str, called: str, tmp_path: Path) -> None:
    base = msgspec.structs.replace(load_preset(name), name=called)
    tuned = msgspec.structs.replace(FOUND, searched_on=['a "b"', os.fsdecode(b"\xff")], overfits=True)
    # Some are the values that a preset begins from, and not those of the default.
    wanted = override(
        base, {"rectify": "clip", "sample_limit": 31.7, "illumination": "static", "resampling_penalty": 1.5}
    )
    path = tmp_path / "tuned.toml"
    path.write_text(preset_text(tuned, wanted), encoding="utf-8")
    assert "over-fits" in tomllib.loads(path.read_text())["description"]
    read = load_config(path, load_preset())  # as resolve --config does
    assert (read.choices, read.settings, read.published) == (wanted.choices, wanted.settings, base.published)


def test_search_finds_something_no_worse_and_checks_it_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.lab.tune.LADDER", ("accumulate",))  # the others take long on NumPy
    # One frame, which cannot be timed, is enough to check on.
    folders = [
        write_sequence(tmp_path / name, count, reference=True, seed=count) for name, count in (("a", 3), ("b", 1))
    ]
    output = tmp_path / "tuned.toml"
    arguments = ["tune", *map(str, folders), "--budget", "10000ms", "--trials", "4", "-o", str(output)]
    arguments += ["--device", "numpy"]
    assert main([*arguments, "--json"]) == 0
    printed, told = capsys.readouterr()
    assert "tuning: 4 of 4 trials, " in told
    tuned = json.loads(printed)
    assert (tuned["searched_on"], tuned["checked_on"]) == (["a"], ["b"])
    assert tuned["reached"]
    assert tuned["best"]["error"] <= tuned["start"]["error"]
    assert tuned["gain"] == pytest.approx(tuned["start"]["error"] / tuned["best"]["error"])
    assert np.isfinite(tuned["gain_elsewhere"])
    load_config(output, load_preset())


@pytest.mark.parametrize("bad", ["a", "b"])
def test_a_truth_that_is_no_light_is_refused_before_the_search(
    bad: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No error against it means anything: NaN would count as black, or make every trial as good as another."""
    monkeypatch.setattr("cltaa.lab.tune.Bench.error", lambda *_: pytest.fail("it searched"))
    folders = [write_sequence(tmp_path / name, 2, reference=True) for name in "ab"]
    write_images(tmp_path / bad / "reference", [np.full((23, 37, 3), np.nan, np.float32)], name="synthetic")
    arguments = ["tune", *map(str, folders), "--budget", "5ms", "--device", "numpy", "-o", str(tmp_path / "t.toml")]
    assert main(arguments) == 65
    assert f"{bad}/reference/synthetic.0000.exr frame 0: NaN or infinity in 2553 values" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_is_reported_before_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_sequence(tmp_path / "a", 2, reference=True)
    monkeypatch.setattr("cltaa.commands.tune.tune", lambda *_, **__: pytest.fail("it searched"))
    arguments = ["tune", str(folder), "--budget", "5ms", "--device", "numpy"]
    for output in (tmp_path / "nowhere" / "t.toml", tmp_path):
        assert main([*arguments, "-o", str(output)]) == 73
    assert capsys.readouterr().err.count("cltaa: error: ") == 2


def test_the_search_begins_with_the_preset_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where its numbers lie beyond what is searched, as basic's sample_limit does."""
    tried: list[Preset] = []

    def error(_: object, preset: Preset) -> float:
        tried.append(preset)
        return float(len(tried))  # the first is the best

    monkeypatch.setattr("cltaa.lab.tune.Bench.error", error)
    monkeypatch.setattr("cltaa.lab.tune.Bench.milliseconds", lambda *_: 1.0)
    folder, output = write_sequence(tmp_path / "a", 2, reference=True), tmp_path / "t.toml"
    arguments = ["tune", str(folder), "--budget", "5ms", "--preset", "basic", "--trials", "2", "--device", "numpy"]
    assert main([*arguments, "-o", str(output)]) == 0
    assert "nothing better" in capsys.readouterr().out
    assert tried[0] == load_preset("basic")
    assert load_config(output, load_preset()).deciding() == load_preset("basic").deciding()
    (tmp_path / "mine.toml").write_text("blend_weight = 0.25\n")
    tried.clear()
    assert main([*arguments, "--config", str(tmp_path / "mine.toml"), "-o", str(output)]) == 0
    assert tried[0].deciding() == override(load_preset("basic"), {"blend_weight": 0.25}).deciding()
    assert load_config(output, load_preset()).deciding() == tried[0].deciding()


@pytest.mark.parametrize(("budget", "best"), [("5ms", "fast"), ("9ms", "gather-8"), ("1ms", None)])
def test_the_search_does_not_end_below_a_preset_that_fits(
    budget: str, best: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Errors and times by name; what is tried beside presets errs by 9 in 4 ms, and a budget of 1 ms nothing keeps."""
    known = {"fast": (3.0, 4.0), "gather-8": (1.0, 8.0), "basic": (5.0, 2.0)}
    monkeypatch.setattr("cltaa.lab.tune.Bench.error", lambda _, preset: known.get(preset.name, (9.0, 4.0))[0])
    monkeypatch.setattr("cltaa.lab.tune.Bench.milliseconds", lambda _, p: known.get(p.name, (9.0, 4.0))[1])
    folder, output = write_sequence(tmp_path / "a", 2, reference=True), tmp_path / "t.toml"
    arguments = ["tune", str(folder), "--budget", budget, "--trials", "2", "--device", "numpy", "-o", str(output)]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert ("the goal was not reached" in said) == (best is None)
    if best is not None:
        assert f"that is the preset {best} as it is" in said
        assert load_config(output, load_preset()).deciding() == load_preset(best).deciding()


def test_what_is_said_of_the_outcome() -> None:
    began = "flip 0.125 in 3 ms a frame; it began with 0.25 in 4 ms (7 trials on a, b)"
    gained = "error 2.000 times smaller where it was searched, 1.500 times on c, d: "
    assert outcome_lines(FOUND) == [began, gained + "it holds there"]
    assert outcome_lines(msgspec.structs.replace(FOUND, overfits=True)) == [began, gained + "it over-fits"]
    faster = msgspec.structs.replace(FOUND, gain=1.0, gain_elsewhere=0.9)
    assert outcome_lines(faster)[1] == "error 1.000 times smaller where it was searched, 0.900 times on c, d"
    once = msgspec.structs.replace(FOUND, trials=1, searched_on=["a"], checked_on=[], gain_elsewhere=None)
    first, second = outcome_lines(once)
    assert first.endswith("(1 trial on a)")
    assert "not checked" in second
    same = outcome_lines(msgspec.structs.replace(FOUND, best=FOUND.start))
    assert same[1:] == ["nothing better than where it began was found; more --trials, or another --preset, may find it"]


def test_the_file_says_that_its_goal_was_not_reached() -> None:
    missed = preset_text(msgspec.structs.replace(FOUND, reached=False), load_preset("fast"))
    about = "Tuned for flip within 5 ms on a, b, 7 trials; the goal was not reached"
    assert tomllib.loads(missed)["description"] == about
    assert "reached" not in preset_text(FOUND, load_preset("fast"))


def test_what_is_asked_for_is_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And the command that uses the outcome is one that a shell does not take apart."""
    asked: dict[str, Any] = {}

    def found(searched: list[Any], checked: list[Any], goal: Goal, launcher: Launcher, **more: Any) -> Any:
        names = [[sequence.folder.name for sequence in some] for some in (searched, checked)]
        asked.update(more, names=names, goal=goal, device=launcher.description)
        return FOUND

    monkeypatch.setattr("cltaa.commands.tune.tune", found)
    folders = [write_sequence(tmp_path / name, 2, reference=True) for name in "abc"]
    output = tmp_path / "what was found.toml"
    options = ["--budget", "5ms", "--metric", "flip", "--trials", "7", "--seed", "3", "--device", "numpy"]
    assert main(["tune", *map(str, folders), *options, "-o", str(output)]) == 0
    assert asked.pop("base") == load_preset()
    assert asked == {
        "names": [["a", "b"], ["c"]],
        "goal": FOUND.goal,
        "device": launcher_for("numpy").description,
        "trials": 7,
        "seed": 3,
        "output": output,
    }
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"written to {output}; use it with: cltaa resolve --config '{output}'"


def test_another_way_to_a_sequence_is_the_same_sequence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sequence(tmp_path / "a", 2, reference=True)
    monkeypatch.chdir(tmp_path)
    command = ["tune", str(tmp_path / "a"), "--check", "a", "--budget", "5ms", "--device", "numpy", "-o", "t.toml"]
    assert main(command) == 64
    assert "used both to search and to check; name another one with --check" in capsys.readouterr().err
