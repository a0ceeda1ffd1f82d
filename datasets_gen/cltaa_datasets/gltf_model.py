"""A glTF model: parts with poses and shapes as functions of time, or at rest (glTF 2.0, section 3.7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa_datasets import GLTF, deform, meshes
from cltaa_datasets.gltf_animation import NodeTree
from cltaa_datasets.gltf_file import MALFORMED, GltfFile, picked
from cltaa_datasets.gltf_material import Materials, Placement
from cltaa_datasets.scene import Matrix, Part, Shape

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive
WIDTHS = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD": (2,), "COLOR": (3, 4), "JOINTS": (4,), "WEIGHTS": (4,)}
COMPRESSED, INSTANCED = "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"
Floats = NDArray[np.float64]
Faces = NDArray[np.int64]  # [F, 3]


class Vertices:
    """Attributes of a primitive [V, width] in float64, and its ``faces`` [F, 3].

    If a corner has no normal, each face gets three vertices of its own, for flat normals there.
    """

    def __init__(self, file: GltfFile, primitive: dict[str, Any]) -> None:
        """Read the faces; raises DataError, and ValueError or KeyError for inconsistent data."""
        file.do_without(COMPRESSED, primitive)
        self._array, self.attributes = file.array, primitive["attributes"]
        self._count = len(self._array(self.attributes["POSITION"]))
        corners = self._array(primitive["indices"]) if "indices" in primitive else np.arange(self._count)
        self.faces = triangles(primitive.get("mode", TRIANGLES), corners.astype(np.int64))
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < self._count:
            raise ValueError(f"a face has vertex {self.faces.max()} of {self._count}")
        self._taken: Faces | slice = slice(None)
        self._smooth = "NORMAL" in self.attributes and bool(self.read("NORMAL")[self.faces].any(axis=-1).all())
        if not self._smooth:
            self._taken = self.faces.ravel()
            self.faces = np.arange(self.faces.size).reshape(-1, 3)

    def read(self, name: str, attributes: Mapping[str, int] | None = None) -> Floats:
        """Read an attribute of the primitive, or of a morph target's ``attributes``; raises as the constructor does."""
        values = np.asarray(self._array((attributes or self.attributes)[name]), np.float64)
        if len(values) != self._count:
            raise ValueError(f"{name} of {len(values)} vertices, POSITION of {self._count}")
        if values.shape[-1] not in WIDTHS[name.partition("_")[0]] or values.ndim != 2:
            raise ValueError(f"{name} of {values.shape[-1] if values.ndim == 2 else 1} numbers a vertex")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite")
        return np.asarray(values[self._taken])

    def normals(self, positions: Floats) -> Floats:
        """Return the normals, where there are none those of the faces; of any length."""
        given = self.read("NORMAL") if "NORMAL" in self.attributes else np.zeros_like(positions)
        if self._smooth:
            return given
        a, b, c = (positions[self.faces[:, corner]] for corner in range(3))
        return np.where(given.any(axis=1, keepdims=True), given, np.repeat(np.cross(b - a, c - a), 3, axis=0))


