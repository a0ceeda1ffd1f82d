"""All scenes: importing this package registers them by name.

To add a scene, write a module here with a function of the seed under ``@register(...)``.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from cltaa.errors import UsageError, known
from cltaa_datasets import model_files
from cltaa_datasets.registry import SCENES, Entry
from cltaa_datasets.scene import Scene

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")  # registers its scenes

FILE_PREFIX = "file:"


def registered() -> list[Entry]:
    """Return all scenes in the order of their names."""
    return [SCENES[name] for name in sorted(SCENES)]


def build_scene(name: str, seed: int = 0, motion: str | None = None) -> Scene:
    """Build a registered scene, or ``file:PATH`` with a motion of ``MOTIONS`` (default: ``default_motion``).

    Raises UsageError for an unknown name, and what ``model_files.load_model`` raises for a file.
    """
    if name.startswith(FILE_PREFIX):
        path = name.removeprefix(FILE_PREFIX)
        motion = motion or model_files.default_motion(path)
        return model_files.played_scene(path, seed) if motion == "play" else model_files.model_scene(path, motion, seed)
    if motion is not None:
        raise UsageError(f"--motion {motion} applies to file:PATH, not to scene {name}", cure="leave it out")
    if name not in SCENES:
        cure = known(name, [*sorted(SCENES), f"{FILE_PREFIX}PATH"], "scenes")
        raise UsageError(f"no such scene: {name}", cure=f"{cure} (see cltaa scenes)")
    return SCENES[name].build(seed)
