"""Twin of ``blend.h``: how much the current sample counts against the history, and what may be stored."""

from __future__ import annotations

import numpy as np

from cltaa.parameters.build import Build, Record
from cltaa.parameters.choices import Accumulate, Negatives, Weighting
from cltaa.reference.colour import Colour, luminance
from cltaa.reference.real import Array, constant, greater, lesser, number, outside_domain
from cltaa.reference.sampling import between_texels


def sample_weight(count: Array, unrest: Array, build: Build, settings: Record) -> Array:
    """Weight of the current sample beside ``count`` earlier ones."""
    least = number(settings["blend_weight"], count)
    if build.choices.accumulate is Accumulate.CONSTANT:
        return np.full_like(count, least)
    if build.choices.accumulate is Accumulate.ADAPTIVE:
        adaptive: Array = least + unrest * (number(settings["moving_weight"], count) - least)
        return adaptive
    mean: Array = number(1.0, count) / (count + number(1.0, count))
    if build.choices.accumulate is Accumulate.COUNT:
        return mean
    return greater(mean, least)


def samples_in_mean(count: Array, build: Build, settings: Record) -> Array:
    """What ``count`` samples count as in the mean that is taken: with the new one 1 / blend_weight at most."""
    if build.choices.accumulate is Accumulate.COUNT:
        return count
    one = number(1.0, count)
    return lesser(count, one / number(settings["blend_weight"], count) - one)


def most_samples(fx: Array, fy: Array, build: Build, settings: Record) -> Array:
    """The most samples that a history resampled at fraction ``fx``, ``fy`` may stand for."""
    one = number(1.0, fx)
    least = one / number(settings["sample_limit"], fx)
    if build.terms.resample_cost:
        least = least + number(settings["resample_cost"], fx) * between_texels(fx, fy)
    most: Array = one / least
    return most


def believed_count(count: Array, most: Array, pull: Array, build: Build, settings: Record) -> Array:
    """Samples that the history still stands for after resampling, ``most`` at most, and rectification."""
    if build.terms.pull_cost:
        count = count / (number(1.0, count) + number(settings["pull_cost"], count) * pull)
    return lesser(count, most)


def luminance_inertia(v: Colour, settings: Record) -> Array:
    """knee + Y, the inverse of a luminance weight (Karis 2014 with knee 1); the kernels have four times it."""
    inertia: Array = number(settings["luminance_knee"], v[0]) + greater(luminance(v), number(0.0, v[0]))
    return inertia


def luminance_weight(weight: Array, current: Colour, history: Colour, build: Build, settings: Record) -> Array:
    """Weights 1 / (knee + Y) as one weight of the current sample."""
    if build.choices.weighting is Weighting.NONE:
        return weight
    x, h = luminance_inertia(current, settings), luminance_inertia(history, settings)
    for_current, for_history = weight * h, (number(1.0, weight) - weight) * x
    result: Array = for_current / (for_current + for_history)
    return result


def weight_of_sample(
    count: Array,
    current: Colour,
    history: Colour,
    reactivity: Array,
    unrest: Array,
    build: Build,
    settings: Record,
) -> Array:
    """Weight of the current sample beside a history of ``count``, before what stills flicker: in a mean of all with
    luminance weights h / (h + count x), where a reactive sample counts for as many more as are then missing."""
    one = number(1.0, count)
    in_mean = build.choices.accumulate in (Accumulate.COUNT, Accumulate.EXPONENTIAL)
    if in_mean and build.choices.weighting is not Weighting.NONE:
        now, inertia = luminance_inertia(history, settings), luminance_inertia(current, settings)
        samples = samples_in_mean(count, build, settings)
        if build.steps.reactive:
            now, samples = (one + reactivity * samples) * now, samples * (one - reactivity)
        share: Array = now / (now + samples * inertia)
        return share
    weight = sample_weight(count, unrest, build, settings)
    if build.steps.reactive:
        weight = weight + reactivity * (one - weight)
    return luminance_weight(weight, current, history, build, settings)


def sample_share(v: Colour, build: Build, settings: Record) -> Array:
    """Luminance weight 1 / (knee + Y) of a sample."""
    one = number(1.0, v[0])
    if build.choices.weighting is Weighting.NONE:
        return np.full_like(v[0], one)
    share: Array = one / luminance_inertia(v, settings)
    return share


def share_difference(v: Colour, other: Colour, build: Build, settings: Record) -> list[Array]:
    """How far two colours differ, each as much as it counts: dim light as it is, highlights no more than
    ``luminance_knee``."""
    knee = number(1.0 if build.choices.weighting is Weighting.NONE else settings["luminance_knee"], v[0])
    a, b = (knee * sample_share(c, build, settings) for c in (v, other))
    return [a * x - b * y for x, y in zip(v, other, strict=True)]


def filtered_share(share: Array, filtered: Colour, build: Build, settings: Record) -> Array:
    """Share of the filtered sample where ``filter_use`` says few-samples; bright ones weigh less, twice."""
    if build.choices.weighting is Weighting.NONE:
        return share
    knee = number(settings["luminance_knee"], share)
    dim = knee / (knee + greater(luminance(filtered), number(0.0, share)))
    result: Array = share * (dim * dim)
    return result


def difference_share(current: Colour, history: Colour, settings: Record) -> Array:
    """Factor of the weight by how much the luminances differ (Lottes)."""
    x, h = luminance(current), luminance(history)
    size = greater(greater(x, h), number(settings["difference_knee"], x))
    u = number(1.0, x) - np.abs(x - h) / size
    differing, agreeing = number(settings["differing_share"], x), number(settings["agreeing_share"], x)
    share: Array = differing + (u * u) * (agreeing - differing)
    return share


def blend(history: Array, current: Array, weight: Array) -> Array:
    """h + w (x - h); a weight of 1 selects the sample."""
    return np.where(weight < number(1.0, weight), history + weight * (current - history), current)


def storable(v: Array, current: Array, build: Build) -> Array:
    """Inside the domain, no denormal, no -0, not below the least of 0 and the current sample."""
    floor_value = lesser(current, number(0.0, current))
    raised = greater(v, floor_value) if build.choices.negatives is Negatives.RAISE else v
    bad = outside_domain(raised) | (np.abs(raised) < constant("TINY", v))
    return np.where(bad, number(0.0, v), raised)


def storable_colour(v: Colour, current: Colour, build: Build) -> Colour:
    """Each channel as ``storable`` leaves it."""
    r, g, b = (storable(x, own, build) for x, own in zip(v, current, strict=True))
    return r, g, b
