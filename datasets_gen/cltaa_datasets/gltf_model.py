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
from cltaa_datasets.scene import AlphaMode, Colour, Material, Matrix, Part, Shape, Texture

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive
WIDTHS = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD": (2,), "COLOR": (3, 4), "JOINTS": (4,), "WEIGHTS": (4,)}
LARGEST_COLOUR = 65504.0  # largest half
COMPRESSED = "KHR_draco_mesh_compression"
Floats = NDArray[np.float64]
Faces = NDArray[np.int64]  # [F, 3]


class Vertices:
    """Attributes of a primitive [V, width] in float64, and its ``faces`` [F, 3].

    If a corner has no normal, each face gets three vertices of its own, for flat normals there.
    """

    def __init__(self, file: GltfFile, primitive: dict[str, Any]) -> None:
        """Read the faces; raises DataError, and ValueError or KeyError for inconsistent data."""
        if COMPRESSED in primitive.get("extensions", {}):
            raise DataError(f"needs the extension {COMPRESSED}", path=file.path, cure="export without compression")
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
        kind = name.partition("_")[0]
        if values.shape[-1] not in WIDTHS[kind] or values.ndim != 2:
            raise ValueError(f"{name} of {values.shape[-1] if values.ndim == 2 else 1} numbers a vertex")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite")
        if kind == "TEXCOORD" and np.abs(values).max(initial=0.0) > meshes.MOST_REPEATS:
            raise ValueError(f"{name} is beyond {meshes.MOST_REPEATS:g}")
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
        self._materials: dict[int | None, Material] = {}
        self._textures: dict[tuple[int, bool], Texture] = {}
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
        uv = np.zeros((count, 2))
        if "TEXCOORD_0" in vertices.attributes:
            uv = vertices.read("TEXCOORD_0") * (1.0, -1.0) + (0.0, 1.0)  # trimesh's v grows upwards, glTF's downwards
        targets = tuple(_target(target, vertices, count) for target in primitive.get("targets", ()))
        joints, shares = np.zeros((count, 1), np.int64), np.ones((count, 1))
        if skin is not None:
            joints, shares = _influences(vertices)
        part = Part(
            name,
            meshes.make_mesh(positions, vertices.faces, rest.normals, uv),
            self._material(primitive.get("material")),
            _colours(vertices, count),
            deforms=bool(targets) or skin is not None,
        )
        weights = weights or (0.0,) * len(targets)
        return Piece(part, node, rest, targets, weights, skin, joints, shares)

    def _material(self, index: int | None) -> Material:
        if index not in self._materials:
            entry = {} if index is None else self._file.item("materials", index)
            pbr = _shiny(entry) or entry.get("pbrMetallicRoughness", {})
            base = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
            self._materials[index] = Material(
                base_colour=(*_light(base[:3]), _share(base[3])),
                base_texture=self._texture(pbr.get("baseColorTexture")),
                metallic=_share(pbr.get("metallicFactor", 1.0)),
                roughness=_share(pbr.get("roughnessFactor", 1.0)),
                metallic_roughness_texture=self._texture(pbr.get("metallicRoughnessTexture"), srgb=False),
                emissive=_light(entry.get("emissiveFactor", (0.0, 0.0, 0.0))),
                emissive_texture=self._texture(entry.get("emissiveTexture")),
                alpha_mode=AlphaMode(entry.get("alphaMode", "OPAQUE")),
                alpha_cutoff=_finite(entry.get("alphaCutoff", 0.5)),
                double_sided=bool(entry.get("doubleSided", False)),
            )
        return self._materials[index]

    def _texture(self, reference: dict[str, int] | None, *, srgb: bool = True) -> Texture | None:
        if reference is None:
            return None
        texture = self._file.item("textures", reference["index"])
        source = texture.get("source", texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
        if source is None:  # only in a format that Pillow does not read
            return None
        key = source, srgb
        if key not in self._textures:
            self._textures[key] = Texture(self._file.image(key[0]), srgb=srgb)
        return self._textures[key]


def _finite(number: Any) -> float:
    found = float(number)
    if not np.isfinite(found):
        raise ValueError(f"{found} in a material")
    return found


def _share(number: Any) -> float:
    """Clamp a number to [0, 1], its range in the specification."""
    return min(max(_finite(number), 0.0), 1.0)


def _light(numbers: Any) -> Colour:
    """Check a colour of a material; raises ValueError for an invalid one."""
    red, green, blue = (_finite(number) for number in numbers)
    if not (min(red, green, blue) >= 0.0 and max(red, green, blue) <= LARGEST_COLOUR):
        raise ValueError(f"a colour {list(numbers)} in a material, expected numbers from 0 to {LARGEST_COLOUR:g}")
    return red, green, blue


def _shiny(entry: dict[str, Any]) -> dict[str, Any]:
    """Approximate a material of KHR_materials_pbrSpecularGlossiness by metallic-roughness without metal."""
    found = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if found is None:
        return {}
    base = {"baseColorTexture": found["diffuseTexture"]} if "diffuseTexture" in found else {}
    colour, gloss = found.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)), found.get("glossinessFactor", 1.0)
    return {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 1.0 - gloss, **base}


def _target(target: dict[str, int], vertices: Vertices, count: int) -> Shape:
    """Return the displacements of positions and normals by a morph target."""
    none = np.zeros((count, 3))
    return Shape(*(vertices.read(name, target) if name in target else none for name in ("POSITION", "NORMAL")))


def _influences(vertices: Vertices) -> tuple[NDArray[np.int64], Floats]:
    """Return the joints of every vertex and their shares, of all sets; a vertex without weights follows its first."""
    sets = sorted(name.removeprefix("JOINTS") for name in vertices.attributes if name.startswith("JOINTS_"))
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
