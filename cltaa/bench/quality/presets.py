"""The presets of ``cltaa bench quality``: those that come with cltaa, and files of the user's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from cltaa.bench.by_name import by_name
from cltaa.parameters.presets import Preset, load_config, load_preset, preset_names


def chosen_presets(names: Sequence[str], configs: Sequence[Path]) -> list[Preset]:
    """The presets of these names and those of TOML files, each called as its file is; without either all of cltaa's.

    A file begins with the default unless it names another preset, and says in its description over which it is.
    Raises UsageError for two files of one name, and what ``load_preset`` and ``load_config`` raise.
    """
    chosen = [load_preset(name) for name in dict.fromkeys(names) or (() if configs else preset_names())]
    for name, path in by_name(configs, "presets").items():
        over = load_config(path, load_preset())
        chosen.append(msgspec.structs.replace(over, name=name, description=over.name))
    return chosen
