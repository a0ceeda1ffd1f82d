"""An animated glTF model: parts whose poses and shapes are functions of time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa_datasets import deform, meshes
from cltaa_datasets.gltf_animation import NodeTree
from cltaa_datasets.gltf_file import GltfFile
from cltaa_datasets.scene import AlphaMode, Material, Matrix, Part, Shape, Texture

TRIANGLES = 4
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """One primitive under one node."""

    part: Part
    node: int
    rest: Shape
    targets: tuple[Shape, ...]
    weights: tuple[float, ...]  # of the targets at rest
    skin: int | None
    joints: NDArray[np.int64]  # [V, K]
    shares: Floats  # [V, K], sum 1


class AnimatedModel:
    """What a file shows at any time; the first animation is played, over and over."""

    def __init__(self, path: Path) -> None:
        """Read a file; raises InputMissing and DataError."""
        self._file = GltfFile(path)
        self.tree = NodeTree(self._file)
        self._materials: dict[int | None, Material] = {}
        self._textures: dict[tuple[int, bool], Texture] = {}
        try:
            self._skins = [self._read_skin(skin) for skin in self._file.items("skins")]
            self.pieces = tuple(self._pieces())
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise DataError(f"cannot be read ({type(error).__name__}: {error})", path=path) from error
        if not self.pieces:
            raise DataError("no triangles in it", path=path, cure="export the model as a mesh")

    @staticmethod
    def animates(path: Path) -> bool:
        """Tell whether a file is glTF with an animation; raises what reading it raises."""
        return path.suffix.lower() in (".glb", ".gltf") and bool(GltfFile(path).items("animations"))

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts, in the order of the poses."""
        return tuple(piece.part for piece in self.pieces)

    def at(self, time: float) -> tuple[list[Matrix], dict[str, Shape]]:
        """A pose for each part, and a shape for each that deforms."""
        nodes = self.tree.poses(time)
        poses, shapes = [], {}
        for piece in self.pieces:
            # A skin stands where its joints stand; its node's own pose says nothing (section 3.7.3.3).
            poses.append(np.eye(4) if piece.skin is not None else nodes[piece.node])
            if piece.part.deforms:
                shapes[piece.part.name] = self._shape(piece, nodes, time)
        return poses, shapes

    def _shape(self, piece: Piece, nodes: list[Matrix], time: float) -> Shape:
        shape = piece.rest
        if piece.targets:
            played = self.tree.property(piece.node, "weights", time)
            shape = deform.morphed(shape, piece.targets, piece.weights if played is None else played.tolist())
        if piece.skin is not None:
            joints, bindings = self._skins[piece.skin]
            matrices = [nodes[joint] @ binding for joint, binding in zip(joints, bindings, strict=True)]
            shape = deform.skinned(shape, piece.joints, piece.shares, matrices)
        return shape

    def _read_skin(self, skin: dict[str, Any]) -> tuple[list[int], Floats]:
        joints = skin["joints"]
        if "inverseBindMatrices" not in skin:
            return joints, np.tile(np.eye(4), (len(joints), 1, 1))
        columns = np.asarray(self._file.array(skin["inverseBindMatrices"]), np.float64)
        return joints, columns.reshape(-1, 4, 4).transpose(0, 2, 1)

    def _pieces(self) -> list[Piece]:
        pieces = []
        for index, node in enumerate(self._file.items("nodes")):
            mesh = self._file.items("meshes")[node["mesh"]] if "mesh" in node else {"primitives": []}
            for number, primitive in enumerate(mesh["primitives"]):
                if primitive.get("mode", TRIANGLES) == TRIANGLES:
                    name = f"{index} {node.get('name', mesh.get('name', 'node'))} {number}"
                    weights = tuple(node.get("weights", mesh.get("weights", ())))
                    pieces.append(self._piece(name, index, primitive, node.get("skin"), weights))
        return pieces

    def _piece(
        self, name: str, node: int, primitive: dict[str, Any], skin: int | None, weights: tuple[float, ...]
    ) -> Piece:
        attributes, array = primitive["attributes"], self._file.array
        positions = np.asarray(array(attributes["POSITION"]), np.float64)
        count = len(positions)
        faces = array(primitive["indices"]).astype(np.int64) if "indices" in primitive else np.arange(count)
        faces = faces.reshape(-1, 3)
        if "NORMAL" in attributes:
            normals = np.asarray(array(attributes["NORMAL"]), np.float64)
        else:
            normals = face_normals(positions, faces)
        uv = np.zeros((count, 2))
        if "TEXCOORD_0" in attributes:
            # trimesh's v grows upwards, glTF's downwards.
            uv = np.asarray(array(attributes["TEXCOORD_0"]), np.float64) * (1.0, -1.0) + (0.0, 1.0)
        targets = tuple(self._target(target, count) for target in primitive.get("targets", ()))
        joints, shares = np.zeros((count, 1), np.int64), np.ones((count, 1))
        if skin is not None:
            joints = array(attributes["JOINTS_0"]).astype(np.int64)
            shares = np.asarray(array(attributes["WEIGHTS_0"]), np.float64)
            shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), np.finfo(np.float32).tiny)
        rest = Shape(positions, deform.unit(normals))
        colours = self._colours(attributes, count)
        part = Part(
            name, meshes.make_mesh(positions, faces, rest.normals, uv), self._material(primitive.get("material")),
            colours, deforms=bool(targets) or skin is not None,
        )  # fmt: skip
        weights = weights or (0.0,) * len(targets)
        return Piece(part, node, rest, targets, weights, skin, joints, shares)

    def _target(self, target: dict[str, int], count: int) -> Shape:
        moved, turned = (
            np.asarray(self._file.array(target[name]), np.float64) if name in target else np.zeros((count, 3))
            for name in ("POSITION", "NORMAL")
        )
        return Shape(moved, turned)

    def _colours(self, attributes: dict[str, int], count: int) -> NDArray[np.float32] | None:
        if "COLOR_0" not in attributes:
            return None
        found = np.asarray(self._file.array(attributes["COLOR_0"]), np.float32)  # linear (section 3.7.2.1)
        return np.ascontiguousarray(np.concatenate([found, np.ones((count, 1), np.float32)], 1)[:, :4])

    def _material(self, index: int | None) -> Material:
        if index not in self._materials:
            entry = {} if index is None else self._file.items("materials")[index]
            pbr = entry.get("pbrMetallicRoughness", {})
            self._materials[index] = Material(
                base_colour=tuple(pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))),
                base_texture=self._texture(pbr.get("baseColorTexture")),
                metallic=float(pbr.get("metallicFactor", 1.0)),
                roughness=float(pbr.get("roughnessFactor", 1.0)),
                metallic_roughness_texture=self._texture(pbr.get("metallicRoughnessTexture"), srgb=False),
                emissive=tuple(entry.get("emissiveFactor", (0.0, 0.0, 0.0))),
                emissive_texture=self._texture(entry.get("emissiveTexture")),
                alpha_mode=AlphaMode(entry.get("alphaMode", "OPAQUE")),
                alpha_cutoff=float(entry.get("alphaCutoff", 0.5)),
                double_sided=bool(entry.get("doubleSided", False)),
            )
        return self._materials[index]

    def _texture(self, reference: dict[str, int] | None, *, srgb: bool = True) -> Texture | None:
        if reference is None:
            return None
        key = self._file.items("textures")[reference["index"]]["source"], srgb
        if key not in self._textures:
            self._textures[key] = Texture(self._file.image(key[0]), srgb=srgb)
        return self._textures[key]


def face_normals(positions: Floats, faces: NDArray[np.int64]) -> Floats:
    """Normals [V, 3] of vertices without any: the mean of their faces' by area."""
    a, b, c = (positions[faces[:, corner]] for corner in range(3))
    normals = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    return normals
