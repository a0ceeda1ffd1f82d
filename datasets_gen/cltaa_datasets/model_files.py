"""A user's model as a scene, with its textures: on a turntable, from an orbiting camera, or with its animation.

An animated model plays before a still camera, on the same floor as the others.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa_datasets import FORMATS, GLTF, MOTIONS, animation, gltf_model, meshes, textures, trimesh_model
from cltaa_datasets.gltf_file import GltfFile, is_file
from cltaa_datasets.scene import (
    AlphaMode,
    Instant,
    Matrix,
    Part,
    Perspective,
    Scene,
    Shape,
    Sky,
    Sun,
    matt,
)

DISTANCE, RISE, FIELD_OF_VIEW = 2.3, 0.6, np.radians(44.0)  # of the camera, from a model of radius 1
TURNS = 0.05  # per second: 18 degrees
START = np.radians(40.0)  # largest first angle; the front of a glTF model faces +z, the camera
SIZES = (1e-12, 1e12)  # range of the radius in metres that float32 matrices can represent in animations
LOOKS = 16  # number of instants that measure the size of an animated model
SUN = animation.direction(125.0, 45.0)
SKY = Sky(zenith=(0.12, 0.22, 0.46), horizon=(0.66, 0.72, 0.80), ground=(0.26, 0.23, 0.20), fog=0.04, ambient=0.6)

Points = NDArray[np.float64]

# A user's model is unknown, so everything that may happen is declared.
ALWAYS = frozenset({Effect.DISOCCLUSION, Effect.THIN, Effect.HDR, Effect.ILLUMINATION, Effect.SKY})


def model_scene(path: str, motion: str, seed: int) -> Scene:
    """Put a model of radius 1 on a tiled floor; the seed changes the tiles and the first angle.

    Raises UsageError for an unknown motion or kind of file, InputMissing and DataError for the file.
    """
    if motion not in ("turntable", "orbit"):
        raise UsageError(f"no such motion: {motion}", cure=f"use one of {', '.join(MOTIONS)}")
    rng = np.random.default_rng(seed)
    model, poses, height = load_model(Path(path))
    parts = (*model, tiled_floor(rng))
    effects = effects_of(model, Effect.MOTION if motion == "turntable" else Effect.CAMERA)
    start = start_angle(rng)
    return Scene(name=scene_name(path), effects=effects, parts=parts, at=_presentation(poses, height, motion, start))


def tiled_floor(rng: np.random.Generator) -> Part:
    """Return the floor of every model scene, at height 0."""
    tiles = textures.blocks(rng, (0.50, 0.48, 0.45), (0.20, 0.19, 0.18), 4, 4, 0.02, bonded=False)
    return Part("floor", meshes.floor(80.0, 1.2, 48), matt(tiles))


def start_angle(rng: np.random.Generator) -> float:
    """Return the first angle of a model in radians."""
    return float(rng.uniform(-START, START))


def effects_of(model: Iterable[Part], moves: Effect) -> frozenset[Effect]:
    """Return ``moves`` and all effects that a model's materials do not exclude."""
    blended = any(part.material.alpha_mode is AlphaMode.BLEND for part in model)
    return ALWAYS | {moves} | ({Effect.REACTIVE} if blended else set())


def standing(low: NDArray[np.float64], high: NDArray[np.float64], path: Path) -> tuple[Matrix, float]:
    """Return the pose that puts a model with bounds ``low`` and ``high`` [3] on the ground with a radius of 1, and its
    height there; raises DataError for bounds that are not finite, too small or too large."""
    with np.errstate(all="ignore"):
        radius = float(np.linalg.norm(high - low)) / 2.0
    if not SIZES[0] < radius < SIZES[1]:
        found = [low.tolist(), high.tolist()]
        expected = f"finite bounds, {SIZES[0]:g} to {SIZES[1]:g} apart"
        raise DataError("the model has no size that can be shown", path=path, expected=expected, found=found)
    centre = (low + high) / 2.0
    stand = animation.scaling(1.0 / radius) @ animation.translation((-centre[0], -low[1], -centre[2]))
    return stand, float(high[1] - low[1]) / radius


def scene_name(path: str) -> str:
    """Return the name of a file's frames: the file's name without unusual characters."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", Path(path).stem) or "model"


def _presentation(poses: list[Matrix], height: float, motion: str, start: float) -> Callable[[float], Instant]:
    lights = (Sun(SUN, (3.2, 3.0, 2.6)),)
    target = (0.0, height / 2.0, 0.0)

    def at(time: float) -> Instant:
        angle = start + 2.0 * np.pi * TURNS * time
        turn = animation.rotation(animation.UP, angle if motion == "turntable" else start)
        around = angle - start if motion == "orbit" else 0.0
        eye = (DISTANCE * float(np.sin(around)), height / 2.0 + RISE, DISTANCE * float(np.cos(around)))
        stand = (*(turn @ pose for pose in poses), np.eye(4))
        return Instant(animation.look_at(eye, target), Perspective(FIELD_OF_VIEW), stand, lights, SKY)

    return at


def load_model(path: Path) -> tuple[tuple[Part, ...], list[Matrix], float]:
    """Read a model and put it on the ground with a bounding radius of 1: return parts, a pose for each, and its height.

    Reads base colour, metallic-roughness and emissive textures, alpha modes and vertex colours; not normal maps,
    occlusion, lights or animations (``played_scene``). Raises UsageError, InputMissing and DataError.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(
            f"no reader for {path.suffix or 'a file without suffix'}", path=path, expected=" ".join(FORMATS)
        )
    if not is_file(path):
        raise InputMissing("there is no such model", path=path, cure="check the path behind file:")
    parts, poses = gltf_model.at_rest(path) if path.suffix.lower() in GLTF else trimesh_model.at_rest(path)
    low, high = bounds([_drawn(part.mesh) for part in parts], poses)
    stand, height = standing(low, high, path)
    placed = [_near(part, stand @ pose) for part, pose in zip(parts, poses, strict=True)]
    if not any((part.mesh.area_faces > 0.0).any() for part, _ in placed):
        raise DataError("no triangle in it has an area", path=path, cure="export the model as a mesh")
    return tuple(part for part, _ in placed), [pose for _, pose in placed], height


