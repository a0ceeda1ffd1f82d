"""Twin of ``gather/window.h``, ``gather_windows.cl`` and ``mix_windows.cl``: the adaptive temporal window.

Each pixel is mixed from several windows of its past, each weighted by its error in the texels around.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record, window_count, window_planes
from cltaa.core.constants import MIDDLE_WINDOW, PAD_X, PAD_Y, SHORT_WINDOW, UNMOVED, WINDOW_REACH, value
from cltaa.core.parameters import CurrentFilter, FilterUse, Recursion
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import (
    Pixel,
    Resolved,
    luminance_weight,
    reactivity_weight,
    storable,
    weighted_difference,
)
from cltaa.reference.colour import (
    Colour,
    accumulates_alpha,
    from_range,
    inner,
    outside_domain_of,
    share_in_domain,
    to_range,
)
from cltaa.reference.gather import Gathering
from cltaa.reference.gather_fit import SampleSums, own_samples, takes_alpha_of_others
from cltaa.reference.gather_track import ring_alpha, ring_reactive
from cltaa.reference.planes import extend_stored, store_resolved
from cltaa.reference.real import (
    NEIGHBOURS,
    Array,
    Mask,
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


def window_ends(frames: int) -> list[int]:
    """Number of ring frames in each window: the latest, a few more, all."""
    return [min(SHORT_WINDOW, frames), min(MIDDLE_WINDOW, frames), frames]


def has_more_frames(window: int, frames: int) -> bool:
    """True if one of the windows of the ring has more of its ``frames`` than the one before it."""
    ends = window_ends(frames)
    return window == 0 or ends[window] > ends[window - 1]


def repeats_previous(window: int, frames: int, static_frames: int, build: Build) -> bool:
    """True if a window equals the one before it, and is not stored."""
    if window >= (UNMOVED - 1 if build.choices.recursion is Recursion.STANDING else UNMOVED + 1):
        return False
    return static_frames < SHORT_WINDOW if window == UNMOVED else not has_more_frames(window, frames)


def window_error(g: SampleSums, now: Pixel, window: Resolved, run: Run) -> Array:
    """Squared distances of the latest samples, the current one among them, from a window's result."""
    d = weighted_difference(to_range(window.rgb, run.build), now.own, run)
    along, square = inner(d, g.recent), inner(d, d)
    if accumulates_alpha(run.build):
        alpha = window.alpha - now.alpha
        along, square = along + alpha * g.recent_alpha, square + alpha * alpha
    squares = (g.recent_squares - 2.0 * along) + (own_samples(now) + g.recent_count) * square
    left = 1.0 - 1.0 / greater(window.count, 1.5)
    return greater(squares, 0.0) / (left * left)


def resolve_unmoved(slots: Array, past: Any, p: Pixel, run: Run) -> tuple[Resolved, SampleSums]:
    """Mean of the samples at each pixel's own position, and the sums of these samples."""
    one = np.ones_like(p.own[0])
    g = SampleSums(np.zeros_like(one))
    for place, then in enumerate(past):
        planes = run.layout.inside(slots[int(then["slot"])]).astype(one.dtype)
        c = planes[:3]
        alpha = planes[ring_alpha(run.steps)] if run.steps.alpha else None
        good = ~outside_domain_of(c, alpha)
        if run.steps.exposure:
            c = c * then["exposure_ratio"]
        c = np.where(good, to_range(c, run.build), p.own)
        counted = np.where(good, one, g.zero)
        if run.steps.reactive:
            counted = counted * reactivity_weight(share_in_domain(planes[ring_reactive(run.steps)], 0.0), p)
        w = counted * luminance_weight(c, run)
        g.sum = g.sum + w * (c - p.own)
        g.weight, g.count = g.weight + w, g.count + counted
        opacity = g.zero if alpha is None else share_in_domain(alpha, 1.0) - p.alpha
        g.alpha = g.alpha + w * opacity
        if place < SHORT_WINDOW:
            g.add_recent(weighted_difference(c, p.own, run), opacity, counted, run.build)
    own = own_samples(p)
    whole = np.where(own > g.zero, luminance_weight(p.own, run), g.zero) + g.weight
    alpha = np.where(takes_alpha_of_others(p, run.build), p.alpha + g.alpha / whole, p.alpha)
    rgb = storable(from_range(p.own + g.sum / whole, run.build), p.own, run.build)
    return Resolved(rgb, alpha, g.count + own), g


