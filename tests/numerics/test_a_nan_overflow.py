"""Failure modes of NaN, infinity and overflow, NUMERICS A: see docs/numerics.md."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.build import Storage
from cltaa.launch import DeviceLauncher
from tests.numerics.still_frames import accumulator, grey, still_frame


@pytest.mark.parametrize("storage", [Storage.HALF, Storage.HALF_STOCHASTIC])
def test_a4_half_history_saturates(launcher: DeviceLauncher, storage: Storage) -> None:
    values = np.array([[65504.0, 65519.0, 65520.0, 1e6, 1e15, 1e30, -65520.0, -1e6, 1.0]], np.float32)
    resolver = accumulator(launcher, 0.1, storage)
    for index in range(4):
        resolved = resolver.resolve(still_frame(index, grey(values)))
        assert np.isfinite(resolved).all()
        assert resolved[0, [0, 1, 2, 3, 4], 0].tolist() == [65504.0] * 5
        assert resolved[0, [6, 7, 8], 0].tolist() == [-65504.0, -65504.0, 1.0]
