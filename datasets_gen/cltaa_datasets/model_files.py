"""A user's model as a scene, with its textures: on a turntable, from an orbiting camera, or with its animation.

An animated model plays before a still camera, on the same floor as the others.
"""

from __future__ import annotations

import codecs
import hashlib
import io
import logging
import re
from collections.abc import Callable, Iterable, Mapping
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
from cltaa_datasets.gltf_file import GltfFile, is_file
from cltaa_datasets.gltf_model import AnimatedModel, at_rest
from cltaa_datasets.image_files import opened, texels
from cltaa_datasets.scene import (
    AlphaMode,
    Instant,
    Material,
    Matrix,
    Part,
    Perspective,
    Scene,
    Shape,
    Sky,
    Sun,
    Texture,
    matt,
)

# Its warnings come with a traceback; this module names what fails.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

DISTANCE, RISE, FIELD_OF_VIEW = 2.3, 0.6, np.radians(44.0)  # of the camera, from a model of radius 1
TURNS = 0.05  # per second: 18 degrees
START = np.radians(40.0)  # largest first angle; the front of a glTF model faces +z, the camera
SIZES = (1e-12, 1e12)  # range of the radius in metres that float32 matrices can represent in animations
USUAL_SIZES = (1e-3, 1e9)  # of a mesh, in its own units; between them trimesh's tolerances (below) do no harm
CREASE = np.radians(30.0)  # sharper edges stay sharp if a file has no normals
# A line of OBJ, MTL or PLY that names a file.
BESIDE = rb"(?im)^[ \t]*(?:mtllib|map_kd|comment[ \t]+texturefile)[ \t]+([^\r\n]+)"
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
    parts, poses = at_rest(path) if path.suffix.lower() in GLTF else _of_trimesh(path)
    low, high = bounds([_drawn(part.mesh) for part in parts], poses)
    stand, height = standing(low, high, path)
    placed = [_near(part, stand @ pose) for part, pose in zip(parts, poses, strict=True)]
    if not any((part.mesh.area_faces > 0.0).any() for part, _ in placed):
        raise DataError("no triangle in it has an area", path=path, cure="export the model as a mesh")
    return tuple(part for part, _ in placed), [pose for _, pose in placed], height


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


def _of_trimesh(path: Path) -> tuple[tuple[Part, ...], list[Matrix]]:
    """Return the parts of a file that trimesh reads, and their poses."""
    beside = _Beside(str(path))
    try:
        with np.errstate(all="ignore"):
            loaded = _load(path, beside)
    except Exception as error:  # each parser of trimesh has its own exceptions
        # trimesh takes an STL whose length does not fit for text, and asks an optional package for its encoding.
        reason = "it is cut short" if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
        raise DataError(f"trimesh cannot read it ({reason})", path=path, cure="export the model again") from error
    if beside.failure is not None:
        raise beside.failure
    shared: dict[int, Texture] = {}
    parts, poses = [], []
    scales = {name: _to_size_one(mesh) for name, mesh in loaded.geometry.items()}
    for node in loaded.graph.nodes_geometry:
        pose, name = loaded.graph[node]
        pose = pose @ np.diag([1.0 / scales[name]] * 3 + [1.0])
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            with np.errstate(all="ignore"):
                parts.append(_part(str(node), mesh, path, shared))
            poses.append(np.asarray(pose, np.float64))
    if not parts:
        raise DataError("no triangles in it", path=path, cure="export the model as a mesh")
    return tuple(parts), poses


