"""Twin of ``span_recursive.h``: what the recursive resolve of a frame adds to what the spans of the past came to."""

from __future__ import annotations

import numpy as np

from cltaa.core.build import Build
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Resolved, drawn_towards
from cltaa.reference.real import (
    Array,
    constant,
    greater,
    lesser,
    limit,
    number,
)


def recursive_share(recursive: Array, count: Array, latest: Array) -> Array:
    """The share [H, W] of a recursive result of ``recursive`` samples beside spans of ``count`` ones; the shortest
    span has ``latest``."""
    zero, one = number(0.0, count), number(1.0, count)
    of_age = limit(constant("BEGUN_ANEW", count) - recursive, zero, one)
    begun = greater(of_age, limit(constant("FEW_GATHERED", count) - count, zero, one))
    few, many = constant("BESIDE_FEW", count) / count, constant("BESIDE_MANY", count) / (count * count)
    most = lesser(constant("BESIDE_MOST", count), lesser(few, many))
    old = limit((recursive - constant("LASTED", count)) * constant("LASTED_STEP", count), zero, one)
    lasted = old * limit((count - constant("GATHERED", count)) * constant("GATHERED_STEP", count), zero, one)
    part = recursive / (recursive + count)
    seen = limit(latest - constant("HARDLY_SEEN", count), zero, one)
    result: Array = seen * (begun * most + lasted * (part * part))
    return result


def beside_recursive(
    spans: Resolved, recursive: Array, count: Array, latest: Array, build: Build, layout: Layout
) -> Resolved:
    """What the spans came to, drawn towards the recursive result, padded planes [3 or 4, rows, stride] and [rows,
    stride] of its samples; the shortest span has ``latest`` of them, [H, W]."""
    planes = layout.inside(recursive).astype(spans.count.dtype)
    share = recursive_share(np.abs(layout.inside(count)), spans.count, latest)
    alpha = spans.alpha + share * (planes[3] - spans.alpha) if build.steps.alpha else spans.alpha
    return Resolved(drawn_towards(spans.rgb, (planes[0], planes[1], planes[2]), share), alpha, spans.count)
