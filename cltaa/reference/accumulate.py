"""Twin of ``taa/accumulate.h``: blends each pixel's sample with its history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import value
from cltaa.core.parameters import (
    Accumulate,
    AlphaFrom,
    AntiFlicker,
    FilterUse,
    Illumination,
    Negatives,
    Rectify,
    Weighting,
)
from cltaa.reference.colour import (
    Colour,
    filled_texels,
    from_box_space,
    from_range,
    luminance,
    sample_is_missing,
    share_in_domain,
    to_blend_range,
    to_box_space,
)
from cltaa.reference.history import History
from cltaa.reference.neighbourhood import Row, Statistics, current_sample, neighbourhood_statistics
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
    outside_domain,
)
from cltaa.reference.rectify import Rectification
from cltaa.reference.sampling import count_limit_of


def next_count(count: Array, blend_boost: Array, build: Build) -> Array:
    """Sample count after one more sample; with ``standing`` 1 where a pixel moves, and ten more where it does not."""
    if build.choices.accumulate is Accumulate.STANDING:
        return np.where(blend_boost > 0.0, 1.0, count + value("STANDING_GAIN"))
    return count + 1.0


def capped_weight(count: Array, blend_boost: Array, settings: Record) -> Array:
    """Weight of the sample against a history of weight ``count / sample_limit``, at most 1, and in motion at most what
    gives the sample ``moving_weight``."""
    one, least, most = (number(v, count) for v in (1.0, settings["blend_weight"], settings["moving_weight"]))
    odds = least / (one - least)
    cap = odds * (one - most) / most
    held = lesser(count / settings["sample_limit"], one)
    history = lesser(held, held + blend_boost * (cap - held))
    return odds / (odds + history)


def sample_weight(count: Array, blend_boost: Array, run: Run) -> Array:
    """Weight of the current sample against ``count`` earlier ones."""
    least = number(run.settings["blend_weight"], count)
    if run.choices.accumulate is Accumulate.CONSTANT:
        return np.full_like(count, least)
    if run.choices.accumulate is Accumulate.ADAPTIVE:
        return least + blend_boost * (number(run.settings["moving_weight"], count) - least)
    if run.choices.accumulate is Accumulate.CAPPED:
        return capped_weight(count, blend_boost, run.settings)
    if run.choices.accumulate is Accumulate.STANDING:
        after = next_count(count, blend_boost, run.build)
        return limit(1.0 / after, least, run.settings["moving_weight"])
    mean: Array = 1.0 / (count + 1.0)
    if run.choices.accumulate is Accumulate.COUNT:
        return mean
    return greater(mean, least)


def samples_in_mean(count: Array, run: Run) -> Array:
    """Samples that the mean counts in a history of ``count``: with the new one 1 / blend_weight at most."""
    if run.choices.accumulate is Accumulate.COUNT:
        return count
    one = number(1.0, count)
    return lesser(count, one / number(run.settings["blend_weight"], count) - one)


def inverse_luminance_weight(v: Colour, settings: Record) -> Array:
    """knee + Y, the inverse of a luminance weight (Karis 2014 with knee 1); the kernels have four times it."""
    return settings["luminance_knee"] + greater(luminance(v), 0.0)


def fold_luminance_weights(weight: Array, current: Colour, history: Colour, run: Run) -> Array:
    """Fold the luminance weights 1 / (knee + Y) of both into one weight of the current sample."""
    if run.choices.weighting is Weighting.NONE:
        return weight
    x, h = inverse_luminance_weight(current, run.settings), inverse_luminance_weight(history, run.settings)
    for_current, for_history = weight * h, (1.0 - weight) * x
    return for_current / (for_current + for_history)


def weight_of_sample(
    count: Array, current: Colour, history: Colour, reactivity: Array, blend_boost: Array, run: Run
) -> Array:
    """Weight of the current sample against a history of ``count``, before anti-flicker: in a running mean with
    luminance weights h / (h + count x), where a reactive sample gains as many samples as the history loses."""
    in_mean = run.choices.accumulate in (Accumulate.COUNT, Accumulate.EXPONENTIAL)
    if in_mean and run.choices.weighting is not Weighting.NONE:
        now, x = inverse_luminance_weight(history, run.settings), inverse_luminance_weight(current, run.settings)
        samples = samples_in_mean(count, run)
        if run.steps.reactive:
            now, samples = (1.0 + reactivity * samples) * now, samples * (1.0 - reactivity)
        return now / (now + samples * x)
    weight = sample_weight(count, blend_boost, run)
    if run.steps.reactive:
        weight = weight + reactivity * (1.0 - weight)
    return fold_luminance_weights(weight, current, history, run)


def luminance_weight(v: Colour, run: Run) -> Array:
    """Luminance weight 1 / (knee + Y) of a sample."""
    if run.choices.weighting is Weighting.NONE:
        return np.full_like(v[0], 1.0)
    return 1.0 / inverse_luminance_weight(v, run.settings)


def weighted_difference(v: Colour, other: Colour, run: Run) -> Colour:
    """Difference of two colours, each scaled by knee / (knee + Y): no highlight's luminance exceeds the knee."""
    knee = 1.0 if run.choices.weighting is Weighting.NONE else run.settings["luminance_knee"]
    a, b = (knee * luminance_weight(c, run) for c in (v, other))
    return a * v - b * other


