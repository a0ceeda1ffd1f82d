"""Gathering samples: nothing is resampled, nothing spreads, and the state can be kept and restored."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from typing import Any
from weakref import finalize

import numpy as np
import pytest

from cltaa.core.parameters import HistoryKind, Illumination
from cltaa.core.plan import plan_frame
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.test_resolve import differing, hard_frames
from tests.sequence_factory import WIDTH, bits, make_camera, make_frame

KEPT = 5


def gathering(**changes: object) -> Preset:
    values: dict[str, object] = {"history": "frames", "history_frames": KEPT, "current_filter": "none", **changes}
    return override(load_preset(), values)


def still(index: int, effects: frozenset[Effect] | None = frozenset({Effect.DISOCCLUSION, Effect.SKY})) -> Frame:
    return make_frame(index, camera=make_camera(), effects=effects, jitter_px=(0.25 - 0.125 * (index % 4), 0.0))


@pytest.mark.parametrize(
    ("changes", "lanes"),
    [
        ({}, 8),
        ({"rectify": "none", "reject": "none"}, 8),
        ({"history_frames": 1, "weighting": "none", "alpha_from": "current"}, 1),
        ({"tonemap": "peak", "rectify": "ellipsoid", "box": "variance", "current_filter": "lanczos"}, 8),
    ],
)
def test_strict_kernel_is_its_twin(changes: dict[str, object], lanes: int) -> None:
    assert differing({"history": "frames", **changes}, list(hard_frames(count=4)), lanes, 7) == 0


def test_a_still_pixel_is_the_mean_of_its_kept_samples() -> None:
    # A slope damped to nothing, of the samples that the pixel itself rendered: a neighbour's lie at least 0.75 away.
    fit = {"fit_ridge": 2.0**20, "fit_reach": 0.5625, "subpixel_frames": 0, "edge_tolerance": 1.0}
    resolver = Resolver(gathering(weighting="none", reject="none", rectify="none", **fit), "numpy")
    frames = [still(index) for index in range(KEPT + 4)]
    for frame in frames:
        resolved = resolver.resolve(frame)
    mean = np.mean([frame.colour for frame in frames[-KEPT - 1 :]], axis=0, dtype=np.float64)
    # A sum of K differences, a quotient, a product and a sum: at most K + 3 roundings of values up to 4 (make_frame).
    # The slope moves each sample's share by its offset times the mean offset, 1/4 each, over the ridge.
    slope = (KEPT + 1) * 4 * 2 / 4**2 / 2.0**20
    assert np.abs(resolved - mean).max() <= (KEPT + 3) * 2.0**-24 * 4 * 2 + slope


def test_a_bad_texel_is_left_out_and_goes_nowhere() -> None:
    clean, dirty = Resolver(gathering(), "numpy"), Resolver(gathering(), "numpy")
    for index in range(4):
        frame = still(index)
        expected = clean.resolve(frame)
        if index == 1:
            colour = frame.colour.copy()
            colour[10, 12] = np.nan
            frame = replace(frame, colour=colour)
        resolved = dirty.resolve(frame)
        assert np.isfinite(resolved).all()
        different = (bits(resolved) != bits(expected)).any(axis=-1)
        # In its own frame the texel reaches the box of its 3x3; later only the pixels whose sample it was.
        reach = 1
        different[10 - reach : 11 + reach, 12 - reach : 13 + reach] = False
        assert not different.any(), index


@pytest.mark.parametrize(
    "after",
    [[make_frame(index, width=45, height=31) for index in (3, 4)], [replace(still(3), cut=True)]],
    ids=["another size", "a cut"],
)
def test_the_frame_ring_is_emptied_by(after: list[Frame]) -> None:
    resolver, fresh = Resolver(gathering(), "numpy"), Resolver(gathering(), "numpy")
    for index in range(3):
        resolver.resolve(still(index))
    for frame in after:
        assert (bits(resolver.resolve(frame)) == bits(fresh.resolve(frame))).all()


def test_samples_are_gathered_where_something_changes() -> None:
    for effects, expected in [
        (None, (HistoryKind.FRAMES, Illumination.WINDOW)),
        ({Effect.DISOCCLUSION}, (HistoryKind.FRAMES, Illumination.STATIC)),
        ({Effect.MOTION, Effect.DISOCCLUSION}, (HistoryKind.FRAMES, Illumination.WINDOW)),
        ({Effect.REACTIVE}, (HistoryKind.FRAMES, Illumination.WINDOW)),
        (set(), (HistoryKind.ACCUMULATED, Illumination.STATIC)),
    ]:
        frame = still(1, None if effects is None else frozenset(effects))
        plan = plan_frame(gathering(), frame, frame.camera)
        assert (plan.choices.history, plan.choices.illumination) == expected, effects
        assert ("gathering" in {reason.step for reason in plan.reasons}) is True, effects


def test_a_thin_thing_that_speeds_up_leaves_no_trace() -> None:
    # The pixels beside the bar follow its motion; they must follow the bar itself, wherever it was, and not their own
    # old samples, which lie on the wall and tell no motion.
    places = [4, 5, 7, 10, 14, 19, 25]
    resolver = Resolver(gathering(weighting="none", illumination="static"), "numpy")
    for index, x in enumerate(places):
        frame = make_frame(
            index, motion=True, camera=make_camera(), effects=frozenset({Effect.MOTION, Effect.DISOCCLUSION})
        )
        colour, depth = np.zeros_like(frame.colour), np.full_like(frame.depth, 5.0)
        motion = np.full((*depth.shape, 2), np.nan, np.float32)
        colour[:, x], depth[:, x] = 1.0, 2.0
        motion[:, x] = (places[max(index - 1, 0)] - x, 0.0)
        drawn = replace(frame, colour=colour, depth=depth, motion=motion, jitter_px=(0.0, 0.0))
        assert (resolver.resolve(drawn) == colour).all(), index


def test_frames_before_one_that_was_not_kept_are_not_gathered() -> None:
    """A shot in which nothing changes accumulates; when its light changes, no sample from before it is there."""
    light, nothing = frozenset({Effect.ILLUMINATION}), frozenset[Effect]()
    camera = make_camera()

    def grey(index: int, level: float, effects: frozenset[Effect], *, cut: bool = False) -> Frame:
        frame = make_frame(index, camera=camera, effects=effects, cut=cut)
        return replace(frame, colour=np.full_like(frame.colour, level), depth=np.full_like(frame.depth, 5.0))

    resolver = Resolver("gather-8", "numpy")
    for index in range(5):
        resolver.resolve(grey(index, 9.0, light))
    shot = grey(5, 1.0, nothing, cut=True), grey(6, 1.0, nothing), grey(7, 1.0, light)
    assert all((resolver.resolve(frame) == 1.0).all() for frame in shot)


def test_a_ring_of_changed_steps_can_be_restored() -> None:
    frames = [
        make_frame(0),
        replace(make_frame(2), step=2),
        make_frame(3),
        make_frame(4),
        replace(make_frame(6), step=2),
    ]
    first, second = Resolver("gather-8", "numpy"), Resolver("gather-8", "numpy")
    for frame in frames[:4]:
        first.resolve(frame)
    past, buffers = first.recurrent()
    for name, target in second.restore(past).items():
        with target.mapped(write=True) as to, buffers[name].mapped(write=False) as source:
            to[...] = source
    assert np.array_equal(bits(second.resolve(frames[4])), bits(first.resolve(frames[4])))


@pytest.mark.parametrize("motion", [False, True])
def test_old_memory_is_free_when_new_is_allocated(motion: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the size changes, or with another channel the ring."""
    held, most = [0], [0]
    allocate = NumpyLauncher.allocate

    def counted(launcher: NumpyLauncher, shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
        buffer, size = allocate(launcher, shape, dtype), prod(shape) * np.dtype(dtype).itemsize
        held[0] += size
        most[0] = max(most[0], held[0])
        finalize(buffer, lambda: held.append(held.pop() - size))
        return buffer

    monkeypatch.setattr(NumpyLauncher, "allocate", counted)
    resolver = Resolver("gather-8", "numpy")
    resolver.resolve(make_frame(0, motion=True))
    first, most[0] = held[0], 0
    resolver.resolve(make_frame(1, motion=motion, width=WIDTH - 4 * motion))
    assert most[0] <= first
