"""Twin of ``to_halves.cl``: the result in halves, as a file holds them."""

from __future__ import annotations

import numpy as np

from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Record
from cltaa.reference.real import Array, constant, quiet


@quiet
def to_halves(
    build: Build,  # noqa: ARG001
    layout: Layout,
    *,
    image: Array,
    halves: Array,
    frame: Record,  # noqa: ARG001
    planes: int,
) -> None:
    """Round the first ``planes`` planes of ``image`` into ``halves``, infinite from the largest half on."""
    v = layout.inside(image)[:planes].astype(np.float32)
    layout.inside(halves)[:planes] = np.where(np.abs(v) >= constant("HALF_LIMIT", v), v + v, v).astype(np.float16)