def triangles(mode: int, corners: NDArray[np.int64]) -> Faces:
    """Return the faces of a primitive of mode TRIANGLES, STRIP or FAN."""
    if mode == TRIANGLES:
        if corners.size % 3:
            raise ValueError(f"{corners.size} corners of triangles, which have 3 each")
        return corners.reshape(-1, 3)
    first = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return np.stack([corners[first + 1], corners[first + 2], corners[np.zeros_like(first)]], axis=1)
    odd = first % 2  # every second triangle of a strip has the opposite winding
    return np.stack([corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=1)


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """One primitive of one node."""

    part: Part
    node: int
    rest: Shape
    targets: tuple[Shape, ...]
    weights: tuple[float, ...]  # weights of the targets at rest
    skin: int | None
    joints: NDArray[np.int64]  # [V, K]
    shares: Floats  # [V, K], sum 1


class AnimatedModel:
    """The parts of a file at any time, with its first animation looped or not played."""

    def __init__(self, path: Path, *, played: bool = True) -> None:
        """Read a file; raises InputMissing and DataError."""
        self._file = GltfFile(path)
        self._materials = Materials(self._file)
        try:
            self.tree = NodeTree(self._file, played=played)
            self._skins = [self._read_skin(skin) for skin in self._file.items("skins")]
            self.pieces = tuple(self._pieces())
            self.at(0.0)  # also checks poses and skins
        except MALFORMED as error:
            reason = f"cannot be read ({type(error).__name__}: {error})"
            raise DataError(reason, path=path, cure="export the model again") from error
        if not self.pieces:
            raise DataError("no triangles in it", path=path, cure="export the model as a mesh")

    @staticmethod
    def animates(path: Path) -> bool:
        """Return whether a file is glTF with an animation; raises what reading it raises."""
        return path.suffix.lower() in GLTF and bool(GltfFile(path).items("animations"))

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts, in the order of the poses."""
        return tuple(piece.part for piece in self.pieces)

    def at(self, time: float) -> tuple[list[Matrix], dict[str, Shape]]:
        """Return a pose for each part, and a shape for each deforming part."""
        nodes = self.tree.poses(time)
        poses, shapes = [], {}
        for piece in self.pieces:
            pose, shape = self._placed(piece, nodes, time)
            poses.append(pose)
            if piece.part.deforms:
                shapes[piece.part.name] = shape
        return poses, shapes

    def _placed(self, piece: Piece, nodes: list[Matrix], time: float) -> tuple[Matrix, Shape]:
        """Return the pose of a piece, and its shape in it."""
        shape = piece.rest
        if piece.targets:
            played = self.tree.property(piece.node, "weights", time)
            shape = deform.morphed(shape, piece.targets, piece.weights if played is None else played.tolist())
        if piece.skin is None:
            return nodes[piece.node], shape
        # The joints place a skin; its node's own pose is ignored (section 3.7.3.3). Joints that mirror also reverse the
        # winding of its triangles, which the renderer learns from a pose that mirrors back.
        joints, bindings = picked(self._skins, piece.skin, "skins")
        matrices = np.stack([nodes[joint] @ binding for joint, binding in zip(joints, bindings, strict=True)])
        mirrored = np.sign(np.linalg.det(matrices[:, :3, :3])).sum() < 0.0
        pose = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
        return pose, deform.skinned(shape, piece.joints, piece.shares, pose @ matrices)

    def _read_skin(self, skin: dict[str, Any]) -> tuple[list[int], Floats]:
        joints = skin["joints"]
        for joint in joints:
            self._file.item("nodes", joint)
        if "inverseBindMatrices" not in skin:
            return joints, np.tile(np.eye(4), (len(joints), 1, 1))
        columns = np.asarray(self._file.array(skin["inverseBindMatrices"]), np.float64)
        if len(columns) < len(joints):
            raise ValueError(f"{len(columns)} inverse bind matrices for {len(joints)} joints")
        return joints, columns[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)

    def _pieces(self) -> list[Piece]:
        pieces, scenes = [], self._file.items("scenes")
        for index in self.tree.shown(self._file.item("scenes", self._file.json.get("scene", 0)) if scenes else None):
            node = self._file.items("nodes")[index]
            mesh = self._file.item("meshes", node["mesh"]) if "mesh" in node else {"primitives": []}
            self._file.do_without(INSTANCED, node)
            for number, primitive in enumerate(mesh["primitives"]):
                if primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN):
                    name = f"{index} {node.get('name', mesh.get('name', 'node'))} {number}"
                    weights = tuple(node.get("weights", mesh.get("weights", ())))
                    piece = self._piece(name, index, primitive, node.get("skin"), weights)
                    pieces += [piece] if len(piece.part.mesh.faces) else []
        return pieces

    def _piece(
        self, name: str, node: int, primitive: dict[str, Any], skin: int | None, weights: tuple[float, ...]
    ) -> Piece:
        vertices = Vertices(self._file, primitive)
        positions = vertices.read("POSITION")
        count = len(positions)
        rest = Shape(positions, deform.unit(vertices.normals(positions)))
        material, placement = self._materials.read(primitive.get("material"))
        uv = _coordinates(vertices, placement) * (1.0, -1.0) + (0.0, 1.0)  # trimesh's v grows upwards, glTF's downwards
        targets = tuple(_target(target, vertices, count) for target in primitive.get("targets", ()))
        joints, shares = np.zeros((count, 1), np.int64), np.ones((count, 1))
        if skin is not None:
            joints, shares = _influences(vertices)
        part = Part(
            name,
            meshes.make_mesh(positions, vertices.faces, rest.normals, uv),
            material,
            _colours(vertices, count),
            deforms=bool(targets) or skin is not None,
        )
        weights = weights or (0.0,) * len(targets)
        return Piece(part, node, rest, targets, weights, skin, joints, shares)


def _coordinates(vertices: Vertices, placement: Placement) -> Floats:
    """Return the coordinates [V, 2] of a material's textures; (0, 0) without any."""
    name = f"TEXCOORD_{placement.of}"
    if name not in vertices.attributes:
        return np.zeros_like(vertices.read("POSITION")[:, :2])
    found = vertices.read(name) @ placement.matrix[:, :2].T + placement.matrix[:, 2]
    if not (np.abs(found) <= meshes.MOST_REPEATS).all():
        raise ValueError(f"{name} is beyond {meshes.MOST_REPEATS:g}")
    return np.asarray(found)


def _target(target: dict[str, int], vertices: Vertices, count: int) -> Shape:
    """Return the displacements of positions and normals by a morph target."""
    none = np.zeros((count, 3))
    return Shape(*(vertices.read(name, target) if name in target else none for name in ("POSITION", "NORMAL")))


def _influences(vertices: Vertices) -> tuple[NDArray[np.int64], Floats]:
    """Return the joints of every vertex and their shares, of all sets; a vertex without weights follows its first."""
    sets = sorted(name.removeprefix("JOINTS") for name in vertices.attributes if name.startswith("JOINTS_")) or ["_0"]
    joints, shares = (np.hstack([vertices.read(kind + of) for of in sets]) for kind in ("JOINTS", "WEIGHTS"))
    shares[shares.sum(axis=1) <= 0.0] = np.eye(1, shares.shape[1])
    return joints.astype(np.int64), shares / shares.sum(axis=1, keepdims=True)


def _colours(vertices: Vertices, count: int) -> NDArray[np.float32] | None:
    if "COLOR_0" not in vertices.attributes:
        return None
    found = vertices.read("COLOR_0").clip(0.0, 1.0).astype(np.float32)  # linear (section 3.7.2.1)
    return np.ascontiguousarray(np.concatenate([found, np.ones((count, 1), np.float32)], 1)[:, :4])


def at_rest(path: Path) -> tuple[tuple[Part, ...], list[Matrix]]:
    """Return the parts of a file at rest, and their poses; raises InputMissing and DataError."""
    model = AnimatedModel(path, played=False)
    poses, shapes = model.at(0.0)
    return tuple(_still(part, shapes.get(part.name)) for part in model.parts), poses


def _still(part: Part, shape: Shape | None) -> Part:
    """Return a rigid part with the shape that its skin and its morph targets give it."""
    if shape is None:
        return part
    uv = meshes.texture_coordinates(part.mesh)
    return replace(part, mesh=meshes.make_mesh(shape.positions, part.mesh.faces, shape.normals, uv), deforms=False)
