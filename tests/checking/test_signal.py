"""Sampling of signals: bilinear between texels, each texel its own, NaN outside, however narrow the image is."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.checking.signal import sample


@pytest.mark.parametrize(("height", "width"), [(5, 7), (1, 7), (5, 1), (1, 1), (2, 2)])
def test_sampling(height: int, width: int) -> None:
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
    assert np.isnan(sample(planes, *outside)).all()
