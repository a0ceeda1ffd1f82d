"""From linear, scene-referred colour to what a screen shows, for pictures, films and perceptual metrics alike.

One transform, on purpose without a tone curve: exposure in stops, cut to [0, 1], sRGB encoding (IEC 61966-2-1). A curve
that bends highlights would hide errors that a compositor sees; what lies above white is judged by the HDR metrics.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Image

Floats = TypeVar("Floats", NDArray[np.float32], NDArray[np.float64])

DARK_LIGHT, DARK_CODE = 0.0031308, 0.04045  # where the line ends
SLOPE, SCALE, OFFSET, POWER = 12.92, 1.055, 0.055, 2.4


def encoded(linear: Floats) -> Floats:
    """Linear light from 0 on as sRGB values: 1 stays 1."""
    return np.where(linear <= DARK_LIGHT, SLOPE * linear, SCALE * linear ** (1 / POWER) - OFFSET)


def decoded(values: Floats) -> Floats:
    """sRGB values from 0 on as linear light; the power goes on above 1."""
    return np.where(values <= DARK_CODE, values / SLOPE, ((values + OFFSET) / SCALE) ** POWER)


Picture = NDArray[np.uint8]  # [H, W, 3], sRGB-encoded

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709, for encoded R'G'B'


def shown_light(linear: Image, stops: float = 0.0) -> Image:
    """Linear colour as far as a screen can show it: after ``stops`` of exposure, cut to [0, 1]; NaN shows as black."""
    with np.errstate(over="ignore", invalid="ignore"):  # signalling NaN, and stops that leave float32
        exposed = np.multiply(linear, np.float32(2.0**stops), dtype=np.float32)
    light: Image = np.where(np.isnan(exposed), np.float32(0), np.clip(exposed, 0.0, 1.0))
    return light


def to_display(linear: Image, stops: float = 0.0) -> Image:
    """Encode linear colour [..., 3] as sRGB in [0, 1], float32, after ``stops`` of exposure; NaN shows as black."""
    return np.clip(encoded(shown_light(linear, stops)), 0.0, 1.0)  # rounding may leave 1


def to_picture(linear: Image, stops: float = 0.0) -> Picture:
    """Encode linear colour [H, W, 3] as 8-bit sRGB, rounded to nearest."""
    return quantise(to_display(linear, stops))


def quantise(display: Image) -> Picture:
    """Round display values in [0, 1] to 8 bits."""
    rounded: Picture = np.rint(display * np.float32(255)).astype(np.uint8)
    return rounded


def luma(display: Image) -> Image:
    """Luma [H, W] of encoded colour [H, W, 3] (ITU-R BT.709)."""
    weighted: Image = display @ LUMA
    return weighted
