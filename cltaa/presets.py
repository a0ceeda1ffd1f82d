"""Named presets: TOML files beside this module, each a set of choices and settings that differ from the defaults."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

import msgspec

from cltaa.errors import DataError, UsageError
from cltaa.file_content import read_text
from cltaa.params import Preset, override

LARGEST_CONFIG = 1 << 16  # bytes; every parameter with a comment takes a few thousand
_FOLDER = resources.files("cltaa") / "presets"


def preset_names() -> list[str]:
    """Names of the presets that come with cltaa, sorted."""
    return sorted(Path(entry.name).stem for entry in _FOLDER.iterdir() if entry.name.endswith(".toml"))


def load_preset(name: str = "default") -> Preset:
    """The preset of that name; raises UsageError where there is none."""
    if name not in preset_names():
        raise UsageError(f"unknown preset {name}", cure=f"known presets: {', '.join(preset_names())}")
    return _parse(name, (_FOLDER / f"{name}.toml").read_text(encoding="utf-8"), origin=f"preset {name}")


def load_config(path: Path, base: Preset) -> Preset:
    """``base`` with the keys of a TOML file; its optional key ``preset`` names another base."""
    return _parse(base.name, read_text(path, "a TOML file", LARGEST_CONFIG), origin=str(path), base=base)


def _parse(name: str, text: str, origin: str, base: Preset | None = None) -> Preset:
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"not TOML: {error}", path=origin) from None
    if "preset" in values:
        base = load_preset(str(values.pop("preset")))
    base = base or Preset(name=name, description="")
    said = {key: values.pop(key) for key in ("description", "jitter", "published") if key in values}
    try:
        named = msgspec.convert(msgspec.to_builtins(base) | said | {"name": name}, Preset)
    except msgspec.ValidationError as error:
        raise UsageError(f"{origin}: {error}".replace("`$.", "`")) from None
    return override(named, values, origin)
