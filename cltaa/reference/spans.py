"""Twin of ``spans.h`` and ``gather_spans.cl``: each pixel from several spans of its past, and how far each is off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, span_planes
from cltaa.core.constants import MIDDLE_SPAN, SHORT_SPAN, SPANS, value
from cltaa.core.parameters import AlphaFrom
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import (
    Pixel,
    Resolved,
    as_reactive,
    sample_share,
    share_difference,
    storable_colour,
    usable_share,
)
from cltaa.reference.colour import Colour, colour_outside_domain, from_range, to_range
from cltaa.reference.gather_fit import Gathered
from cltaa.reference.gather_track import KEPT_CLOSENESS, kept_alpha, kept_reactive, seen_then
from cltaa.reference.gathering import Gathering
from cltaa.reference.neighbourhood import Surface, usable_closeness
from cltaa.reference.planes import extend_stored
from cltaa.reference.real import Array, constant, greater, number, quiet
from cltaa.reference.reprojection import Motion


def span_ends(frames: int) -> list[int]:
    """How many of the kept frames each span has: the latest, a few more, all."""
    return [min(SHORT_SPAN, frames), min(MIDDLE_SPAN, frames), frames]


def span_error(g: Gathered, now: Colour, span: Resolved, build: Build, settings: Record) -> Array:
    """Squared distances of the latest samples, the current one among them, from what a span says."""
    one, two = number(1.0, g.zero), number(2.0, g.zero)
    d = share_difference(to_range(span.rgb, build), now, build, settings)
    along = (d[0] * g.recent[0] + d[1] * g.recent[1]) + d[2] * g.recent[2]
    size = (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    squares = (g.recent_squares - two * along) + (one + g.recent_count) * size
    left = one - one / greater(span.count, number(1.5, g.zero))
    error: Array = greater(squares, number(0.0, g.zero)) / (left * left)
    return error


def drawn_here(planes: Array, then: Record, p: Pixel, build: Build) -> tuple[Colour, Array]:
    """What kept planes [KEPT_PLANES, H, W] drew at each pixel's own place, and where that is a colour."""
    c: Any = tuple(planes[:3])
    good = ~colour_outside_domain(c)
    if build.steps.exposure:
        ratio = number(then["exposure_ratio"], p.own[0])
        c = (c[0] * ratio, c[1] * ratio, c[2] * ratio)
    r, g, b = (np.where(good, k, own) for k, own in zip(to_range(c, build), p.own, strict=True))
    return (r, g, b), good


def alike_here(planes: Array, p: Pixel, build: Build) -> Array:
    """How much counts of what kept planes [KEPT_PLANES, H, W] drew there, by its reactivity."""
    if not build.steps.reactive:
        return np.ones_like(p.reactivity)
    r = planes[kept_reactive(build.steps)].astype(p.reactivity.dtype)
    return as_reactive(usable_share(r, 0.0), p)


def stood_here(slots: Array, past: Any, s: Surface, build: Build, layout: Layout, settings: Record) -> Array:
    """Whether something as close as each pixel's surface stood at its own place before the latest frames, [H, W]."""
    zero, one = np.zeros_like(s.closeness), np.ones_like(s.closeness)
    if len(past) < SHORT_SPAN:
        return np.zeros(zero.shape, bool)
    then, still = past[SHORT_SPAN - 1], Motion(zero, zero, one, zero, zero == zero)
    drawn = layout.inside(slots[int(then["slot"])])[KEPT_CLOSENESS].astype(zero.dtype)
    return seen_then(usable_closeness(drawn, then), s, still, build, settings)


@dataclass(slots=True)
class Repeats:
    """Squared differences [H, W] of samples at each pixel's own place from those of frames whose samples lay nearly
    there: of the latest frames together, and of all of them, in how many pairs."""

    latest: Array
    everything: Array
    pairs: Array
    told: Array  # each of the latest frames has such a frame

    @classmethod
    def none(cls, zero: Array) -> Repeats:
        """Those of no frame."""
        return cls(zero, zero, zero, np.ones(zero.shape, bool))

    def add(self, sample: Colour, again: Colour, good: Array, build: Build, settings: Record, *, latest: bool) -> None:
        """One frame's sample and the one that repeats it; ``good`` where both are colours."""
        zero = np.zeros_like(self.pairs)
        d = share_difference(again, sample, build, settings)
        squares = np.where(good, (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2], zero)
        if latest:
            self.latest, self.told = self.latest + squares, self.told & good
        self.everything, self.pairs = self.everything + squares, self.pairs + np.where(good, np.ones_like(zero), zero)

    def error(self, lately: Array, moves: Array, otherwise: Array) -> Array:
        """What they say of the span without motion, ``otherwise`` where there are none or the latest frames did not see
        the surface (not ``lately``): of what moves along itself the latest samples alone, of what stands the variance
        of all of them too."""
        one = np.ones_like(otherwise)
        everything = number(0.5 * (SHORT_SPAN + 1), one) * (self.everything / greater(self.pairs, one))
        error = np.where(moves, self.latest, greater(self.latest, everything))
        result: Array = np.where(lately & self.told & (self.pairs > np.zeros_like(one)), error, otherwise)
        return result


