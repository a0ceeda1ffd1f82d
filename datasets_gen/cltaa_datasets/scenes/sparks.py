"""Sparks: points of radiance ten thousand, at most a pixel wide, each on its own path."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, swarms
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Part, Shape, emitting
from cltaa_datasets.sets import gallery, standing

COUNT, SIZE = 70, 0.006  # number; metres from a spark's centre to its tip
LIFE, REST = 1.2, 0.15  # seconds
NOZZLE = animation.translation((-0.2, 1.3, 0.4))
SPEEDS = np.array([-1.6, 0.0, -0.3]), np.array([1.6, 2.2, 0.5])
PULL = np.array([0.0, -3.0, 0.0])
HOT = (1.0e4, 4.2e3, 9.0e2)


def glowing() -> Part:
    """Return the swarm of sparks, a deforming part."""
    light = emitting(HOT, double_sided=True)
    return Part("sparks", swarms.repeated(swarms.OCTAHEDRON, swarms.SIDES, COUNT), light, deforms=True)


def thrown(rng: np.random.Generator) -> swarms.Path:
    """Return the paths of the sparks from their nozzle."""
    return swarms.fountain(rng, COUNT, life=LIFE, rest=REST, speeds=SPEEDS, pull=PULL, growth=0.0, size=SIZE)


@register(
    "sparks",
    "Sparks of radiance 10000 fly before a wall",
    (Effect.MOTION, Effect.HDR, Effect.THIN, Effect.DISOCCLUSION),
)
def sparks(seed: int) -> Staging:
    """Throw sparks from a nozzle; the seed changes their paths and phases."""
    path = thrown(np.random.default_rng(seed))
    parts = (glowing(), *gallery(seed))

    def at(time: float) -> Instant:
        shapes: dict[str, Shape] = {"sparks": swarms.placed(swarms.OCTAHEDRON, *path(time))}
        return standing(parts, moving=(NOZZLE,), shapes=shapes)

    return parts, at
