"""Scenes with one camera move each, in the same gallery: pan, dolly, roll, zoom, parallel lens, halt, cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Lens, Matrix, Orthographic, Perspective
from cltaa_datasets.sets import LENS, VIEW, gallery, slid, standing

SLOW, QUICK = 4.0, 2.4  # periods of swings in seconds
PAN = np.radians(7.0)  # either way
ROLL = np.radians(12.0)
ZOOM = 0.25  # share of the field of view, either way
DOLLY = 0.8  # metres, either way
STRIDE = 0.5  # seconds that the halting camera walks, and as long that it stands
SHOT = 0.4  # length of a shot in seconds
PARALLEL = Orthographic(half_height=1.3, near=0.5, far=12.0)


def _filmed(seed: int, camera: Callable[[float], tuple[Matrix, Lens]]) -> Staging:
    """Stage the gallery, filmed by ``camera(time)``; the seed also changes the start of its swing."""
    parts = gallery(seed)
    start = float(np.random.default_rng(seed).random()) * SLOW

    def at(time: float) -> Instant:
        view, lens = camera(time + start)
        return standing(parts, view, lens=lens)

    return parts, at


@register("pan", "A camera on a tripod turns from side to side", (Effect.CAMERA,))
def pan(seed: int) -> Staging:
    """Turn about the vertical: no parallax, nothing disoccluded."""
    return _filmed(seed, lambda t: (animation.rotation(animation.UP, PAN * animation.swing(t, SLOW)) @ VIEW, LENS))


@register("roll", "A camera turns about the axis of its lens", (Effect.CAMERA,))
def roll(seed: int) -> Staging:
    """Turn about the view axis: fast motion at the edges, none in the middle."""
    return _filmed(seed, lambda t: (animation.rotation((0.0, 0.0, 1.0), ROLL * animation.swing(t, SLOW)) @ VIEW, LENS))


@register("zoom", "A still camera zooms in and out", (Effect.CAMERA,))
def zoom(seed: int) -> Staging:
    """Change only the projection."""
    return _filmed(seed, lambda t: (VIEW, Perspective(LENS.field_of_view * (1.0 + ZOOM * animation.swing(t, SLOW)))))


@register("dolly", "A camera slides to and fro past the things before a wall", (Effect.CAMERA, Effect.DISOCCLUSION))
def dolly(seed: int) -> Staging:
    """Slide sideways and forward: parallax, and disocclusion behind every exhibit."""
    return _filmed(
        seed, lambda t: (slid(DOLLY * animation.swing(t, SLOW), -0.5 * DOLLY * animation.swing(t, QUICK)), LENS)
    )


@register("parallel", "A camera with a parallel lens slides to and fro", (Effect.CAMERA, Effect.DISOCCLUSION))
def parallel(seed: int) -> Staging:
    """Slide and turn a little under an orthographic projection, where a slide moves all depths equally."""

    def camera(time: float) -> tuple[Matrix, Lens]:
        turn = animation.rotation(animation.UP, 0.5 * PAN * animation.swing(time, QUICK))
        return turn @ slid(0.5 * DOLLY * animation.swing(time, SLOW)), PARALLEL

    return _filmed(seed, camera)


@register("halt", "A camera that walks, stands, and walks on", (Effect.CAMERA, Effect.DISOCCLUSION))
def halt(seed: int) -> Staging:
    """Walk for half a second, stand for as long: between its steps the camera matrices are equal to the bit."""
    parts = gallery(seed)
    start = float(np.random.default_rng(seed).uniform(-DOLLY, 0.0))

    def at(time: float) -> Instant:
        steps, rest = divmod(time, 2.0 * STRIDE)
        return standing(parts, slid(start + DOLLY * (steps * STRIDE + min(rest, STRIDE))))

    return parts, at


@register("cut", "Three standing cameras, cut from one to the next", (Effect.CAMERA, Effect.CUT))
def cut(seed: int) -> Staging:
    """Jump to another view every 0.4 seconds; within a shot nothing moves."""
    parts = gallery(seed)
    views = (
        VIEW,
        animation.look_at((-1.2, 0.7, 2.4), (0.0, 1.1, -1.5)),
        animation.look_at((1.3, 2.0, 2.4), (0.2, 1.0, -1.5)),
    )
    first = int(np.random.default_rng(seed).integers(len(views)))

    def at(time: float) -> Instant:
        shot = animation.whole_periods(time, SHOT)
        return standing(parts, views[(first + shot) % len(views)], shot=shot)

    return parts, at