def _to_size_one(mesh: Any) -> float:
    """Scale a tiny or huge mesh by a power of two, which keeps its digits, to a size of about 1; return the factor.

    trimesh merges vertices closer than 1e-8, sees no area below 1e-14, and counts in 64-bit integers of 1e-8.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max(initial=0.0)) if len(mesh.vertices) else 0.0
    if not np.isfinite(size) or size == 0.0 or USUAL_SIZES[0] <= size <= USUAL_SIZES[1]:
        return 1.0
    factor = float(2.0 ** -np.floor(np.log2(size)))
    mesh.apply_scale(factor)
    return factor


def _load(path: Path, beside: _Beside) -> trimesh.Scene:
    """Load a file with trimesh; an OBJ may have any encoding, because only names and comments are not ASCII."""
    if path.suffix.lower() != ".obj":
        return trimesh.load_scene(path, resolver=beside, process=False)
    text = _text(path.read_bytes()).replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    # trimesh needs keywords at the start of lines, and reads them in comments too.
    text = re.sub("^ *#.*|^ +", "", text, flags=re.MULTILINE)
    if re.search(r"^f (?:.* )?0(?:[ /]|$)", text, re.MULTILINE):  # trimesh would take the last vertex
        raise ValueError("a face has vertex 0, and the first is 1")
    return trimesh.load_scene(io.StringIO(text), file_type="obj", resolver=beside, process=False)


def _text(content: bytes) -> str:
    """Decode text as UTF-8, as UTF-16 with a byte order mark, or else as Latin-1, which accepts any bytes."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def content_sha256(path: Path) -> str:
    """Return the SHA-256 of a model's file and of the files beside it that it names; raises InputMissing, DataError."""
    if path.suffix.lower() in GLTF:
        return GltfFile(path).sha256()
    digest, beside, read = hashlib.sha256(), _Beside(str(path)), [path.read_bytes()]
    for content in read:
        digest.update(content)
        read += (beside.get(_text(name)) for name in re.findall(BESIDE, content))
    return digest.hexdigest()


class _Beside(trimesh.resolvers.FilePathResolver):
    """Resolves files beside a model; converts material libraries to UTF-8.

    trimesh draws on without a file that fails, so ``failure`` keeps the last error.
    """

    failure: CltaaError | None = None

    def get(self, name: str) -> bytes:
        """Return the bytes of a file; raises InputMissing."""
        try:
            content: bytes = super().get(name.replace("\\", "/"))  # as paths are written on Windows
        except (OSError, ValueError) as error:
            self.failure = InputMissing(f"there is no {name} beside the model", path=self.clean, cure="copy it there")
            raise self.failure from error
        if name.lower().strip().endswith(".mtl"):
            return _text(content).encode()
        try:
            opened(content)
        except ValueError as error:
            self.failure = DataError(f"image {name} cannot be read ({error})", path=self.clean, cure="save it again")
        return content


def _part(name: str, mesh: trimesh.Trimesh, path: Path, shared: dict[int, Texture]) -> Part:
    beyond = mesh.faces[(mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))]
    if len(beyond):
        reason = f"a face of mesh {name} has vertex {beyond[0]} of {len(mesh.vertices)}"
        raise DataError(reason, path=path, cure="export the model again")
    if mesh.vertices.shape[1] != 3:
        reason = f"vertices of mesh {name} are not three numbers"
        raise DataError(reason, path=path, cure="export the model again")
    # trimesh silently drops non-finite vertices.
    _refuse_infinite(mesh.vertices, f"vertices of mesh {name}", path)
    mesh.process()
    visual: Any = mesh.visual
    # trimesh computes missing normals on access; only its cache shows whether the file had them.
    if "vertex_normals" not in mesh._cache and visual.kind in (None, "face"):
        mesh = trimesh.graph.smooth_shade(mesh, angle=CREASE)
        visual = mesh.visual
    _refuse_infinite(mesh.vertex_normals, f"normals of mesh {name}", path)
    repeats = meshes.texture_coordinates(mesh)
    _refuse_infinite(repeats, f"texture coordinates of mesh {name}", path, meshes.MOST_REPEATS)
    if visual.kind == "face":
        flat = mesh.copy()
        flat.unmerge_vertices()
        return Part(name, flat, Material(), np.repeat(_linear(visual.face_colors), 3, axis=0))
    if visual.kind == "vertex":
        return _with_normals(Part(name, mesh, Material(), _linear(visual.vertex_colors)))
    if visual.kind == "texture":
        return _with_normals(Part(name, mesh, _material(visual.material, shared)))
    return _with_normals(Part(name, mesh, Material(base_colour=(0.6, 0.6, 0.6, 1.0), roughness=0.5)))


