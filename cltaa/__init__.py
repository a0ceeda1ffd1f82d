"""cltaa: capture, resolve and judge temporal anti-aliasing.

import cltaa

resolver = cltaa.Resolver()
for frame in cltaa.open_sequence("sequence"):
    image = resolver.resolve(frame)  # [H, W, 3] float32, linear
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cltaa.core.parameters import Choices, Settings
    from cltaa.core.presets import Preset, load_preset
    from cltaa.core.resolver import Resolver
    from cltaa.errors import CltaaError
    from cltaa.frame import Camera, Effect, Frame
    from cltaa.io.sequence import FrameSequence, open_sequence
    from cltaa.lab.inspect.plan import plan

__version__ = "0.1.0"

# Public name -> module. Imported on first use, so that ``import cltaa`` loads neither OpenCL nor OpenEXR.
_HOMES = {
    "Camera": "cltaa.frame",
    "Choices": "cltaa.core.parameters",
    "CltaaError": "cltaa.errors",
    "Effect": "cltaa.frame",
    "Frame": "cltaa.frame",
    "Preset": "cltaa.core.presets",
    "Resolver": "cltaa.core.resolver",
    "FrameSequence": "cltaa.io.sequence",
    "Settings": "cltaa.core.parameters",
    "load_preset": "cltaa.core.presets",
    "open_sequence": "cltaa.io.sequence",
    "plan": "cltaa.lab.inspect.plan",
}

__all__ = [
    "Camera",
    "Choices",
    "CltaaError",
    "Effect",
    "Frame",
    "FrameSequence",
    "Preset",
    "Resolver",
    "Settings",
    "load_preset",
    "open_sequence",
    "plan",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOMES:
        from cltaa.renamed import PUBLIC, current

        name = current(name, PUBLIC, frozenset(_HOMES), "cltaa's")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
