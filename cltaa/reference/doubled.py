"""Twin of ``texels.h``, ``doubled.h`` and ``resolve_doubled.cl``: the resolve of one frame with a history at 200 %."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record, texel_planes
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.parameters import Reject
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import (
    Pixel,
    Resolved,
    believed_samples,
    box_gamma,
    current_pixel,
    past_alpha,
    resolve_beside,
    storable_colour,
)
from cltaa.reference.colour import Colour, colour_outside_domain
from cltaa.reference.history import History, same_surface
from cltaa.reference.illumination import history_in_range
from cltaa.reference.neighbourhood import Surface, nearest_surface
from cltaa.reference.planes import extend_stored, read_rows, store_resolved
from cltaa.reference.real import (
    Array,
    Mask,
    constant,
    limit,
    number,
    quiet,
)
from cltaa.reference.rectify import Rectification, rectify
from cltaa.reference.reprojection import Motion, motion_to_edge, on_screen, surface_motion
from cltaa.reference.sampling import (
    SIX_TAPS,
    Footprint,
    Quad,
    Row,
    bilinear,
    footprint_of,
    history_weights,
    sample_quad,
    weigh,
    weigh_rows,
)
from cltaa.reference.store import stored_history

TEXELS = ((0, 0), (1, 0), (0, 1), (1, 1))  # right, down: the order in which they are kept


class Doubled(NamedTuple):
    """The history of the four texels of each pixel, and their mean."""

    texel: tuple[History, ...]
    mean: Colour


def doubled_footprint(m: Motion, valid: Mask, layout: Layout) -> Footprint:
    """Where the upper left texel of each pixel was: row and column count texels, two a texel of the padded plane."""
    two = number(2.0, m.u)
    f = footprint_of(m._replace(u=m.u * two, v=m.v * two), valid, layout)
    y, x = np.mgrid[: layout.height, : layout.width]
    return f._replace(row=f.row + (y + PAD_Y), column=f.column + (x + PAD_X))


def load_tap(plane: Array, f: Footprint, column: int, row: int, real: Any) -> Array:
    """The texel that lies ``column`` and ``row`` texels from the footprint in a plane [2, 2, rows, stride]."""
    x, y = f.column + column, f.row + row
    tap: Array = plane[y & 1, x & 1, y >> 1, x >> 1].astype(real)
    return tap


def sample_texels(plane: Array, f: Footprint, build: Build, real: Any) -> list[Array]:
    """The four texels of each pixel from a plane [2, 2, rows, stride], filtered along x first."""
    reach = range(-2, 4) if build.choices.history_filter in SIX_TAPS else range(-1, 3)
    wx, wy = history_weights(f.fx, build), history_weights(f.fy, build)
    texels = []
    for right, down in TEXELS:
        rows: list[Row] = []
        for j in reach:
            rows.append(weigh([load_tap(plane, f, i + right, j + down, real) for i in reach], wx, build))
        texels.append(weigh_rows(rows, wx, wy, build))
    return texels


def sample_counts(plane: Array, f: Footprint, real: Any) -> list[Array]:
    """The same of a plane of counts, interpolated."""
    return [
        bilinear(Quad(*(load_tap(plane, f, x + i, y + j, real) for j in (0, 1) for i in (0, 1))), f) for x, y in TEXELS
    ]


def mean_of_four(values: Any) -> Array:
    """Their mean, exact where they are equal."""
    a, b, c, d = values
    mean: Array = number(0.25, a) * ((a + b) + (c + d))
    return mean


def mean_colour(colours: list[Colour]) -> Colour:
    """The mean of four colours."""
    r, g, b = (mean_of_four(channel) for channel in zip(*colours, strict=True))
    return r, g, b


def sample_doubled(
    previous_closeness: Array,
    texels: Array,
    m: Motion,
    s: Surface,
    build: Build,
    layout: Layout,
    frame: Record,
    settings: Record,
) -> Doubled:
    """The texels' planes [16 or 20, rows, stride] at the motion of their pixel; usable for all four or for none."""
    real: Any = m.u.dtype
    planes = texels.reshape(-1, 2, 2, layout.rows, layout.stride)
    seen = motion_to_edge(m, build, layout)
    valid = on_screen(seen, layout) & np.bool_(frame["reset"] == 0)
    pixel, f = footprint_of(seen, valid, layout), doubled_footprint(seen, valid, layout)
    count = 3 + build.steps.alpha
    v = [sample_texels(planes[channel], f, build, real) for channel in range(count)]
    counts = sample_counts(planes[count], f, real)
    if build.choices.reject is Reject.DEPTH:
        there = sample_quad(previous_closeness[0], pixel, real)
        valid = valid & same_surface(there, s, m, settings["depth_tolerance"])
    colours = [(v[0][t], v[1][t], v[2][t]) for t in range(4)]
    for rgb in colours:
        valid = valid & ~colour_outside_domain(rgb)
    one, zero = np.ones_like(f.fx), np.zeros_like(f.fx)
    shares = [limit(a, zero, one) for a in v[3]] if build.steps.alpha else [one] * 4
    colours = [history_in_range(rgb, build, frame) for rgb in colours]
    texel = tuple(History(*given, f.fx, f.fy, valid) for given in zip(colours, shares, counts, strict=True))
    return Doubled(texel, mean_colour(colours))


