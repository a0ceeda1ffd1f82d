"""The vertices and faces of a glTF primitive (glTF 2.0, section 3.7.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa_datasets.gltf_file import GltfFile

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive
WIDTHS = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD_0": (2,), "COLOR_0": (3, 4), "JOINTS_0": (4,), "WEIGHTS_0": (4,)}
LARGEST_COLOUR = 65504.0  # of a half
COMPRESSED = "KHR_draco_mesh_compression"
Floats = NDArray[np.float64]
Faces = NDArray[np.int64]  # [F, 3]


class Vertices:
    """Attributes of a primitive [V, width] in float64, and its ``faces`` [F, 3].

    Where it has no normals each face has three vertices of its own, so that flat ones can be given to it.
    """

    def __init__(self, file: GltfFile, primitive: dict[str, Any]) -> None:
        """Read the faces; raises DataError, and ValueError or KeyError for what does not fit together."""
        if COMPRESSED in primitive.get("extensions", {}):
            raise DataError(f"needs the extension {COMPRESSED}", path=file.path, cure="export without compression")
        self._array, self.attributes = file.array, primitive["attributes"]
        self._count = len(self._array(self.attributes["POSITION"]))
        corners = self._array(primitive["indices"]) if "indices" in primitive else np.arange(self._count)
        self.faces = triangles(primitive.get("mode", TRIANGLES), corners.astype(np.int64))
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < self._count:
            raise ValueError(f"a face has vertex {self.faces.max()} of {self._count}")
        self._taken: Faces | slice = slice(None)
        if "NORMAL" not in self.attributes:
            self._taken = self.faces.ravel()
            self.faces = np.arange(self.faces.size).reshape(-1, 3)

    def read(self, name: str, attributes: Mapping[str, int] | None = None) -> Floats:
        """An attribute of the primitive, or of ``attributes`` of a morph target; raises as the constructor does."""
        values = np.asarray(self._array((attributes or self.attributes)[name]), np.float64)
        if len(values) != self._count:
            raise ValueError(f"{name} of {len(values)} vertices, POSITION of {self._count}")
        if values.shape[-1] not in WIDTHS[name] or values.ndim != 2:
            raise ValueError(f"{name} of {values.shape[-1] if values.ndim == 2 else 1} numbers a vertex")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite")
        if name == "COLOR_0" and (values.min(initial=0.0) < 0.0 or values.max(initial=0.0) > LARGEST_COLOUR):
            raise ValueError(f"{name} is no light")
        return np.asarray(values[self._taken])

    def normals(self, positions: Floats) -> Floats:
        """The normals, or those of the faces where there are none; of any length."""
        if "NORMAL" in self.attributes:
            return self.read("NORMAL")
        a, b, c = (positions[self.faces[:, corner]] for corner in range(3))
        return np.repeat(np.cross(b - a, c - a), 3, axis=0)


def triangles(mode: int, corners: NDArray[np.int64]) -> Faces:
    """Faces of a primitive of mode TRIANGLES, STRIP or FAN."""
    if mode == TRIANGLES:
        if corners.size % 3:
            raise ValueError(f"{corners.size} corners of triangles, which have 3 each")
        return corners.reshape(-1, 3)
    first = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return np.stack([corners[first + 1], corners[first + 2], corners[np.zeros_like(first)]], axis=1)
    odd = first % 2  # every other triangle of a strip is wound the other way
    return np.stack([corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=1)
