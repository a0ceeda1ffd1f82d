"""Where scenes are written down: ``@register(...)`` above a function that builds one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cltaa.frame import Effect
from cltaa_datasets.scene import Instant, Part, Scene

# What a scene's function returns: its parts, and how they stand at a time.
Staging = tuple[tuple[Part, ...], Callable[[float], Instant]]


@dataclass(frozen=True, slots=True)
class Entry:
    """A scene that can be built."""

    name: str
    description: str
    effects: frozenset[Effect]
    stage: Callable[[int], Staging]

    def build(self, seed: int) -> Scene:
        """Build the scene; the seed changes textures, placement and phase."""
        parts, at = self.stage(seed)
        return Scene(name=self.name, effects=self.effects, parts=parts, at=at)


SCENES: dict[str, Entry] = {}


def register(
    name: str, description: str, effects: Iterable[Effect]
) -> Callable[[Callable[[int], Staging]], Callable[[int], Staging]]:
    """Write a scene down under ``name``; ``effects`` promise what happens in it, and that nothing else does."""

    def enter(stage: Callable[[int], Staging]) -> Callable[[int], Staging]:
        SCENES[name] = Entry(name, description, frozenset(effects), stage)
        return stage

    return enter
