"""Read and write padded planes for the twins: twin of ``platform/storage.h``, ``store.cl`` and ``arrays.cl``.

``store_recurrent`` is the twin of that in ``taa/accumulate.h``, ``extend_stored`` of that in ``schedule/edges.h``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from cltaa.camera import inverse_depth
from cltaa.core.build import Build, Record, Storage
from cltaa.core.constants import value
from cltaa.core.planes import Kind, Layout
from cltaa.reference.accumulate import Resolved
from cltaa.reference.colour import repaired_planes
from cltaa.reference.illumination import tests_light
from cltaa.reference.neighbourhood import Row, read_row
from cltaa.reference.real import Array, Run, greater, quiet, real_type

Words = NDArray[np.uint32]


def half_storable(v: Array) -> Array:
    """Clamp ``v`` to the range of halves; what would round to -0 becomes +0."""
    most = value("HALF_LIMIT")
    limited = np.where(v > most, most, np.where(v < -most, -most, v))
    return np.where(np.abs(limited) <= value("HALF_TINY"), 0.0, limited)


def hash_bits(v: Words) -> Words:
    """Hash numbers to 32 bits (the integer hash "lowbias32", Wellons 2018)."""
    v = (v ^ (v >> np.uint32(16))) * np.uint32(0x7FEB352D)
    v = (v ^ (v >> np.uint32(15))) * np.uint32(0x846CA68B)
    return v ^ (v >> np.uint32(16))


def storage_dither(layout: Layout, frame: Record) -> Array:
    """Pseudo-random numbers in [0, 1), new for every pixel and frame and the same in every run, [H, W] float32."""
    x, y = np.arange(layout.width, dtype=np.uint32), np.arange(layout.height, dtype=np.uint32)
    row = hash_bits(y + hash_bits(np.array([frame["number"]], np.uint32)))
    bits = hash_bits(x[None, :] ^ row[:, None])
    dither = (bits >> np.uint32(8)).astype(np.float32)
    return dither * value("DITHER_STEP")


def stochastic_half(v: Array, dither: Array) -> Array:
    """One of the two halves around float32 ``v``, the upper one with the probability of the fraction between them."""
    power = (v.view(np.int32) & np.int32(0x7F800000)).view(np.float32)
    step = greater(power, value("HALF_NORMAL")) * value("HALF_STEP")
    scaled = v / step
    low = np.floor(scaled)
    return np.where(scaled - low > dither, low + 1.0, low) * step


def stored_history(v: Array, run: Run) -> NDArray[Any]:
    """``v`` [..., H, W] in the storage format of the history."""
    if run.build.storage in (Storage.FLOAT, Storage.DOUBLE):
        return v
    rounded = half_storable(v.astype(np.float32))
    if run.build.storage is Storage.HALF_STOCHASTIC:
        rounded = stochastic_half(rounded, storage_dither(run.layout, run.frame))
    return rounded.astype(np.float16)  # to the nearest, as vstore_half_rte does


@quiet
def pack(
    build: Build,  # noqa: ARG001
    layout: Layout,
    *,
    image: Array,
    target: Array,
    planes: int,
    halves: int,
    **places: int,
) -> None:
    """Twin of ``arrays.cl``: write the result to an array, rounded to ``halves``, infinite from the largest half on."""
    v = layout.inside(image)[:planes].astype(np.float32)
    if halves:
        v = np.where(np.abs(v) >= value("HALF_LIMIT"), v + v, v)
    strided(target, v.shape, **places)[...] = v


def unpack(
    build: Build,  # noqa: ARG001
    layout: Layout,
    *,
    source: Array,
    target: Array,
    planes: int,
    kind: int,
    below: float,
    at: float,
    **places: int,
) -> None:
    """Twin of ``arrays.cl``: fill planes and their halo from an array, distances as inverse depth."""
    inside = layout.inside(target)[:planes]
    given = strided(source, inside.shape, **places)
    if kind == Kind.AS_IT_IS:
        inside[...] = given
    else:
        inverse_depth(given.astype(np.float32, copy=False), inside, parallel=kind == Kind.PARALLEL)
        inside[inside <= below] = at
    layout.extend_edges(target[:planes])


def strided(array: Array, shape: tuple[int, ...], **places: int) -> Array:
    """View of a flat ``array`` as planes of ``shape``, by the first element and the steps that the kernel gets."""
    steps = (places[f"{axis}_step"] * array.itemsize for axis in ("plane", "row", "column"))
    return as_strided(array[places["first"] :], shape, tuple(steps))


def extend_edges(
    build: Build,  # noqa: ARG001
    layout: Layout,
    *,
    image: Array,
    floats: Array | None,
    frame: Record,  # noqa: ARG001
    planes: int,
    more: int,
) -> None:
    """Repeat the edge of the first ``planes`` planes of ``image``, and of ``more`` of ``floats``, into the halo."""
    layout.extend_edges(image[:planes])
    if floats is not None:
        layout.extend_edges(floats[:more])


def read_rows(current: Array, inverse_depth: Array, motion: Array | None, run: Run) -> tuple[Row, Row, Row]:
    """The rows above, at and below each pixel, from padded planes in the build's real."""
    real = real_type(run.build)
    colour = repaired_planes(current, run.layout).astype(real)
    near = inverse_depth.astype(real)
    moved = None if motion is None else motion.astype(real)
    above, centre, below = (read_row(colour, near, moved, dy, run) for dy in (-1, 0, 1))
    return above, centre, below


def store_resolved(resolved: Resolved, run: Run, output: Array, output_count: Array) -> None:
    """Write a resolved frame into padded planes, in the build's storage format."""
    target = run.layout.inside(output)
    target[:3] = stored_history(resolved.rgb, run)
    if run.steps.alpha:
        alpha = np.where(resolved.alpha < value("TINY"), 0, resolved.alpha)
        target[3] = stored_history(alpha, run)
    run.layout.inside(output_count)[0] = resolved.count


def store_recurrent(resolved: Resolved, run: Run, output: Array, output_count: Array) -> None:
    """As ``store_resolved``; where the build tests light, also the illumination change after the count's plane."""
    store_resolved(resolved, run, output, output_count)
    if tests_light(run.build):
        run.layout.inside(output_count)[1] = resolved.change


def extend_stored(run: Run, *planes: Array) -> None:
    """Repeat the edges of what a kernel stores, where it does so itself (``kernels/schedule/edges.h``)."""
    if run.build.extends:
        for stored in planes:
            run.layout.extend_edges(stored)