def filtered_share(share: Array, filtered: Colour, run: Run) -> Array:
    """Share of the filtered sample (``filter_use`` = few-samples); bright ones are weighted down twice."""
    if run.choices.weighting is Weighting.NONE:
        return share
    knee = run.settings["luminance_knee"]
    dim = knee / (knee + greater(luminance(filtered), 0.0))
    return share * (dim * dim)


def difference_factor(current: Colour, history: Colour, settings: Record) -> Array:
    """Factor of the weight by the difference of the luminances (Lottes)."""
    x, h = luminance(current), luminance(history)
    size = greater(greater(x, h), settings["difference_knee"])
    u = greater(1.0 - np.abs(x - h) / size, 0.0)
    differing, agreeing = number(settings["differing_share"], x), number(settings["agreeing_share"], x)
    return differing + (u * u) * (agreeing - differing)


def blend(history: Array, current: Array, weight: Array) -> Array:
    """h + w (x - h); a weight of 1 selects the sample."""
    return np.where(weight < 1.0, history + weight * (current - history), current)


def storable(v: Colour, current: Colour, build: Build) -> Colour:
    """Make values storable: inside the domain, no denormal, no -0, not below the lesser of 0 and the current sample."""
    floor_value = lesser(current, 0.0)
    raised = greater(v, floor_value) if build.choices.negatives is Negatives.RAISE else v
    bad = outside_domain(raised) | (np.abs(raised) < value("TINY"))
    return np.where(bad, 0.0, raised)


class Pixel(NamedTuple):
    """Current frame at each pixel: its sample ``own``, and ``filtered``, the current filter's, which also replaces
    ``own`` unless ``filter_use`` is few-samples."""

    own: Colour
    filtered: Colour
    alpha: Array
    reactivity: Array
    stats: Statistics  # of the 3x3
    least_reactive: Array  # of the 3x3, where temporal windows are weighted
    most_reactive: Array
    missing: Mask | None = None  # its own sample is missing; set where frames are gathered
    filled: tuple[Colour, Array] | None = None  # the fill that replaces it and its alpha without any other sample


@dataclass(frozen=True, slots=True)
class Resolved:
    """Result of one frame at each pixel."""

    rgb: Colour
    alpha: Array
    count: Array
    change: Array | None = None  # illumination change, where the build tests light


def load_shares(alpha: Array | None, reactive: Array | None, like: Array, run: Run) -> tuple[Array, Array]:
    """Alpha and reactivity of each pixel from padded planes [1, rows, stride], the former of ``whole_samples``; 1 and
    0 where a build has none."""
    one, zero = np.ones_like(like), np.zeros_like(like)
    steps = run.steps
    return (
        run.layout.inside(alpha)[0].astype(like.dtype) if steps.alpha and alpha is not None else one,
        share_in_domain(run.layout.inside(reactive)[0].astype(like.dtype), 0.0)
        if steps.reactive and reactive is not None
        else zero,
    )


def current_pixel(rows: tuple[Row, Row, Row], alpha: Array | None, reactive: Array | None, run: Run) -> Pixel:
    """Each pixel from the rows above, at and below it, and from padded planes [1, rows, stride] of shares."""
    stats = neighbourhood_statistics(*rows, run)
    filtered = current_sample(*rows, stats, run)
    own = rows[1].centre if run.choices.filter_use is FilterUse.FEW else filtered
    shares = load_shares(alpha, reactive, own[0], run)
    least = most = shares[1]
    if run.steps.reactive and reactive is not None and run.choices.illumination is Illumination.WINDOW:
        for step in NEIGHBOURS:
            r = share_in_domain(neighbour(reactive[0], *step, run.layout).astype(least.dtype), 0.0)
            least, most = lesser(least, r), greater(most, r)
    return Pixel(own, filtered, *shares, stats, least, most)


def reactivity_weight(r: Array, now: Pixel) -> Array:
    """Weights of samples [H, W] that were rendered with reactivity ``r``."""
    off = greater(greater(now.least_reactive - r, r - now.most_reactive), 0.0)
    far = off * value("REACTIVE_FALL")
    return greater(1.0 - far * far, 0.0)


