"""The promises about numbers, of every tier as it is shipped and planned: gathered or not, light tested for or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.parameters import Box, Illumination, Rectify
from cltaa.core.presets import LADDER, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.test_resolve import hard_frames, turned
from tests.numerics.still_frames import still_frame
from tests.sequence_factory import bits, make_frame

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
    if declared == "everything" and tier.choices.rectify is not Rectify.NONE:  # a box that noise widens
        illumination = Illumination.TEST
    assert choices.illumination is illumination


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
        effects = DECLARED[declared]
        standing = None if effects is None else effects - {Effect.CAMERA}
        for index in range(5):
            resolved = resolver.resolve(still_frame(index, image, effects=standing))
            assert np.array_equal(bits(resolved), bits(image)), declared
        check_plan(resolver, declared)


@pytest.mark.parametrize("tier", TIERS)
def test_g6_twice_the_light_gives_twice_the_picture_in_every_tier(tier: str) -> None:
    for declared in DECLARED:
        preset, factors = override(load_preset(tier), {"weighting": "none"}), [1.0, 2.0**-30, 2.0**30]
        resolvers = [Resolver(preset, "numpy") for _ in factors]
        for frame in moving(4, declared):
            lit = [replace(frame, colour=frame.colour * np.float32(factor)) for factor in factors]
            plain, *others = (resolver.resolve(each)[..., :3] for resolver, each in zip(resolvers, lit, strict=True))
            for factor, image in zip(factors[1:], others, strict=True):
                assert np.array_equal(bits(image), bits(plain * np.float32(factor))), declared
        check_plan(resolvers[0], declared)


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
