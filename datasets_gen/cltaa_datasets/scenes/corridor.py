"""A walk down a colonnade whose fine checkered floor runs to the horizon."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Part, Perspective, Sky, Sun, matt

PACE = 1.6  # metres per second
LENGTH = 160.0  # of the colonnade in metres
BAY = 4.0  # metres from column to column
SUN = animation.direction(-60.0, 38.0)
SKY = Sky(
    zenith=(0.12, 0.28, 0.66),
    horizon=(0.90, 0.80, 0.66),
    ground=(0.34, 0.30, 0.26),
    glow=(0.9, 0.6, 0.3),
    glow_direction=animation.direction(-12.0, 6.0),
    fog=0.012,
    ambient=0.6,
)


def colonnade(rng: np.random.Generator) -> tuple[Part, Part]:
    """Return two rows of columns on plinths, and the beams on them."""
    stone = matt(textures.mottle(rng, (0.62, 0.54, 0.44), (0.86, 0.80, 0.70), 6))
    brick = matt(textures.blocks(rng, (0.72, 0.36, 0.22), (0.62, 0.58, 0.52), 6, 12, 0.012))
    stones, beams = [], []
    for side in (-3.0, 3.0):
        for z in np.arange(2.0, -LENGTH, -BAY).tolist():
            stones.append(meshes.placed(meshes.cylinder(0.34, 3.3, (2.0, 3.0)), (side, 0.3, z)))
            for height, width in ((0.15, 1.0), (3.7, 0.9)):
                block = meshes.box((width, 0.3 if height < 1.0 else 0.2, width), 1.0)
                stones.append(meshes.placed(block, (side, height, z)))
        for z in np.arange(0.0, -LENGTH, -BAY).tolist():
            beams.append(meshes.placed(meshes.box((0.8, 0.9, BAY), 1.5), (side, 4.25, z)))
    return Part("columns", meshes.merge(stones), stone), Part("beams", meshes.merge(beams), brick)


@register(
    "corridor",
    "A dolly between columns over a fine checkered floor that runs to the horizon",
    (Effect.CAMERA, Effect.DISOCCLUSION, Effect.SKY),
)
def corridor(seed: int) -> Staging:
    """Stage the scene; the seed changes the stones, the bricks and the start of the walk."""
    rng = np.random.default_rng(seed)
    marble = matt(textures.checker((0.78, 0.74, 0.68), (0.06, 0.06, 0.07), 8, rng))
    parts = (Part("floor", meshes.floor(300.0, 2.4, 64), marble), *colonnade(rng))
    start = float(rng.uniform(0.0, BAY))
    lights = (Sun(SUN, (4.6, 3.8, 2.8)),)

    def at(time: float) -> Instant:
        z = -start - PACE * time
        view = animation.look_at((0.3, 1.6, z), (-0.2, 1.5, z - 10.0))
        return Instant(view, Perspective(np.radians(58.0)), (np.eye(4),) * len(parts), lights, SKY)

    return parts, at