@quiet
def gather_windows(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    inverse_depth: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    ring: Array,
    past: Any,
    frames: int,
    static_frames: int,
    recursive: Array,
    recursive_count: Array,
    windows: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from each window of ``frames`` ring frames into ``windows`` [WINDOWS * WINDOW_PLANES, rows,
    stride]; the latest ``static_frames`` of them share the current camera."""
    run = Run(build, layout, frame, settings)
    gathering = Gathering.begin(run, locals())
    own, planes, begun = gathering.pixel, window_planes(build.steps), 0
    count, held = window_count(build.choices), recursive_result(recursive, recursive_count, layout, own.alpha)
    target = layout.inside(windows)[: count * planes].reshape(count, planes, layout.height, layout.width)
    for window, end in enumerate(window_ends(frames)):
        gathering.add(past[begun:end], run, before=begun, recent=SHORT_WINDOW - begun)
        out = gathering.resolved(run)
        if build.choices.recursion is Recursion.STANDING and window == UNMOVED - 1:
            out = longer_history(out, own.most_reactive <= 0, held)
        error = window_error(gathering.near, own, out, run)
        if not repeats_previous(window, frames, static_frames, build):
            _store(target[window], out, error)
        begun = end
    if build.steps.reactive:
        unlike = gathering.near.unlike > gathering.near.recent_count
        for window in range(UNMOVED - 1):
            _store(target[window], out, error, unlike)
    at_rest = (gathering.motion.u == 0) & (gathering.motion.v == 0)
    if not repeats_previous(UNMOVED, frames, static_frames, build):
        unmoved, sums = resolve_unmoved(gathering.slots, past[:static_frames], own, run)
        if build.choices.recursion is Recursion.STANDING:
            unmoved = longer_history(unmoved, at_rest, held)
        valid = sums.recent_count >= SHORT_WINDOW
        out = _chosen(valid, unmoved, out)
        error = np.where(valid, window_error(sums, own, unmoved, run), error)
        _store(target[UNMOVED], out, error)
    if build.choices.recursion is Recursion.STANDING:
        refuted = history_is_refuted(at_rest, own, held.count)
        refuted &= frames_before(past[:static_frames], build) >= value("REFUTED_SAMPLES")
        if own.missing is not None:
            refuted &= ~own.missing
        filtered = storable(from_range(own.filtered, build), own.own, build)
        present = Resolved(filtered, own.alpha, np.ones_like(error))
        beyond = present_error(gathering.near, own, refuted, run)
        _store(target[-2], _chosen(refuted, present, out), beyond)
        if build.steps.look_ahead:  # it lags behind later frames, so beside them it has no share
            held = Resolved(held.rgb, held.alpha, np.zeros_like(error))
        held_error = window_error(gathering.near, own, held, run)
        _store(target[-1], held, np.where(at_rest, held_error, held_error * value("MOVING_ERROR")))
    extend_stored(run, windows[: count * planes])


def frames_before(past: Any, build: Build) -> int:
    """Number of earlier frames in the ring."""
    return int(np.count_nonzero(past["ahead"] <= 0)) if build.steps.look_ahead else len(past)


def history_is_refuted(at_rest: Mask, p: Pixel, recursive_count: Array) -> Mask:
    """True where a surface is at rest, but the recursive resolve holds few of its samples."""
    few: Mask = recursive_count < value("REFUTED_SAMPLES")
    return at_rest & few & (p.most_reactive <= 0.0)


def present_error(g: SampleSums, p: Pixel, valid: Mask, run: Run) -> Array:
    """Distance of each pixel's own sample from the others in the current filter."""
    beyond = np.full_like(g.zero, value("DOMAIN_LIMIT"))
    choices = run.choices
    if choices.filter_use is not FilterUse.FEW or choices.current_filter is CurrentFilter.NONE:
        return beyond
    one = number(1.0, g.zero)
    left, right, above, below = (
        number(run.frame[f"{side}_weight"], one) for side in ("left", "right", "above", "below")
    )
    others = one - (one - (left + right)) * (one - (above + below))
    d = weighted_difference(p.filtered, p.own, run)
    error = value("PRESENT_PENALTY") * ((own_samples(p) + g.recent_count) * (inner(d, d) / (others * others)))
    return np.where(valid & (others > value("LEAST_NEIGHBOUR_SHARE")), error, beyond)


def recursive_result(recursive: Array, recursive_count: Array, layout: Layout, alpha: Array) -> Resolved:
    """The result of the recursive resolve, which contains all frames before; its alpha where it has one."""
    count, held = (layout.inside(planes).astype(alpha.dtype) for planes in (recursive_count[0], recursive))
    return Resolved(held[:3], held[3] if len(held) > 3 else np.ones_like(count), count)


def longer_history(window: Resolved, where: Mask, recursive: Resolved) -> Resolved:
    """A window, or, ``where`` the recursive resolve holds more samples, its result."""
    return _chosen((recursive.count > window.count) & where, recursive, window)


def _chosen(where: Mask, one: Resolved, other: Resolved) -> Resolved:
    """``one`` where ``where`` is true, ``other`` elsewhere."""
    pairs = (one.rgb, other.rgb), (one.alpha, other.alpha), (one.count, other.count)
    return Resolved(*(np.where(where, *pair) for pair in pairs))


def _store(planes: Array, out: Resolved, error: Array, where: Array | None = None) -> None:
    """Write a window's result, everywhere or only ``where``, and alpha if there is a plane for it."""
    for plane, values in zip(planes, [*out.rgb, error, out.count, out.alpha], strict=False):
        plane[...] = values if where is None else np.where(where, values, plane)


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


def window_weight(error: Array, least: Array) -> Array:
    """Weight of a window relative to that of the least error."""
    tiny = value("TINY")
    ratio = greater((least + tiny) / (error + tiny), value("LEAST_ERROR_RATIO"))
    second = ratio * ratio
    fourth = second * second
    eighth = fourth * fourth
    return eighth * eighth


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
    reach: float,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Mix each pixel from the windows of its past, padded planes [WINDOWS * WINDOW_PLANES, rows, stride], of a ring of
    ``frames``, of which the latest ``static_frames`` share the current camera; ``lag_ratio`` is that of FrameRing, and
    ``reach`` the share of the drift by which a pixel goes on into the range of the 3x3."""
    run = Run(build, layout, frame, settings)
    real: Any = real_type(build)
    shape = window_count(build.choices), window_planes(build.steps)
    parts = windows[: shape[0] * shape[1]].astype(real).reshape(*shape, layout.rows, layout.stride)
    stored = [window for window in range(len(parts)) if not repeats_previous(window, frames, static_frames, build)]
    sources = [max(k for k in stored if k <= window) for window in range(len(parts))]
    errors = [sum_around(parts[k][3], layout) for k in sources]
    recursion = build.choices.recursion is Recursion.STANDING
    rivals, least = len(parts) - recursion, errors[0]
    for error in errors[1:rivals]:
        least = lesser(least, error)
    zero, first, weight = np.zeros_like(least), layout.inside(parts[0]), window_weight(errors[0], least)
    own_alpha, darkest = first[5] if build.steps.alpha else np.ones_like(least), first[:3]
    sums, alphas, counts = np.zeros_like(darkest), zero, zero
    light, opacity, latest, latest_of_alpha = sums, zero, sums, zero  # their drift and that of the second
    followed = weight  # of the windows that follow it
    for window, (k, error) in enumerate(zip(sources[1:rivals], errors[1:rivals], strict=True), start=1):
        w, own = window_weight(error, least), layout.inside(parts[k])
        if window > UNMOVED:
            light, opacity = np.zeros_like(sums), zero
        elif k == window and (window == UNMOVED or has_more_frames(window, frames)):
            light, opacity = drift_to_shortest(parts[k], parts[0], run)
        if window == 1:
            latest, latest_of_alpha = light, opacity
        followed = followed + w if window <= UNMOVED else followed
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
    if reach > 0:
        may_go = follows * number(reach, zero)
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
