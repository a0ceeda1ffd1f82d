"""Combined effects: all compatible ones in one picture, and glossy objects on a transparent ground."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, swarms
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Perspective, Shadow, Sky, Sun
from cltaa_datasets.scenes import spinner
from cltaa_datasets.scenes.deforming import banner
from cltaa_datasets.scenes.glass import puffs, rising
from cltaa_datasets.scenes.sparks import glowing, thrown
from cltaa_datasets.scenes.still import courtyard, things
from cltaa_datasets.sets import standing

FIELD_OF_VIEW = np.radians(44.0)
SKY = Sky(zenith=(0.14, 0.30, 0.64), horizon=(0.70, 0.76, 0.84), ground=(0.24, 0.22, 0.19), fog=0.006, ambient=0.6)
SHADOW = Shadow((0.0, 1.5, -1.5), 6.0, 2048)
SHOT, STEP = 0.8, 0.4  # seconds per shot, per exposure
EXPOSURES = (1.0, 0.5)
SWING = 3.0  # seconds
PLACES = tuple(animation.translation(place) for place in ((1.0, 1.2, 1.0), (-0.6, 0.3, 1.4), (-0.4, 0.4, -2.6)))


@register(
    "everything",
    "A courtyard with every effect that does not exclude another",
    set(Effect) - {Effect.ALPHA, Effect.NOISE},
)
def everything(seed: int) -> Staging:
    """Combine sparks, smoke, a waving cloth and a moving sun with a camera that walks, zooms, cuts and adapts."""
    rng = np.random.default_rng(seed)
    (sheet, waving), flying, drifting = banner(rng), thrown(rng), rising(rng)
    parts = (glowing(), puffs(), sheet, *courtyard(rng), *things(rng))

    def at(time: float) -> Instant:
        swing, shot = animation.swing(time, SWING), animation.whole_periods(time, SHOT)
        x = (-1.2 if shot % 2 else 0.4) + 0.5 * swing
        shapes = {
            "sparks": swarms.placed(swarms.OCTAHEDRON, *flying(time)),
            "smoke": swarms.placed(swarms.CARD, *drifting(time)),
            "cloth": waving(time),
        }
        return standing(
            parts,
            animation.look_at((x, 1.65, 5.0), (0.5 * x, 1.0, -1.0)),
            moving=PLACES,
            lens=Perspective(FIELD_OF_VIEW * (1.0 + 0.1 * swing)),
            lights=(Sun(animation.direction(130.0 + 20.0 * swing, 45.0), (3.4, 3.1, 2.7), SHADOW),),
            sky=SKY,
            exposure=EXPOSURES[animation.whole_periods(time, STEP) % len(EXPOSURES)],
            shot=shot,
            shapes=shapes,
        )

    return parts, at


@register(
    "turntable",
    "Textured and shining things that turn on a transparent ground",
    (Effect.MOTION, Effect.DISOCCLUSION, Effect.ILLUMINATION, Effect.HDR, Effect.ALPHA),
)
def turntable(seed: int) -> Staging:
    """Turn the objects of ``spinner`` without surroundings, as for a composite."""
    parts, at = spinner.spinner(seed)
    turning = len(spinner.movers(np.random.default_rng(seed)))

    def alone(time: float) -> Instant:
        now = at(time)
        return standing(
            parts[:turning], now.world_to_view, moving=now.poses[:turning], lens=now.lens, lights=now.lights, sky=None
        )

    return parts[:turning], alone
