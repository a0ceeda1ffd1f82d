"""Weights of the current filter: each kernel at the distances of the three samples along an axis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cltaa.core.parameters import Choices, CurrentFilter, Settings
from cltaa.core.record import axis_weights

Kernel = Callable[[np.ndarray], np.ndarray]
FALLOFF = 1.7
KERNELS: dict[str, Kernel] = {
    "none": lambda _: np.array([0.0, 1.0, 0.0]),
    "bilinear": lambda d: np.maximum(0.0, 1.0 - d),
    "gaussian": lambda d: np.exp(-FALLOFF * d**2),
    # As FSR writes it.
    "lanczos": lambda d: np.where(d < 2, (25 / 16 * (0.4 * d**2 - 1) ** 2 - 9 / 16) * (0.25 * d**2 - 1) ** 2, 0.0),
}


@pytest.mark.parametrize("kind", CurrentFilter)
def test_weights_are_shares_of_the_kernel_at_each_sample(kind: CurrentFilter) -> None:
    choices, settings = Choices(current_filter=kind), Settings(filter_falloff=FALLOFF)
    for jitter in (-0.45, 0.0, 0.3, 1.4):
        values = KERNELS[kind](np.abs(np.array([-1.0, 0.0, 1.0]) + jitter))
        before, _, after = values / values.sum()
        # A dozen roundings of doubles of the order of 1.
        assert axis_weights(jitter, choices, settings) == pytest.approx((before, after), rel=0, abs=16 * 2.0**-52)
