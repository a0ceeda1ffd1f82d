"""What scenes are made of: a digest of the meshes, colours and textures of each, changed knowingly or not at all."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from cltaa_datasets.scene import Scene, Texture

TIME = 0.7  # seconds, when what moves stands nowhere special
# Lengths are rounded to a tenth of a millimetre, so that a processor whose sine differs in the last bit gives the same;
# the shift keeps round numbers away from where rounding turns.
STEP, SHIFT = 1e-4, 0.1234567

DIGESTS = {
    "charts": "603bf06f9f648fad",
    "charts_drift": "179a305697448486",
    "cloth": "5d1a3ddebcb40872",
    "conveyor": "de30bde04c287afb",
    "corridor": "2c2633d772d71645",
    "cut": "a4aaa26663d9fe2c",
    "depth_range": "9e2840c6b7e5ada0",
    "dolly": "394935e4af6bdfb3",
    "everything": "a9918d9e7e7de4c6",
    "exposure": "adb6c00a6f793bea",
    "far_off": "df15dea6602338b8",
    "flash": "adb6c00a6f793bea",
    "foliage": "fbc11f432ccf462f",
    "glints": "f24fadcd2e188ab9",
    "halt": "0c99327a6331d509",
    "morphing": "08f181bd4c74dbf3",
    "occluder": "9e1333fff3721d62",
    "pan": "3b29eb719cdba82b",
    "panes": "87c8fc03bb844bf6",
    "parallel": "9de6c88b95b26705",
    "roll": "dfcf19adf80dfb50",
    "shadow": "adb6c00a6f793bea",
    "silhouettes": "6679cf9818a57207",
    "skinned": "dbd8dc9c1a164aa6",
    "smoke": "2998e16228043136",
    "sparks": "8956489ee84f35e0",
    "spinner": "efe97bd862b695c7",
    "starry": "c93cffc1e74e6040",
    "still": "06ed64c297a94a97",
    "swaying": "59be86f08fecfa4f",
    "turntable": "58b519b5a22c8e4b",
    "wires": "c2a19539c00b7a57",
    "zoom": "adb6c00a6f793bea",
}


def digest(scene: Scene) -> str:
    found = hashlib.sha256()

    def add(values: Any) -> None:
        array = np.asarray(values)
        if array.dtype.kind == "f":
            array = np.floor(array.astype(np.float64) / STEP + SHIFT).astype(np.int64)
        found.update(f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())

    instant = scene.at(TIME)
    for part, pose in zip(scene.parts, instant.poses, strict=True):
        found.update(part.name.encode())
        add(part.mesh.vertices)
        add(part.mesh.faces)
        uv = getattr(part.mesh.visual, "uv", None)
        for more in (uv, part.colours, pose):
            if more is not None:
                add(more)
        material = part.material
        for field in material.__dataclass_fields__:
            value = getattr(material, field)
            if isinstance(value, Texture):
                add(value.texels)
                found.update(f"{value.srgb}{value.smooth}".encode())
            else:
                found.update(f"{field}{value}".encode())
    for name in sorted(instant.shapes):
        add(instant.shapes[name].positions)
    add(instant.world_to_view)
    found.update(f"{instant.shot}".encode())
    return found.hexdigest()[:16]
