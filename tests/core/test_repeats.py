"""Samples that repeat the jitter of earlier ones: they tell light that stands from light that came back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from tests.core.test_spans import WIDTH, lit
from tests.sequence_factory import bits


def test_each_of_the_latest_frames_is_told_the_frame_that_repeats_it() -> None:
    jitters = [(0.4, 0.0), (0.1, 0.3), (-0.3, 0.2), (0.3, -0.3), *((-0.4, -0.4 + 0.2 * k) for k in range(5))]
    again = [*jitters, (-0.3, 0.26), (0.4, 0.05)]
    preset = override(load_preset("t5"), {"frames_kept": 10})
    resolver = Resolver(preset, "numpy")
    for index, jitter in enumerate(again):
        resolver.resolve(replace(lit(index, 1.0, 0.5), jitter_px=jitter))
        assert resolver.last is not None
        with resolver.last.arguments["past"].mapped(write=False) as told:
            records = told.copy()
        assert (records["again"][: min(index, 4)] >= 0).all() == (index in (0, 8, 9, 10))
    # The last repeats the first, ten frames ago, by 0.05 pixels; the one before it the third, seven frames before.
    assert list(records["again"][:2]) == [9, 7]


def flashing(index: int, moved_from: int = WIDTH) -> Frame:
    """Places in the pixels that come back after four frames, each with a colour of its own, under light that is three
    times as bright in frames 4 to 11; from a column on all moves along itself."""
    light = 3.0 if 4 <= index < 12 else 1.0
    frame = lit(index, light, 0.0)
    colour = light * np.random.default_rng(index % 4).uniform(0.2, 0.6, frame.colour.shape)
    assert frame.motion is not None
    motion = np.full_like(frame.motion, np.nan)
    motion[:, moved_from:] = 1.5, 0.0
    beside = (0.0, 0.004, -0.004, 0.0, 0.0)[index // 4]  # those of the bright frames lie nearest to those of the others
    return replace(frame, colour=colour.astype(np.float32), motion=motion, jitter_px=(0.1 * (index % 4) + beside, 0.0))


def test_light_that_came_back_is_not_taken_for_light_that_stood() -> None:
    resolver = Resolver(override(load_preset("t5"), {"current_filter": "none", "frames_kept": 19}))
    for index in range(20):
        resolved = resolver.resolve(flashing(index))
    four = np.mean([flashing(index).colour for index in range(16, 20)], 0)
    # The latest four repeat those before them; the mean of all is 1.8 times as bright.
    assert float((resolved / four).mean()) == pytest.approx(1.0, abs=0.1)


def test_what_moves_along_itself_is_asked_of_the_latest_samples_alone() -> None:
    preset = override(load_preset("t5"), {"frames_kept": 19})
    device, twin = Resolver(preset, strict=True), Resolver(preset, "numpy")
    for index in range(20):
        frame = flashing(index, moved_from=WIDTH // 2)
        assert (bits(device.resolve(frame)) == bits(twin.resolve(frame))).all()
