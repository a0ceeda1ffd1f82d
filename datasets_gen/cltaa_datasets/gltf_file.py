"""The container of a glTF 2.0 file: its JSON, its buffers, and accessors as arrays (specification, sections 3.6 and 4).

trimesh reads the other formats (docs/decisions explain why not this one).
"""

from __future__ import annotations

import base64
import hashlib
import json
import struct
import urllib.parse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError, InputMissing
from cltaa_datasets.image_files import opened, texels

Entry = TypeVar("Entry")

MAGIC, JSON_CHUNK, BIN_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
# Exceptions of files whose JSON has other types or numbers than the specification allows.
MALFORMED = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
# Extensions that a file may require although geometry and animation are readable without them.
HARMLESS = (
    "KHR_materials_",
    "KHR_texture_transform",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "EXT_texture_webp",
)


class GltfFile:
    """A glTF or GLB file in memory. Every method raises DataError for an inconsistent file."""

    def __init__(self, path: Path) -> None:
        """Read a file and the buffers beside it; raises InputMissing and DataError."""
        self.path = path
        if not is_file(path):
            raise InputMissing("there is no such model", path=path, cure="check the path behind file:")
        try:
            self.json, binary = _chunks(path.read_bytes())
            needed = [name for name in self.json.get("extensionsRequired", ()) if not name.startswith(HARMLESS)]
            if needed:
                self.do_without(needed[0], {"extensions": needed})
            # Only the first buffer may be the binary chunk.
            chunks = (binary, *[b""] * len(self.items("buffers")))
            self._buffers = [self._bytes(b.get("uri"), c) for b, c in zip(self.items("buffers"), chunks, strict=False)]
        except (*MALFORMED, struct.error) as error:
            reason = f"is no glTF 2.0 file ({type(error).__name__}: {error})"
            raise DataError(reason, path=path, cure="export the model again") from error

    def items(self, name: str) -> list[dict[str, Any]]:
        """Return a top-level list, empty if the file has none."""
        found: list[dict[str, Any]] = self.json.get(name, [])
        return found

    def do_without(self, extension: str, of: dict[str, Any]) -> None:
        """Raise DataError for an object that has an extension."""
        if extension in of.get("extensions", ()):
            raise DataError(f"needs the extension {extension}", path=self.path, cure="export without it")

    def item(self, name: str, index: int) -> dict[str, Any]:
        """Return an entry of a top-level list; raises ValueError for a number that has none."""
        return picked(self.items(name), index, name)

    def sha256(self) -> str:
        """Return the SHA-256 of the file and of the files beside it that it names."""
        digest = hashlib.sha256(self.path.read_bytes())
        for named in (*self.items("buffers"), *self.items("images")):
            digest.update(self._bytes(named.get("uri"), b""))
        return digest.hexdigest()

    def _bytes(self, uri: str | None, binary: bytes) -> bytes:
        if uri is None:
            return binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        folder = self.path.parent.resolve()
        beside = (folder / urllib.parse.unquote(uri)).resolve()
        if not beside.is_relative_to(folder):  # an untrusted model must not read this machine's other files
            raise DataError(f"refers to {uri}, outside its own folder", path=self.path, cure="copy it beside the model")
        if not is_file(beside):
            raise InputMissing(f"there is no {uri} beside the model", path=self.path, cure="copy it there")
        return beside.read_bytes()

    def _view(self, index: int) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and its stride (0: packed)."""
        view = self.item("bufferViews", index)
        start, length = view.get("byteOffset", 0), view["byteLength"]
        content = picked(self._buffers, view["buffer"], "buffers")[max(start, 0) : start + length]
        if len(content) != length:
            raise DataError(f"buffer view {index} is cut short", path=self.path, expected=length, found=len(content))
        return content, int(view.get("byteStride", 0))

    def array(self, index: int) -> NDArray[Any]:
        """Return an accessor as [count] or [count, width]; normalised integers become float64 in [-1, 1]."""
        try:
            accessor = self.item("accessors", index)
            dtype, width = np.dtype(COMPONENTS[accessor["componentType"]]), WIDTHS[accessor["type"]]
            count = int(accessor["count"])
            if count > sum(map(len, self._buffers)):  # checked before allocating
                raise ValueError(f"{count} values, more than the file has bytes")
            values = np.zeros((count, width), dtype)
            if "bufferView" in accessor:
                values[:] = self._strided(accessor["bufferView"], accessor.get("byteOffset", 0), count, width, dtype)
            if "sparse" in accessor:
                self._replace(values, accessor["sparse"])
        except MALFORMED as error:
            reason = f"accessor {index} cannot be read ({error})"
            raise DataError(reason, path=self.path, cure="export the model again") from error
        if accessor.get("normalized") and dtype.kind != "f":
            values = np.maximum(values / float(2 ** (8 * dtype.itemsize - (dtype.kind == "i")) - 1), -1.0)
        return values[:, 0] if width == 1 else values

    def _strided(self, view: int, offset: int, count: int, width: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        content, stride = self._view(view)
        packed = dtype.itemsize * width
        strides = (stride or packed, dtype.itemsize)
        return np.ndarray((count, width), dtype.newbyteorder("<"), content, offset, strides)

    def _replace(self, values: NDArray[Any], sparse: dict[str, Any]) -> None:
        count, where, what = sparse["count"], sparse["indices"], sparse["values"]
        kind = np.dtype(COMPONENTS[where["componentType"]])
        places = self._strided(where["bufferView"], where.get("byteOffset", 0), count, 1, kind)[:, 0]
        values[places] = self._strided(
            what["bufferView"], what.get("byteOffset", 0), count, values.shape[1], values.dtype
        )

    def image(self, index: int) -> NDArray[np.uint8]:
        """Return an image as RGBA texels [H, W, 4]."""
        found = self.item("images", index)
        content = self._view(found["bufferView"])[0] if "bufferView" in found else self._bytes(found.get("uri"), b"")
        try:
            return texels(opened(content))
        except ValueError as error:
            raise DataError(f"image {index} cannot be read ({error})", path=self.path) from error


def is_file(path: Path) -> bool:
    """Return whether there is a file; False for a name too long for one."""
    try:
        return path.is_file()
    except OSError:
        return False


def picked(found: Sequence[Entry], index: int, name: str) -> Entry:
    """Return an entry of a list; raises ValueError for an index outside it. (Python counts a negative from the end.)"""
    if not 0 <= index < len(found):
        raise ValueError(f"it refers to {name} {index} of {len(found)}")
    return found[index]


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Split GLB into its JSON and binary chunk; a .gltf file has only JSON."""
    found: dict[int, bytes] = {}
    if not content.startswith(MAGIC):
        found[JSON_CHUNK] = content
    place = 12
    while content.startswith(MAGIC) and place + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, place)
        found.setdefault(kind, content[place + 8 : place + 8 + length])
        place += 8 + length
    text = json.loads(found.get(JSON_CHUNK, b""))
    if not isinstance(text, dict) or "asset" not in text:
        raise ValueError("no asset in it")
    version = str(text["asset"].get("version", "2.0"))
    if not version.startswith("2."):
        raise ValueError(f"its version is {version}")
    return text, found.get(BIN_CHUNK, b"")
