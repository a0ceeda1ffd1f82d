"""The ladder of presets: complete, and its middle is the default."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.core.parameters import HistoryKind
from cltaa.core.presets import LADDER, load_preset, preset_names
from cltaa.io.preset_file import load_config


def test_the_ladder_is_complete_and_only_its_top_gathers() -> None:
    assert set(LADDER) <= set(preset_names())
    assert [load_preset(name).name for name in LADDER] == list(LADDER)
    gathering = [name for name in LADDER if load_preset(name).choices.history is HistoryKind.FRAMES]
    assert gathering == ["gather-8", "gather-48"]
    assert [load_preset(name).settings.history_frames + 1 for name in gathering] == [8, 48]


def test_the_command_takes_an_old_name_with_one_line_that_names_the_new_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["presets", "gather-48"]) == 0
    expected = capsys.readouterr().out
    for old in ("t5", "t5"):  # each time, not once a process
        assert main(["presets", old]) == 0
        said = capsys.readouterr()
        assert said.out == expected
        assert said.err == "cltaa: warning: preset t5 is called gather-48 now; the next version takes that alone\n"
    assert main(["presets", "karis", "--against", "t2"]) == 0
    assert (
        capsys.readouterr().err == "cltaa: warning: preset t2 is called fast now; the next version takes that alone\n"
    )


def test_a_file_may_begin_with_an_old_name(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('preset = "t4"\nfit_reach = 0.75\n')
    with pytest.warns(FutureWarning, match="called gather-8 now"):
        assert load_config(tmp_path / "mine.toml", load_preset()).name == "mine.toml over gather-8"
