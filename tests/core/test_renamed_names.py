"""Each name of an earlier version leads to one of today. (words: frozen)"""

from __future__ import annotations

from pathlib import Path

import pytest

import cltaa
from cltaa.cli import main
from cltaa.commands.options import chosen_effects
from cltaa.core.presets import FIELDS, load_preset, override, preset_names, words_of
from cltaa.frame import Effect, parse_effects
from cltaa.io.preset_file import load_config
from cltaa.renamed import EFFECTS, KEYS, MEMBERS, PRESETS, PUBLIC, WORDS, Renamed
from tests.sequence_factory import write_sequence


def test_no_old_name_is_one_of_today_and_each_new_one_is() -> None:
    assert not KEYS.keys() & FIELDS.keys()
    assert {*KEYS.values()} <= FIELDS.keys()
    for key, words in WORDS.items():
        assert not words.keys() & {*words_of(key)}
        assert {*words.values()} <= {*words_of(key)}
    assert not PRESETS.keys() & {*preset_names()}
    assert {*PRESETS.values()} <= {*preset_names()}
    assert {*EFFECTS.values()} <= {*Effect}
    assert {*MEMBERS["Effect"].values()} <= Effect.__members__.keys()


def test_every_old_key_stands_for_its_new_one() -> None:
    for old, new in KEYS.items():
        for word, now in WORDS.get(new, {"1": 1}).items():
            with pytest.warns(Renamed) as said:
                assert override(load_preset(), {old: word}) == override(load_preset(), {new: now}), old
            assert str(said[0].message).startswith(f"key {old} is called {new} now"), old
            assert new not in WORDS or str(said[1].message).startswith(f"{new} = {word} is called {now} now"), old


def test_every_old_preset_stands_for_its_new_one(tmp_path: Path) -> None:
    for old, new in PRESETS.items():
        with pytest.warns(Renamed, match=f"^preset {old} is called {new} now"):
            assert load_preset(old) == load_preset(new), old
        path = tmp_path / "mine.toml"
        path.write_text(f'preset = "{old}"\nfresh_blur = 0.25\n')
        with pytest.warns(Renamed) as said:
            preset = load_config(path, load_preset("simvx"))
        assert (preset.name, preset.settings.disocclusion_blur) == (f"mine.toml over {new}", 0.25), old
        assert (preset.choices, len(said)) == (load_preset(new).choices, 2), old


def test_every_old_effect_stands_for_its_new_one() -> None:
    for old, new in EFFECTS.items():
        with pytest.warns(Renamed, match=f"^effect {old} is called {new} now"):
            assert chosen_effects(old) == frozenset({Effect(new)}), old
        assert parse_effects(f"camera,{old}") == {Effect.CAMERA, Effect(new)}, old


def test_every_old_member_stands_for_its_new_one() -> None:
    for old, new in MEMBERS["Effect"].items():
        with pytest.warns(Renamed, match=f"^member Effect.{old} is called Effect.{new} now"):
            assert getattr(Effect, old) is Effect[new], old


def test_a_command_warns_in_one_line_for_each_old_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 1)
    command = ["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy"]
    assert main([*command, "--preset", "t2", "--set", "gamma_still=2"]) == 0
    said = capsys.readouterr()
    assert "preset fast with box_scale_static=2" in said.out
    assert said.err.count("cltaa: warning: ") == 2
    assert "key gamma_still is called box_scale_static now" in said.err


def test_every_old_public_name_stands_for_its_new_one() -> None:
    for old, new in PUBLIC.items():
        with pytest.warns(Renamed, match=f"{old} is called {new} now"):
            assert getattr(cltaa, old) is getattr(cltaa, new), old
