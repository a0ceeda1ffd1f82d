"""Sub-pixel wires against the sky: a pasture fence and a power line, under a walking camera."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Material, Part, Perspective, Sky, Sun, matt

WALK = 0.9  # metres per second
SUN = animation.direction(70.0, 32.0)
SKY = Sky(
    zenith=(0.10, 0.25, 0.62),
    horizon=(0.86, 0.82, 0.76),
    ground=(0.30, 0.30, 0.20),
    glow=(0.5, 0.35, 0.15),
    glow_direction=animation.direction(40.0, 10.0),
    fog=0.004,
    ambient=0.6,
)


def fence(rng: np.random.Generator) -> tuple[Part, Part]:
    """Return posts, 2.5 m apart, on uneven ground, and six wires of 2 mm radius from post to post."""
    heads = [
        (2.5 * (i - 9) + float(x), 1.35 + float(y), -5.0 - 0.35 * i)
        for i, (x, y) in enumerate(rng.uniform(-0.05, 0.05, (18, 2)))
    ]
    timber = [meshes.bar((x, -0.3, z), (x, y, z), 0.055, 10) for x, y, z in heads]
    strands = []
    for (x0, y0, z0), (x1, y1, z1) in pairwise(heads):
        for share in np.linspace(0.16, 0.96, 6).tolist():
            strands.append(meshes.bar((x0, share * y0, z0), (x1, share * y1, z1), 0.002))
    wood = matt(textures.planks(rng, (0.42, 0.30, 0.20)))
    steel = Material(base_colour=(0.10, 0.10, 0.11, 1.0), specular=0.0)
    return Part("posts", meshes.merge(timber), wood), Part("strands", meshes.merge(strands), steel)


def power_line(rng: np.random.Generator) -> Part:
    """Return five distant masts, 32 m apart, with cross-arms and sagging cables of 9 mm radius."""
    bars = []
    feet = [(32.0 * (i - 1.6), 0.0, -34.0 - 7.0 * i + float(rng.uniform(-1.0, 1.0))) for i in range(5)]
    for x, _, z in feet:
        bars.append(meshes.bar((x, -1.0, z), (x, 9.0, z), 0.11, 8))
        bars += [meshes.bar((x - 1.3, y, z), (x + 1.3, y, z), 0.05) for y in (7.4, 8.5)]
    for (x0, _, z0), (x1, _, z1) in pairwise(feet):
        for arm in (-1.2, 1.2):
            for height in (7.4, 8.5):
                start, end = np.array([x0 + arm, height, z0]), np.array([x1 + arm, height, z1])
                bars.append(meshes.tube(partial(_sagging, start, end), _sideways, 0.009, 24))
    return Part("power line", meshes.merge(bars), Material(base_colour=(0.07, 0.07, 0.08, 1.0), specular=0.0))


def _sagging(start: meshes.Floats, end: meshes.Floats, s: meshes.Floats) -> meshes.Floats:
    """Return a parabola between two points, with a sag of 1.1 m in the middle."""
    points = start + s[..., None] * (end - start)
    points[..., 1] -= 4.4 * s * (1.0 - s)
    return points


def _sideways(_: meshes.Floats) -> meshes.Floats:
    return np.array([0.0, 0.0, 1.0])


@register(
    "wires",
    "A fence and a power line of sub-pixel wires against the sky, from a camera that walks by",
    (Effect.CAMERA, Effect.THIN, Effect.DISOCCLUSION, Effect.SKY),
)
def wires(seed: int) -> Staging:
    """Stage the scene; the seed changes posts, masts, textures and the start of the walk."""
    rng = np.random.default_rng(seed)
    grass = matt(textures.mottle(rng, (0.10, 0.14, 0.03), (0.36, 0.40, 0.14), 32))
    meadow = Part("meadow", meshes.floor(240.0, 1.5, 48), grass)
    parts = (*fence(rng), power_line(rng), meadow)
    start = float(rng.uniform(-1.0, 1.0))
    lights = (Sun(SUN, (4.2, 3.7, 3.0)),)

    def at(time: float) -> Instant:
        x = start + WALK * time
        view = animation.look_at((x, 0.42, 0.0), (x + 2.4, 1.75, -9.0))
        return Instant(view, Perspective(np.radians(46.0)), (np.eye(4),) * len(parts), lights, SKY)

    return parts, at
