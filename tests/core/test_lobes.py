"""A highlight no wider than a pixel, read between texels: what its filter's negative lobes may take beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from tests.sequence_factory import make_camera, make_frame

WIDTH, HEIGHT = 24, 16
WALL, HIGHLIGHT = np.float32(0.2), np.float32(20.0)
SLIDE = np.array((0.5, 0.25), np.float32)


def wall(index: int, light: np.float32, highlight: np.float32) -> Frame:
    """A plain wall that slides by parts of a pixel, of a light that may change, with a highlight on one pixel."""
    frame = make_frame(
        index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=frozenset({Effect.SHADING, Effect.MOTION})
    )
    colour = np.full((HEIGHT, WIDTH, 3), light, np.float32)
    colour[HEIGHT // 2, WIDTH // 2] = highlight
    motion = np.broadcast_to(SLIDE, (HEIGHT, WIDTH, 2)).copy()
    return replace(frame, colour=colour, depth=np.full((HEIGHT, WIDTH), 5.0, np.float32), motion=motion)


def after_a_highlight(light: np.float32, highlight: np.float32, **settings: float | str) -> Image:
    """The wall in the frame after that of the highlight, of a history that no box holds."""
    resolver = Resolver(override(load_preset(), {"rectify": "none", **settings}), "numpy")
    resolver.resolve(wall(0, light, highlight))
    return resolver.resolve(wall(1, light, light))


@pytest.mark.parametrize("floor", [0.0, 0.5, 1.0])
def test_nothing_beside_a_highlight_is_darker_than_a_share_of_what_was_there(floor: float) -> None:
    assert after_a_highlight(WALL, HIGHLIGHT, light_change="ignore").min() == 0.0  # what would be negative
    assert after_a_highlight(WALL, HIGHLIGHT, lobe_floor=floor).min() >= floor * WALL * (1 - 1e-6)


def test_it_takes_nothing_off_the_highlight() -> None:
    held, free = (after_a_highlight(WALL, HIGHLIGHT, lobe_floor=floor) for floor in (1.0, 0.0))
    brighter = free > WALL
    assert brighter.any()
    assert (held[brighter] == free[brighter]).all()


def test_half_of_the_least_never_lifts_a_read_without_lobes() -> None:
    # The nearest row has half of the weight at least, here beside a black texel of the other.
    kept, free, lifted = (
        after_a_highlight(WALL, np.float32(0.0), lobe_floor=floor, history_filter="bilinear")
        for floor in (0.5, 0.0, 1.0)
    )
    assert (kept == free).all()
    assert (lifted != free).any()


def test_negative_light_may_be_as_low_as_it_was() -> None:
    plain = np.float32(-0.3)
    assert (after_a_highlight(plain, plain) == plain).all()
