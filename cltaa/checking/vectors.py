"""The linear model of a motion channel that was read almost right: gains of a few tenths, jitter left inside.

Where the vectors err by less than the width of an edge, the residual of whole hypotheses tells little; the gradient of
all points together tells a hundredth of a pixel. The model is displacement = G m + d + L c: m the declared vectors, d
the measured shift of the still part, c the change of jitter; G is the identity and L zero when all is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cltaa.checking.alignment import Picture
from cltaa.checking.signal import Vector, sample

ITERATIONS = 15
TIE = 1e-3  # of the mean information: what the pixels do not tell stays as declared


class Observed(NamedTuple):
    """Points of one pair that carry a vector; ``shift`` is None where no still part shows what jitter did."""

    own: Vector  # [2, n]
    x: Vector
    y: Vector
    now: Vector
    before: Picture
    scale: float
    shift: Vector | None
    jitter_change: Vector  # [2]


class Model(NamedTuple):
    """G [2, 2], L [2, 2] and the information [8, 8] about both, row after row."""

    gain: Vector
    leak: Vector
    information: Vector

    def distance(self, gain: Vector, leak: Vector) -> float:
        """How much worse another gain and leak would explain the pixels."""
        step = np.concatenate([(gain - self.gain).ravel(), (leak - self.leak).ravel()])
        return float(step @ self.information @ step)


def fit_model(observed: Sequence[Observed]) -> Model:
    """Fit the model to all pairs at once, from the identity, by Gauss-Newton with robust weights."""
    unknown = np.concatenate([np.eye(2).ravel(), np.zeros(4)])
    start = unknown.copy()
    information = np.zeros((8, 8))
    for _ in range(ITERATIONS):
        information, gradient = np.zeros((8, 8)), np.zeros(8)
        for pair in observed:
            part, towards = _normal_equations(pair, unknown)
            information += part
            gradient += towards
        tie = TIE * np.trace(information) / 8 * np.eye(8) + 1e-12 * np.eye(8)
        step = np.linalg.solve(information + tie, gradient - tie @ (unknown - start))
        unknown = unknown + np.clip(step, -0.5, 0.5)
        if np.abs(step).max() < 1e-3:
            break
    return Model(unknown[:4].reshape(2, 2), unknown[4:].reshape(2, 2), information)


def explanations(model: Model, maps: Mapping[str, Vector]) -> dict[str, float]:
    """Distance of the model from each map of the vectors, and from jitter left in them, by name."""
    none, one = np.zeros((2, 2)), np.eye(2)
    distances = {name: model.distance(matrix, none) for name, matrix in maps.items()}
    # Vectors m' = m + c need c taken away again, and the other way round.
    distances["jittered"] = model.distance(one, -one)
    distances["jittered-reversed"] = model.distance(one, one)
    return distances


def _normal_equations(pair: Observed, unknown: Vector) -> tuple[Vector, Vector]:
    gain, leak = unknown[:4].reshape(2, 2), unknown[4:].reshape(2, 2)
    shift = np.zeros(2) if pair.shift is None else pair.shift
    u, v = gain @ pair.own + (shift + leak @ pair.jitter_change)[:, None]
    there = sample(pair.before.signal, pair.x + u, pair.y + v)
    inside = np.isfinite(there)
    x, y = (pair.x + u)[inside], (pair.y + v)[inside]
    left = (pair.now - there)[inside]
    by_x, by_y = sample(pair.before.gradient, x, y)
    change = np.repeat(pair.jitter_change[:, None], len(x), axis=1)
    slope = np.concatenate([by_x * pair.own[:, inside], by_y * pair.own[:, inside], by_x * change, by_y * change])
    weight = 1.0 / (1.0 + (left / pair.scale) ** 2) ** 2
    return (slope * weight) @ slope.T, (slope * weight) @ left
