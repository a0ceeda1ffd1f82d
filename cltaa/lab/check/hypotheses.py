"""Findings and their hypotheses: linear maps of vectors, and readings of matrices."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cltaa.frame import Camera
from cltaa.inputs.convert import mended_camera
from cltaa.inputs.profile import Cameras
from cltaa.lab.check.registration import Vector

SURE, ASKED, DOUBTFUL = 0.8, 0.55, 0.6  # least confidence of a mistake, of a question; confidence of a doubtful one


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A certain error (``mistake``), a possible one (``question``), or a note.

    ``confidence`` is 0 to 1; ``evidence`` the numbers behind it; ``fix`` the keys of a reader profile that correct it,
    relative to how the frames were read, empty if only rendering again helps; ``option`` the same for the command line.
    """

    name: str
    mistake: bool
    confidence: float
    what: str
    evidence: str
    fix: dict[str, dict[str, Any]] = {}
    option: str = ""
    question: bool = False

    @property
    def settled(self) -> Finding:
        """The finding itself, or a question without a fix for a mistake below SURE."""
        if not self.mistake or self.confidence >= SURE:
            return self
        return msgspec.structs.replace(self, mistake=False, question=True, fix={})


def mistake(name: str, what: str, evidence: str, confidence: float, fix: Mapping[str, object] | None = None) -> Finding:
    """Make a mistake; its name begins with a profile section, as ``depth-scaled``, whose keys ``fix`` sets."""
    name, mended = name.replace(" ", "-"), {} if fix is None else {name.partition("-")[0]: dict(fix)}
    return Finding(name=name, mistake=True, confidence=confidence, what=what, evidence=evidence, fix=mended)


SMALLEST_SPREAD = 0.05  # share of the mean, because pairs of one shot are not independent


def sureness(declared: Vector, winner: Vector) -> float:
    """Return the confidence, 0 to 0.99, that ``winner`` [n] is the smaller of two residuals, from n pairs.

    By Cantelli's inequality, which holds for any distribution: a distribution about 0 gives a mean t standard errors
    above 0 with a probability of at most 1 / (1 + t^2).
    """
    gain = declared - winner
    mean = float(gain.mean())
    if mean <= 0.0:
        return 0.0
    spread = max(float(gain.std(ddof=1)) if len(gain) > 1 else mean, SMALLEST_SPREAD * mean)
    squared = (mean / spread) ** 2 * len(gain)
    return min(squared / (1.0 + squared), 0.99)


_SPOKEN = {
    "negated": "of the other sign",
    "x-negated": "of the other sign in x",
    "y-flipped": "of the other sign in y",
    "swapped": "y before x",
    "units-uv": "fractions of the picture",
    "units-ndc": "halves of the picture, y up",
    "centred-on-half-uv": "around 0.5, in fractions of the picture",
    "centred-on-half-ndc": "around 0.5, in halves of the picture, y up",
}
SIGNS = {"": (1.0, 1.0), "negated": (-1.0, -1.0), "x-negated": (-1.0, 1.0), "y-flipped": (1.0, -1.0)}


def linear_maps(width: int, height: int) -> dict[str, Vector]:
    """Return maps [2, 2] by name, true value = map @ declared value; the empty name is the identity.

    ``uv`` and ``ndc``: the declared numbers are fractions of the display window with y down, or halves with y up.
    """
    maps: dict[str, Vector] = {}
    for sign, factors in SIGNS.items():
        maps[sign] = np.diag(factors)
        for size in (0.5, 2.0):
            maps[f"scaled-{size:g} {sign}".strip()] = size * np.diag(factors)
        maps[f"units-uv {sign}".strip()] = np.diag(np.multiply(factors, (width, height)))
        maps[f"units-ndc {sign}".strip()] = np.diag(np.multiply(factors, (width / 2, -height / 2)))
        maps[f"swapped {sign}".strip()] = np.diag(factors) @ np.array([[0.0, 1.0], [1.0, 0.0]])
    return maps


