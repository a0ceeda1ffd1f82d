"""Swarms: many small bodies in one mesh, each on its own path."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import trimesh

from cltaa_datasets import meshes
from cltaa_datasets.scene import Shape

Floats = meshes.Floats
Path = Callable[[float], tuple[Floats, Floats]]  # seconds -> centres [N, 3] and sizes [N]

OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
SIDES = np.array([(x, y, z) for x, y, z in product((0, 3), (1, 4), (2, 5))])
CARD = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
HALVES = np.array([(0, 1, 2), (0, 2, 3)])


def repeated(body: Floats, faces: Floats, count: int) -> trimesh.Trimesh:
    """Build one mesh of ``count`` copies of a body at the origin; x and y give the texture coordinates."""
    vertices = np.tile(body, (count, 1))
    every = np.concatenate([faces + len(body) * i for i in range(count)])
    return meshes.make_mesh(vertices, every, np.tile((0.0, 0.0, 1.0), (len(vertices), 1)), 0.5 + 0.5 * vertices[:, :2])


def placed(body: Floats, centres: Floats, sizes: Floats) -> Shape:
    """Return the vertices of the copies of ``body``, each with its own centre and size."""
    positions = (centres[:, None] + sizes[:, None, None] * body).reshape(-1, 3)
    return Shape(positions, np.tile((0.0, 0.0, 1.0), (len(positions), 1)))


def fountain(
    rng: np.random.Generator,
    count: int,
    *,
    life: float,
    rest: float,
    speeds: tuple[Floats, Floats],
    pull: Floats,
    growth: float,
    size: float,
) -> Path:
    """Throw bodies from the origin repeatedly, each with a random phase and velocity.

    ``speeds`` are the least and greatest velocities, ``pull`` the acceleration, ``size`` the first size, ``growth`` its
    increase per second. Between two flights a body waits ``rest`` seconds at the origin with size 0, so that no visible
    body jumps.
    """
    start, velocity = rng.random(count), rng.uniform(*speeds, (count, 3))

    def at(time: float) -> tuple[Floats, Floats]:
        age = (time / (life + rest) + start) % 1.0 * (life + rest) - rest
        flown = np.maximum(age, 0.0)[:, None]
        centres = velocity * flown + 0.5 * np.asarray(pull) * flown**2
        # The size fades in and out, and is 0 at the last instant too.
        fade = np.clip(np.minimum(age, life - rest - age) / rest, 0.0, 1.0)
        return centres, (size + growth * flown[:, 0]) * fade

    return at
