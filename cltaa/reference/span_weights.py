"""Twin of ``span_weights.h``: how far each span of a pixel's past is believed, and how far light has moved since."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import CONSTANTS, PAD_X, PAD_Y, SHORT_SPAN, SPAN_REACH
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import sample_share
from cltaa.reference.real import Array, constant, greater, lesser, number

TEXELS = (2 * SPAN_REACH + 1) ** 2


def around(plane: Array, layout: Layout, reach: int = SPAN_REACH) -> Iterator[Array]:
    """A padded plane [rows, stride] moved by each step of the window, row by row, [H, W] each."""
    for j in range(-reach, reach + 1):
        for i in range(-reach, reach + 1):
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


def unsettled(repeated: Array, error: Array) -> Array:
    """How much of a drift to spans that leave ``error`` is left to the one without motion."""
    tiny = constant("TINY", error)
    ratio = (lesser(constant("SURELY_STANDS", error) * repeated, error) + tiny) / (error + tiny)
    second = ratio * ratio
    result: Array = second * second
    return result


class Drift(NamedTuple):
    """How far light has moved in one channel since a span: the mean over the window [H, W], its variance, and what the
    texels show."""

    mean: Array
    variance: Array
    level: Array


def drift_of(then: list[Array], now: list[Array], weights: list[Array]) -> Drift:
    """The drift of one channel from the texels [H, W] of a window then and now, each by its weight."""
    differences = [k - v for k, v in zip(now, then, strict=True)]
    total = squares = level = weight = np.zeros_like(weights[0])
    for d, v, w in zip(differences, then, weights, strict=True):
        total, level, weight = total + w * d, level + w * np.abs(v), weight + w
    mean = total / weight
    for d, w in zip(differences, weights, strict=True):
        off = d - mean
        squares = squares + w * (off * off)
    return Drift(mean, squares / (weight * number(TEXELS - 1, mean)), level / weight)


def drifts_of(
    span: Array, shortest: Array, middle: Array, share: Array, build: Build, layout: Layout, settings: Record
) -> list[Drift]:
    """The drifts of padded planes [3, rows, stride] to what lies ``share`` of the way from the shortest to the middle;
    a texel counts as its light does in a mean, then and now."""
    then = [list(around(plane, layout)) for plane in span]
    now = [
        [first + share * (second - first) for first, second in zip(around(a, layout), around(b, layout), strict=True)]
        for a, b in zip(shortest, middle, strict=True)
    ]
    weights = [
        sample_share((r, g, b), build, settings) * sample_share((x, y, z), build, settings)
        for r, g, b, x, y, z in zip(*then, *now, strict=True)
    ]
    return [drift_of(v, k, weights) for v, k in zip(then, now, strict=True)]


def t_of(drift: Drift, noise: Array, least: Array) -> Array:
    """Student's t of a drift whose variance grows by ``noise`` and whose deviation by ``least`` of the level."""
    error = np.sqrt(drift.variance + noise) + (least * drift.level + constant("TINY", drift.mean))
    result: Array = np.abs(drift.mean) / error
    return result


def believed(drifts: list[Drift], noise: Array, least: Array, enough: Array) -> list[Array]:
    """As much of a drift in three channels as is not chance, by the one that drifted most."""
    r, g, b = (t_of(drift, noise, least) for drift in drifts)
    chance = enough / greater(greater(r, greater(g, b)), enough)
    sure = number(1.0, r) - chance * chance
    return [sure * drift.mean for drift in drifts]


def shared_noise(error: Array) -> Array:
    """Variance of the mean of the latest samples in a channel, as far as all texels around share it."""
    of_each = 3.0 * TEXELS * (SHORT_SPAN + 1) * (SHORT_SPAN + 1)
    result: Array = error * number(CONSTANTS["SHARED_NOISE"].value / of_each, error)
    return result
