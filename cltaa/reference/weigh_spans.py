"""Twin of ``weigh_spans.cl``: from the spans of each pixel's past to its colour."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, span_planes
from cltaa.core.constants import SPANS
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Resolved, storable_colour
from cltaa.reference.planes import real_type, store_resolved
from cltaa.reference.real import Array, constant, lesser, quiet
from cltaa.reference.span_now import held_by_now, moved_to_now
from cltaa.reference.span_recursive import beside_recursive
from cltaa.reference.span_weights import (
    believed,
    drifts_of,
    shared_noise,
    sum_around,
    trust,
    unsettled,
)


def errors_of(parts: Any, repeats: Array, layout: Layout) -> tuple[list[Array], Array, Array]:
    """The errors of spans [SPANS, SPAN_PLANES, rows, stride] summed up over each window, the least of them, and the sum
    of ``repeats`` [rows, stride], which takes the place of the last where it is less."""
    errors = [sum_around(part[3], layout) for part in parts]
    repeated = sum_around(repeats, layout)
    errors[-1] = lesser(errors[-1], repeated)
    least: Array = errors[0]
    for error in errors[1:]:
        least = lesser(least, error)
    return errors, least, repeated


@quiet
def weigh_spans(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    spans: Array,
    repeats: Array,
    recursive: Array,
    recursive_count: Array,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Write each pixel from the spans of its past, padded planes [SPANS * SPAN_PLANES, rows, stride], what repeated
    samples say of the last, [1, rows, stride], the current frame [3, rows, stride], and the recursive resolve of it:
    planes [3 or 4, rows, stride] in the numbers of the history, and of its samples, [1, rows, stride]."""
    planes = span_planes(build.steps)
    real: Any = real_type(build)
    parts = spans.astype(real).reshape(SPANS, planes, layout.rows, layout.stride)
    errors, least, repeated = errors_of(parts, repeats[0].astype(real), layout)
    floor, enough = constant("DRIFT_FLOOR", least), constant("DRIFT_T", least)
    zero, one, lag = np.zeros_like(least), np.ones_like(least), constant("LAG", least)
    short, middle = parts[0][:3], parts[1][:3]
    alike = drifts_of(middle, short, short, zero, build, layout, settings)
    sharp = constant("SURE_FLOOR", least)
    rate = believed(alike, shared_noise(errors[0]), sharp, constant("SURE_T", least))
    better = lesser(errors[0], errors[1])
    short_trust, middle_trust = trust(errors[0], better), trust(errors[1], better)
    share = middle_trust / (short_trust + middle_trust)
    first = layout.inside(parts[0])
    alpha, weight, darkest = first[5] if build.steps.alpha else one, trust(errors[0], least), list(first[:3])
    sums, alphas, counts, ahead = [zero, zero, zero], zero, zero, weight * lag
    of_spans: list[Array] = []
    for span, (part, error) in enumerate(zip(parts[1:], errors[1:], strict=True), start=1):
        w, own = trust(error, least), layout.inside(part)
        drifts = alike
        if span > 1:
            drifts = drifts_of(part[:3], short, middle, share, build, layout, settings)
        moves = unsettled(repeated, better) if span == SPANS - 1 else one
        ahead = ahead + w * (moves * (lag if span == 1 else lag + share))
        moved = [v + moves * step for v, step in zip(own, believed(drifts, zero, floor, enough), strict=False)]
        sums = [total + w * (v - k) for total, v, k in zip(sums, moved, first, strict=False)]
        darkest = [lesser(k, v) for k, v in zip(darkest, own, strict=False)]
        counts = counts + w * (own[4] - first[4])
        if build.steps.alpha:
            alphas = alphas + w * (own[5] - alpha)
        weight, of_spans = weight + w, [*of_spans, w]
    r, g, b = (k + (total + ahead * v) / weight for k, total, v in zip(first, sums, rate, strict=False))
    shares, now, colours = [w / weight for w in of_spans], current.astype(real), [part[:3] for part in parts]
    r, g, b = moved_to_now((r, g, b), colours, shares, now, build, layout, frame, settings)
    r, g, b = held_by_now((r, g, b), now, layout)
    rgb = storable_colour((r, g, b), (darkest[0], darkest[1], darkest[2]), build)
    resolved = Resolved(rgb, alpha + alphas / weight, first[4] + counts / weight)
    resolved = beside_recursive(resolved, recursive, recursive_count[0].astype(real), first[4], build, layout)
    store_resolved(resolved, build, layout, frame, output, output_count)
