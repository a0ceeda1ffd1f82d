"""cltaa: capture, resolve and judge temporal anti-aliasing.

import cltaa

resolver = cltaa.Resolver()
for frame in cltaa.open_sequence("sequence"):
    image = resolver.resolve(frame)  # [H, W, 3] float32, linear
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cltaa.errors import CltaaError
    from cltaa.frames import Camera, Effect, Frame
    from cltaa.inspection.sequence_plan import plan
    from cltaa.parameters.choices import Choices, Settings
    from cltaa.parameters.presets import Preset, load_preset
    from cltaa.resolve.resolver import Resolver
    from cltaa.sequences.sources import Sequence, open_sequence

__version__ = "0.1.0"

# Public name -> module. Imported on first use, so that ``import cltaa`` loads neither OpenCL nor OpenEXR.
_HOMES = {
    "Camera": "cltaa.frames",
    "Choices": "cltaa.parameters.choices",
    "CltaaError": "cltaa.errors",
    "Effect": "cltaa.frames",
    "Frame": "cltaa.frames",
    "Preset": "cltaa.parameters.presets",
    "Resolver": "cltaa.resolve.resolver",
    "Sequence": "cltaa.sequences.sources",
    "Settings": "cltaa.parameters.choices",
    "load_preset": "cltaa.parameters.presets",
    "open_sequence": "cltaa.sequences.sources",
    "plan": "cltaa.inspection.sequence_plan",
}

__all__ = [
    "Camera",
    "Choices",
    "CltaaError",
    "Effect",
    "Frame",
    "Preset",
    "Resolver",
    "Sequence",
    "Settings",
    "load_preset",
    "open_sequence",
    "plan",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
