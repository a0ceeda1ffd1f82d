"""Test charts: text, zone plate and edges at 45 degrees, still and drifting, and shapes on a transparent ground."""

from __future__ import annotations

import numpy as np

from cltaa.frame import Effect
from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import Instant, Orthographic, Part, emitting
from cltaa_datasets.scenes.plants import hedge
from cltaa_datasets.sets import exhibits, standing

HALF = 1.0  # half the height of the picture in metres
LENS = Orthographic(HALF, 1.0, 9.0)
VIEW = animation.look_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
DRIFT = 0.11  # metres per second along the diagonal: about half a pixel per frame at 360 rows
TILT = np.radians(45.0)
WHITE = (1.0, 1.0, 1.0)  # emitted, so that a print does not depend on the light


def chart(seed: int) -> tuple[Part, ...]:
    """Return a page of text, a zone plate and a checkerboard, each turned by 45 degrees, over a plain grey ground."""
    rng = np.random.default_rng(seed)
    square = meshes.sheet((-0.42, -0.42, 0.0), (0.84, 0.0, 0.0), (0.0, 0.84, 0.0))
    printed = {
        "text": (-1.18, textures.lettering(rng, (0.03, 0.03, 0.04), (0.88, 0.87, 0.83), 22)),
        "zone plate": (0.0, textures.zone_plate()),
        "checkers": (1.18, textures.checker((0.85, 0.83, 0.8), (0.05, 0.05, 0.06), 16, rng)),
    }
    tilt = animation.rotation((0.0, 0.0, 1.0), TILT)
    sheets = tuple(
        Part(name, meshes.moved(square, animation.translation((x, 0.0, 0.1 * i)) @ tilt), emitting(WHITE, texture))
        for i, (name, (x, texture)) in enumerate(printed.items(), start=1)
    )
    ground = textures.mottle(rng, (0.20, 0.20, 0.21), (0.26, 0.26, 0.27))
    plane = meshes.sheet((-6.0, -6.0, 0.0), (12.0, 0.0, 0.0), (0.0, 12.0, 0.0), (6.0, 6.0))
    return (Part("ground", plane, emitting(WHITE, ground)), *sheets)


@register("charts", "Text, zone plate and checkers at 45 degrees, still", ())
def charts(seed: int) -> Staging:
    """Stage the chart before a still camera: nothing changes."""
    parts = chart(seed)
    now = standing(parts, VIEW, lens=LENS, lights=())
    return parts, lambda _: now


@register("charts_drift", "The charts under a camera that drifts along the diagonal", (Effect.CAMERA,))
def charts_drift(seed: int) -> Staging:
    """Move by a fraction of a pixel per frame, along the edges and across them."""
    parts = chart(seed)

    def at(time: float) -> Instant:
        along = DRIFT * time * np.sqrt(0.5)
        view = animation.translation((-along, along, 0.0)) @ VIEW
        return standing(parts, view, lens=LENS, lights=())

    return parts, at


@register("silhouettes", "Leaves, a lattice and a knot on a transparent ground, still", (Effect.ALPHA, Effect.THIN))
def silhouettes(seed: int) -> Staging:
    """Leave out the background, so that coverage must be anti-aliased."""
    parts = (*hedge(seed)[:1], *exhibits(np.random.default_rng(seed)))
    now = standing(parts, sky=None)
    return parts, lambda _: now
