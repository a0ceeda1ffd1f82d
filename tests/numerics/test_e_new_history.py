"""Failure modes of beginning anew: what is dropped is never looked at. docs/numerics.md, E5."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.build import Storage
from cltaa.core.presets import override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect
from cltaa.opencl.launcher import DeviceLauncher
from tests.numerics.still_frames import still_frame, unfiltered
from tests.sequence_factory import bits, make_frame

HEIGHT, WIDTH = 96, 128
POISON = np.array([np.nan, np.inf, -np.inf, 1e30, -3e38], np.float32)


def poison(resolver: Resolver) -> None:
    """Fill what a resolver hands on from frame to frame with what is NaN, or no light."""
    random = np.random.default_rng(46)
    _, memory = resolver.recurrent()
    for buffer in memory.values():
        with buffer.mapped(write=True) as planes, np.errstate(over="ignore"):
            planes[...] = random.choice(POISON, planes.shape).astype(planes.dtype)


@pytest.mark.parametrize("storage", [Storage.FLOAT, Storage.HALF])
@pytest.mark.parametrize("why", ["cut", "gap", "reset", "size"])
def test_e5_a_new_history_never_looks_at_the_old_one(launcher: DeviceLauncher, why: str, storage: Storage) -> None:
    resolver = Resolver(unfiltered(), launcher, strict=True, storage=storage)
    frames = [make_frame(i, alpha=True, effects=None) for i in range(3)]
    for frame in frames[:2]:
        resolver.resolve(frame)
    poison(resolver)
    if why == "reset":
        resolver.reset()
    if why == "size":
        frames[2] = make_frame(2, width=WIDTH, height=HEIGHT, alpha=True, effects=None)
    last = replace(frames[2], cut=why == "cut", index=7 if why == "gap" else 2)
    resolved = resolver.resolve(last)
    assert last.alpha is not None
    expected = np.dstack([last.colour, last.alpha])
    if storage is Storage.HALF:
        expected = expected.astype(np.float16).astype(np.float32)
    assert np.array_equal(bits(resolved), bits(expected))


@pytest.mark.parametrize("effects", [None, frozenset(Effect)], ids=["undeclared", "light"])
def test_e5_a_filtered_cut_never_looks_at_the_old_history(
    launcher: DeviceLauncher, effects: frozenset[Effect] | None
) -> None:
    # The first frame after a cut is filtered: to the same bits whatever was before, and of nothing but itself. Where
    # light may change, what was before is compared with what is now.
    cut = replace(make_frame(2, alpha=True, effects=effects), cut=True)
    results = []
    for seed, poisoned in ((1, False), (2, False), (3, True)):  # undeclared as planned, else with every step
        resolver = Resolver(device=launcher, strict=True, every_step=effects is not None)
        for index in range(2):
            resolver.resolve(make_frame(index, alpha=True, effects=effects, seed=seed))
        if poisoned:
            poison(resolver)
        results.append(bits(resolver.resolve(cut)))
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])
    assert not np.array_equal(results[0][..., :3], bits(cut.colour))


def test_e5_even_history_that_is_used_may_be_poisoned(launcher: DeviceLauncher) -> None:
    # Not by this program; but nothing of it may reach the picture, or stay.
    resolver = Resolver(device=launcher, strict=True, every_step=True)
    frames = [make_frame(i, alpha=True, effects=None) for i in range(4)]
    for frame in frames[:2]:
        resolver.resolve(frame)
    _, memory = resolver.recurrent()
    with memory["history"].mapped(write=True) as planes:
        planes[...] = np.random.default_rng(47).choice(POISON, planes.shape)
    for frame in frames[2:]:
        resolved = resolver.resolve(frame)
        assert np.isfinite(resolved).all()
        assert np.abs(resolved).max() <= 8.0  # twice the factory's largest colour


@pytest.mark.parametrize("by", ["weight", "mask"])
def test_e5_a_full_weight_never_looks_at_poison(launcher: DeviceLauncher, by: str) -> None:
    changes = {"accumulate": "exponential", "blend_weight": 1.0} if by == "weight" else {}
    resolver = Resolver(override(unfiltered(), {**changes, "disocclusion_blur": 0.0}), launcher, strict=True)
    frames = [make_frame(i, alpha=True, effects=None) for i in range(3)]
    share = np.ones(frames[0].depth.shape, np.float32)
    for frame in frames[:2]:
        resolver.resolve(replace(frame, reactive=share if by == "mask" else None))
    _, memory = resolver.recurrent()
    for buffer in memory.values():
        with buffer.mapped(write=True) as planes:
            planes[...] = np.random.default_rng(49).choice(POISON, planes.shape)
    last = replace(frames[2], reactive=share if by == "mask" else None)
    assert last.alpha is not None
    assert np.array_equal(bits(resolver.resolve(last)), bits(np.dstack([last.colour, last.alpha])))


def test_e5_a_full_weight_takes_the_sample_as_it_is() -> None:
    # h + 1 (x - h) is 0 for h = 1e8 and x = 1.1: a weight of 1 has to select.
    for changes, channels in (
        ({"accumulate": "exponential", "blend_weight": 1.0}, {}),
        ({}, {"reactive": np.ones((6, 9), np.float32)}),
    ):
        resolver = Resolver(override(unfiltered(), {**changes, "rectify": "none"}), "numpy")
        bright, dim = np.full((6, 9, 3), 1e8, np.float32), np.full((6, 9, 3), 1.1, np.float32)
        resolver.resolve(still_frame(0, bright, effects=None, alpha=np.ones((6, 9), np.float32), **channels))
        third = np.full((6, 9), 1 / 3, np.float32)
        resolved = resolver.resolve(still_frame(1, dim, effects=None, alpha=third, **channels))
        assert np.array_equal(bits(resolved), bits(np.dstack([dim, third])))
