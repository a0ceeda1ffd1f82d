"""Twin of ``gather/drift.h`` and ``mix_windows.cl``: mixes each pixel from several windows of its past.

The error of a window in the texels around weights it, and its drift of light shifts it to the shortest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record, unmoved_window, window_count, window_planes
from cltaa.core.constants import PAD_X, PAD_Y, WINDOW_REACH, value
from cltaa.core.parameters import Recursion
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Resolved, luminance_weight, storable
from cltaa.reference.colour import Colour, outside_domain_of
from cltaa.reference.gather_window import has_more_frames, repeats_previous
from cltaa.reference.planes import store_resolved
from cltaa.reference.real import (
    NEIGHBOURS,
    Array,
    Run,
    greater,
    lesser,
    limit,
    neighbour,
    number,
    quiet,
    real_type,
)

TEXELS = (2 * WINDOW_REACH + 1) ** 2


def row_sums(plane: Array, layout: Layout) -> Array:
    """The sums over the texels left and right of each of padded planes [..., rows, stride], [..., rows, W]."""
    total: Array = np.zeros_like(plane[..., : layout.width])
    for i in range(-WINDOW_REACH, WINDOW_REACH + 1):
        total = total + plane[..., PAD_X + i : PAD_X + i + layout.width]
    return total


def column_sums(rows: Array, layout: Layout) -> Array:
    """The sums [..., H, W] over the rows above and below each of padded rows [..., rows, W]."""
    total: Array = np.zeros_like(rows[..., : layout.height, :])
    for j in range(-WINDOW_REACH, WINDOW_REACH + 1):
        total = total + rows[..., PAD_Y + j : PAD_Y + j + layout.height, :]
    return total


def sum_around(plane: Array, layout: Layout) -> Array:
    """The sum over the texels [..., H, W] around each pixel of padded planes [..., rows, stride], row by row."""
    return column_sums(row_sums(plane, layout), layout)


def window_weight(error: Array, least: Array, build: Build) -> Array:
    """Weight of a window relative to that of the least error."""
    tiny = value("TINY")
    ratio = greater((least + tiny) / (error + tiny), value("LEAST_ERROR_RATIO"))
    second = ratio * ratio
    fourth = second * second
    eighth = fourth * fourth
    return eighth if build.steps.centred else eighth * eighth


def times_counted(window: int, frames: int, build: Build) -> int:
    """How often a window counts: beside frames ahead that of all ring frames twice, and in the ring one that repeats
    another not at all."""
    unmoved = unmoved_window(build.steps)
    if not build.steps.look_ahead or window >= unmoved:
        return 1
    return has_more_frames(window, frames, build) + (window == unmoved - 1)


def recursive_share(count: Array, others: Array, error: Array, least: Array) -> Array:
    """Share of the recursive result in its mean with the other windows."""
    tiny = value("TINY")
    ratio = lesser((least + tiny) / (error + tiny), 1.0)
    second = ratio * ratio
    return (count / greater(count + others, 1.0)) * (second * second)


class Drift(NamedTuple):
    """Drift of light since a window: the mean over the texels around [..., H, W], its variance, and the window's
    light."""

    mean: Array
    variance: Array
    level: Array


def drift_of(then: Array, now: Array, weights: Array, layout: Layout) -> Drift:
    """The drift between planes [..., rows, stride] of a window ``then`` and ``now``, each texel by its weight [rows,
    stride].

    Squares are summed about the mean of a row, then those of the rows' means about that of all (Chan, Golub and LeVeque
    1979).
    """
    d, weight = now - then, row_sums(weights, layout)
    mean = row_sums(weights * d, layout) / weight
    squares = np.zeros_like(mean)
    for i in range(PAD_X - WINDOW_REACH, PAD_X + WINDOW_REACH + 1):
        columns = np.s_[..., i : i + layout.width]
        off = d[columns] - mean
        squares = squares + weights[columns] * (off * off)
    whole = column_sums(weight, layout)
    middle = column_sums(weight * mean, layout) / whole
    spread = np.zeros_like(middle)
    for j in range(PAD_Y - WINDOW_REACH, PAD_Y + WINDOW_REACH + 1):
        rows = np.s_[..., j : j + layout.height, :]
        off = mean[rows] - middle
        spread = spread + (squares[rows] + weight[rows] * (off * off))
    level = sum_around(weights * np.abs(then), layout) / whole
    return Drift(middle, spread / (whole * (TEXELS - 1)), level)


def shared_weights(window: Array, shortest: Array, run: Run) -> Array:
    """Weight of each texel [rows, stride]: the luminance weights of both windows."""
    return luminance_weight(window[:3], run) * luminance_weight(shortest[:3], run)


def students_t_of_drift(drift: Drift) -> Array:
    """Student's t of a drift; DRIFT_FLOOR of the light is added to its standard error."""
    floor = value("DRIFT_FLOOR") * drift.level + value("TINY")
    return np.abs(drift.mean) / (np.sqrt(drift.variance) + floor)