def rectified_alpha(alpha: Array | None, past: Array, run: Run) -> Array:
    """The history's alpha, clamped to the extremes of the current 3x3 where colour is rectified."""
    if alpha is None or run.choices.rectify is Rectify.NONE:
        return past
    share = alpha[0].astype(past.dtype)
    low, high = np.ones_like(past), np.zeros_like(past)
    for step in NEIGHBOURS:
        a = neighbour(share, *step, run.layout)
        low, high = lesser(a, low), greater(a, high)
    return limit(past, low, high)


def disoccluded_colour(current: Colour, mean: Colour, run: Run) -> Colour:
    """Sample of a pixel without history, moved towards its neighbourhood's mean."""
    change = from_box_space(mean - to_box_space(current, run.build), run.build)
    return current + run.settings["disocclusion_blur"] * change


def lerp_colour(own: Colour, filtered: Colour, share: Array) -> Colour:
    """Move ``own`` towards ``filtered`` by a share."""
    return own + share * (filtered - own)


def effective_count(p: Pixel, h: History, run: Run) -> Array:
    """Effective sample count of the history, after resampling and reactivity."""
    count = lesser(h.count, count_limit_of(h.fx, h.fy, run))
    return count * (1.0 - p.reactivity) if run.steps.reactive else count


def fading_share(of_mean: Array, settings: Record) -> Array:
    """Share of the filtered sample in the n-th of a history: 1 / n, ``of_mean``, but as 1 / n^2 from some n on."""
    return lesser(of_mean, settings["filter_samples"] * (of_mean * of_mean))


def rectified(h: History, r: Rectification, run: Run) -> Colour:
    """The history of a pixel after rectification."""
    change = r.change
    if run.build.terms.box_leak:
        kept = number(1.0, change) - number(run.settings["box_leak"], change)
        change = np.where(h.count >= run.settings["sample_limit"], kept * change, change)
    return h.rgb + change


def resolve_pixel(p: Pixel, h: History, r: Rectification, run: Run) -> Resolved:
    """Blend the pixel with its rectified history; without history the result begins anew."""
    count, current = effective_count(p, h, run), p.filtered
    past = rectified(h, r, run)
    if run.choices.filter_use is FilterUse.FEW:
        share = np.where(h.valid, fading_share(1.0 / (count + 1.0), run.settings), 1.0)
        current = lerp_colour(p.own, current, filtered_share(share, current, run))
    weight = weight_of_sample(count, current, past, p.reactivity, r.blend_boost, run)
    if run.choices.anti_flicker is AntiFlicker.DIFFERENCE:
        weight = weight * difference_factor(current, past, run.settings)
    if run.choices.anti_flicker is AntiFlicker.CLAMP_DISTANCE:
        weight = weight * r.anti_flicker_factor
    if run.choices.accumulate in (Accumulate.CONSTANT, Accumulate.ADAPTIVE):
        weight = np.where(count > 0.0, weight, 1.0)
    fresh = to_blend_range(disoccluded_colour(current, p.stats.mean, run), run.build)
    mixed = blend(to_blend_range(past, run.build), to_blend_range(current, run.build), weight)
    stored = storable(from_range(np.where(h.valid, mixed, fresh), run.build), current, run.build)
    alpha = p.alpha
    if run.choices.alpha_from is AlphaFrom.BLEND:
        alpha = np.where(h.valid, blend(h.alpha if r.alpha is None else r.alpha, alpha, weight), alpha)
    first = h.count if run.build.terms.first_samples else 1.0
    samples = np.where(h.valid, next_count(count, r.blend_boost, run.build), first)
    return Resolved(stored, alpha, samples, np.where(h.valid, h.change, 0.0))


def without_missing(out: Resolved, h: History, current: Array, alpha: Array | None, run: Run) -> Resolved:
    """Result where samples are missing: the history unchanged if its count is at least 1, else a fill."""
    zero = np.zeros_like(h.count)
    missing, kept = sample_is_missing(current, run.layout), h.valid & (h.count >= 1.0)
    filled, opacity = filled_texels(current, alpha, run.build, run.layout)
    past = storable(from_range(h.rgb, run.build), zero, run.build)
    rgb = np.where(missing, np.where(kept, past, storable(from_range(filled, run.build), filled, run.build)), out.rgb)
    opacity = np.where(missing, np.where(kept, h.alpha, opacity), out.alpha)
    count = np.where(kept, lesser(h.count, count_limit_of(h.fx, h.fy, run)), zero)
    change = np.where(missing, np.where(kept, h.change, zero), zero if out.change is None else out.change)
    return Resolved(rgb, opacity, np.where(missing, count, out.count), change)
