"""Limits of precision: a million metres from the origin, and ten centimetres to the horizon in one picture."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Part, Perspective, Sky, Sun, cut_out, matt
from cltaa_datasets.sets import gallery, slid, standing

FAR_OFF = (1.0e6, 2.0e5, -1.0e6)  # metres
SWING, REACH = 4.0, 0.8  # seconds, metres
NEAREST, FARTHEST = 0.1, 3.0e5  # metres
EYE_HEIGHT, SIDEWAYS = 30.0, 0.04  # metres
TURN = np.radians(2.0)
STARS_TURN = np.radians(6.0)
NIGHT = Sky(zenith=(0.004, 0.006, 0.016), horizon=(0.05, 0.05, 0.07), ground=(0.01, 0.01, 0.01), stars=4.0)
NIGHT_LENS = Perspective(np.radians(50.0))
MOON = Sun(animation.direction(-140.0, 50.0), (0.8, 0.9, 1.1))


@register("far_off", "A dolly through a gallery a million metres from the origin", (Effect.CAMERA, Effect.DISOCCLUSION))
def far_off(seed: int) -> Staging:
    """Move the scene ``dolly`` away from the origin: float32 world space would be wrong by hundreds of pixels."""
    parts = gallery(seed)
    there = animation.translation(FAR_OFF)
    back = animation.translation((-FAR_OFF[0], -FAR_OFF[1], -FAR_OFF[2]))
    start = float(np.random.default_rng(seed).random()) * SWING

    def at(time: float) -> Instant:
        view = slid(REACH * animation.swing(time + start, SWING))
        return standing(parts, view @ back, moving=(there,) * len(parts))

    return parts, at


@register(
    "depth_range",
    "A lattice ten centimetres from the lens, towers, and hills three hundred kilometres away",
    (Effect.CAMERA, Effect.DISOCCLUSION, Effect.THIN, Effect.SKY),
)
def depth_range(seed: int) -> Staging:
    """Sway behind a lattice: it crosses the picture while the hills only follow the camera's rotation."""
    rng = np.random.default_rng(seed)
    net = cut_out(textures.lattice((0.12, 0.10, 0.08), 6, 0.16))
    grass = matt(textures.mottle(rng, (0.10, 0.16, 0.04), (0.34, 0.38, 0.14), 16))
    brick = matt(textures.blocks(rng, (0.66, 0.32, 0.20), (0.60, 0.56, 0.50), 6, 12, 0.012))
    towers = [
        meshes.placed(meshes.box((9.0, h, 9.0), 6.0), (x, h / 2.0, z))
        for x, z, h in zip(rng.uniform(-160, 200, 24), rng.uniform(-700, -60, 24), rng.uniform(15, 70, 24), strict=True)
    ]
    hills = [
        meshes.placed(meshes.sphere(size, (60.0, 30.0), 16), (x, -0.55 * size, -FARTHEST))
        for x, size in zip(np.linspace(-2.2e5, 2.2e5, 9), rng.uniform(2.5e4, 4.5e4, 9), strict=True)
    ]
    corner = (-0.03, EYE_HEIGHT - 0.1, -NEAREST)
    parts = (
        Part("net", meshes.sheet(corner, (0.06, 0.0, 0.0), (0.0, 0.2, 0.0), (1.0, 3.0)), net),
        Part("towers", meshes.merge(towers), brick),
        Part("hills", meshes.merge(hills), grass),
        Part("plain", meshes.floor(FARTHEST, 40.0, 64), grass),
    )
    lens, sky = Perspective(np.radians(50.0), NEAREST / 2.0), Sky(ambient=0.6)
    phase = float(rng.random()) * SWING
    lights = (Sun(animation.direction(110.0, 35.0), (3.6, 3.3, 2.8)),)

    def at(time: float) -> Instant:
        x = SIDEWAYS * animation.swing(time + phase, SWING)
        view = animation.rotation(animation.UP, TURN * animation.swing(time + phase, SWING))
        view = view @ animation.look_at((x, EYE_HEIGHT, 0.0), (x, EYE_HEIGHT - 2.0, -100.0))
        return standing(parts, view, lens=lens, lights=lights, sky=sky)

    return parts, at


@register(
    "starry",
    "Posts under a sky full of stars, from a camera that turns, rolls and walks",
    (Effect.CAMERA, Effect.DISOCCLUSION, Effect.THIN, Effect.SKY),
)
def starry(seed: int) -> Staging:
    """Turn and walk under the stars: only the turn moves them."""
    rng = np.random.default_rng(seed)
    ground = matt(textures.mottle(rng, (0.02, 0.03, 0.03), (0.10, 0.11, 0.09), 16))
    timber = matt(textures.planks(rng, (0.24, 0.18, 0.12)))
    posts = [
        meshes.bar((x, 0.0, z), (x + lean, 3.2, z), 0.07, 8)
        for x, z, lean in zip(rng.uniform(-7, 7, 16), rng.uniform(-12, -3, 16), rng.uniform(-0.3, 0.3, 16), strict=True)
    ]
    parts = (Part("ground", meshes.floor(200.0, 3.0, 32), ground), Part("posts", meshes.merge(posts), timber))
    phase = float(rng.random()) * SWING

    def at(time: float) -> Instant:
        now = time + phase
        pan = animation.rotation(animation.UP, STARS_TURN * animation.swing(now, SWING))
        roll = animation.rotation((0.0, 0.0, 1.0), STARS_TURN * animation.swing(now, 0.7 * SWING))
        x = REACH * animation.swing(now, SWING)
        view = roll @ pan @ animation.look_at((x, 1.6, 2.0), (x, 3.4, -6.0))
        return standing(parts, view, lens=NIGHT_LENS, lights=(MOON,), sky=NIGHT)

    return parts, at
