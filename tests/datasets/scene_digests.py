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
    "charts": "53244d0a7bdfe587",
    "charts_drift": "6939e3d38ab5cc18",
    "cloth": "c562442d9d8883fc",
    "conveyor": "2d28a51a902f7041",
    "corridor": "a5f95c0a204d6e7d",
    "cut": "5a208f09d3a1bd34",
    "depth_range": "ed4556e20a614c41",
    "dolly": "7dbfab94607dfd14",
    "everything": "fe0f6ffd3b5460a9",
    "exposure": "466c0ad281b5c890",
    "far_off": "836f0ddc4fe5e15c",
    "flash": "466c0ad281b5c890",
    "foliage": "dfcdb713bccf3108",
    "glints": "dbb8d5f7d9ba00b5",
    "halt": "540c747aad484f63",
    "morphing": "da52a50068d2c880",
    "occluder": "004305d1f472f5f5",
    "pan": "bc52f56d6e36e90f",
    "panes": "e7164a4386d548fe",
    "parallel": "5da0f3ff74c0e802",
    "roll": "7c98d8f89b2c0c5f",
    "shadow": "466c0ad281b5c890",
    "silhouettes": "044f8ecc84d37b71",
    "skinned": "da72f10e3f570b05",
    "smoke": "a7d55b06b211da2c",
    "sparks": "3aa6e76ed659b762",
    "spinner": "9912e0370f822751",
    "starry": "5b0fa28cf80bc3bf",
    "still": "c1d341d5e576a755",
    "swaying": "6a0c756c9761eac1",
    "turntable": "7641ef43a9f9d2f6",
    "wires": "5038791fe11b4e31",
    "zoom": "466c0ad281b5c890",
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
