"""Pictures as signals: what of them is kept, how they are blurred, where they are looked at and sampled."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.lab.check.registration import (
    MOST_POINTS,
    blur,
    grid_points,
    register_signal,
    sample,
    squeezed_light,
)


def test_sampling() -> None:
    for height, width in [(5, 7), (1, 7), (5, 1), (1, 1), (2, 2)]:
        random = np.random.default_rng(0)
        planes = random.integers(0, 256, (2, height, width)).astype(np.float32)
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[:height, :width])
        np.testing.assert_array_equal(sample(planes, columns, rows), planes.reshape(2, -1))
        # Quarters of whole numbers are exact, so that the order of the sum is of no matter.
        x, y = random.integers(0, 4 * width - 3, 50) / 4, random.integers(0, 4 * height - 3, 50) / 4
        near = (1 - np.abs(columns - x[:, None])).clip(0) * (1 - np.abs(rows - y[:, None])).clip(0)
        np.testing.assert_array_equal(sample(planes, x, y), planes.reshape(2, -1) @ near.T)
        np.testing.assert_array_equal(sample(planes[0], x, y), sample(planes, x, y)[0])
        outside = np.array([-0.25, width - 0.75, np.nan, np.inf, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, height - 0.5])
        assert np.isnan(sample(planes, *outside)).all(), (height, width)


def picture(height: int = 30, width: int = 40) -> np.ndarray:
    return np.random.default_rng(1).random((height, width, 3), dtype=np.float32)


def test_light_is_squeezed_about_its_own_middle() -> None:
    grey = np.repeat(np.array([[[0.0], [1.0], [2.0], [6.0]]], np.float32), 3, -1)
    # The weights of luminance sum to 1 but for their rounding; of what shines, 2 is the middle.
    np.testing.assert_allclose(squeezed_light(grey), [[0, 1 / 3, 1 / 2, 3 / 4]], rtol=8 * 2.0**-24)
    assert not squeezed_light(0 * grey).any()


def test_exposure_cancels() -> None:
    np.testing.assert_array_equal(squeezed_light(picture() * np.float32(8.0)), squeezed_light(picture()))


def test_what_is_no_light_is_dark_and_what_is_infinite_bright() -> None:
    colour = picture()
    colour[1], colour[2], colour[3], colour[4] = np.nan, -5.0, -np.inf, np.inf
    light = squeezed_light(colour)
    assert not light[1:4].any()
    assert (light[4] > 0.999).all()
    assert (light[5:] < 0.999).all()
    assert np.isfinite(register_signal(colour)).all()


@pytest.mark.parametrize("sigma", [0.6, 4.0])
def test_a_blur_spreads_by_its_deviation_and_keeps_the_sum(sigma: float) -> None:
    point = np.zeros((65, 67), np.float32)
    point[30, 34] = 1.0
    across = np.arange(67) - 34.0, np.arange(65) - 30.0
    blurred = blur(point, sigma).astype(np.float64)
    for axis, places in enumerate(across):
        weights = blurred.sum(axis)
        assert weights.sum() == pytest.approx(1.0, abs=1e-5)  # 65 * 67 roundings of numbers that sum to 1
        assert weights @ places == pytest.approx(0.0, abs=1e-4)
        # Cut off beyond 3 deviations, where 1.1 % of the variance of the continuous one lies.
        assert np.sqrt(weights @ places**2) == pytest.approx(sigma, rel=0.02)


def test_edges_are_repeated() -> None:
    ramp = np.repeat(np.array([[0.0]] * 20 + [[8.0]] * 20, np.float32), 30, 1)
    blurred = blur(ramp, 1.0)
    # Seven weights that sum to 1 but for their rounding, twice.
    np.testing.assert_allclose(blurred[-1], 8.0, rtol=16 * 2.0**-24)
    assert not blurred[0].any()
    np.testing.assert_allclose(blur(np.ones((30, 40), np.float32), 4.0), 1.0, rtol=64 * 2.0**-24)


def test_the_band_holds_neither_slow_light_nor_noise_of_single_pixels() -> None:
    """Of waves of 64, 8 and 2 pixels the middle one is left; by the Gaussians' transfer exp(-2 (pi sigma f)^2)."""
    x = np.arange(160)
    found = {}
    for length in (64, 8, 2):
        light = 1.0 + 0.5 * np.cos(2 * np.pi * x / length)
        colour = np.repeat(np.repeat(light[None, :, None], 40, 0), 3, -1).astype(np.float32)
        band, whole = (signal[8:-8, 32:-32] for signal in (register_signal(colour), squeezed_light(colour)))
        found[length] = float(band.std() / whole.std())
    assert found[64] < 0.1  # 1 - exp(-2 (pi 4 / 64)^2) = 0.07
    assert found[8] == pytest.approx(0.9, abs=0.02)  # exp(-2 (pi 0.6 / 8)^2) - 0.007, and overtones of the squeeze
    # Weights 1, 0.249 and 0.004 of pixels 0, 1 and 2 apart: (1 - 0.498 + 0.008) / (1 + 0.498 + 0.008).
    assert found[2] == pytest.approx(0.339, abs=0.01)


def test_points_are_of_a_regular_grid_and_not_too_many() -> None:
    for height, width, step in [(90, 160, 1), (200, 300, 1), (200, 301, 2), (600, 800, 3), (1080, 1920, 6)]:
        x, y = grid_points(height, width)
        assert len(x) <= MOST_POINTS, (height, width)
        across, down = np.arange(step // 2, width, step), np.arange(step // 2, height, step)
        np.testing.assert_array_equal(x, np.tile(across, len(down)))
        np.testing.assert_array_equal(y, np.repeat(down, len(across)))
