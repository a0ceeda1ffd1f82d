"""Occluders that slide before a detailed wall."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Part, cut_out, matt
from cltaa_datasets.sets import VIEW, poster_wall, standing

BOARD_PERIOD, BOARD_REACH = 3.2, 1.7  # seconds, metres either way
GRILLE_PERIOD, GRILLE_REACH = 5.0, 1.2


def movers() -> tuple[Part, ...]:
    """Return a striped board in front and a cut-out grille behind it."""
    striped = textures.stripes((0.82, 0.10, 0.08), (0.88, 0.86, 0.80), 3, 3)
    net = cut_out(textures.lattice((0.10, 0.32, 0.26), 5))
    return (
        Part("board", meshes.box((0.95, 1.9, 0.06)), matt(striped)),
        Part("grille", meshes.sheet((-0.8, 0.05, 0.0), (1.6, 0.0, 0.0), (0.0, 2.1, 0.0), (1.6, 2.1)), net),
    )


@register(
    "occluder",
    "A board and a grille slide before a detailed wall and uncover it; the camera is still",
    (Effect.MOTION, Effect.DISOCCLUSION),
)
def occluder(seed: int) -> Staging:
    """Stage the scene; the seed changes wall, posters and the start of each slide."""
    rng = np.random.default_rng(seed)
    parts = (*movers(), *poster_wall(rng))
    phase = rng.random(2).tolist()

    def at(time: float) -> Instant:
        board = (BOARD_REACH * animation.swing(time, BOARD_PERIOD, phase[0]), 1.0, 0.4)
        grille = (GRILLE_REACH * animation.swing(time, GRILLE_PERIOD, phase[1]), 0.0, -0.9)
        return standing(parts, VIEW, moving=(animation.translation(board), animation.translation(grille)))

    return parts, at
