"""Twin of ``gather/window.h`` and ``gather_windows.cl``: the adaptive temporal window.

Each pixel is resolved from several windows of its past, each with its error; ``mix_windows`` mixes them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, first_windows, unmoved_window, window_count, window_planes
from cltaa.core.constants import LONG_WINDOW, value
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
from cltaa.reference.colour import accumulates_alpha, from_range, inner, outside_domain_of, share_in_domain, to_range
from cltaa.reference.gather import Gathering
from cltaa.reference.gather_fit import SampleSums, own_samples, takes_alpha_of_others
from cltaa.reference.gather_track import ring_alpha, ring_reactive
from cltaa.reference.planes import extend_stored
from cltaa.reference.real import Array, Mask, Run, greater, number, quiet


def window_ends(frames: int, build: Build) -> list[int]:
    """Number of ring frames in each window: the latest, more, in a long ring with frames ahead more again, all."""
    ends = *first_windows(centred=build.steps.centred), *[LONG_WINDOW] * build.steps.long_ring, frames
    return [min(end, frames) for end in ends]


def recent_frames(build: Build) -> int:
    """Number of the nearest frames whose samples judge each window: those of the shortest."""
    return first_windows(centred=build.steps.centred)[0]


def has_more_frames(window: int, frames: int, build: Build) -> bool:
    """True if one of the windows of the ring has more of its ``frames`` than the one before it."""
    ends = window_ends(frames, build)
    return window == 0 or ends[window] > ends[window - 1]


def repeats_previous(window: int, frames: int, static_frames: int, build: Build) -> bool:
    """True if a window equals the one before it, and is not stored."""
    unmoved = unmoved_window(build.steps)
    if window >= (unmoved - 1 if build.choices.recursion is Recursion.STANDING else unmoved + 1):
        return False
    return static_frames < recent_frames(build) if window == unmoved else not has_more_frames(window, frames, build)


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
        if place < recent_frames(run.build):
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
    count, unmoved_at = window_count(build.choices, build.steps), unmoved_window(build.steps)
    held = recursive_result(recursive, recursive_count, layout, own.alpha)
    target = layout.inside(windows)[: count * planes].reshape(count, planes, layout.height, layout.width)
    for window, end in enumerate(window_ends(frames, build)):
        gathering.add(past[begun:end], run, before=begun, recent=recent_frames(build) - begun)
        out = gathering.resolved(run)
        if build.choices.recursion is Recursion.STANDING and window == unmoved_at - 1:
            out = longer_history(out, own.most_reactive <= 0, held)
        error = window_error(gathering.near, own, out, run)
        if not repeats_previous(window, frames, static_frames, build):
            _store(target[window], out, error)
        begun = end
    if build.steps.reactive:
        unlike = gathering.near.unlike > gathering.near.recent_count
        for window in range(unmoved_at - 1):
            _store(target[window], out, error, unlike)
    at_rest = (gathering.motion.u == 0) & (gathering.motion.v == 0)
    if not repeats_previous(unmoved_at, frames, static_frames, build):
        unmoved, sums = resolve_unmoved(gathering.slots, past[:static_frames], own, run)
        if build.choices.recursion is Recursion.STANDING:
            unmoved = longer_history(unmoved, at_rest, held)
        valid = sums.recent_count >= recent_frames(build)
        out = _chosen(valid, unmoved, out)
        error = np.where(valid, window_error(sums, own, unmoved, run), error)
        _store(target[unmoved_at], out, error)
    if build.choices.recursion is Recursion.STANDING:
        refuted = history_is_refuted(at_rest, own, held.count, frames_before(past[:static_frames], build), run)
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
    """Number of earlier frames among ``past``."""
    return int(np.count_nonzero(past["ahead"] <= 0)) if build.steps.look_ahead else len(past)


def history_is_refuted(at_rest: Mask, p: Pixel, recursive_count: Array, before: int, run: Run) -> Mask:
    """True where the camera was at rest for ``before`` frames and the surface is now, but the recursive resolve has too
    few samples."""
    wanted = run.settings["refuted_samples"]
    refuted: Mask = at_rest & (recursive_count < wanted) & (p.most_reactive <= 0.0) & (before >= wanted)
    return refuted if p.missing is None else refuted & ~p.missing


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
