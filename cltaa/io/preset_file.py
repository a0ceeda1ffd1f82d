"""Presets in files of users: TOML, a few keys over a preset that comes with cltaa."""

from __future__ import annotations

from pathlib import Path

import msgspec

from cltaa.core.presets import Preset, load_preset, parse_preset
from cltaa.io.content import read_text

LARGEST_CONFIG = 1 << 16  # bytes; every parameter with a comment takes a few thousand


def load_config(path: Path, base: Preset) -> Preset:
    """``base`` with the keys of a TOML file over it, and so named; its optional key ``preset`` names another base."""
    parsed = parse_preset(read_text(path, "a TOML file", LARGEST_CONFIG), str(path), base)
    return msgspec.structs.replace(parsed, name=f"{path.name} over {parsed.name}")


def preset_of(name: str, config: Path | None) -> Preset:
    """The preset of that name, with a TOML file over it where one is given; raises what reading either raises."""
    preset = load_preset(name)
    return preset if config is None else load_config(config, preset)