def spoken(name: str) -> str:
    """Describe the declared numbers if the map of this name gives the true ones."""
    return ", ".join(_SPOKEN.get(word) or _size(float(word.removeprefix("scaled-"))) for word in name.split())


def _size(factor: float) -> str:
    """Describe declared numbers that must be multiplied by ``factor``."""
    if factor > 1.0:
        return "half the right size" if factor == 2.0 else f"1/{factor:.2g} of the right size"
    return "twice the right size" if factor == 0.5 else f"{1.0 / factor:.2g} times the right size"


def scaled(factor: float, sign: str) -> tuple[str, Vector]:
    """Return the name and the map [2, 2] of a factor, to three digits unless it is ``whole``, and one of SIGNS."""
    factor = factor if factor == whole(factor) else float(f"{factor:.3g}")
    return f"scaled-{factor:.3g} {sign}".strip(), factor * np.diag(SIGNS[sign])


def whole(factor: float) -> float:
    """Return the whole number nearest to ``factor``, or one over a whole number below 1."""
    return float(round(factor)) if factor > 1.0 else 1.0 / round(1.0 / factor)


def simple(factor: float) -> tuple[float, float]:
    """Return the power of two nearest to ``factor``, and the nearest whole number, or one over one."""
    return 2.0 ** round(math.log2(factor)), whole(factor)


class Affine(NamedTuple):
    """True vector = matrix @ (declared vector - offset)."""

    matrix: Vector  # [2, 2]
    offset: float = 0.0  # for both axes
    aspect: float = 1.0  # of the unit of declared vectors, which a profile applies after it has swapped them

    def __call__(self, declared: Vector) -> Vector:
        """Return the true vectors [2, n]."""
        return np.asarray(self.matrix @ (declared - self.offset), np.float64)

    @property
    def fix(self) -> dict[str, object]:
        """Keys of a profile for this map."""
        matrix = self.matrix / np.array([[1.0, self.aspect], [1.0 / self.aspect, 1.0]])
        return linear_fix(matrix) | ({"offset": [self.offset] * 2} if self.offset else {})


PLAIN = Affine(np.eye(2))  # the vectors as declared


def affine_maps(width: int, height: int, unit: tuple[float, float] = (1.0, 1.0)) -> dict[str, Affine]:
    """Return the linear maps, those from UV or NDC with y before x, and those from UV or NDC centred on 0.5, as images
    without negative numbers store them. ``unit`` is that of the declared vectors, in pixels."""
    maps = {name: Affine(matrix) for name, matrix in linear_maps(width, height).items()}
    aspect = unit[0] / unit[1]
    for signed, factors in SIGNS.items():
        matrix = np.diag(factors) @ np.array([[0.0, aspect], [1.0 / aspect, 0.0]])
        maps[f"swapped {signed}".strip()] = Affine(np.asarray(matrix, np.float64), aspect=aspect)
    for name, (across, down) in (("uv", (width, height)), ("ndc", (width / 2, -height / 2))):
        for signed, factors in SIGNS.items():
            matrix = np.diag(factors) @ np.array([[0.0, across], [down, 0.0]])
            maps[f"swapped units-{name} {signed}".strip()] = Affine(np.asarray(matrix, np.float64))
    for name, spans in (("uv", (width, height)), ("ndc", (width, -height))):
        for sign in (1.0, -1.0):
            maps[f"centred-on-half-{name}{' negated' if sign < 0 else ''}"] = Affine(sign * np.diag(spans), 0.5)
    return maps


def linear_fix(matrix: Vector) -> dict[str, object]:
    """Return the profile keys of motion or jitter for true value = matrix @ declared value."""
    swap = bool(matrix[0, 0] == 0.0)
    scale = [float(matrix[0, 1]), float(matrix[1, 0])] if swap else [float(matrix[0, 0]), float(matrix[1, 1])]
    return {"scale": scale, "swap": True} if swap else {"scale": scale}


