"""cltaa: capture, resolve and judge temporal anti-aliasing.

import cltaa

with cltaa.Resolver() as resolver:
    for frame in cltaa.open("sequence"):
        image = resolver.resolve(frame)  # [H, W, 3] float32, linear
"""

from __future__ import annotations

TYPE_CHECKING = False  # typing's, which imports slower than all the rest: an interrupt meanwhile escapes our handler
if TYPE_CHECKING:
    from typing import Any

    from cltaa.core.parameters import Choices, Settings
    from cltaa.core.presets import Preset
    from cltaa.core.resolver import Resolver
    from cltaa.errors import CltaaError
    from cltaa.frame import Camera, Effect, Frame
    from cltaa.inputs.open import open_input as open
    from cltaa.io.exr_write import write_frame
    from cltaa.io.preset_file import read_preset as load_preset
    from cltaa.io.sequence import FrameSequence
    from cltaa.lab.check.report import check_folder as check
    from cltaa.lab.inspect.findings import inspect_input as inspect
    from cltaa.lab.inspect.plan import plan
    from cltaa.lab.judge.metrics import measure
    from cltaa.pipeline.folder import resolve_folder as resolve

__version__ = "0.1.0"

# Public name -> its module, and its name there if that differs. Imported on first use, so that ``import cltaa`` loads
# neither OpenCL nor OpenEXR.
_HOMES = {
    "Camera": "cltaa.frame",
    "Choices": "cltaa.core.parameters",
    "CltaaError": "cltaa.errors",
    "Effect": "cltaa.frame",
    "Frame": "cltaa.frame",
    "FrameSequence": "cltaa.io.sequence",
    "Preset": "cltaa.core.presets",
    "Resolver": "cltaa.core.resolver",
    "Settings": "cltaa.core.parameters",
    "check": "cltaa.lab.check.report:check_folder",
    "inspect": "cltaa.lab.inspect.findings:inspect_input",
    "load_preset": "cltaa.io.preset_file:read_preset",
    "measure": "cltaa.lab.judge.metrics",
    "open": "cltaa.inputs.open:open_input",
    "plan": "cltaa.lab.inspect.plan",
    "resolve": "cltaa.pipeline.folder:resolve_folder",
    "write_frame": "cltaa.io.exr_write",
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
    "check",
    "inspect",
    "load_preset",
    "measure",
    "open",
    "plan",
    "resolve",
    "write_frame",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOMES:
        from cltaa.renamed import PUBLIC, current

        name = current(name, PUBLIC, frozenset(_HOMES), "cltaa's")
    if name not in _HOMES:
        import sys

        what = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(what, name=name, obj=sys.modules[__name__])  # Python names the nearest
    from importlib import import_module

    module, _, there = _HOMES[name].partition(":")
    return getattr(import_module(module), there or name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
