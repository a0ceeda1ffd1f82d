"""Names of earlier versions are taken, and whoever uses one is told the new one. (words: frozen)"""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from cltaa import renamed
from cltaa.cli import main
from cltaa.commands.options import chosen_effects
from cltaa.core.presets import load_preset, override
from cltaa.errors import UsageError
from cltaa.frame import Effect, parse_effects
from cltaa.io.preset_file import load_config
from cltaa.renamed import Renamed


@pytest.fixture
def earlier(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give today's names earlier ones, so that the tests hold whatever is renamed next."""
    monkeypatch.setitem(renamed.KEYS, "highest_count", "sample_limit")
    monkeypatch.setitem(renamed.KEYS, "correction", "rectify")
    monkeypatch.setitem(renamed.KEYS, "lost", "no_such_key")
    monkeypatch.setitem(renamed.WORDS, "rectify", {"cut": "clip", "lost": "no-such-word"})
    monkeypatch.setitem(renamed.PRESETS, "usual", "default")
    monkeypatch.setitem(renamed.PRESETS, "lost", "no-such-preset")
    monkeypatch.setitem(renamed.EFFECTS, "reflecting", "reactive")
    monkeypatch.setitem(renamed.MEMBERS["Effect"], "REFLECTING", "REACTIVE")


@pytest.mark.usefixtures("earlier")
def test_an_old_key_and_an_old_value_warn_and_still_work() -> None:
    with pytest.warns(Renamed, match="^key highest_count is called sample_limit now"):
        assert override(load_preset(), {"highest_count": 7}).settings.sample_limit == 7
    with pytest.warns(Renamed) as said:
        assert override(load_preset(), {"correction": "cut"}).choices.rectify == "clip"
    assert [str(each.message).partition(" now;")[0] for each in said] == [
        "key correction is called rectify",
        "rectify = cut is called clip",
    ]


@pytest.mark.usefixtures("earlier")
def test_a_key_of_a_file_and_a_preset_that_it_begins_with(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('preset = "usual"\nhighest_count = 5.0\n')
    with pytest.warns(Renamed) as said:
        preset = load_config(path, load_preset("simvx"))
    assert (preset.name, preset.settings.sample_limit) == ("mine.toml over default", 5.0)
    assert len(said) == 2


@pytest.mark.usefixtures("earlier")
def test_an_old_effect_name_warns_and_still_works() -> None:
    with pytest.warns(Renamed, match="^effect reflecting is called reactive now"):
        assert chosen_effects("camera, reflecting") == frozenset({Effect.CAMERA, Effect.REACTIVE})
    with pytest.warns(Renamed, match="^member Effect.REFLECTING is called Effect.REACTIVE now"):
        assert Effect.REFLECTING is Effect.REACTIVE  # type: ignore[attr-defined]
    with pytest.warns(Renamed):
        assert Effect("reflecting") is Effect.REACTIVE
    with pytest.raises(ValueError, match="glowing"):
        Effect("glowing")
    with pytest.raises(AttributeError, match="type object 'Effect' has no attribute 'GLOWING'"):
        Effect.GLOWING  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.usefixtures("earlier")
def test_a_file_is_read_without_a_word() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert parse_effects("camera,reflecting") == {Effect.CAMERA, Effect.REACTIVE}


@pytest.mark.usefixtures("earlier")
@pytest.mark.parametrize("values", [{"lost": 1}, {"rectify": "lost"}])
def test_a_name_that_leads_nowhere_is_none(values: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="lost"):
        override(load_preset(), values)
    with pytest.raises(UsageError, match="unknown preset lost"):
        load_preset("lost")


@pytest.mark.usefixtures("earlier")
def test_a_command_says_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):  # each time, not once a process
        assert main(["presets", "karis", "--against", "usual"]) == 0
        said = "cltaa: warning: preset usual is called default now; the next version takes that alone\n"
        assert capsys.readouterr().err == said


@pytest.mark.usefixtures("earlier")
def test_a_command_says_one_line_for_two_places(capsys: pytest.CaptureFixture[str]) -> None:
    with renamed.one_line_each():
        load_preset("usual")
        load_preset("usual")
    assert capsys.readouterr().err.count("cltaa: warning: ") == 1


def test_a_program_gets_a_warning_that_python_shows() -> None:
    code = (
        "from cltaa import renamed; from cltaa.core.presets import load_preset\n"
        "renamed.PRESETS['usual'] = 'default'\n"
        "load_preset('usual')\n"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stderr
    assert "Renamed: preset usual is called default now" in shown