def content_sha256(path: Path) -> str:
    """Return the SHA-256 of a model's file and of the files beside it that it names; raises InputMissing, DataError."""
    return GltfFile(path).sha256() if path.suffix.lower() in GLTF else trimesh_model.sha256(path)


def _drawn(mesh: trimesh.Trimesh) -> Points:
    """Return the vertices [N, 3] that faces use."""
    return np.asarray(mesh.vertices[np.unique(mesh.faces)], np.float64)


def _near(part: Part, pose: Matrix) -> tuple[Part, Matrix]:
    """Centre a part in its own space at about its world size; return it and its pose.

    So a model of a town in map coordinates, or of a molecule in metres, keeps its precision in float32.
    """
    scale = float(np.linalg.norm(pose[:3, :3], axis=0).max()) or 1.0
    points = _drawn(part.mesh)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    vertices = (np.asarray(part.mesh.vertices) - centre) * scale
    moved = pose.copy()
    moved[:3, :3] /= scale
    moved[:3, 3] += pose[:3, :3] @ centre
    uv = meshes.texture_coordinates(part.mesh)
    return replace(part, mesh=meshes.make_mesh(vertices, part.mesh.faces, part.mesh.vertex_normals, uv)), moved


def bounds(positions: Iterable[Points], poses: Iterable[Matrix]) -> tuple[Points, Points]:
    """Return the least and the greatest coordinates [3] of vertices [V, 3] under each of ``poses``."""
    with np.errstate(all="ignore"):  # ``standing`` reports extreme numbers
        placed = [points @ pose[:3, :3].T + pose[:3, 3] for points, pose in zip(positions, poses, strict=True)]
    return np.min([points.min(axis=0) for points in placed], axis=0), np.max([p.max(axis=0) for p in placed], axis=0)


def default_motion(path: str) -> str:
    """Return the default motion of a file: play if it is animated, else turntable."""
    try:
        return "play" if gltf_model.AnimatedModel.animates(Path(path)) else "turntable"
    except CltaaError:
        return "turntable"  # its reader supports more formats, and reports the error


def played_scene(path: str, seed: int) -> Scene:
    """Put an animated model on a tiled floor, scaled to a radius of 1 over its whole animation.

    Raises UsageError for a file without animation, InputMissing and DataError.
    """
    if not gltf_model.AnimatedModel.animates(Path(path)):
        raise UsageError("it has no animation to play", path=path, cure="use --motion turntable or orbit")
    model = gltf_model.AnimatedModel(Path(path))
    rng = np.random.default_rng(seed)
    floor = tiled_floor(rng)
    stand, height = standing(*_bounds(model), Path(path))
    stand = animation.rotation(animation.UP, start_angle(rng)) @ stand
    effects = effects_of(model.parts, Effect.MOTION)
    lights = (Sun(SUN, (3.2, 3.0, 2.6)),)
    eye = (0.0, height / 2.0 + RISE, DISTANCE)
    view, lens = animation.look_at(eye, (0.0, height / 2.0, 0.0)), Perspective(FIELD_OF_VIEW)
    # Each part lies about its own middle, so that one far from the origin keeps its precision in float32.
    _, first = model.at(0.0)
    middles = [(points.min(axis=0) + points.max(axis=0)) / 2.0 for points in _stood(model, first)]
    parts = [replace(p, mesh=meshes.placed(p.mesh, -m)) for p, m in zip(model.parts, middles, strict=True)]

    def at(time: float) -> Instant:
        poses, found = model.at(time)
        placed = [stand @ pose @ animation.translation(m) for pose, m in zip(poses, middles, strict=True)]
        named = [(part.name, m) for part, m in zip(parts, middles, strict=True) if part.deforms]
        shapes = {name: Shape(found[name].positions - m, found[name].normals) for name, m in named}
        return Instant(view, lens, (*placed, np.eye(4)), lights, SKY, shapes=shapes)

    return Scene(scene_name(path), effects, (*parts, floor), at)


def _stood(model: gltf_model.AnimatedModel, shapes: Mapping[str, Shape]) -> list[Points]:
    """Return the vertices of each part that its faces use, as ``shapes`` has those that deform."""
    stood = [(part, shapes[part.name].positions if part.deforms else part.mesh.vertices) for part in model.parts]
    return [np.asarray(vertices[np.unique(part.mesh.faces)], np.float64) for part, vertices in stood]


def _bounds(model: gltf_model.AnimatedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest coordinates [3] over the whole animation."""
    corners: list[NDArray[np.float64]] = []
    for time in np.linspace(0.0, model.tree.duration, LOOKS).tolist():
        poses, shapes = model.at(time)
        corners += bounds(_stood(model, shapes), poses)
    return np.min(corners, axis=0), np.max(corners, axis=0)
