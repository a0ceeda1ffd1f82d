"""Anybody's model as a scene, with its textures, on a turntable or seen from an orbit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.io.display import decoded
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.gltf_model import at_rest
from cltaa_datasets.models import FORMATS, GLTF, MOTIONS
from cltaa_datasets.scene import AlphaMode, Instant, Material, Matrix, Part, Perspective, Scene, Sky, Sun, Texture

DISTANCE, RISE, FIELD_OF_VIEW = 2.3, 0.6, np.radians(44.0)  # of the camera, from a model of radius 1
TURNS = 0.05  # a second: 18 degrees
START = np.radians(40.0)  # the front of a glTF model looks along +z, to the camera; it is shown within this angle
CREASE = np.radians(30.0)  # edges sharper than this stay sharp where a file has no normals
SUN = animation.direction(125.0, 45.0)
SKY = Sky(zenith=(0.12, 0.22, 0.46), horizon=(0.66, 0.72, 0.80), ground=(0.26, 0.23, 0.20), fog=0.04, ambient=0.6)

Points = NDArray[np.float64]

# Nothing is known of a stranger's model, so all that may happen is declared.
ALWAYS = frozenset({Effect.DISOCCLUSION, Effect.THIN, Effect.HDR, Effect.ILLUMINATION, Effect.SKY})


def model_scene(path: str, motion: str, seed: int) -> Scene:
    """Put a model of radius 1 on a tiled floor; the seed changes the tiles and where the turn begins.

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
    """The floor that every model stands on, at height 0."""
    tiles = textures.blocks(rng, (0.50, 0.48, 0.45), (0.20, 0.19, 0.18), 4, 4, 0.02, bonded=False)
    return Part("floor", meshes.floor(80.0, 1.2, 48), Material(base_texture=tiles, specular=0.0))


def start_angle(rng: np.random.Generator) -> float:
    """The angle in radians at which a model is shown first."""
    return float(rng.uniform(-START, START))


def effects_of(model: Iterable[Part], moves: Effect) -> frozenset[Effect]:
    """What a model may call for beside what ``moves``: all that its materials do not exclude."""
    blended = any(part.material.alpha_mode is AlphaMode.BLEND for part in model)
    return ALWAYS | {moves} | ({Effect.REACTIVE} if blended else set())


def standing(low: NDArray[np.float64], high: NDArray[np.float64], path: Path) -> tuple[Matrix, float]:
    """The pose that puts a model with bounds ``low`` and ``high`` [3] on the ground with a radius of 1, and its height
    there; raises DataError where the bounds are not finite or nothing."""
    radius = float(np.linalg.norm(high - low)) / 2.0
    if not np.isfinite(radius) or radius == 0.0:
        found = [low.tolist(), high.tolist()]
        raise DataError("the model has no size", path=path, expected="finite bounds", found=found)
    centre = (low + high) / 2.0
    stand = animation.scaling(1.0 / radius) @ animation.translation((-centre[0], -low[1], -centre[2]))
    return stand, float(high[1] - low[1]) / radius


def scene_name(path: str) -> str:
    """Return the name of a file's frames: that of the file, without what a file name should not have."""
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
    """Read a model and stand it on the ground with a bounding radius of 1: its parts, a pose for each, its height.

    Read are base colour, metallic-roughness and emissive textures, alpha modes and vertex colours; normal maps,
    occlusion and lights are not; ``played_models`` reads animation. Raises UsageError, InputMissing and DataError.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(
            f"no reader for {path.suffix or 'a file without suffix'}", path=path, expected=" ".join(FORMATS)
        )
    if not path.is_file():
        raise InputMissing("there is no such model", path=path, cure="check the path behind file:")
    parts, poses = at_rest(path) if path.suffix.lower() in GLTF else _of_trimesh(path)
    low, high = bounds([np.asarray(part.mesh.vertices) for part in parts], poses)
    stand, height = standing(low, high, path)
    return parts, [stand @ pose for pose in poses], height


def bounds(positions: Iterable[Points], poses: Iterable[Matrix]) -> tuple[Points, Points]:
    """The least and the greatest coordinates [3] of what stands at ``poses``, each with vertices [V, 3]."""
    placed = [points @ pose[:3, :3].T + pose[:3, 3] for points, pose in zip(positions, poses, strict=True)]
    return np.min([points.min(axis=0) for points in placed], axis=0), np.max([p.max(axis=0) for p in placed], axis=0)


def _of_trimesh(path: Path) -> tuple[tuple[Part, ...], list[Matrix]]:
    """The parts of a file that trimesh reads, and how each stands."""
    try:
        loaded = trimesh.load_scene(path)
    except Exception as error:  # any parser of trimesh's, each with exceptions of its own
        reason = f"{type(error).__name__}: {error}"
        raise DataError(f"trimesh cannot read it ({reason})", path=path, cure="export the model again") from error
    shared: dict[int, Texture] = {}
    parts, poses = [], []
    for node in loaded.graph.nodes_geometry:
        pose, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            parts.append(_part(str(node), mesh, path, shared))
            poses.append(np.asarray(pose, np.float64))
    if not parts:
        raise DataError("no triangles in it", path=path, cure="export the model as a mesh")
    return tuple(parts), poses


def _part(name: str, mesh: trimesh.Trimesh, path: Path, shared: dict[int, Texture]) -> Part:
    visual: Any = mesh.visual
    # trimesh computes missing normals when asked; only its cache knows whether the file had them.
    if "vertex_normals" not in mesh._cache and visual.kind in (None, "face"):
        mesh = trimesh.graph.smooth_shade(mesh, angle=CREASE)
        visual = mesh.visual
    if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.vertex_normals).all()):
        raise DataError(f"mesh {name} has vertices or normals that are not finite", path=path)
    if visual.kind == "face":
        flat = mesh.copy()
        flat.unmerge_vertices()
        return Part(name, flat, Material(), np.repeat(_linear(visual.face_colors), 3, axis=0))
    if visual.kind == "vertex":
        return Part(name, mesh, Material(), _linear(visual.vertex_colors))
    if visual.kind == "texture":
        return Part(name, mesh, _material(visual.material, shared))
    return Part(name, mesh, Material(base_colour=(0.6, 0.6, 0.6, 1.0), roughness=0.5))


def _linear(colours: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Decode sRGB-encoded vertex colours [N, 4]; alpha is linear."""
    values = np.asarray(colours, np.float64) / 255.0
    values[:, :3] = decoded(values[:, :3])
    return values.astype(np.float32)


def _material(found: Any, shared: dict[int, Texture]) -> Material:
    """Translate trimesh's material of an OBJ or a PLY: those know no metal, and no way to be see-through but texels."""
    pbr = found if isinstance(found, trimesh.visual.material.PBRMaterial) else found.to_pbr()
    base = (255, 255, 255, 255) if pbr.baseColorFactor is None else pbr.baseColorFactor
    return Material(
        base_colour=tuple((np.asarray(base, np.float64) / 255.0).tolist()),
        base_texture=_texture(pbr.baseColorTexture, shared),
        metallic=0.0,
        roughness=1.0 if pbr.roughnessFactor is None else float(pbr.roughnessFactor),
    )


def _texture(image: Any, shared: dict[int, Texture]) -> Texture | None:
    """Turn a Pillow image into a texture; an image used twice becomes one texture."""
    if image is None:
        return None
    if id(image) not in shared:
        shared[id(image)] = Texture(np.asarray(image.convert("RGBA"), np.uint8))
    return shared[id(image)]
