"""Foliage: cut-outs smaller than a pixel, under a sliding camera and swaying."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import AlphaMode, Instant, Matrix, Part, emitting
from cltaa_datasets.sets import poster_wall, slid, standing

SWING, REACH = 4.0, 0.7  # seconds, metres
SWAY = 0.09  # metres sideways per metre of height


def hedge(seed: int) -> tuple[Part, ...]:
    """Return three rows of crossed leafy sheets before the poster wall, one part per row; leaves are at most a few
    pixels wide."""
    rng = np.random.default_rng(seed)
    leaves = textures.leaves(rng, (0.04, 0.12, 0.03), (0.24, 0.40, 0.10), 170)
    # Emissive, so that a swaying leaf keeps its colour.
    green = emitting((1.0, 1.0, 1.0), leaves, base_texture=leaves, alpha_mode=AlphaMode.MASK, double_sided=True)
    sheet = meshes.sheet((-0.5, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.1, 0.0), (1.5, 1.6))
    grown = []
    for row in range(3):
        bushes = [
            meshes.moved(
                sheet,
                animation.translation((x + float(rng.uniform(-0.2, 0.2)), 0.0, 0.1 - 0.7 * row))
                @ animation.rotation(animation.UP, float(rng.uniform(-0.6, 0.6)) + cross),
            )
            for x in np.linspace(-2.4, 2.4, 6).tolist()
            for cross in (0.0, 1.4)
        ]
        grown.append(Part(f"row {row}", meshes.merge(bushes), green))
    return (*grown, *poster_wall(rng))


@register("foliage", "A camera slides past hedges of cut-out leaves", (Effect.CAMERA, Effect.THIN, Effect.DISOCCLUSION))
def foliage(seed: int) -> Staging:
    """Slide sideways: every leaf causes disocclusion."""
    parts = hedge(seed)
    start = float(np.random.default_rng(seed).random()) * SWING

    def at(time: float) -> Instant:
        return standing(parts, slid(REACH * animation.swing(time + start, SWING)))

    return parts, at


@register("swaying", "Hedges of cut-out leaves sway before a wall", (Effect.MOTION, Effect.THIN, Effect.DISOCCLUSION))
def swaying(seed: int) -> Staging:
    """Shear each row in the wind, which makes non-rigid poses."""
    parts = hedge(seed)
    phase = np.random.default_rng(seed).random(3)

    def at(time: float) -> Instant:
        return standing(parts, moving=tuple(_leaning(time, 2.0 + 0.7 * i, float(p)) for i, p in enumerate(phase)))

    return parts, at


def _leaning(time: float, period: float, phase: float) -> Matrix:
    pose = np.eye(4)
    pose[0, 1] = SWAY * animation.swing(time, period, phase)
    return pose
