"""Reads a model of any format that trimesh reads, with its textures; glTF has a reader of its own, ``gltf_model``."""

from __future__ import annotations

import codecs
import hashlib
import io
import logging
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.errors import CltaaError, DataError, InputMissing
from cltaa.io.display import decoded
from cltaa_datasets import deform, meshes
from cltaa_datasets.image_files import opened, texels
from cltaa_datasets.scene import Material, Matrix, Part, Texture

# Its warnings come with a traceback; this module names what fails.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

USUAL_SIZES = (1e-3, 1e9)  # of a mesh, in its own units; between them trimesh's tolerances (below) do no harm
CREASE = np.radians(30.0)  # sharper edges stay sharp if a file has no normals
# A line of OBJ, MTL or PLY that names a file.
BESIDE = rb"(?im)^[ \t]*(?:mtllib|map_kd|comment[ \t]+texturefile)[ \t]+([^\r\n]+)"


def at_rest(path: Path) -> tuple[tuple[Part, ...], list[Matrix]]:
    """Return the parts of a file and their poses; raises InputMissing and DataError."""
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


def sha256(path: Path) -> str:
    """Return the SHA-256 of the file and of the files beside it that it names; raises InputMissing, DataError."""
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


def _refuse_infinite(numbers: NDArray[np.float64], what: str, path: Path, largest: float = np.inf) -> None:
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