def sure_share(t: Array, settings: Record) -> Array:
    """Share of a drift that is not chance, by Student's t."""
    enough = settings["drift_t"]
    chance = enough / greater(t, enough)
    return 1.0 - chance * chance


def drift_to_shortest(window: Array, shortest: Array, run: Run) -> tuple[Colour, Array]:
    """Drift of light and alpha between padded planes [WINDOW_PLANES, rows, stride], as far as it is not chance.

    The channel of light that drifted most decides that for light, and for alpha, whose level is 1, its own t.
    """
    weights = shared_weights(window, shortest, run)
    drift = drift_of(window[:3], shortest[:3], weights, run.layout)
    r, g, b = students_t_of_drift(drift)
    light, opacity = sure_share(greater(r, greater(g, b)), run.settings) * drift.mean, np.zeros_like(r)
    if run.steps.alpha:
        alpha = drift_of(window[5], shortest[5], weights, run.layout)._replace(level=np.ones_like(r))
        opacity = sure_share(students_t_of_drift(alpha), run.settings) * alpha.mean
    return light, opacity


def up_to(change: Array, most: Array) -> Array:
    """A change in the direction of ``most``, and no more than that."""
    return limit(change, lesser(most, 0.0), greater(most, 0.0))


def trend_within_lag(
    light: Array, opacity: Array, current: Array, alpha: Array | None, shortest: Array, run: Run
) -> tuple[Array, Array]:
    """How far the shortest window lags behind the current light and alpha: as far as their trends ``light`` and
    ``opacity``, and no more than the current samples around lie from it."""
    samples = current[:3].astype(shortest.dtype)
    alphas = alpha[0].astype(shortest.dtype) if alpha is not None and run.steps.alpha else None
    missing = outside_domain_of(samples, alphas)
    now = np.where(missing, shortest[:3], samples)
    weights = np.where(missing, np.zeros_like(shortest[0]), shared_weights(now, shortest, run))
    weight = greater(sum_around(weights, run.layout), value("TINY"))

    def within(trend: Array, off: Array) -> Array:
        return up_to(trend, sum_around(weights * off, run.layout) / weight)

    if alphas is None:
        return within(light, now - shortest[:3]), np.zeros_like(opacity)
    shares = np.where(missing, shortest[5], limit(alphas, 0.0, 1.0))
    return within(light, now - shortest[:3]), within(opacity, shares - shortest[5])


def further_into_range(
    light: Array, opacity: Array, out: tuple[Array, Array], current: Array, alpha: Array | None, run: Run
) -> tuple[Array, Array]:
    """How much further than the trend pixels go, ``out`` their light [3, H, W] and alpha [H, W]: by the drift since the
    second window, ``light`` and ``opacity``, until they meet the range of the current 3x3."""
    rgb, share = out
    for step in NEIGHBOURS:
        sample = neighbour(current[:3], *step, run.layout).astype(rgb.dtype)
        own = (
            neighbour(alpha[0], *step, run.layout).astype(rgb.dtype) if alpha is not None and run.steps.alpha else None
        )
        missing = outside_domain_of(sample, own)
        light = up_to(np.where(missing, rgb, sample) - rgb, light)
        if own is not None:
            opacity = up_to(np.where(missing, share, limit(own, 0.0, 1.0)) - share, opacity)
    return light, opacity


