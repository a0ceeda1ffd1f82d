"""The registry of scenes: ``@register(...)`` above a function that builds one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cltaa.frame import Effect
from cltaa_datasets.scene import Instant, Part, Scene

# Result of a scene's function: its parts, and their instant as a function of time.
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
    """Register a scene under ``name``; ``effects`` must list everything that happens in it."""

    def enter(stage: Callable[[int], Staging]) -> Callable[[int], Staging]:
        SCENES[name] = Entry(name, description, frozenset(effects), stage)
        return stage

    return enter
