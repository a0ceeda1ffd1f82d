"""What the tests of the core decode: a file of many channels, and planes that it is decoded into."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.core.planes import empty_haloed
from cltaa.exr import core as exr_core
from cltaa.io.content import Copy
from cltaa.io.exr_header import read_layout

WIDTH, HEIGHT = 37, 301  # more rows than any chunk of scan lines has, and no multiple of them
Pixels = NDArray[Any]


def channels(kind: str) -> dict[str, Pixels]:
    """More of them than the library has room for without asking; names in another order than the file's."""
    random = np.random.default_rng(1)
    made: dict[str, Pixels] = {"id": random.integers(0, 2**32, (HEIGHT, WIDTH), dtype=np.uint32)}
    for name in ("Z", "backward.v", "backward.u", "R", "G", "B", "a"):
        made[name] = random.standard_normal((HEIGHT, WIDTH)).astype("float32" if name == "Z" else kind)
    return made


def decode(path: Path, *, leave_out: str = "", widen: bool = True) -> dict[str, Pixels] | None:
    """Every channel decoded into planes whose rows lie apart, filled with sevens before; halves are widened or not."""
    layout = read_layout(path)
    planes: dict[str, Pixels] = {}
    for name, kind in layout.channels.items():
        plane = empty_haloed(1, layout.height, layout.width)[0]
        plane[...] = 7.0
        planes[name] = plane.view(np.uint32) if kind == "uint" else plane
        if kind == "half" and not widen:
            planes[name] = np.full((layout.height, layout.width + 3), 7.0, np.float16)[:, 1:-2]
    planes.pop(leave_out, None)
    copy = Copy()
    with path.open("rb") as file:
        copy.fill(path, file)
    return planes if exr_core.decode(copy, layout, planes) else None
