"""``accumulate = capped``: a history gains weight with its samples, in motion no more than makes moving_weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from tests.sequence_factory import make_camera, make_frame

PLAIN = {"rectify": "none", "tonemap": "none", "current_filter": "none", "dilation": "none", "reject": "none"}
LEAST, MOST, SAMPLES = 0.0442, 0.2357, 3


@pytest.mark.parametrize("device", [None, "numpy"])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_the_weight_of_a_sample_is_the_formulas(speed: float, device: str | None) -> None:
    resolver = Resolver(override(load_preset("fsr3-like"), PLAIN | {"motion_widths": 0.0}), device, every_step=True)
    odds = LEAST / (1 - LEAST)
    cap = odds * (1 - MOST) / MOST
    expected = 0.0
    for index in range(6):
        frame = make_frame(index, motion=True, camera=make_camera(), effects=None)
        motion = np.full((*frame.depth.shape, 2), (speed, 0.0), np.float32)
        flat = np.full_like(frame.colour, 1.0 if index else 0.0)
        resolved = resolver.resolve(replace(frame, colour=flat, motion=motion))
        if index:
            held = min(index / SAMPLES, 1.0)
            history = min(held, cap) if speed else held
            expected += odds / (odds + history) * (1.0 - expected)
        # A dozen roundings of numbers up to 1, on the way from the left edge, where history ends, to the middle.
        assert abs(float(resolved[10, 12, 0]) - expected) <= 12 * 2.0**-24
