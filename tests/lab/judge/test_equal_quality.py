"""The law of stratified samples, shown on synthetic edges, and the numbers read off it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.lab.judge.metrics import STRATIFIED_EXPONENT, equal_quality_samples, falls, samples_on_curve

PIXELS, FRAMES, TRUTH_SIDE = 400, 30, 200


def edges(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Normals and offsets of one straight edge a pixel, any direction, some just outside the pixel."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0, 2 * np.pi, PIXELS)
    return np.cos(angle), np.sin(angle), random.uniform(-0.7, 0.7, PIXELS)


def coverage(side: int, seed: int, random: np.random.Generator | None) -> NDArray[np.float64]:
    """Share of side x side samples behind each pixel's edge; jittered in their strata, or at their centres."""
    normal_x, normal_y, offset = edges(seed)
    row, column = np.mgrid[:side, :side].reshape(2, -1)
    jitter = np.full((2, side * side), 0.5) if random is None else random.random((2, side * side))
    x, y = (column + jitter[0]) / side - 0.5, (row + jitter[1]) / side - 0.5
    behind: NDArray[np.bool_] = normal_x[:, None] * x + normal_y[:, None] * y < offset[:, None]
    return np.asarray(behind.mean(axis=1))


def measured_mse(side: int, truth: NDArray[np.float64], seed: int = 0) -> float:
    random = np.random.default_rng((seed, side))
    return float(np.mean([np.mean((coverage(side, seed, random) - truth) ** 2) for _ in range(FRAMES)]))


@pytest.fixture(scope="module")
def exact() -> NDArray[np.float64]:
    return coverage(TRUTH_SIDE, 0, None)


@pytest.mark.parametrize("side", [2, 3, 4, 6, 8])
def test_edges_follow_the_law(side: int, exact: NDArray[np.float64]) -> None:
    """400 random edges, 30 draws: the number of samples is found again within 10 % (worst observed 6.0 %, for 4)."""
    found = equal_quality_samples(measured_mse(side, exact), measured_mse(1, exact))
    assert found == pytest.approx(side**2, rel=0.10)


def test_noise_of_the_truth_is_taken_off() -> None:
    """Against a truth of 64 samples, 36 are found again (observed 33.0); uncorrected they look like 26.8."""
    draws = [coverage(8, 0, np.random.default_rng((9, frame))) for frame in range(FRAMES)]
    random = np.random.default_rng(3)
    errors = {
        side: float(np.mean([np.mean((coverage(side, 0, random) - truth) ** 2) for truth in draws])) for side in (1, 6)
    }
    assert equal_quality_samples(errors[6], errors[1], truth_samples=64) == pytest.approx(36, rel=0.15)
    assert equal_quality_samples(errors[6], errors[1]) < 36 * 0.85


def test_the_formula_itself() -> None:
    for samples in (0.5, 1.0, 7.3, 1000.0):
        assert equal_quality_samples(0.2 * samples**-STRATIFIED_EXPONENT, 0.2) == pytest.approx(samples, rel=1e-12)
    assert equal_quality_samples(0.0, 0.2) == math.inf


def test_equal_quality_samples_are_at_most_those_of_the_truth() -> None:
    noise = 64.0**-1.5
    for error in (0.0, 0.2 * noise / (1 + noise), 0.2 * noise * 1.001):
        assert equal_quality_samples(error, 0.2, truth_samples=64) == 64


@pytest.mark.parametrize(("error", "one"), [(0.1, 0.0), (-0.1, 0.2), (math.nan, 0.2), (0.1, math.inf)])
def test_errors_that_are_not_positive_are_refused(error: float, one: float) -> None:
    with pytest.raises(
        DataError, match=r"no equal-quality samples for these errors \(expected positive numbers, found"
    ):
        equal_quality_samples(error, one)


def test_curve_is_read_between_its_points_and_not_beyond() -> None:
    curve = [(16, 0.01), (1, 1.0), (4, 0.1)]
    assert samples_on_curve(0.1, curve) == pytest.approx(4, rel=1e-12)
    assert samples_on_curve(10**-1.5, curve) == pytest.approx(8, rel=1e-12)
    for error, end in ((2.0, 1), (0.001, 16), (0.0, 16)):
        assert samples_on_curve(error, curve) == pytest.approx(end, rel=1e-12)


def test_errors_that_do_not_fall_are_no_curve() -> None:
    assert falls([(1, 1.0), (4, 0.5)])
    for wrong in ([(1, 1.0)], [(1, 1.0), (4, 1.0)], [(1, 1.0), (4, 0.0)]):
        assert not falls(wrong)
