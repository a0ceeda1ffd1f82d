"""See-through surfaces, whose motion no channel can hold: panes and smoke before a wall."""

from __future__ import annotations

import numpy as np

from cltaa.frames import Effect
from cltaa_datasets import animation, meshes
from cltaa_datasets.registry import Staging, register
from cltaa_datasets.scene import AlphaMode, Instant, Material, Part
from cltaa_datasets.sets import gallery, standing

PANES = (  # colour and opacity, place, metres either way, period
    ((0.75, 0.12, 0.10, 0.45), (-0.9, 0.35, 0.9), 0.7, 2.6),
    ((0.10, 0.55, 0.20, 0.30), (0.5, 0.55, 1.2), 0.6, 3.4),
    ((0.10, 0.20, 0.75, 0.60), (0.2, 0.2, 0.6), 0.9, 4.2),
)


@register("panes", "Coloured panes of glass slide before a still gallery", (Effect.REACTIVE,))
def panes(seed: int) -> Staging:
    """Depth and motion stay those of the wall behind; the channel ``reactive`` says how much is the glass's."""
    rng = np.random.default_rng(seed)
    phase = rng.random(len(PANES))
    glass = tuple(
        Part(
            f"pane {i}",
            meshes.sheet((-0.4, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 1.4, 0.0)),
            Material(base_colour=colour, specular=0.0, alpha_mode=AlphaMode.BLEND, double_sided=True),
        )
        for i, (colour, *_) in enumerate(PANES)
    )
    parts = (*glass, *gallery(seed))

    def at(time: float) -> Instant:
        slid = tuple(
            animation.translation((x + reach * animation.swing(time, period, float(phase[i])), y, z))
            for i, (_, (x, y, z), reach, period) in enumerate(PANES)
        )
        return standing(parts, moving=slid)

    return parts, at
