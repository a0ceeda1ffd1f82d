"""Things that slide before a detailed wall and uncover it again."""

from __future__ import annotations

import numpy as np

from cltaa.frames import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import AlphaMode, Instant, Material, Part, Perspective, Sky, Sun

SUN = animation.direction(150.0, 40.0)
SKY = Sky(ambient=0.55)
BOARD_PERIOD, BOARD_REACH = 3.2, 1.7  # seconds, metres
GRILLE_PERIOD, GRILLE_REACH = 5.0, 1.2


def wall(rng: np.random.Generator) -> tuple[Part, ...]:
    """A brick wall with printed posters, over a boarded floor; all of it matt."""
    brick = textures.blocks(rng, (0.70, 0.36, 0.24), (0.64, 0.60, 0.54), 6, 12, 0.012)
    inks = (
        ((0.04, 0.05, 0.10), (0.85, 0.80, 0.68)),
        ((0.55, 0.07, 0.06), (0.90, 0.88, 0.80)),
        ((0.9, 0.85, 0.6), (0.05, 0.16, 0.22)),
    )
    posters = [
        Part(
            f"poster {i}",
            meshes.sheet((x, 0.75 + 0.12 * i, -1.98), (1.15, 0.0, 0.0), (0.0, 1.15, 0.0)),
            Material(base_texture=textures.lettering(rng, *inks[i], 22 + 4 * i), specular=0.0),
        )
        for i, x in enumerate((-2.35, -0.55, 1.3))
    ]
    boards = Material(base_texture=textures.planks(rng, (0.50, 0.34, 0.20)), specular=0.0)
    return (
        Part(
            "wall",
            meshes.sheet((-6.0, 0.0, -2.0), (12.0, 0.0, 0.0), (0.0, 5.0, 0.0), (6.0, 2.5), 4),
            Material(base_texture=brick, specular=0.0),
        ),
        Part("floor", meshes.sheet((-6.0, 0.0, 5.0), (12.0, 0.0, 0.0), (0.0, 0.0, -7.0), (6.0, 5.0), 4), boards),
        *posters,
    )


def movers() -> tuple[Part, ...]:
    """A striped board close by and a cut-out grille behind it."""
    striped = textures.stripes((0.82, 0.10, 0.08), (0.88, 0.86, 0.80), 3, 3)
    net = Material(
        base_texture=textures.lattice((0.10, 0.32, 0.26), 5), specular=0.0, alpha_mode=AlphaMode.MASK, double_sided=True
    )
    return (
        Part("board", meshes.box((0.95, 1.9, 0.06)), Material(base_texture=striped, specular=0.0)),
        Part("grille", meshes.sheet((-0.8, 0.05, 0.0), (1.6, 0.0, 0.0), (0.0, 2.1, 0.0), (1.6, 2.1)), net),
    )


@register(
    "occluder",
    "A board and a grille slide before a detailed wall and uncover it; the camera is still",
    (Effect.MOTION, Effect.UNCOVER),
)
def occluder(seed: int) -> Staging:
    """Stage the scene; the seed changes wall, posters and where each slide begins."""
    rng = np.random.default_rng(seed)
    moving, still = movers(), wall(rng)
    phase = rng.random(2).tolist()
    view = animation.look_at((0.0, 1.45, 3.4), (0.0, 1.25, -2.0))
    lights = (Sun(SUN, (3.6, 3.3, 2.9)),)

    def at(time: float) -> Instant:
        board = (BOARD_REACH * animation.swing(time, BOARD_PERIOD, phase[0]), 1.0, 0.4)
        grille = (GRILLE_REACH * animation.swing(time, GRILLE_PERIOD, phase[1]), 0.0, -0.9)
        stand = (animation.translation(board), animation.translation(grille), *((np.eye(4),) * len(still)))
        return Instant(view, Perspective(np.radians(40.0)), stand, lights, SKY)

    return (*moving, *still), at
