"""Equal-quality samples: how many samples a pixel a supersampler needs for the same mean squared error.

The law and its limits are derived in ``docs/metrics.md``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cltaa.errors import DataError

# An edge crosses about sqrt(n) of a pixel's n strata; only those err, each by variance ~ 1/n^2 (Mitchell 1996,
# "Consequences of Stratified Sampling in Graphics"): the mean squared error of edges falls as n^(-3/2).
STRATIFIED_EXPONENT = 1.5


def equal_quality_samples(mse: float, one_sample_mse: float, *, truth_samples: int | None = None) -> float:
    """Stratified samples a pixel that give ``mse``, from the error of one sample and MSE(n) = MSE(1) n^(-3/2).

    Both errors are means of ``cltaa.lab.judge.metrics.light_mse`` against one truth. Where that truth has
    ``truth_samples`` samples a pixel, its own share of both errors is taken off by the same law, and the result is at
    most ``truth_samples``: a truth cannot vouch for more. Infinite for no error against an exact truth. Raises
    DataError for errors that are none.
    """
    if not (one_sample_mse > 0 and mse >= 0 and math.isfinite(one_sample_mse) and math.isfinite(mse)):
        found = f"{mse:g} against {one_sample_mse:g} for one sample"
        raise DataError("no equal-quality samples for these errors", expected="positive numbers", found=found)
    truth_error = 0.0
    if truth_samples is not None:
        noise = truth_samples**-STRATIFIED_EXPONENT
        one_sample_mse /= 1 + noise
        truth_error = one_sample_mse * noise
    limit = math.inf if truth_samples is None else float(truth_samples)
    error = mse - truth_error
    if error <= 0:
        return limit
    return float(min(limit, (one_sample_mse / error) ** (1 / STRATIFIED_EXPONENT)))


def falls(curve: Sequence[tuple[int, float]]) -> bool:
    """Whether two or more errors are positive and fall with the samples, so that one can be read off them."""
    errors = [error for _, error in sorted(curve)]
    return len(errors) > 1 and min(errors) > 0 and all(later < earlier for earlier, later in pairwise(errors))


def samples_on_curve(mse: float, curve: Sequence[tuple[int, float]]) -> float:
    """Samples a pixel that give ``mse``, read off measured points (samples, error), straight between them in log-log.

    All errors are against one truth, so that its own share cancels. Beyond its ends the curve says nothing: the
    result is then the nearest end. Raises DataError unless the errors fall as ``falls`` asks.
    """
    ordered = sorted(curve)
    errors = np.array([error for _, error in ordered])
    if not falls(curve):
        raise DataError("no curve of error against samples", expected="two or more falling errors", found=ordered)
    if mse <= 0:
        return float(ordered[-1][0])
    samples = np.log([count for count, _ in ordered])
    return float(np.exp(np.interp(-math.log(mse), -np.log(errors), samples)))


def supersampling_curve(one_sample_mse: float, yardsticks: Mapping[int, Sequence[float]]) -> list[tuple[int, float]]:
    """Mean squared error against samples a pixel, from the errors of each frame of the yardsticks.

    It begins with the single samples; without an error is what was drawn as the truth itself was, which is left out.
    """
    means = [(count, sum(errors) / len(errors)) for count, errors in yardsticks.items() if any(errors)]
    return [(1, one_sample_mse), *means]


class EqualQuality(NamedTuple):
    """Equal-quality samples of a test, how they were found, and whether there may be more of them, or fewer."""

    samples: float
    method: str  # "measured", or "n^-1.5 law"
    bound: str | None  # "at least" and "at most" where the curve, or the truth, ends


def equal_quality(
    test_mse: float, one_sample_mse: float, yardsticks: Mapping[int, Sequence[float]], count: int | None
) -> EqualQuality:
    """Equal-quality samples of a test, read off its capture's yardsticks where their errors fall, else by the law.

    The errors are those of ``cltaa.lab.judge.metrics.light_mse``: means over the frames of the test, and of the
    ``yardsticks``, by samples a pixel, those of each frame. ``count`` is the samples of the truth, where known.
    """
    curve = supersampling_curve(one_sample_mse, yardsticks)
    if falls(curve):
        bound = "at most" if test_mse > one_sample_mse else "at least" if test_mse < curve[-1][1] else None
        return EqualQuality(samples_on_curve(test_mse, curve), "measured", bound)
    samples = equal_quality_samples(test_mse, one_sample_mse, truth_samples=count)
    return EqualQuality(samples, "n^-1.5 law", "at least" if samples == count else None)
