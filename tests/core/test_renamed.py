"""Names of earlier versions are taken, and whoever uses one is told the new one. (words: frozen)"""

from __future__ import annotations

import subprocess
import sys

import pytest

from cltaa import renamed
from cltaa.cli import main
from cltaa.core.presets import load_preset, override
from cltaa.errors import UsageError
from cltaa.frame import Effect
from cltaa.renamed import Renamed


@pytest.fixture
def earlier(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give today's names earlier ones, so that the tests hold whatever is renamed next."""
    monkeypatch.setitem(renamed.KEYS, "lost", "no_such_key")
    monkeypatch.setitem(renamed.WORDS, "rectify", {"lost": "no-such-word"})
    monkeypatch.setitem(renamed.PRESETS, "usual", "default")
    monkeypatch.setitem(renamed.PRESETS, "lost", "no-such-preset")
    monkeypatch.setitem(renamed.EFFECTS, "reflecting", "reactive")


@pytest.mark.usefixtures("earlier")
def test_an_old_effect_name_makes_an_effect_and_an_unknown_one_none() -> None:
    with pytest.warns(Renamed):
        assert Effect("reflecting") is Effect.REACTIVE
    with pytest.raises(UsageError, match="unknown effect glowing; known effects: "):
        Effect("glowing")
    with pytest.raises(AttributeError, match="type object 'Effect' has no attribute 'GLOWING'"):
        Effect.GLOWING  # type: ignore[attr-defined]  # noqa: B018


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
