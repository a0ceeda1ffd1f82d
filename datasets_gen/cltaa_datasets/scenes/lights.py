"""Colour changes without motion: glints, flashes, moving shadows, exposure steps."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Lamp, Material, Part, Shadow, Sun
from cltaa_datasets.sets import LIGHTS, gallery, poster_wall, standing

FLASH = 0.2  # seconds from one flash to the next
FLASH_LENGTH = 0.07  # seconds
STEP = 0.4  # seconds between changes of exposure
EXPOSURES = (1.0, 0.25, 2.0, 0.5)
ORBIT = 1.1  # period in seconds of the lamp's orbit in ``glints``
LAMP = 25.0
SUN_SWING = 3.0  # seconds
SHADOW = Shadow((0.0, 1.5, -0.5), 4.0)


@register("glints", "Highlights of up to 10000 run over still gold and lacquer", (Effect.ILLUMINATION, Effect.HDR))
def glints(seed: int) -> Staging:
    """Circle a lamp over polished objects: only the highlights move."""
    rng = np.random.default_rng(seed)
    # The least roughness of the shading model gives the sharpest highlight.
    gold = Material(base_colour=(1.0, 0.72, 0.33, 1.0), metallic=1.0, roughness=0.08)
    lacquer = Material(base_texture=textures.checker((0.5, 0.04, 0.03), (0.05, 0.05, 0.06), 8, rng), roughness=0.15)
    beads = [
        meshes.placed(meshes.sphere(0.05, cells=8), (x, 0.9 + y, -1.2))
        for x in np.linspace(-0.3, 1.9, 12).tolist()
        for y in np.linspace(0.0, 1.0, 6).tolist()
    ]
    parts = (
        Part("knot", meshes.placed(meshes.knot(0.75, 0.15), (-1.2, 1.2, -0.6)), gold),
        Part("beads", meshes.merge(beads), gold),
        Part("vase", meshes.placed(meshes.torus(0.45, 0.2), (0.8, 0.3, 0.2)), lacquer),
        *poster_wall(rng),
    )
    phase = float(rng.random())

    def at(time: float) -> Instant:
        angle = 2.0 * np.pi * (time / ORBIT + phase)
        place = (2.2 * float(np.sin(angle)), 2.4 + 0.6 * float(np.cos(2.0 * angle)), 1.0 + float(np.cos(angle)))
        return standing(parts, lights=(*LIGHTS, Lamp(place, (LAMP, 0.9 * LAMP, 0.7 * LAMP))))

    return parts, at


@register("flash", "Two lamps flash over a wall on which nothing moves", (Effect.ILLUMINATION,))
def flash(seed: int) -> Staging:
    """Flash red and blue lamps in turn, each lit for two frames of six."""
    parts = gallery(seed)
    late = float(np.random.default_rng(seed).random()) * FLASH
    places = ((-1.6, 1.8, 0.2), (1.5, 1.9, 0.4))
    colours = ((2.6, 0.5, 0.3), (0.4, 0.8, 3.0))

    def at(time: float) -> Instant:
        turn, since = divmod(time + late, FLASH)
        lamp = (Lamp(places[int(turn) % 2], colours[int(turn) % 2]),) if since < FLASH_LENGTH else ()
        return standing(parts, lights=(*LIGHTS, *lamp))

    return parts, at


@register("exposure", "The exposure steps between a half, a quarter and twice as much", (Effect.EXPOSURE,))
def exposure(seed: int) -> Staging:
    """Change the exposure of the whole picture every 0.4 seconds."""
    parts = gallery(seed)

    def at(time: float) -> Instant:
        return standing(parts, exposure=EXPOSURES[animation.whole_periods(time, STEP) % len(EXPOSURES)])

    return parts, at


@register("shadow", "The shadows of still things sweep over a wall as the sun runs", (Effect.ILLUMINATION,))
def shadow(seed: int) -> Staging:
    """Move the sun across the sky in seconds; nothing else moves."""
    parts = gallery(seed)
    phase = float(np.random.default_rng(seed).random())

    def at(time: float) -> Instant:
        azimuth = 150.0 + 25.0 * animation.swing(time, SUN_SWING, phase)
        sun = Sun(animation.direction(azimuth, 42.0), (3.9, 3.6, 3.1), SHADOW)
        return standing(parts, lights=(sun,))

    return parts, at