LEAST_SHIFT_PX = 0.1  # root mean square; a smaller shift is no jitter
NEAR = 0.35  # largest relative distance of a fit from a map that it supports, even if other maps are farther


class Regression(NamedTuple):
    """Measured = matrix @ declared, by least squares, and the root mean square error ``left`` in pixels."""

    matrix: Vector  # [2, 2]
    left: float


def regress(measured: Vector, declared: Vector, weights: Vector) -> Regression:
    """Fit ``measured`` [n, 2] by ``declared`` [n, 2], with a weight for each row, ``weights`` [n]."""
    root = np.sqrt(weights)[:, None]
    matrix, *_ = np.linalg.lstsq(declared * root, measured * root, rcond=None)
    found = np.asarray(matrix.T, np.float64)
    return Regression(found, left_over(measured, declared, found, weights))


def left_over(measured: Vector, declared: Vector, matrix: Vector, weights: Vector) -> float:
    """Return the weighted root mean square length of measured - matrix @ declared, in pixels."""
    difference = ((measured - declared @ matrix.T) ** 2).sum(1)
    return float(np.sqrt((difference * weights).sum() / weights.sum()))


def to_and_fro(values: Vector) -> bool:
    """Return True if the steps of ``values`` [n, 2] vary as much as the values: true for jitter, not for motion."""
    step, spread = (float(np.hypot(*part.std(0))) for part in (np.diff(values, axis=0), values))
    return step >= max(spread, LEAST_SHIFT_PX)


Change = Callable[[Camera], Camera]


class Meaning(NamedTuple):
    """Another meaning of the matrices: its description and its keys of a profile."""

    what: str
    fix: dict[str, Any]

    def change(self, camera: Camera) -> Camera:
        """Convert ``camera``, read as declared, to this meaning; raises LinAlgError for a singular matrix."""
        rule = Cameras(**self.fix)
        return mended_camera(camera.world_to_view, camera.view_to_clip, rule, (0.0, 0.0), 1, 1)


_TRANSPOSED = {"transposed": Meaning("the matrices are transposed", {"layout": "column"})}
_HALF_TRANSPOSED = {
    "view-transposed": Meaning("the view matrix is transposed", {"view_layout": "column"}),
    "projection-transposed": Meaning("the projection is transposed", {"projection_layout": "column"}),
}
_INVERSE = {"inverse": Meaning("the view matrix leads from camera to world", {"sense": "camera-to-world"})}
_AXES = {
    "z-forward": Meaning("view space looks along +z", {"flip_z": True}),
    "z-forward-projection": Meaning("view and projection look along +z", {"flip_z": True, "flip_projection_z": True}),
    "mirrored": Meaning("the world is left-handed", {"mirrored": True}),
    "left-handed": Meaning(
        "world, view and projection are left-handed", {"flip_z": True, "flip_projection_z": True, "mirrored": True}
    ),
}
_FLIPPED = {"y-flipped": Meaning("the projection's y points down", {"flip_y": True})}


def _together(*choices: Mapping[str, Meaning]) -> dict[str, Meaning]:
    """Return all combinations of one meaning from each of ``choices``."""
    made = {}
    for parts in product(*(choice.items() for choice in choices)):
        there = [(name, meaning) for name, meaning in parts if name]
        fix = {key: value for _, meaning in there for key, value in meaning.fix.items()}
        made["-".join(name for name, _ in there)] = Meaning(", and ".join(m.what for _, m in there), fix)
    return made


_NOT = {"": Meaning("", {})}
# Gross mistakes, one at a time: each can be detected by itself.
MEANINGS = _TRANSPOSED | _HALF_TRANSPOSED | _INVERSE | _AXES | _FLIPPED | _together(_TRANSPOSED, _AXES)
# All combinations of them; none of them under the empty name.
COMBINED = _together(_NOT | _TRANSPOSED, _NOT | _INVERSE, _NOT | _AXES, _NOT | _FLIPPED)
