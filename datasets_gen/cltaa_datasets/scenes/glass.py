"""Translucent surfaces, whose motion no channel can hold: panes and smoke before a wall."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, swarms, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import AlphaMode, Instant, Material, Part
from cltaa_datasets.sets import gallery, standing

PUFFS, SIZE, GROWTH = 40, 0.10, 0.14  # of smoke; metres, metres per second
LIFE, REST = 2.4, 0.2  # seconds
SPEEDS = np.array([-0.35, 0.3, -0.1]), np.array([0.35, 0.7, 0.3])
RISE = np.array([0.12, 0.2, 0.0])
CHIMNEY = animation.translation((0.1, 0.4, 0.8))
PANES = (  # colour and opacity, place, metres either way, period
    ((0.75, 0.12, 0.10, 0.45), (-0.9, 0.35, 0.9), 0.7, 2.6),
    ((0.10, 0.55, 0.20, 0.30), (0.5, 0.55, 1.2), 0.6, 3.4),
    ((0.10, 0.20, 0.75, 0.60), (0.2, 0.2, 0.6), 0.9, 4.2),
)


@register("panes", "Coloured panes of glass slide before a still gallery", (Effect.REACTIVE,))
def panes(seed: int) -> Staging:
    """Slide panes: depth and motion remain the wall's; the channel ``reactive`` holds the glass's share."""
    rng = np.random.default_rng(seed)
    phase = rng.random(len(PANES))
    glass = tuple(
        Part(
            f"pane {i}",
            meshes.sheet((-0.4, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 1.4, 0.0)),
            Material(base_colour=colour, specular=0.0, alpha_mode=AlphaMode.BLEND, double_sided=True),
        )
        for i, (colour, *_) in enumerate(PANES)
    )
    parts = (*glass, *gallery(seed))

    def at(time: float) -> Instant:
        slid = tuple(
            animation.translation((x + reach * animation.swing(time, period, float(phase[i])), y, z))
            for i, (_, (x, y, z), reach, period) in enumerate(PANES)
        )
        return standing(parts, moving=slid)

    return parts, at


def puffs() -> Part:
    """Return a swarm of soft grey discs that face +z."""
    across, down = textures.coordinates(64)
    density = np.clip(1.0 - 2.0 * np.hypot(across - 0.5, down - 0.5), 0.0, 1.0)
    soft = textures.make_texture(np.ones((64, 64, 3)), density)
    # All emit the same light, so that the order of drawing does not matter.
    grey = Material(
        base_colour=(0.0, 0.0, 0.0, 0.5),
        base_texture=soft,
        specular=0.0,
        emissive=(0.45, 0.45, 0.47),
        alpha_mode=AlphaMode.BLEND,
        double_sided=True,
    )
    return Part("smoke", swarms.repeated(swarms.CARD, swarms.HALVES, PUFFS), grey, deforms=True)


def rising(rng: np.random.Generator) -> swarms.Path:
    """Return the paths of the puffs from their chimney."""
    return swarms.fountain(rng, PUFFS, life=LIFE, rest=REST, speeds=SPEEDS, pull=RISE, growth=GROWTH, size=SIZE)


@register("smoke", "Smoke of soft particles rises before a still gallery", (Effect.REACTIVE,))
def smoke(seed: int) -> Staging:
    """Let particles rise that have neither depth nor motion vectors."""
    path = rising(np.random.default_rng(seed))
    parts = (puffs(), *gallery(seed))

    def at(time: float) -> Instant:
        return standing(parts, moving=(CHIMNEY,), shapes={"smoke": swarms.placed(swarms.CARD, *path(time))})

    return parts, at
