"""The sRGB curve (IEC 61966-2-1), both ways, as precise as what it is given: a line where it is dark, a power above."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = TypeVar("Floats", NDArray[np.float32], NDArray[np.float64])

DARK_LIGHT, DARK_CODE = 0.0031308, 0.04045  # where the line ends
SLOPE, SCALE, OFFSET, POWER = 12.92, 1.055, 0.055, 2.4


def encoded(linear: Floats) -> Floats:
    """Linear light from 0 on as sRGB values: 1 stays 1."""
    return np.where(linear <= DARK_LIGHT, SLOPE * linear, SCALE * linear ** (1 / POWER) - OFFSET)


def decoded(values: Floats) -> Floats:
    """sRGB values from 0 on as linear light; the power goes on above 1."""
    return np.where(values <= DARK_CODE, values / SLOPE, ((values + OFFSET) / SCALE) ** POWER)
