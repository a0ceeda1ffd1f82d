"""Anybody's model as a scene, with its textures: on a turntable, seen from an orbit, or played as it is animated.

What is played stands before a still camera, on the floor that other models turn on.
"""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.io.display import decoded
from cltaa_datasets import FORMATS, GLTF, MOTIONS, animation, deform, meshes, textures
from cltaa_datasets.gltf_model import AnimatedModel, at_rest
from cltaa_datasets.scene import AlphaMode, Instant, Material, Matrix, Part, Perspective, Scene, Sky, Sun, Texture

DISTANCE, RISE, FIELD_OF_VIEW = 2.3, 0.6, np.radians(44.0)  # of the camera, from a model of radius 1
TURNS = 0.05  # a second: 18 degrees
START = np.radians(40.0)  # the front of a glTF model looks along +z, to the camera; it is shown within this angle
SIZES = (1e-12, 1e12)  # metres of radius: float32 matrices carry what is animated between them
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
    occlusion and lights are not; ``played_scene`` plays animations. Raises UsageError, InputMissing and DataError.
    """
    if path.suffix.lower() not in FORMATS:
        raise UsageError(
            f"no reader for {path.suffix or 'a file without suffix'}", path=path, expected=" ".join(FORMATS)
        )
    if not path.is_file():
        raise InputMissing("there is no such model", path=path, cure="check the path behind file:")
    parts, poses = at_rest(path) if path.suffix.lower() in GLTF else _of_trimesh(path)
    low, high = bounds([_drawn(part.mesh) for part in parts], poses)
    stand, height = standing(low, high, path)
    placed = [_near(part, stand @ pose) for part, pose in zip(parts, poses, strict=True)]
    if not any((part.mesh.area_faces > 0.0).any() for part, _ in placed):
        raise DataError("no triangle in it has an area", path=path, cure="export the model as a mesh")
    return tuple(part for part, _ in placed), [pose for _, pose in placed], height


def _drawn(mesh: trimesh.Trimesh) -> Points:
    """The vertices [N, 3] that faces have."""
    return np.asarray(mesh.vertices[np.unique(mesh.faces)], np.float64)


def _near(part: Part, pose: Matrix) -> tuple[Part, Matrix]:
    """A part about the origin of its own space and of about its size in the world, and its pose.

    A model of a town in the coordinates of a map, or of a molecule in metres, keeps its digits in float32 so.
    """
    scale = float(np.cbrt(abs(np.linalg.det(pose[:3, :3])))) or 1.0
    points = _drawn(part.mesh)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    vertices = (np.asarray(part.mesh.vertices) - centre) * scale
    moved = pose.copy()
    moved[:3, :3] /= scale
    moved[:3, 3] += pose[:3, :3] @ centre
    uv = meshes.texture_coordinates(part.mesh)
    return replace(part, mesh=meshes.make_mesh(vertices, part.mesh.faces, part.mesh.vertex_normals, uv)), moved


def bounds(positions: Iterable[Points], poses: Iterable[Matrix]) -> tuple[Points, Points]:
    """The least and the greatest coordinates [3] of what stands at ``poses``, each with vertices [V, 3]."""
    with np.errstate(all="ignore"):  # numbers beyond any model's are told by what stands it up
        placed = [points @ pose[:3, :3].T + pose[:3, 3] for points, pose in zip(positions, poses, strict=True)]
    return np.min([points.min(axis=0) for points in placed], axis=0), np.max([p.max(axis=0) for p in placed], axis=0)


def _of_trimesh(path: Path) -> tuple[tuple[Part, ...], list[Matrix]]:
    """The parts of a file that trimesh reads, and how each stands."""
    try:
        with np.errstate(all="ignore"):
            loaded = _load(path)
    except Exception as error:  # any parser of trimesh's, each with exceptions of its own
        reason = f"{type(error).__name__}: {error}"
        raise DataError(f"trimesh cannot read it ({reason})", path=path, cure="export the model again") from error
    shared: dict[int, Texture] = {}
    parts, poses = [], []
    for node in loaded.graph.nodes_geometry:
        pose, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            with np.errstate(all="ignore"):
                parts.append(_part(str(node), mesh, path, shared))
            poses.append(np.asarray(pose, np.float64))
    if not parts:
        raise DataError("no triangles in it", path=path, cure="export the model as a mesh")
    return tuple(parts), poses


def _load(path: Path) -> trimesh.Scene:
    """What trimesh reads, of text in whatever encoding: names and comments are all that is not ASCII in it."""
    if path.suffix.lower() != ".obj":
        return trimesh.load_scene(path, process=False)
    text = _text(path.read_bytes()).replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    text = re.sub("^ +", "", text, flags=re.MULTILINE)  # trimesh knows lines by how they begin
    return trimesh.load_scene(io.StringIO(text), file_type="obj", resolver=_Beside(str(path)), process=False)


def _text(content: bytes) -> str:
    """Text in UTF-8, in UTF-16 with its mark, or else in Latin-1, which any bytes are."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


class _Beside(trimesh.resolvers.FilePathResolver):
    """Files beside a model; a library of materials as UTF-8."""

    def get(self, name: str) -> bytes:
        """Bytes of a file."""
        content: bytes = super().get(name)
        return _text(content).encode() if name.lower().strip().endswith(".mtl") else content


