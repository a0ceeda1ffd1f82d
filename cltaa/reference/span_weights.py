"""Twin of ``span_weights.h`` and ``weigh_spans.cl``: from the spans of each pixel's past to its colour."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cltaa.build import Build, Record, span_planes
from cltaa.constants import PAD_X, PAD_Y, SPAN_REACH, SPANS
from cltaa.layout import Layout
from cltaa.reference.blend import storable_colour
from cltaa.reference.pixel import Resolved
from cltaa.reference.planes import real_type, store_resolved
from cltaa.reference.real import Array, constant, greater, lesser, number, quiet

TEXELS = (2 * SPAN_REACH + 1) ** 2


def around(plane: Array, layout: Layout) -> Iterator[Array]:
    """A padded plane [rows, stride] moved by each step of the window, row by row, [H, W] each."""
    for j in range(-SPAN_REACH, SPAN_REACH + 1):
        for i in range(-SPAN_REACH, SPAN_REACH + 1):
            top, left = PAD_Y + j, PAD_X + i
            yield plane[top : top + layout.height, left : left + layout.width]


def sum_around(plane: Array, layout: Layout) -> Array:
    """The sum over the window about each pixel."""
    total: Array = np.zeros_like(layout.inside(plane))
    for part in around(plane, layout):
        total = total + part
    return total


def trust(error: Array, least: Array) -> Array:
    """How much a span is believed beside that of the least error."""
    tiny = constant("TINY", error)
    ratio = greater((least + tiny) / (error + tiny), constant("LEAST_TRUST", error))
    second = ratio * ratio
    fourth = second * second
    eighth = fourth * fourth
    result: Array = eighth * eighth
    return result


def drift_of(span: Array, shortest: Array, layout: Layout, settings: Record) -> tuple[Array, Array]:
    """How far light has moved in one channel since a span, by the shortest one, and Student's t of it."""
    own = layout.inside(shortest) - layout.inside(span)
    total = squares = level = np.zeros_like(own)
    for v, now in zip(around(span, layout), around(shortest, layout), strict=True):
        d = (now - v) - own
        total, squares, level = total + d, squares + d * d, level + np.abs(v)
    texels, zero, one = number(TEXELS, own), number(0.0, own), number(1.0, own)
    offset = total / texels
    variance = greater(squares - total * offset, zero) / (texels * (texels - one))
    floor = number(settings["change_floor"], own)
    error = np.sqrt(variance) + (floor * (level / texels) + constant("TINY", own))
    return own + offset, np.abs(own + offset) / error


def caught_up(span: Array, shortest: Array, layout: Layout, settings: Record) -> list[Array]:
    """A span's colour, from padded planes [3, rows, stride], moved by as much of the drift as is not chance."""
    drifts = [drift_of(span[c], shortest[c], layout, settings) for c in range(3)]
    (_, r), (_, g), (_, b) = drifts
    least = number(settings["change_t"], r)
    chance = least / greater(greater(r, greater(g, b)), least)
    sure = number(1.0, r) - chance * chance
    return [layout.inside(v) + sure * mean for v, (mean, _) in zip(span, drifts, strict=False)]


@quiet
def weigh_spans(
    build: Build, layout: Layout, *, spans: Array, output: Array, output_count: Array, frame: Record, settings: Record
) -> None:
    """Write each pixel from the spans of its past, padded planes [SPANS * SPAN_PLANES, rows, stride]."""
    planes = span_planes(build.steps)
    real: Any = real_type(build)
    parts = spans.astype(real).reshape(SPANS, planes, layout.rows, layout.stride)
    errors = [sum_around(part[3], layout) for part in parts]
    least = errors[0]
    for error in errors[1:]:
        least = lesser(least, error)
    first = layout.inside(parts[0])
    alpha = first[5] if build.steps.alpha else np.ones_like(least)
    weight, darkest = trust(errors[0], least), list(first[:3])
    zero = np.zeros_like(weight)
    sums, alphas, counts = [zero, zero, zero], zero, zero
    for part, error in zip(parts[1:], errors[1:], strict=True):
        w, own = trust(error, least), layout.inside(part)
        moved = caught_up(part[:3], parts[0][:3], layout, settings)
        sums = [total + w * (v - k) for total, v, k in zip(sums, moved, first, strict=False)]
        darkest = [lesser(k, v) for k, v in zip(darkest, own, strict=False)]
        counts = counts + w * (own[4] - first[4])
        if build.steps.alpha:
            alphas = alphas + w * (own[5] - alpha)
        weight = weight + w
    r, g, b = (k + total / weight for k, total in zip(first, sums, strict=False))
    rgb = storable_colour((r, g, b), (darkest[0], darkest[1], darkest[2]), build)
    resolved = Resolved(rgb, alpha + alphas / weight, first[4] + counts / weight)
    store_resolved(resolved, build, layout, frame, output, output_count)
