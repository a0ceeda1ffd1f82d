"""Deforming meshes: a printed cloth in the wind, morph targets, a skinned arm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from cltaa.frame import Effect
from cltaa_datasets import animation, deform, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Material, Matrix, Part, Shape, emitting, matt
from cltaa_datasets.sets import poster_wall, standing

CELLS = 32  # of the cloth
WIND, WAVE = 1.1, 0.22  # period of a wave in seconds, its amplitude in metres
JOINTS, LENGTH = 5, 1.9  # of the arm; metres
SWAY, BEND = 2.2, np.radians(26.0)  # period of a swing in seconds, largest angle at each joint
MORPH = (1.3, 1.9)  # periods of the two targets in seconds


def shape_of(mesh: trimesh.Trimesh) -> Shape:
    """Return the vertices of a mesh as a Shape."""
    return Shape(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.vertex_normals, np.float64))


def banner(rng: np.random.Generator) -> tuple[Part, Callable[[float], Shape]]:
    """Return a printed cloth and its shape as a function of time; it is emissive, so that no colour changes."""
    page = textures.lettering(rng, (0.05, 0.06, 0.30), (0.86, 0.80, 0.62), 20)
    print_ = emitting((0.8, 0.8, 0.8), page, double_sided=True)
    phase = float(rng.random())

    def waving(time: float) -> trimesh.Trimesh:
        def point(u: meshes.Floats, v: meshes.Floats) -> meshes.Floats:
            turn = 2.0 * np.pi * (1.5 * u - time / WIND + phase)
            height = 0.4 + 1.6 * v + 0.3 * WAVE * u * np.cos(turn + v)
            return np.stack([-1.5 + 2.6 * u, height, WAVE * u * np.sin(turn)], -1)

        return meshes.surface(point, CELLS, CELLS // 2, (2.0, 1.0))

    return Part("cloth", waving(0.0), print_, deforms=True), lambda time: shape_of(waving(time))


@register("cloth", "A printed cloth waves before a wall", (Effect.MOTION, Effect.DISOCCLUSION))
def cloth(seed: int) -> Staging:
    """Wave a sheet: every vertex has its own motion."""
    rng = np.random.default_rng(seed)
    sheet, shape = banner(rng)
    parts = (sheet, *poster_wall(rng))
    return parts, lambda time: standing(parts, shapes={"cloth": shape(time)})


@register(
    "morphing",
    "A ball that becomes a cube and a spindle by blends of shapes",
    (Effect.MOTION, Effect.DISOCCLUSION, Effect.ILLUMINATION),
)
def morphing(seed: int) -> Staging:
    """Blend two targets into a ball; its lit side changes with its shape."""
    rng = np.random.default_rng(seed)
    ball = meshes.sphere(0.75, (4.0, 2.0), 24)
    rest = shape_of(ball)
    # A superellipsoid is nearly a cube and has a normal everywhere.
    bulge = (np.abs(rest.normals) ** 6).sum(axis=1, keepdims=True) ** (-1.0 / 6.0)
    slopes = deform.unit(np.sign(rest.normals) * np.abs(rest.normals) ** 5)
    squeeze = np.array([0.55, 1.5, 0.55])
    cube = Shape(0.62 * rest.normals * bulge - rest.positions, slopes - rest.normals)
    spindle = Shape(rest.positions * (squeeze - 1.0), deform.unit(rest.normals / squeeze) - rest.normals)
    tiles = textures.checker((0.10, 0.36, 0.62), (0.88, 0.84, 0.66), 8, rng)
    parts = (Part("ball", ball, matt(tiles), deforms=True), *poster_wall(rng))
    phase = rng.random(2).tolist()

    def at(time: float) -> Instant:
        weights = [0.5 + 0.5 * animation.swing(time, p, f) for p, f in zip(MORPH, phase, strict=True)]
        weights[1] *= 1.0 - weights[0]
        shape = deform.morphed(rest, (cube, spindle), weights)
        return standing(parts, moving=(animation.translation((0.0, 1.15, -0.2)),), shapes={"ball": shape})

    return parts, at


@register(
    "skinned", "An arm of five joints bends before a wall", (Effect.MOTION, Effect.DISOCCLUSION, Effect.ILLUMINATION)
)
def skinned(seed: int) -> Staging:
    """Bend a tube by linear blend skinning; each joint swings later than the one before."""
    rng = np.random.default_rng(seed)
    tube = meshes.surface(_arm, 24, 40, (4.0, 8.0))
    rest, bone = shape_of(tube), LENGTH / JOINTS
    place = np.clip(rest.positions[:, 1] / bone, 0.0, JOINTS - 1e-9)
    lower = np.clip(np.floor(place - 0.5).astype(int), 0, JOINTS - 2)
    share = np.clip(place - 0.5 - lower, 0.0, 1.0)
    joints, weights = np.stack([lower, lower + 1], 1), np.stack([1.0 - share, share], 1)
    stripes = textures.blocks(rng, (0.75, 0.30, 0.18), (0.66, 0.62, 0.56), 6, 10, 0.012)
    brick = Material(base_texture=stripes, specular=0.0, double_sided=True)
    parts = (Part("arm", tube, brick, deforms=True), *poster_wall(rng))
    phase = float(rng.random())

    def posed(time: float) -> list[Matrix]:
        matrices, chain = [], np.eye(4)
        for joint in range(JOINTS):
            angle = BEND * animation.swing(time, SWAY, phase - 0.09 * joint)
            foot = animation.translation((0.0, joint * bone, 0.0))
            chain = chain @ foot @ animation.rotation((0.3, 0.0, 1.0), angle) @ np.linalg.inv(foot)
            matrices.append(chain)
        return matrices

    def at(time: float) -> Instant:
        shape = deform.skinned(rest, joints, weights, posed(time))
        return standing(parts, moving=(animation.translation((0.1, 0.0, -0.2)),), shapes={"arm": shape})

    return parts, at


def _arm(u: meshes.Floats, v: meshes.Floats) -> meshes.Floats:
    around, thickness = 2.0 * np.pi * u, 0.24 - 0.14 * v
    return np.stack([thickness * np.sin(around), LENGTH * v, thickness * np.cos(around)], -1)
