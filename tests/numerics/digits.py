"""Parts of numbers that carry an error each (bounded.py): signs, exponents, whole parts. Arrays of one shape, float64.

An infinite error means that rounding may turn the part altogether.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


def floor(value: Values, error: Values) -> tuple[Values, Values]:
    """The whole number below: where a texel lies, so that another one is another texel."""
    same = np.floor(value - error) == np.floor(value + error)
    return np.floor(value), np.where(same, 0.0, np.inf)


def truncated(value: Values, error: Values) -> tuple[Values, Values]:
    """The whole part, which may be that of any number within the error."""
    whole, lower, upper = (np.trunc(v) for v in (value, value - error, value + error))
    return whole, np.maximum(upper - whole, whole - lower)


def mantissa(value: Values, error: Values) -> tuple[Values, Values, NDArray[np.intc]]:
    """The part from a half to 1, its error, and the exponent."""
    part, exponent = np.frexp(value)
    same = [np.frexp(np.abs(value) + by)[1] == exponent for by in (-error, error)]
    return part, np.where((same[0] & same[1]) | (error == 0), np.ldexp(error, -exponent), np.inf), exponent


def scaled(value: Values, error: Values, exponent: Values) -> tuple[Values, Values]:
    """Times a power of two, which rounds nothing."""
    whole = exponent.astype(np.intc)
    return np.ldexp(value, whole), np.ldexp(error, whole)


def signed(value: Values, error: Values, sign: Values, of_sign: Values) -> tuple[Values, Values]:
    """The size of one number with the sign of another, whose error is ``of_sign``."""
    turned = (of_sign > 0) & (np.abs(sign) <= of_sign)
    return np.copysign(value, sign), np.where(turned, np.inf, error)
