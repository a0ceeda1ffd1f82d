"""Where light may change: what has just come into view shows itself, and nothing of what stood before it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.build import Build
from cltaa.core.constants import CONSTANTS
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.reference.launcher import NumpyLauncher
from cltaa.reference.real import Array
from cltaa.reference.span_recursive import recursive_share
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 40, 30
WALL, THING = 0.4, 0.1  # mean of the wall, of which each sample is off by 0.3, and all of the thing before it
DECLARED = frozenset({Effect.SHADING, Effect.MOTION, Effect.UNCOVER})


def before_a_wall(index: int, edge: int, thing: float = THING, motion_px: float = float("nan")) -> Frame:
    """A thing from the left to column ``edge`` before a wall, whose samples are of one of two colours by chance."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=DECLARED)
    chance = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    covered = (np.arange(WIDTH) < edge)[None, :]
    colour = np.where(covered[..., None], thing, np.where(chance, WALL + 0.3, WALL - 0.3))
    motion = np.full((HEIGHT, WIDTH, 2), motion_px, np.float32)
    depth = np.where(covered, 3.0, 5.0) * np.ones((HEIGHT, 1))
    return replace(
        frame, colour=(colour * np.ones(3)).astype(np.float32), depth=depth.astype(np.float32), motion=motion
    )


def test_of_a_thing_that_draws_back_nothing_stays_before_what_it_uncovers() -> None:
    resolver, shown = Resolver(override(load_preset("t5"), {"frames_kept": 9})), []
    for index in range(12):
        edge = WIDTH - 4 - 2 * index
        resolved = resolver.resolve(before_a_wall(index, edge))
        if index > 4:
            # Its 3x3 shows the wall alone. The texel right of it did so in the frame before, it did not itself.
            shown.append(resolved[:, edge + 1])
    # Half of what a mean of 210 values of such a spread is off by; with what recurs there it was 0.10 darker.
    assert abs(float(np.mean(shown)) - WALL) < 0.04


def test_what_stood_at_a_place_is_not_counted_for_what_has_come_there() -> None:
    preset = override(load_preset("t5"), {"frames_kept": 9})
    device, twin = Resolver(preset, strict=True), Resolver(preset, "numpy")
    for index in range(11):
        frame = before_a_wall(index, WIDTH if index < 10 else 0, thing=0.8 * WALL, motion_px=1.5)
        assert (bits(device.resolve(frame)) == bits(twin.resolve(frame))).all()
    assert twin.last is not None
    with twin.last.arguments["output_count"].mapped(write=False) as count:
        # One sample there is, and ten lie nearer to it than the mean of those around it.
        assert np.allclose(twin.last.layout.inside(count), 1.0, atol=1e-6)


@pytest.mark.parametrize("device", ["numpy", None])
def test_a_mask_of_nothing_leaves_the_bits_of_no_mask_where_a_thing_draws_back(device: str | None) -> None:
    preset, empty = override(load_preset("t5"), {"frames_kept": 9}), np.zeros((HEIGHT, WIDTH), np.float32)
    bare, masked = (Resolver(preset, device, strict=True) for _ in range(2))
    for index in range(12):
        frame = replace(before_a_wall(index, WIDTH - 4 - 2 * index), effects=DECLARED | {Effect.REACTIVE})
        assert (bits(masked.resolve(replace(frame, reactive=empty))) == bits(bare.resolve(frame))).all()


class Counting(NumpyLauncher):
    """Notes for each frame how many samples the shortest of its spans says that it has."""

    def __init__(self) -> None:
        self.counts: list[Array] = []

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        super().run(kernel, build, layout, arguments)
        if kernel == "gather_spans":
            self.counts.append(layout.inside(arguments["spans"].array)[4].copy())


def test_what_a_veil_comes_over_was_seen_by_the_latest_frames_all_the_same() -> None:
    bare, veiled, preset = Counting(), Counting(), override(load_preset("t5"), {"frames_kept": 9})
    resolvers = {share: Resolver(preset, on) for share, on in ((0.0, bare), (0.7, veiled))}
    for index in range(8):
        for share, resolver in resolvers.items():
            mask = np.full((HEIGHT, WIDTH), share * (index == 7), np.float32)
            frame = replace(before_a_wall(index, 20), effects=DECLARED | {Effect.REACTIVE}, reactive=mask)
            resolver.resolve(frame)
    assert bare.counts[-1].max() > 3.9  # the latest three and the current one
    # A sample counts for less or for nothing, and has been seen nonetheless.
    assert np.allclose(veiled.counts[-1], bare.counts[-1], rtol=1e-6)


def test_a_recursive_result_of_what_the_latest_frames_did_not_show_is_left_out() -> None:
    latest = CONSTANTS["HARDLY_SEEN"].value + np.array([[-0.5, 0.0, 0.5, 1.0, 2.0]], np.float32)
    for recursive, spans, whole in ((2.0, 1.0, 0.85), (32.0, 32.0, 0.25)):
        share = recursive_share(np.full_like(latest, recursive), np.full_like(latest, spans), latest)
        assert np.allclose(share, whole * np.array([[0.0, 0.0, 0.5, 1.0, 1.0]]), atol=1e-6)
