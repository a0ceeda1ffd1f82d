"""The sampler against scipy's own interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from cltaa.lab.judge.video_scores import CubicSampler

HEIGHT, WIDTH = 20, 33
# Sums of 16 products of coefficients below 4 in size: 16 * 4 * 2^-53 = 7e-15, and as much for the coefficients.
TOLERANCE = 2e-14


@pytest.mark.parametrize("beyond", [0.0, 3.0])
def test_as_scipy_interpolates(beyond: float) -> None:
    random = np.random.default_rng(4)
    image = random.random((HEIGHT, WIDTH, 3))
    y = random.uniform(-beyond, HEIGHT - 1 + beyond, 500)
    x = random.uniform(-beyond, WIDTH - 1 + beyond, 500)
    found = CubicSampler(HEIGHT, WIDTH, x, y)(image)
    for channel in range(3):
        expected = ndimage.map_coordinates(image[..., channel], [y, x], order=3, mode="nearest")
        np.testing.assert_allclose(found[:, channel], expected, rtol=0, atol=TOLERANCE)


def test_texel_centres_give_the_texels() -> None:
    image = np.random.default_rng(5).random((HEIGHT, WIDTH, 2))
    y, x = (place.ravel().astype(float) for place in np.mgrid[:HEIGHT, :WIDTH])
    np.testing.assert_allclose(CubicSampler(HEIGHT, WIDTH, x, y)(image), image.reshape(-1, 2), rtol=0, atol=TOLERANCE)


def test_nothing_to_sample() -> None:
    assert CubicSampler(HEIGHT, WIDTH, np.zeros(0), np.zeros(0))(np.ones((HEIGHT, WIDTH, 3))).shape == (0, 3)