def sample_mass(right: int, down: int, frame: Record, like: Array) -> Any:
    """What the frame's sample counts for in a texel: it falls with the distance between the two."""
    across = number(frame["right_mass" if right else "left_mass"], like)
    return across * number(frame["lower_mass" if down else "upper_mass"], like)


def resolve_texel(p: Pixel, h: History, r: Rectification, mass: Any, build: Build, settings: Record) -> Resolved:
    """A texel beside a sample of that mass: one sample beside as many as the history has of that mass."""
    out = resolve_beside(p, h, r, believed_samples(p, h, r, build, settings) / mass, build, settings)
    return replace(out, count=out.count * mass)


def mean_of_texels(texels: list[Resolved], build: Build) -> Resolved:
    """The pixel: the mean of its texels."""
    mean = mean_colour([texel.rgb for texel in texels])
    alpha, count = (mean_of_four([getattr(texel, name) for texel in texels]) for name in ("alpha", "count"))
    return Resolved(storable_colour(mean, mean, build), alpha, count)


def store_texel(texel: Resolved, planes: Array, build: Build, layout: Layout, frame: Record) -> None:
    """Write a texel of each pixel into its planes [4 or 5, rows, stride], in the numbers of the build's storage."""
    values = [*texel.rgb, texel.count]
    if build.steps.alpha:
        values.insert(3, np.where(texel.alpha < constant("TINY", texel.alpha), 0, texel.alpha))
    for plane, value in zip(planes, values, strict=True):
        layout.inside(plane)[:] = stored_history(value, build, layout, frame)


@quiet
def resolve_doubled(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    closeness: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    previous_closeness: Array,
    texels: Array,
    texels_out: Array,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame into ``texels_out`` [16 or 20, rows, stride], ``output`` [3 or 4, ...] and its count."""
    rows = read_rows(current, closeness, motion, build, layout, frame)
    p = current_pixel(rows, alpha, reactive, build, layout, frame)
    s = nearest_surface(*rows, build, settings["edge_tolerance"])
    m = surface_motion(s, build, layout, frame)
    d = sample_doubled(previous_closeness, texels, m, s, build, layout, frame, settings)
    r = rectify(d.mean, p.filtered, p.near, m, box_gamma(m, settings), build, layout, settings)
    out: list[Resolved] = []
    for t, (h, place) in enumerate(zip(d.texel, TEXELS, strict=True)):
        if build.steps.alpha and alpha is not None:
            h = replace(h, alpha=past_alpha(alpha, h.alpha, build, layout))
        out.append(resolve_texel(p, h, r, sample_mass(*place, frame, h.count), build, settings))
        store_texel(out[-1], texels_out[t : texel_planes(build.steps.alpha) : 4], build, layout, frame)
    store_resolved(mean_of_texels(out, build), build, layout, frame, output, output_count)
    texels = texels_out[: texel_planes(build.steps.alpha)]
    extend_stored(build, layout, texels, output[: 3 + build.steps.alpha], output_count)