def resolve_unmoved(
    slots: Array, past: Any, p: Pixel, build: Build, layout: Layout, settings: Record
) -> tuple[Resolved, Gathered, Repeats]:
    """The plain mean of what was drawn at each pixel's own place, the sums of its samples, and how they repeat."""

    def drawn(then: Record) -> tuple[Colour, Array]:
        return drawn_here(layout.inside(slots[int(then["slot"])]).astype(zero.dtype), then, p, build)

    zero, one = np.zeros_like(p.own[0]), np.ones_like(p.own[0])
    total, weight, count, alphas = [zero, zero, zero], zero, zero, zero
    sums, repeats, after, after_good = Gathered(zero), Repeats.none(zero), p.own, np.ones(zero.shape, bool)
    standing = settings.copy()
    standing["luminance_knee"] *= np.float32(value("STANDING_KNEE"))
    for place, then in enumerate(past):
        c, good = drawn(then)
        planes = layout.inside(slots[int(then["slot"])])
        counted = np.where(good, alike_here(planes, p, build), zero)
        w = counted * sample_share(c, build, standing)
        d = [k - own for k, own in zip(c, p.own, strict=True)]
        if place < SHORT_SPAN:
            sums.add_recent(share_difference(c, p.own, build, settings), counted)
        total = [t + w * k for t, k in zip(total, d, strict=True)]
        weight, count = weight + w, count + counted
        if then["again"] >= 0:
            again, good_again = drawn(past[int(then["again"])])
            repeats.add(after, again, good_again & after_good, build, settings, latest=place <= SHORT_SPAN)
        after, after_good = c, good
        if build.steps.alpha:
            a = usable_share(planes[kept_alpha(build.steps)].astype(zero.dtype), 1.0)
            alphas = alphas + counted * (a - p.alpha)
    whole = sample_share(p.own, build, standing) + weight
    r, g, b = (own + t / whole for own, t in zip(p.own, total, strict=True))
    alpha, counted = p.alpha, count + one
    if build.choices.alpha_from is AlphaFrom.BLEND:
        alpha = alpha + alphas / counted
    return Resolved(storable_colour(from_range((r, g, b), build), p.own, build), alpha, counted), sums, repeats


@quiet
def gather_spans(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    closeness: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    kept: Array,
    past: Any,
    frames: int,
    standing: int,
    spans: Array,
    repeats: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from each span of ``frames`` kept ones into ``spans`` [SPANS * SPAN_PLANES, rows, stride]; the
    latest ``standing`` of them were seen by the camera of now. What repeated samples say of the span without
    motion goes into ``repeats`` [1, rows, stride]."""
    gathering = Gathering.begin(build, layout, locals())
    target, own = layout.inside(spans)[: SPANS * span_planes(build.steps)], gathering.pixel.own
    planes, begun, moves = span_planes(build.steps), 0, gathering.moves
    for span, end in enumerate(span_ends(frames)):
        gathering.add(past[begun:end], build, layout, frame, settings, before=begun, recent=SHORT_SPAN - begun)
        said = gathering.resolved(build, layout, settings)
        error = span_error(gathering.near, own, said, build, settings)
        _store(target[span * planes : (span + 1) * planes], said, error)
        begun = end
    if build.steps.reactive:
        unlike = gathering.near.unlike > gathering.near.recent_count
        for span in range(SPANS - 2):
            _store(target[span * planes : (span + 1) * planes], said, error, unlike)
        # The count of the shortest: all of the latest samples that showed the surface.
        target[4][...] = target[4] + gathering.near.unlike
    lately = gathering.layers.edge | (gathering.near.recent_count > constant("SEEN_LATELY", error))
    lately = lately | stood_here(gathering.slots, past[:standing], gathering.sides[0][0], build, layout, settings)
    unmoved, sums, repeating = resolve_unmoved(
        gathering.slots, past[:standing], gathering.pixel, build, layout, settings
    )
    told = lately & (sums.recent_count >= number(SHORT_SPAN, error))
    r, g, b = (np.where(told, k, v) for k, v in zip(unmoved.rgb, said.rgb, strict=True))
    alphas, counts = np.where(told, unmoved.alpha, said.alpha), np.where(told, unmoved.count, said.count)
    error = np.where(told, span_error(sums, own, unmoved, build, settings), error)
    _store(target[-planes:], Resolved((r, g, b), alphas, counts), error)
    layout.inside(repeats)[0] = repeating.error(lately, moves, error)
    extend_stored(build, layout, spans[: SPANS * planes], repeats)


def _store(planes: Array, said: Resolved, error: Array, where: Array | None = None) -> None:
    """Write what a span says, everywhere or ``where`` it is asked for, and alpha where there is a plane for it."""
    for plane, values in zip(planes, [*said.rgb, error, said.count, said.alpha], strict=False):
        plane[...] = values if where is None else np.where(where, values, plane)