@quiet
def mix_windows(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    alpha: Array | None,
    windows: Array,
    frames: int,
    static_frames: int,
    lag_ratio: float,
    drift_share: float,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Mix each pixel from the windows of its past, padded planes [WINDOWS * WINDOW_PLANES, rows, stride], of a ring of
    ``frames``, of which the latest ``static_frames`` share the current camera; ``lag_ratio`` is that of FrameRing, and
    ``drift_share`` the share of the drift by which a pixel goes on into the range of the 3x3."""
    run = Run(build, layout, frame, settings)
    real: Any = real_type(build)
    shape = window_count(build.choices, build.steps), window_planes(build.steps)
    unmoved = unmoved_window(build.steps)
    parts = windows[: shape[0] * shape[1]].astype(real).reshape(*shape, layout.rows, layout.stride)
    stored = [window for window in range(len(parts)) if not repeats_previous(window, frames, static_frames, build)]
    sources = [max(k for k in stored if k <= window) for window in range(len(parts))]
    errors = [sum_around(parts[k][3], layout) for k in sources]
    recursion = build.choices.recursion is Recursion.STANDING
    rivals, least = len(parts) - recursion, errors[0]
    for error in errors[1:rivals]:
        least = lesser(least, error)
    zero, first, weight = np.zeros_like(least), layout.inside(parts[0]), window_weight(errors[0], least, build)
    own_alpha, darkest = first[5] if build.steps.alpha else np.ones_like(least), first[:3]
    sums, alphas, counts = np.zeros_like(darkest), zero, zero
    light, opacity, latest, latest_of_alpha = sums, zero, sums, zero  # their drift and that of the second
    followed = weight  # of the windows that follow it
    for window, (k, error) in enumerate(zip(sources[1:rivals], errors[1:rivals], strict=True), start=1):
        w, own = times_counted(window, frames, build) * window_weight(error, least, build), layout.inside(parts[k])
        if window > unmoved:
            light, opacity = np.zeros_like(sums), zero
        elif k == window and (window == unmoved or has_more_frames(window, frames, build)):
            light, opacity = drift_to_shortest(parts[k], parts[0], run)
        if window == 1:
            latest, latest_of_alpha = light, opacity
        followed = followed + w if window <= unmoved else followed
        sums, darkest = sums + w * ((own[:3] + light) - first[:3]), lesser(darkest, own[:3])
        counts = counts + w * (own[4] - first[4])
        if build.steps.alpha:
            alphas = alphas + w * ((own[5] + opacity) - own_alpha)
        weight = weight + w
    follows, rgb, opacity = followed / weight, first[:3] + sums / weight, own_alpha + alphas / weight
    if lag_ratio > 0:
        drift = latest * number(lag_ratio, zero), latest_of_alpha * number(lag_ratio, zero)
        trend, trend_of_alpha = trend_within_lag(*drift, current, alpha, parts[0], run)
        rgb, opacity = rgb + follows * trend, opacity + follows * trend_of_alpha
    if drift_share > 0:
        may_go = follows * number(drift_share, zero)
        drift = may_go * latest, may_go * latest_of_alpha
        further, further_alpha = further_into_range(*drift, (rgb, opacity), current, alpha, run)
        rgb, opacity = rgb + further, opacity + further_alpha
    count = first[4] + counts / weight
    if recursion:
        held = layout.inside(parts[-1])
        share = recursive_share(held[4], count, errors[-1], least)
        rgb, count = rgb + share * (held[:3] - rgb), count + share * (held[4] - count)
        darkest = lesser(darkest, held[:3])
        if build.steps.alpha:
            opacity = opacity + share * (held[5] - opacity)
    resolved = Resolved(storable(rgb, darkest, build), limit(opacity, zero, 1.0), count)
    store_resolved(resolved, run, output, output_count)
