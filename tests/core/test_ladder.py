"""The ladder of presets: complete, and its middle is the default."""

from __future__ import annotations

from cltaa.core.parameters import HistoryKind
from cltaa.core.presets import LADDER, load_preset, preset_names


def test_the_ladder_is_complete_and_only_its_top_gathers() -> None:
    assert set(LADDER) <= set(preset_names())
    assert [load_preset(name).name for name in LADDER] == list(LADDER)
    gathering = [name for name in LADDER if load_preset(name).choices.history is HistoryKind.FRAMES]
    assert gathering == ["gather-8", "gather-48"]
    assert [load_preset(name).settings.history_frames + 1 for name in gathering] == [8, 48]