def _refuse_infinite(numbers: Points, what: str, path: Path, largest: float = np.inf) -> None:
    if not np.isfinite(numbers).all() or (np.abs(numbers) > largest).any():
        reason = f"{what} are not finite" + ("" if largest == np.inf else f", or beyond {largest:g}")
        raise DataError(reason, path=path, cure="export the model again")


def _with_normals(part: Part) -> Part:
    """Return ``part`` with unit normals; faces with a zero normal, as where two sides meet, become flat."""
    faces, normals = np.asarray(part.mesh.faces), np.asarray(part.mesh.vertex_normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    none = ~((length > 0.0) & np.isfinite(length))
    normals = np.where(none, 0.0, normals / np.where(none, 1.0, length))
    alone, uv = none[faces, 0].any(axis=1), meshes.texture_coordinates(part.mesh)
    if not alone.any():
        return replace(part, mesh=meshes.make_mesh(part.mesh.vertices, faces, normals, uv))
    # Append copies of the vertices of such faces.
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
    """Convert trimesh's material of an OBJ or a PLY, which have no metal, and transparency only in textures."""
    pbr = found if isinstance(found, trimesh.visual.material.PBRMaterial) else found.to_pbr()
    base = (255, 255, 255, 255) if pbr.baseColorFactor is None else pbr.baseColorFactor
    return Material(
        base_colour=tuple((np.asarray(base, np.float64) / 255.0).tolist()),
        base_texture=_texture(pbr.baseColorTexture, shared),
        metallic=0.0,
        roughness=1.0 if pbr.roughnessFactor is None else float(pbr.roughnessFactor),
    )


def _texture(image: Any, shared: dict[int, Texture]) -> Texture | None:
    """Convert a Pillow image to a texture; an image used twice becomes one texture."""
    if image is None:
        return None
    if id(image) not in shared:
        shared[id(image)] = Texture(texels(image))
    return shared[id(image)]


LOOKS = 16  # number of instants that measure the size of an animated model


def default_motion(path: str) -> str:
    """Return the default motion of a file: play if it is animated, else turntable."""
    try:
        return "play" if AnimatedModel.animates(Path(path)) else "turntable"
    except CltaaError:
        return "turntable"  # its reader supports more formats, and reports the error


def played_scene(path: str, seed: int) -> Scene:
    """Put an animated model on a tiled floor, scaled to a radius of 1 over its whole animation.

    Raises UsageError for a file without animation, InputMissing and DataError.
    """
    if not AnimatedModel.animates(Path(path)):
        raise UsageError("it has no animation to play", path=path, cure="use --motion turntable or orbit")
    model = AnimatedModel(Path(path))
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


def _stood(model: AnimatedModel, shapes: Mapping[str, Shape]) -> list[Points]:
    """Return the vertices of each part that its faces use, as ``shapes`` has those that deform."""
    stood = [(part, shapes[part.name].positions if part.deforms else part.mesh.vertices) for part in model.parts]
    return [np.asarray(vertices[np.unique(part.mesh.faces)], np.float64) for part, vertices in stood]


def _bounds(model: AnimatedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest coordinates [3] over the whole animation."""
    corners: list[NDArray[np.float64]] = []
    for time in np.linspace(0.0, model.tree.duration, LOOKS).tolist():
        poses, shapes = model.at(time)
        corners += bounds(_stood(model, shapes), poses)
    return np.min(corners, axis=0), np.max(corners, axis=0)
