"""Which of several linear maps explains what was measured: signs, exchanged axes, factors of two, other units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cltaa.checking.signal import Vector

_SPOKEN = {
    "negated": "of the other sign", "x-negated": "of the other sign in x", "y-flipped": "of the other sign in y",
    "scaled-0.5": "twice the right size", "scaled-2": "half the right size", "swapped": "y before x",
    "units-uv": "fractions of the picture", "units-ndc": "halves of the picture, y up",
    "centred-on-half": "around 0.5", "uv": "in fractions of the picture", "ndc": "in halves of the picture, y up",
}  # fmt: skip
_SIGNS = {"": (1.0, 1.0), "negated": (-1.0, -1.0), "x-negated": (-1.0, 1.0), "y-flipped": (1.0, -1.0)}


def linear_maps(width: int, height: int) -> dict[str, Vector]:
    """True value = map @ declared value, [2, 2], for each name; the empty name is the identity.

    ``uv`` and ``ndc`` mean that the declared numbers are fractions of the display window, y down and y up.
    """
    maps: dict[str, Vector] = {}
    for sign, factors in _SIGNS.items():
        maps[sign] = np.diag(factors)
        for size in (0.5, 2.0):
            maps[f"scaled-{size:g} {sign}".strip()] = size * np.diag(factors)
        maps[f"units-uv {sign}".strip()] = np.diag(np.multiply(factors, (width, height)))
        maps[f"units-ndc {sign}".strip()] = np.diag(np.multiply(factors, (width / 2, -height / 2)))
        maps[f"swapped {sign}".strip()] = np.diag(factors) @ np.array([[0.0, 1.0], [1.0, 0.0]])
    return maps


def spoken(name: str) -> str:
    """What the declared numbers are, if the map of this name makes the true ones of them."""
    return ", ".join(_SPOKEN[word] for word in name.split())


class Affine(NamedTuple):
    """True vector = matrix @ (declared vector - offset)."""

    matrix: Vector  # [2, 2]
    offset: float = 0.0  # of both axes

    def __call__(self, declared: Vector) -> Vector:
        """The true vectors [2, n]."""
        return np.asarray(self.matrix @ (declared - self.offset), np.float64)

    @property
    def fix(self) -> dict[str, object]:
        """Keys of a profile that say so."""
        return linear_fix(self.matrix) | ({"offset": [self.offset] * 2} if self.offset else {})


def affine_maps(width: int, height: int) -> dict[str, Affine]:
    """The linear maps, and fractions of the picture or halves of it that lie around 0.5, as pictures hold them."""
    maps = {name: Affine(matrix) for name, matrix in linear_maps(width, height).items()}
    for name, unit in (("uv", (width, height)), ("ndc", (width, -height))):
        for sign in (1.0, -1.0):
            maps[f"centred-on-half {name}{' negated' if sign < 0 else ''}"] = Affine(sign * np.diag(unit), 0.5)
    return maps


def linear_fix(matrix: Vector) -> dict[str, object]:
    """Keys of a profile, of motion or jitter, for true value = matrix @ declared value."""
    swap = bool(matrix[0, 0] == 0.0)
    scale = [float(matrix[0, 1]), float(matrix[1, 0])] if swap else [float(matrix[0, 0]), float(matrix[1, 1])]
    return {"scale": scale, "swap": True} if swap else {"scale": scale}


class Regression(NamedTuple):
    """Measured = matrix @ declared, by least squares, and what is left over, root mean square in pixels."""

    matrix: Vector  # [2, 2]
    left: float


def regress(measured: Vector, declared: Vector, weights: Vector) -> Regression:
    """Fit ``measured`` [n, 2] by ``declared`` [n, 2], each row weighed by ``weights`` [n]."""
    root = np.sqrt(weights)[:, None]
    matrix, *_ = np.linalg.lstsq(declared * root, measured * root, rcond=None)
    found = np.asarray(matrix.T, np.float64)
    return Regression(found, left_over(measured, declared, found, weights))


def left_over(measured: Vector, declared: Vector, matrix: Vector, weights: Vector) -> float:
    """Root mean square length of measured - matrix @ declared, in pixels."""
    difference = ((measured - declared @ matrix.T) ** 2).sum(1)
    return float(np.sqrt((difference * weights).sum() / weights.sum()))
