"""Twin of ``resolve.cl`` and ``extend_edges.cl``: the whole resolve of one frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cltaa.build import Build, Real, Record
from cltaa.layout import Layout
from cltaa.reference.history import sample_history
from cltaa.reference.neighbourhood import Row, current_sample, nearest_surface, neighbourhood_statistics, read_row
from cltaa.reference.pixel import Resolved, box_gamma, past_alpha, resolve_pixel, usable_share
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
    above, centre, below = read_rows(current, closeness, motion, build, layout, frame)
    near = neighbourhood_statistics(above, centre, below, build)
    s = nearest_surface(above, centre, below, build, settings["edge_tolerance"])
    m = surface_motion(s, build, layout, frame)
    sample = current_sample(above, centre, below, near, build, frame)
    h = sample_history(history, history_count, previous_closeness, m, s, build, layout, frame, settings)
    r = rectify(h.rgb, sample, near, m, box_gamma(m, settings), build, layout, settings)
    if build.steps.alpha and alpha is not None:
        h = replace(h, alpha=past_alpha(alpha, h.alpha, build, layout))
    resolved = resolve_pixel(
        centre.centre,
        sample,
        *load_shares(alpha, reactive, h.count, build, layout),
        near.mean,
        h,
        r,
        build,
        settings,
    )
    store_resolved(resolved, build, layout, frame, output, output_count)


def load_shares(
    alpha: Array | None, reactive: Array | None, like: Array, build: Build, layout: Layout
) -> tuple[Array, Array]:
    """Alpha and reactivity of each pixel from padded planes [1, rows, stride]; 1 and 0 where a build has none."""
    one, zero = np.ones_like(like), np.zeros_like(like)
    steps = build.steps
    return (
        usable_share(layout.inside(alpha)[0].astype(like.dtype), 1.0) if steps.alpha and alpha is not None else one,
        usable_share(layout.inside(reactive)[0].astype(like.dtype), 0.0)
        if steps.reactive and reactive is not None
        else zero,
    )


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
