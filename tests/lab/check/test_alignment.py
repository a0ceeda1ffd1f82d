"""The shift between two pictures, where it is known: slopes without a curve are solved to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.lab.check.registration import (
    FARTHEST_PX,
    LEAST_POINTS,
    Fit,
    fit_shift,
    residual_of,
    with_gradient,
)

Y, X = np.mgrid[:24, :32].astype(np.float64)
# Points whose neighbours rise by 1 to the right, and such whose neighbours rise by 2 downwards.
ACROSS = (X >= 3) & (X < 13) & (Y >= 4) & (Y < 20)
DOWN = (X >= 19) & (X < 29) & (Y >= 4) & (Y < 20)
BEFORE = with_gradient(np.where(X < 16, X, 2 * Y).astype(np.float32))
# Sums of 320 terms, of up to 50 each: 320 * 50 * 2^-53.
ROUNDING = 2.0**-39


def fit(there: np.ndarray, shift: tuple[float, float]) -> Fit:
    x, y = X[there], Y[there]
    now = np.where(x < 16, x + shift[0], 2 * (y + shift[1]))
    return fit_shift(now, BEFORE, x, y, 1.0)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, -0.5), (-0.75, 1.25), (1.5, 0.375)])
def test_a_shift_is_found(shift: tuple[float, float]) -> None:
    found = fit(ACROSS | DOWN, shift)
    np.testing.assert_allclose(found.shift, shift, rtol=0, atol=ROUNDING)
    assert found.residual < ROUNDING
    assert (ACROSS | DOWN).sum() == 320
    # All points count in full, with the noise that is taken for the least: a thousandth of the scale.
    np.testing.assert_allclose(found.information, np.diag([160.0, 4 * 160.0]) / 1e-3**2, rtol=1e-9)


def test_a_shift_is_at_most_so_far() -> None:
    assert fit(ACROSS | DOWN, (2.75, -0.5)).shift.tolist() == pytest.approx([FARTHEST_PX, -0.5], abs=ROUNDING)


@pytest.mark.parametrize(
    "there", [ACROSS, DOWN, (ACROSS | DOWN) & (np.cumsum(ACROSS | DOWN).reshape(X.shape) < LEAST_POINTS)]
)
def test_slopes_of_one_direction_and_few_points_decide_nothing(there: np.ndarray) -> None:
    assert fit(there, (0.5, 0.5)).shift.tolist() == [0.0, 0.0]


def test_a_residual_counts_at_most_one_a_point() -> None:
    x, y = np.array([4.0, 5.0, 6.0, -3.0]), np.full(4, 8.0)
    now = np.array([4.0, 5.5, 16.0, 0.0])  # as before; a quarter of the scale off; far off; outside
    assert residual_of(now, BEFORE, x, y, 2.0) == (0.0 + 0.25 + 1.0 + 1.0) / 4
    assert residual_of(now[:0], BEFORE, x[:0], y[:0], 2.0) == 1.0
