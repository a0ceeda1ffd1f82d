"""A still life in a courtyard: nothing moves, all surfaces have fine detail, nothing is much brighter than white."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Material, Part, Perspective, Sky, Sun, cut_out, matt

SUN = animation.direction(130.0, 45.0)
SKY = Sky(zenith=(0.14, 0.30, 0.64), horizon=(0.70, 0.76, 0.84), ground=(0.24, 0.22, 0.19), fog=0.006, ambient=0.6)


def courtyard(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return paving and a brick wall with a coping."""
    paving = textures.blocks(rng, (0.56, 0.50, 0.42), (0.20, 0.19, 0.16), 4, 4, 0.02, bonded=False)
    brick = textures.blocks(rng, (0.66, 0.32, 0.20), (0.60, 0.56, 0.50), 6, 12, 0.012)
    stone = textures.mottle(rng, (0.45, 0.43, 0.40), (0.70, 0.67, 0.62))
    return (
        Part("paving", meshes.floor(60.0, 2.4, 24), matt(paving)),
        Part("wall", meshes.sheet((-16.0, 0.0, -4.5), (32.0, 0.0, 0.0), (0.0, 2.4, 0.0), (16.0, 1.2), 4), matt(brick)),
        Part("coping", meshes.placed(meshes.box((32.0, 0.16, 0.6), 1.0), (0.0, 2.48, -4.6)), matt(stone)),
    )


def things(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return glazed and plain shapes, and crossed sheets of foliage."""
    glaze = textures.checker((0.08, 0.34, 0.44), (0.84, 0.80, 0.66), 8, rng)
    page = textures.lettering(rng, (0.06, 0.05, 0.05), (0.80, 0.74, 0.62), 26)
    striped = textures.stripes((0.70, 0.14, 0.08), (0.84, 0.80, 0.72), 6)
    green = cut_out(textures.leaves(rng, (0.04, 0.12, 0.03), (0.24, 0.40, 0.10)))
    sheets = [
        meshes.moved(
            meshes.sheet((-0.7, 0.0, 0.0), (1.4, 0.0, 0.0), (0.0, 1.9, 0.0), (1.0, 1.4)),
            animation.translation((x, 0.0, z)) @ animation.rotation(animation.UP, turn + float(rng.uniform(-0.4, 0.4))),
        )
        for x, z in ((-3.1, -3.0), (3.3, -2.6), (2.2, -3.6))
        for turn in (0.3, 1.35, 2.4)
    ]
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    return (
        Part(
            "knot",
            meshes.moved(
                meshes.knot(0.85, 0.18),
                animation.translation((0.15, 1.25, -1.2)) @ animation.rotation(animation.UP, turn),
            ),
            Material(base_texture=glaze, roughness=0.6),
        ),
        Part(
            "ball",
            meshes.placed(meshes.sphere(0.62, (6.0, 3.0)), (-1.65, 0.62, 0.2)),
            Material(base_texture=page, roughness=0.7),
        ),
        Part(
            "block",
            meshes.moved(
                meshes.box((0.9, 0.9, 0.9)),
                animation.translation((1.65, 0.45, 0.3)) @ animation.rotation(animation.UP, turn),
            ),
            Material(base_texture=striped, roughness=0.8),
        ),
        Part("foliage", meshes.merge(sheets), green),
    )


@register("still", "A finely detailed courtyard in which nothing moves, for convergence", (Effect.SKY,))
def still(seed: int) -> Staging:
    """Stage the scene; the seed changes textures, rotations and foliage."""
    rng = np.random.default_rng(seed)
    parts = (*courtyard(rng), *things(rng))
    now = Instant(
        animation.look_at((0.1, 1.65, 5.0), (0.1, 1.0, -1.0)),
        Perspective(np.radians(44.0)),
        (np.eye(4),) * len(parts),
        (Sun(SUN, (3.4, 3.1, 2.7)),),
        SKY,
    )
    return parts, lambda _: now
