"""Textured objects with own rotation before a still camera."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Material, Matrix, Part, Perspective, Sky, Sun

SUN = animation.direction(125.0, 42.0)
SKY = Sky(
    zenith=(0.10, 0.20, 0.46),
    horizon=(0.66, 0.72, 0.80),
    ground=(0.26, 0.22, 0.19),
    glow=(1.2, 1.0, 0.8),
    glow_direction=SUN,
    fog=0.01,
    ambient=0.55,
)
BALL_TURNS = 0.16  # per second, as below
CRATE_TURNS = 0.12
KNOT_TURNS = 0.10
RING_TURNS = 0.20


def movers(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return a printed ball, a brick cube, a glazed knot and a golden ring."""
    page = textures.lettering(rng, (0.05, 0.06, 0.10), (0.86, 0.82, 0.74), 20)
    brick = textures.blocks(rng, (0.75, 0.30, 0.18), (0.66, 0.62, 0.56), 6, 10, 0.012)
    glaze = textures.checker((0.10, 0.36, 0.62), (0.88, 0.84, 0.66), 4, rng)
    return (
        Part("ball", meshes.sphere(0.85, (4.0, 2.0)), Material(base_texture=page, roughness=0.45)),
        Part("crate", meshes.box((1.25, 1.25, 1.25)), Material(base_texture=brick, roughness=0.8)),
        Part("knot", meshes.knot(0.8, 0.17), Material(base_texture=glaze, roughness=0.3)),
        Part(
            "ring", meshes.torus(0.62, 0.2), Material(base_colour=(1.0, 0.72, 0.33, 1.0), metallic=1.0, roughness=0.28)
        ),
    )


def surroundings(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return a tiled terrace, a plastered wall behind it, and plinths."""
    tiles = Material(
        base_texture=textures.blocks(rng, (0.58, 0.55, 0.50), (0.24, 0.22, 0.20), 4, 4, 0.02, bonded=False)
    )
    plaster = Material(base_texture=textures.blocks(rng, (0.66, 0.60, 0.50), (0.46, 0.42, 0.36), 5, 9, 0.01))
    stone = Material(base_texture=textures.mottle(rng, (0.30, 0.29, 0.28), (0.62, 0.60, 0.57)), roughness=0.7)
    plinths = [meshes.placed(meshes.box((1.1, 0.5, 1.1), 1.0), (x, 0.25, z)) for x, z in ((-2.3, -0.6), (2.35, -0.4))]
    return (
        Part("terrace", meshes.floor(40.0, 2.0, 16), tiles),
        Part("wall", meshes.sheet((-14.0, 0.0, -5.5), (28.0, 0.0, 0.0), (0.0, 3.1, 0.0), (8.0, 1.3), 4), plaster),
        Part("plinths", meshes.merge(plinths), stone),
    )


@register(
    "spinner",
    "Textured and shining things that turn on their own before a still camera",
    (Effect.MOTION, Effect.DISOCCLUSION, Effect.ILLUMINATION, Effect.HDR, Effect.SKY),
)
def spinner(seed: int) -> Staging:
    """Stage the scene; the seed changes the textures and the start of each rotation."""
    rng = np.random.default_rng(seed)
    moving, still = movers(rng), surroundings(rng)
    phase = rng.random(len(moving))
    view = animation.look_at((0.2, 1.75, 6.6), (0.05, 1.15, 0.0))
    lights = (Sun(SUN, (4.6, 4.2, 3.5)),)

    def poses(time: float) -> tuple[Matrix, ...]:
        ball, crate, knot, ring = (2.0 * np.pi * phase).tolist()
        turn = 2.0 * np.pi * time
        return (
            animation.translation((-2.3, 1.36, -0.6)) @ animation.rotation((0.15, 1.0, 0.0), ball + BALL_TURNS * turn),
            animation.translation((-0.45, 0.95 + 0.12 * float(np.sin(turn / 2.0 + crate)), 0.9))
            @ animation.rotation((0.4, 1.0, 0.2), crate + CRATE_TURNS * turn),
            animation.translation((0.85, 1.75, -1.7)) @ animation.rotation((0.3, 1.0, 0.1), knot - KNOT_TURNS * turn),
            animation.translation((2.35, 1.35, -0.4)) @ animation.rotation((1.0, 0.3, 0.2), ring + RING_TURNS * turn),
        )

    def at(time: float) -> Instant:
        stand = (*poses(time), *((np.eye(4),) * len(still)))
        return Instant(view, Perspective(np.radians(42.0)), stand, lights, SKY)

    return (*moving, *still), at
