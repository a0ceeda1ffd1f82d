"""The ladder of presets: complete, and its middle is the default."""

from __future__ import annotations

from cltaa.core.parameters import HistoryOf
from cltaa.core.presets import load_preset, preset_names


def test_the_default_is_tier_three() -> None:
    default, tier = load_preset(), load_preset("t3")
    assert (default.choices, default.settings) == (tier.choices, tier.settings)


def test_tiers_are_complete_and_only_the_top_gathers() -> None:
    tiers = [name for name in preset_names() if name[0] == "t" and name[1:].isdigit()]
    assert tiers == [f"t{number}" for number in range(6)]
    gathering = [name for name in tiers if load_preset(name).choices.history_of is HistoryOf.SAMPLES]
    assert gathering == ["t4", "t5"]
    assert load_preset("t4").settings.frames_kept < load_preset("t5").settings.frames_kept
