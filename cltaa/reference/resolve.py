"""Twin of ``resolve.cl`` and ``extend_edges.cl``: the whole resolve of one frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cltaa.build import Build, Real, Record
from cltaa.layout import Layout
from cltaa.reference.history import sample_history
from cltaa.reference.neighbourhood import Row, nearest_surface, read_row
from cltaa.reference.pixel import Resolved, box_gamma, current_pixel, past_alpha, resolve_pixel
from cltaa.reference.projection import surface_motion
from cltaa.reference.real import Array, constant, quiet
from cltaa.reference.rectify import rectify
from cltaa.reference.repair import repaired_planes
from cltaa.reference.storage import stored_history


def real_type(build: Build) -> Any:
    """NumPy type of the build's real."""
    return np.float64 if build.real is Real.DOUBLE else np.float32


def read_rows(
    current: Array, closeness: Array, motion: Array | None, build: Build, layout: Layout, frame: Record
) -> tuple[Row, Row, Row]:
    """The rows above, at and below each pixel, from padded planes in the build's real."""
    real = real_type(build)
    colour = repaired_planes(current, layout).astype(real)
    near = closeness.astype(real)
    moved = None if motion is None else motion.astype(real)
    above, centre, below = (read_row(colour, near, moved, dy, build, layout, frame) for dy in (-1, 0, 1))
    return above, centre, below


@quiet
def resolve(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    closeness: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    history: Array,
    history_count: Array,
    previous_closeness: Array,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes into ``output`` [3 or 4, rows, stride] and ``output_count``."""
    rows = read_rows(current, closeness, motion, build, layout, frame)
    p = current_pixel(rows, alpha, reactive, build, layout, frame)
    s = nearest_surface(*rows, build, settings["edge_tolerance"])
    m = surface_motion(s, build, layout, frame)
    h = sample_history(current, history, history_count, previous_closeness, m, s, build, layout, frame, settings)
    r = rectify(h.rgb, p.filtered, p.near, m, box_gamma(m, settings), build, layout, settings)
    if build.steps.alpha and alpha is not None:
        h = replace(h, alpha=past_alpha(alpha, h.alpha, build, layout))
    store_resolved(resolve_pixel(p, h, r, build, settings), build, layout, frame, output, output_count)


def store_resolved(
    resolved: Resolved, build: Build, layout: Layout, frame: Record, output: Array, output_count: Array
) -> None:
    """Write a resolved frame into padded planes, in the numbers of the build's storage."""
    target = layout.inside(output)
    for channel in range(3):
        target[channel] = stored_history(resolved.rgb[channel], build, layout, frame)
    if build.steps.alpha:
        alpha = np.where(resolved.alpha < constant("TINY", resolved.alpha), 0, resolved.alpha)
        target[3] = stored_history(alpha, build, layout, frame)
    layout.inside(output_count)[0] = resolved.count


def extend_edges(build: Build, layout: Layout, *, image: Array, frame: Record, planes: int) -> None:  # noqa: ARG001
    """Repeat the edge of the first ``planes`` planes into the halo."""
    layout.extend_edges(image[:planes])
