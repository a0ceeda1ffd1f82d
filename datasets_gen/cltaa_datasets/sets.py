"""Sets that several scenes share, so that scenes with different effects differ in nothing else.

All materials are matt, so that their colour does not change with the view direction, and a moving camera changes only
positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.scene import Instant, Lens, Light, Matrix, Part, Perspective, Shape, Sky, Sun, cut_out, matt

SUN = animation.direction(150.0, 40.0)
LIGHTS = (Sun(SUN, (3.6, 3.3, 2.9)),)
SKY = Sky(ambient=0.55)
LENS = Perspective(np.radians(40.0))
EYE, TARGET = (0.0, 1.45, 3.4), (0.0, 1.25, -2.0)
VIEW = animation.look_at(EYE, TARGET)
NO_SHAPES: Mapping[str, Shape] = MappingProxyType({})


def slid(x: float, z: float = 0.0) -> Matrix:
    """Return the usual view from an eye that slid by ``x`` and ``z`` metres, with its target."""
    return animation.look_at((EYE[0] + x, EYE[1], EYE[2] + z), (TARGET[0] + x, TARGET[1], TARGET[2] + z))


def poster_wall(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return a brick wall with printed posters, over a boarded floor."""
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
            matt(textures.lettering(rng, *inks[i], 22 + 4 * i)),
        )
        for i, x in enumerate((-2.35, -0.55, 1.3))
    ]
    boards = matt(textures.planks(rng, (0.50, 0.34, 0.20)))
    return (
        Part("wall", meshes.sheet((-6.0, 0.0, -2.0), (12.0, 0.0, 0.0), (0.0, 5.0, 0.0), (6.0, 2.5), 4), matt(brick)),
        Part("floor", meshes.sheet((-6.0, 0.0, 5.0), (12.0, 0.0, 0.0), (0.0, 0.0, -7.0), (6.0, 5.0), 4), boards),
        *posters,
    )


def exhibits(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return a glazed knot, a striped block and a cut-out grille in front of the wall."""
    glaze = textures.checker((0.08, 0.34, 0.44), (0.84, 0.80, 0.66), 8, rng)
    striped = textures.stripes((0.70, 0.14, 0.08), (0.84, 0.80, 0.72), 6)
    net = cut_out(textures.lattice((0.10, 0.32, 0.26), 5))
    turn = animation.rotation(animation.UP, float(rng.uniform(0.0, 2.0 * np.pi)))
    return (
        Part(
            "knot", meshes.moved(meshes.knot(0.6, 0.12), animation.translation((-1.1, 0.95, -0.6)) @ turn), matt(glaze)
        ),
        Part(
            "block",
            meshes.moved(meshes.box((0.6, 0.6, 0.6)), animation.translation((0.95, 0.3, 0.3)) @ turn),
            matt(striped),
        ),
        Part("grille", meshes.sheet((0.2, 0.05, -1.1), (1.2, 0.0, 0.0), (0.0, 1.7, 0.0), (1.2, 1.7)), net),
    )


def gallery(seed: int) -> tuple[Part, ...]:
    """Return the wall with its posters, and the exhibits in front of it: fine texture at two to six metres."""
    rng = np.random.default_rng(seed)
    return (*poster_wall(rng), *exhibits(rng))


def standing(
    parts: tuple[Part, ...],
    view: Matrix = VIEW,
    *,
    moving: tuple[Matrix | None, ...] = (),
    lens: Lens = LENS,
    lights: tuple[Light, ...] = LIGHTS,
    sky: Sky | None = SKY,
    exposure: float = 1.0,
    shot: int = 0,
    shapes: Mapping[str, Shape] = NO_SHAPES,
) -> Instant:
    """Return an instant with the poses ``moving`` for the first parts, and the identity for all others."""
    poses = (*moving, *((np.eye(4),) * (len(parts) - len(moving))))
    return Instant(view, lens, poses, lights, sky, exposure, shot, shapes)
