"""The promises about numbers, of every tier as it is shipped and planned: gathered or not, light tested for or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.parameters import Box, Illumination
from cltaa.core.presets import LADDER, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.test_resolve import hard_frames, turned
from tests.numerics.still_frames import still_frame
from tests.sequence_factory import any_bits, bits, make_frame

WIDTH, HEIGHT = 28, 24
TIERS = LADDER
# Light is tested for unless what is declared rules out that history is wrong.
DECLARED: dict[str, frozenset[Effect] | None] = {
    "nothing": None,
    "everything": frozenset(Effect),
    "no light": frozenset(Effect) - {Effect.ILLUMINATION, Effect.REACTIVE, Effect.EXPOSURE, Effect.MOTION, Effect.THIN},
}


def moving(count: int, declared: str) -> Iterator[Frame]:
    """Random frames with every channel, under a camera that turns, zooms and moves."""
    for index in range(count):
        yield make_frame(
            index,
            width=WIDTH,
            height=HEIGHT,
            motion=True,
            alpha=True,
            reactive=declared != "no light",
            camera=turned(index, WIDTH, HEIGHT),
            effects=DECLARED[declared],
        )


def check_plan(resolver: Resolver, declared: str) -> None:
    """That the test looks at what it is for."""
    assert resolver.plan is not None
    choices, tier = resolver.plan.choices, resolver.preset
    assert choices.history is tier.choices.history
    illumination = Illumination.STATIC if declared == "no light" else tier.choices.illumination
    assert choices.illumination is illumination


@pytest.mark.parametrize("tier", TIERS)
def test_a1_any_bits_give_finite_output_in_every_tier(tier: str) -> None:
    for declared in DECLARED:
        random, resolver = np.random.default_rng(71), Resolver(tier, "numpy")

        for frame in moving(4, declared):
            planes = {name: getattr(frame, name) for name in ("colour", "depth", "motion", "alpha", "reactive")}
            channels: dict[str, Any] = {name: any_bits(random, p) for name, p in planes.items() if p is not None}
            assert np.isfinite(resolver.resolve(replace(frame, **channels))).all(), declared
        check_plan(resolver, declared)


@pytest.mark.parametrize("tier", TIERS)
def test_e1_a_constant_picture_keeps_its_bits_in_every_tier(tier: str) -> None:
    for declared in DECLARED:
        resolver, colour = Resolver(tier, "numpy"), np.array([0.1, 3.7, 2e-5], np.float32)
        for frame in moving(5, declared):
            share = None if frame.alpha is None else np.full_like(frame.alpha, 1 / 3)
            flat = replace(frame, colour=np.broadcast_to(colour, frame.colour.shape).copy(), alpha=share)
            resolved = resolver.resolve(flat)
            assert np.array_equal(bits(resolved[..., :3]), bits(flat.colour)), declared
            assert (resolved[..., 3] == np.float32(1 / 3)).all(), declared
        check_plan(resolver, declared)


@pytest.mark.parametrize("tier", [tier for tier in TIERS if load_preset(tier).choices.box is Box.EXTREMES])
def test_e1_equal_frames_give_equal_bits_in_every_tier(tier: str) -> None:
    # Without what filters a sample for itself, which leaves nothing but a flat picture as it is. A box of deviations,
    # that of tier 2, leaves out what lies beyond them, be it the history of a texel that stays as it is.
    for declared in DECLARED:
        image = (10.0 ** np.random.default_rng(72).uniform(-4, 4, (HEIGHT, WIDTH, 3))).astype(np.float32)
        resolver = Resolver(override(load_preset(tier), {"current_filter": "none", "disocclusion_blur": 0.0}), "numpy")
        for index in range(5):
            resolved = resolver.resolve(still_frame(index, image, effects=DECLARED[declared]))
            assert np.array_equal(bits(resolved), bits(image)), declared
        check_plan(resolver, declared)


@pytest.mark.parametrize("tier", TIERS)
def test_g6_twice_the_light_gives_twice_the_picture_in_every_tier(tier: str) -> None:
    for declared in DECLARED:
        plain, brighter = (Resolver(override(load_preset(tier), {"weighting": "none"}), "numpy") for _ in range(2))
        factor = np.float32(2.0**7)
        for frame in moving(4, declared):
            resolved, twice = plain.resolve(frame), brighter.resolve(replace(frame, colour=frame.colour * factor))
            assert np.array_equal(bits(twice[..., :3]), bits(resolved[..., :3] * factor)), declared
        check_plan(plain, declared)


@pytest.mark.parametrize(
    ("tier", "declared"),
    [
        ("default", "everything"),
        ("gather-48", "no light"),
        *(pytest.param(tier, declared, marks=pytest.mark.big) for tier in TIERS for declared in DECLARED),
    ],
)
def test_g1_every_tier_gives_the_bits_of_its_twin(launcher: DeviceLauncher, tier: str, declared: str) -> None:
    ours, theirs = Resolver(tier, launcher, strict=True), Resolver(tier, "numpy")
    for frame in hard_frames(WIDTH, HEIGHT, 5):
        given = replace(frame, effects=DECLARED[declared], reactive=None if declared == "no light" else frame.reactive)
        assert np.array_equal(bits(ours.resolve(given)), bits(theirs.resolve(given)))
    check_plan(ours, declared)
