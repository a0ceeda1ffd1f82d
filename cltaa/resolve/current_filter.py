"""The current filter: a separable kernel over the jittered samples around a pixel, evaluated at the pixel's centre."""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from cltaa.parameters.choices import Choices, CurrentFilter, Settings


class AxisWeights(NamedTuple):
    """Weights along an axis: of the outer two of three samples, which sum to 1, or in the two texels of a pixel."""

    before: float
    after: float


def axis_weights(jitter: float, choices: Choices, settings: Settings) -> AxisWeights:
    """Weights along one axis for samples that lie ``jitter`` pixels after their pixels' centres."""
    if choices.current_filter is CurrentFilter.NONE:
        return AxisWeights(0.0, 0.0)
    before, middle, after = (_value(abs(step + jitter), choices.current_filter, settings) for step in (-1, 0, 1))
    total = before + middle + after
    return AxisWeights(before / total, after / total)


def axis_masses(jitter: float, settings: Settings) -> AxisWeights:
    """What a sample ``jitter`` pixels after its pixel's centre counts for in two texels along an axis.

    exp(-texel_falloff d^2) at the distance d from a texel's centre, a quarter of a pixel before the pixel's or after.
    """
    return AxisWeights(*(exp(-settings.texel_falloff * (jitter - place) ** 2) for place in (-0.25, 0.25)))


def _value(d: float, kind: CurrentFilter, settings: Settings) -> float:
    """The kernel at distance ``d`` in pixels."""
    if kind is CurrentFilter.BILINEAR:
        return max(0.0, 1.0 - d)
    if kind is CurrentFilter.GAUSSIAN:
        return exp(-settings.filter_falloff * d * d)
    # Lanczos-2 as a polynomial: (d^2 - 1) (d^2 - 4)^3 / 64, within 0.05 of the windowed sinc.
    return (d * d - 1.0) * (d * d - 4.0) ** 3 / 64.0 if d < 2.0 else 0.0
