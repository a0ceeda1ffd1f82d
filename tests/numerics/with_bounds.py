"""A twin run on numbers that carry their error: each plane that it writes, and how far a float32 program may be off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace

from cltaa.core.build import HALVES, Build, Storage
from cltaa.core.constants import value as value_of
from cltaa.core.planes import Layout
from cltaa.reference import KERNELS
from tests.numerics.bounded import Bounded


def with_bounds(kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> dict[str, Bounded]:
    """Run the twin of a kernel in float64 with bounds; arguments by the kernel's names, planes as float32 arrays.

    Returns every plane as it is afterwards, those that the kernel wrote among them.
    """
    planes = {name: Bounded.exact(given) for name, given in arguments.items() if np.ndim(given) > 1}
    KERNELS[kernel](replace(build, storage=Storage.FLOAT), layout, **{**arguments, **planes})
    for name in {"output", "texels_out"} & set(planes) if build.storage in HALVES else ():
        planes[name] = _stored_in_halves(planes[name], build.storage)
    return planes


def _stored_in_halves(v: Bounded, storage: Storage) -> Bounded:
    """What is kept of ``v``: limited to the range of halves, then off by half their distance, or by less than all."""
    most = value_of("HALF_LIMIT")
    kept = Bounded(np.clip(v.value, -most, most), v.error)
    size = np.maximum(np.abs(kept.value) + kept.error, value_of("HALF_NORMAL"))
    power = np.exp2(np.frexp(size)[1] - 1.0)
    distance = power * value_of("HALF_STEP")
    return Bounded(kept.value, kept.error + (distance if storage is Storage.HALF_STOCHASTIC else 0.5 * distance))
