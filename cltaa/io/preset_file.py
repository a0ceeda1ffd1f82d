"""Presets in TOML files of a user."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec

from cltaa.core.presets import Preset, load_preset, parse_preset
from cltaa.errors import public
from cltaa.io.content import read_text
from cltaa.printable import printable

LARGEST_CONFIG = 1 << 16  # bytes; every parameter with a comment takes a few thousand


def load_config(path: Path, base: Preset) -> Preset:
    """Return ``base`` with the keys of a TOML file over it, named after both; its key ``preset`` names another base."""
    parsed = parse_preset(read_text(path, "a TOML file", LARGEST_CONFIG), str(path), base, tells=True)
    return msgspec.structs.replace(parsed, name=f"{printable(path.name)} over {parsed.name}")


@public("load_preset")
def read_preset(named: str | Path = "default", before: Callable[[Preset], Preset] | None = None) -> Preset:
    """Return the preset of that name, or of a file ``FILE.toml`` over the default; ``before`` changes what is below.
    Raises UsageError, and for a file InputMissing and DataError."""
    file = isinstance(named, str | Path) and str(named).endswith(".toml")
    preset = load_preset("default" if file else str(named) if isinstance(named, Path) else named)
    preset = preset if before is None else before(preset)
    return load_config(Path(named), preset) if file else preset