def _part(name: str, mesh: trimesh.Trimesh, path: Path, shared: dict[int, Texture]) -> Part:
    if mesh.faces.max() >= len(mesh.vertices):
        reason = f"a face of mesh {name} has vertex {mesh.faces.max()} of {len(mesh.vertices)}"
        raise DataError(reason, path=path, cure="export the model again")
    # What is not finite trimesh leaves out without a word.
    _refuse_infinite(mesh.vertices, f"vertices of mesh {name}", path)
    mesh.process()
    visual: Any = mesh.visual
    # trimesh computes missing normals when asked; only its cache knows whether the file had them.
    if "vertex_normals" not in mesh._cache and visual.kind in (None, "face"):
        mesh = trimesh.graph.smooth_shade(mesh, angle=CREASE)
        visual = mesh.visual
    _refuse_infinite(mesh.vertex_normals, f"normals of mesh {name}", path)
    _refuse_infinite(meshes.texture_coordinates(mesh), f"texture coordinates of mesh {name}", path)
    if visual.kind == "face":
        flat = mesh.copy()
        flat.unmerge_vertices()
        return Part(name, flat, Material(), np.repeat(_linear(visual.face_colors), 3, axis=0))
    if visual.kind == "vertex":
        return _with_normals(Part(name, mesh, Material(), _linear(visual.vertex_colors)))
    if visual.kind == "texture":
        return _with_normals(Part(name, mesh, _material(visual.material, shared)))
    return _with_normals(Part(name, mesh, Material(base_colour=(0.6, 0.6, 0.6, 1.0), roughness=0.5)))


def _refuse_infinite(numbers: Points, what: str, path: Path) -> None:
    if not np.isfinite(numbers).all():
        raise DataError(f"{what} are not finite", path=path, cure="export the model again")


def _with_normals(part: Part) -> Part:
    """``part`` with normals of length 1; a face of a vertex that has none, as where two sides meet, is flat."""
    faces, normals = np.asarray(part.mesh.faces), np.asarray(part.mesh.vertex_normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    none = ~((length > 0.0) & np.isfinite(length))
    normals = np.where(none, 0.0, normals / np.where(none, 1.0, length))
    alone, uv = none[faces, 0].any(axis=1), meshes.texture_coordinates(part.mesh)
    if not alone.any():
        return replace(part, mesh=meshes.make_mesh(part.mesh.vertices, faces, normals, uv))
    # Behind all others, each vertex of such a face a second time.
    copied = faces[alone].ravel()
    rows = np.concatenate([np.arange(len(normals)), copied])
    faces = faces.copy()
    faces[alone] = np.arange(len(normals), len(rows)).reshape(-1, 3)
    vertices = np.asarray(part.mesh.vertices)[rows]
    a, b, c = (vertices[faces[alone][:, corner]] for corner in range(3))
    flat = np.repeat(deform.unit(np.cross(b - a, c - a)), 3, axis=0)
    mesh = meshes.make_mesh(vertices, faces, np.concatenate([normals, flat]), uv[rows] if len(uv) else uv)
    return replace(part, mesh=mesh, colours=None if part.colours is None else part.colours[rows])


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


LOOKS = 16  # instants at which the size of what is played is measured


def default_motion(path: str) -> str:
    """How a file is shown where nobody says: as it is animated, else on a turntable."""
    try:
        return "play" if AnimatedModel.animates(Path(path)) else "turntable"
    except CltaaError:
        return "turntable"  # whose reader knows more formats, and says what is wrong


def played_scene(path: str, seed: int) -> Scene:
    """Stand an animated model on a tiled floor, scaled to a radius of 1 over all that it does; raises DataError."""
    model = AnimatedModel(Path(path))
    rng = np.random.default_rng(seed)
    floor = tiled_floor(rng)
    stand, height = standing(*_bounds(model), Path(path))
    stand = animation.rotation(animation.UP, start_angle(rng)) @ stand
    effects = effects_of(model.parts, Effect.MOTION)
    lights = (Sun(SUN, (3.2, 3.0, 2.6)),)
    eye = (0.0, height / 2.0 + RISE, DISTANCE)
    view, lens = animation.look_at(eye, (0.0, height / 2.0, 0.0)), Perspective(FIELD_OF_VIEW)

    def at(time: float) -> Instant:
        poses, shapes = model.at(time)
        placed = (*(stand @ pose for pose in poses), np.eye(4))
        return Instant(view, lens, placed, lights, SKY, shapes=shapes)

    return Scene(scene_name(path), effects, (*model.parts, floor), at)


def _bounds(model: AnimatedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the greatest coordinates [3] over all that the model does."""
    corners: list[NDArray[np.float64]] = []
    for time in np.linspace(0.0, model.tree.duration, LOOKS).tolist():
        poses, shapes = model.at(time)
        stood = (shapes[p.name].positions if p.name in shapes else np.asarray(p.mesh.vertices) for p in model.parts)
        corners += bounds(stood, poses)
    return np.min(corners, axis=0), np.max(corners, axis=0)
