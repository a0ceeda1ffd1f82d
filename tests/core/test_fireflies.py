"""Fireflies: what is dimmed where that is asked for, and what is a highlight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Frame
from cltaa.inputs.open import open_input
from cltaa.pipeline.folder import with_fireflies
from tests.inputs.foreign import write_blender
from tests.sequence_factory import bits, make_frame

PLACE = (11, 17)
CLAMP = {"fireflies": "clamp"}
Texel = tuple[int, int]


def standing(index: int, *bright: Texel) -> Frame:
    """Light from 1 to 2 that stands on a wall that stands, 60000 at some texels."""
    frame = make_frame(0, jitter_px=(0.0, 0.0), effects=None)
    colour = np.float32(1) + frame.colour / np.float32(4)
    for texel in bright:
        colour[texel] = 60000.0
    return replace(frame, index=index, colour=colour, depth=np.full_like(frame.depth, 4.0))


@pytest.mark.parametrize("preset", ["default", "fast"])
def test_a_firefly_adds_nothing_to_the_history(preset: str) -> None:
    resolver = Resolver(override(load_preset(preset), CLAMP), "numpy")
    for index in range(3):
        before = resolver.resolve(standing(index))
    assert np.array_equal(bits(resolver.resolve(standing(3, PLACE))[PLACE]), bits(before[PLACE]))


def test_two_fireflies_side_by_side_add_nothing_to_the_filtered_samples_around_them() -> None:
    resolver, (y, x) = Resolver(override(load_preset(), {**CLAMP, "weighting": "none"}), "numpy"), PLACE
    resolver.resolve(standing(0))
    image = resolver.resolve(standing(1, PLACE, (y, x + 1)))
    assert image.max() <= 2.0  # the brightest light there


def test_a_first_firefly_is_as_bright_as_the_second_brightest_around_it() -> None:
    sharp = override(load_preset(), {**CLAMP, "current_filter": "none"})
    image = Resolver(sharp, strict=True).resolve(standing(0, PLACE))
    around = standing(0).colour[PLACE[0] - 1 : PLACE[0] + 2, PLACE[1] - 1 : PLACE[1] + 2] @ [0.25, 0.5, 0.25]
    around[1, 1] = 0.0
    assert image[PLACE] @ [0.25, 0.5, 0.25] == pytest.approx(np.sort(around.ravel())[-2], rel=2.0**-20)


def test_what_fills_more_texels_or_frames_is_a_highlight() -> None:
    y, x = PLACE
    keep, clamp = (Resolver(override(load_preset(), change), "numpy") for change in ({}, CLAMP))
    square = [(y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)]
    for index in range(3):
        frame = standing(index, *square)
        kept, clamped = (resolver.resolve(frame)[y : y + 2, x : x + 2] for resolver in (keep, clamp))
        assert np.array_equal(bits(kept), bits(clamped))
    # It stands in the history by now: what is left of it alone is no firefly.
    assert clamp.resolve(standing(3, PLACE))[PLACE].min() > 1000


def test_the_profile_says_what_becomes_of_them(tmp_path: Path) -> None:
    write_blender(tmp_path, [make_frame(index, motion=True) for index in range(2)])
    sequence = open_input(tmp_path)

    def said(preset: str, asked: str | None = None) -> str:
        changed: Preset = with_fireflies(load_preset(preset), sequence, asked)
        return changed.choices.fireflies.value

    assert [said(name) for name in ("default", "fast", "karis", "gather-8")] == ["clamp", "clamp", "keep", "keep"]
    assert [said("default", "keep"), said("karis", "clamp")] == ["keep", "clamp"]
    with pytest.raises(UsageError, match="preset gather-8 gathers"):
        said("gather-8", "clamp")
