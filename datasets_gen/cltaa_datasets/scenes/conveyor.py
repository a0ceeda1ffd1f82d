"""Own motion only: a printed belt that fills the picture and slides in its own plane."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Part, matt
from cltaa_datasets.sets import standing

REACH, PERIOD = (0.9, 0.5), (3.1, 4.3)  # metres either way and periods in seconds, across and along
VIEW = animation.look_at((0.0, 2.2, 2.0), (0.0, 0.0, 0.0))


@register("conveyor", "A printed belt slides under a still camera; nothing is ever disoccluded", (Effect.MOTION,))
def conveyor(seed: int) -> Staging:
    """Stage the scene; the seed changes the print and the start of the slide."""
    rng = np.random.default_rng(seed)
    belt = textures.lettering(rng, (0.05, 0.06, 0.10), (0.84, 0.80, 0.70), 20)
    parts = (Part("belt", meshes.floor(9.0, 1.5, 4), matt(belt)),)
    phase = rng.random(2).tolist()

    def at(time: float) -> Instant:
        x, z = (r * animation.swing(time, p, f) for r, p, f in zip(REACH, PERIOD, phase, strict=True))
        return standing(parts, VIEW, moving=(animation.translation((x, 0.0, z)),))

    return parts, at
