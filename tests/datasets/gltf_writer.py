"""Writes glTF files, array by array."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
FLOAT, SHORT, BYTE = 5126, 5123, 5121
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
HALF_TURN = (0.0, 0.0, 1.0, 0.0)


class Writer:
    """Collects arrays and writes them as GLB."""

    def __init__(self, **entries: Any) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], **entries}
        self.blob = b""

    def add(self, values: Any, component: int = FLOAT, **more: Any) -> int:
        kinds = {FLOAT: np.float32, SHORT: np.uint16, BYTE: np.uint8}
        array = np.atleast_1d(np.asarray(values, kinds[component]))
        width = 1 if array.ndim == 1 else array.shape[1]
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": array.nbytes})
        self.blob += array.tobytes() + b"\0" * (-array.nbytes % 4)
        view = len(self.json["bufferViews"]) - 1
        entry = {"bufferView": view, "componentType": component, "count": len(array), "type": KINDS[width], **more}
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def square(self, **more: Any) -> dict[str, Any]:
        normals = self.add(np.tile([0.0, 0.0, 1.0], (4, 1)))
        attributes = {"POSITION": self.add(SQUARE), "NORMAL": normals, **more.pop("attributes", {})}
        return {"attributes": attributes, "indices": self.add([0, 1, 2, 0, 2, 3], SHORT), **more}

    def animate(self, node: int, path: str, times: Any, values: Any, interpolation: str = "LINEAR") -> None:
        (animation,) = self.json.setdefault("animations", [{"channels": [], "samplers": []}])
        sampler = {"input": self.add(times), "output": self.add(values), "interpolation": interpolation}
        animation["samplers"].append(sampler)
        place = len(animation["samplers"]) - 1
        animation["channels"].append({"sampler": place, "target": {"node": node, "path": path}})

    def write(self, path: Path) -> Path:
        self.json["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(self.blob), 0x004E4942)
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body) + len(self.blob)) + body + self.blob)
        return path


JOINTS, WHOLE = [(0, 0, 0, 0)] * 2 + [(1, 0, 0, 0)] * 2, [(255, 0, 0, 0)] * 4


def skinned_square(
    path: Path, *, joints: Any = (JOINTS,), weights: Any = (WHOLE,), bound: int = 2, above: Any = None
) -> Path:
    """A square whose upper side follows a joint; ``above`` is a node over everything."""
    nodes = [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {}, {"translation": [0, 1, 0]}]
    writer = Writer(nodes=nodes + ([{"children": [0, 1, 2], **above}] if above else []))
    skin = {f"JOINTS_{place}": writer.add(numbers, BYTE) for place, numbers in enumerate(joints)}
    skin |= {f"WEIGHTS_{place}": writer.add(shares, BYTE, normalized=True) for place, shares in enumerate(weights)}
    bindings = np.tile(np.eye(4, dtype=np.float32), (bound, 1, 1))
    bindings[1:2, 1, 3] = -1.0
    writer.json["meshes"] = [{"primitives": [writer.square(attributes=skin)]}]
    matrices = writer.add(bindings.transpose(0, 2, 1).reshape(bound, 16))
    writer.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": matrices}]
    writer.animate(2, "translation", [0.0, 1.0], [(0, 1, 0), (1, 1, 0)])
    return writer.write(path)
