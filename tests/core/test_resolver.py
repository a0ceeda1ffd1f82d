"""The resolver looked at in time: what accumulates, what starts anew, what never changes."""

from __future__ import annotations

import inspect
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cltaa.core.bands import BandedResolver
from cltaa.core.buffers import Buffers
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError, UsageError
from cltaa.frame import Camera, Effect
from tests.core.standing import STILL, panned, still_frame
from tests.numerics.exact_cameras import orthographic
from tests.sequence_factory import bits, make_camera, make_frame

UNIT_ROUNDOFF = 2.0**-24


@pytest.mark.parametrize("blur", [0.0, 1.0])  # of what appears amid pixels with a past
def test_without_a_filter_a_first_frame_is_what_was_drawn(blur: float) -> None:
    frame = still_frame(0)
    preset = override(load_preset(), {"disocclusion_blur": blur, "current_filter": "none"})
    assert np.array_equal(bits(Resolver(preset, "numpy").resolve(frame)), bits(frame.colour))


def test_still_sequence_is_the_mean_of_its_samples() -> None:
    plain = override(load_preset(), {"current_filter": "none"})
    resolver, total = Resolver(plain), np.zeros_like(still_frame(0).colour, np.float64)
    for index in range(64):
        frame = still_frame(index)
        total += frame.colour
        resolved = resolver.resolve(frame)
        largest = 4.0  # of the factory's colours
        # Each step h + w (x - h) rounds three times (3 u of the largest value) and later steps shrink what came before.
        assert np.abs(resolved - total / (index + 1)).max() <= 3 * UNIT_ROUNDOFF * largest * (index + 1)


@pytest.mark.parametrize(("preset", "effects"), [("default", STILL), ("default", None), ("gather-48", None)])
def test_constant_image_keeps_its_bits(preset: str, effects: frozenset[Effect] | None) -> None:
    """In the fast build of a device; core/test_promises.py has every preset on NumPy."""
    colour = np.full_like(still_frame(0).colour, (0.3, 0.7, 0.1))
    resolver = Resolver(preset)
    for index in range(20):
        resolved = resolver.resolve(still_frame(index, colour=colour, effects=effects))
        assert np.array_equal(bits(resolved), bits(colour))


@pytest.mark.parametrize("change", ["cut", "gap", "reset", "size", "lens", "reserved", "no memory"])
def test_history_starts_anew(change: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # ``standing`` gives a history of no samples a weight.
    resolver = Resolver(override(load_preset(), {"current_filter": "none", "accumulate": "standing"}), "numpy")
    for index in range(3):
        resolver.resolve(still_frame(index))
    frame = still_frame(3, cut=True) if change == "cut" else still_frame(9 if change == "gap" else 3)
    if change == "size":
        frame = replace(make_frame(3, width=50, height=20, camera=make_camera(), effects=STILL))
    if change == "lens":
        frame = replace(frame, camera=Camera(frame.camera.world_to_view, orthographic(2.0, 1.5)))
    if change == "reset":
        resolver.reset()
    if change == "reserved":
        resolver.reserve(50, 20, alpha=False)
    if change == "no memory":
        with monkeypatch.context() as patch:
            patch.setattr(resolver.launcher, "allocate", Mock(side_effect=MemoryError))
            with pytest.raises(MemoryError):
                resolver.resolve(make_frame(3, width=50, height=20, effects=STILL))
    assert np.array_equal(bits(resolver.resolve(frame)), bits(frame.colour))


def test_a_device_that_is_opened_again_has_no_history() -> None:
    resolver, fresh = Resolver(device="numpy"), Resolver(device="numpy")
    resolver.resolve(make_frame(0))
    resolver.reopen()
    np.testing.assert_array_equal(bits(resolver.resolve(make_frame(1))), bits(fresh.resolve(make_frame(1))))


@pytest.mark.parametrize("every_step", [False, True])
@pytest.mark.parametrize("preset", ["default", "gather-8"])
def test_a_restored_state_continues_with_the_same_bits(preset: str, every_step: bool) -> None:
    """Where every step runs, alpha of a frame without one has its memory too; what a preset ignores is not kept."""
    changed = override(load_preset(preset), {"reproject": "camera", "reactive_mask": "ignore"})
    first, second = (Resolver(changed, "numpy", every_step=every_step) for _ in range(2))
    first.resolve(make_frame(0, motion=True, reactive=True))
    past, buffers = first.recurrent()
    for name, target in second.restore(past).items():
        with target.mapped(write=True) as to, buffers[name].mapped(write=False) as source:
            assert to.shape == source.shape
            to[...] = source
    frame = make_frame(1, motion=True, reactive=True)
    np.testing.assert_array_equal(bits(second.resolve(frame)), bits(first.resolve(frame)))


def test_what_comes_into_view_is_the_current_sample() -> None:
    resolver, shift = Resolver(override(load_preset(), {"current_filter": "none"}), "numpy"), 5
    first = make_frame(0, effects=None)
    flat = np.full_like(first.depth, 4.0)
    resolver.resolve(replace(first, depth=flat))
    second = replace(make_frame(1, effects=None), depth=flat, camera=panned(first.camera, shift, first.width))
    resolved = resolver.resolve(second)
    fresh = (resolved == second.colour).all(axis=-1)
    assert list(np.flatnonzero(fresh.all(axis=0))) == list(range(first.width - shift, first.width))


def test_history_is_brought_to_the_exposure_of_now() -> None:
    plain = {
        "rectify": "none",
        "weighting": "none",
        "reject": "none",
        "illumination": "static",
        "current_filter": "none",
    }
    one, other = (Resolver(override(load_preset(), plain), "numpy") for _ in range(2))
    for index, exposure in enumerate((1.0, 2.0, 0.5, 4.0)):
        frame = still_frame(index, effects=None)
        steady, colour = one.resolve(frame), np.float32(exposure) * frame.colour
        resolved = other.resolve(replace(frame, colour=colour, exposure=exposure))
        assert np.array_equal(bits(resolved), bits(np.float32(exposure) * steady))


def test_a_mask_that_the_preset_ignores_changes_nothing() -> None:
    bare, masked = (Resolver(override(load_preset(), {"reactive_mask": "ignore"})) for _ in range(2))
    for index in range(3):
        frame = still_frame(index, effects=None)
        mask = np.full(frame.depth.shape, 0.8, np.float32)
        assert np.array_equal(bits(masked.resolve(replace(frame, reactive=mask))), bits(bare.resolve(frame)))


@pytest.mark.parametrize("preset", ["default", "gather-8", "gather-48"])
def test_a_frame_that_was_interrupted_is_resolved_to_the_same_bits(
    preset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, resolver = Resolver(preset), Resolver(preset)

    def interrupt() -> None:
        raise KeyboardInterrupt

    for index in range(4):
        frame = make_frame(index, effects=None)
        with monkeypatch.context() as patch:
            patch.setattr(resolver.launcher, "finish", interrupt)
            with pytest.raises(KeyboardInterrupt):
                resolver.resolve(frame)
        assert np.array_equal(bits(resolver.resolve(frame)), bits(whole.resolve(frame)))


@pytest.mark.parametrize("preset", ["default", "gather-8+8"])
def test_what_an_interrupted_frame_lent_is_waited_for(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    resolver = Resolver(preset, "numpy")
    with monkeypatch.context() as patch:
        patch.setattr(resolver.launcher, "finish", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            resolver.feed(make_frame(0))
    called: list[str] = []
    for name in ("finish", "run"):
        monkeypatch.setattr(resolver.launcher, name, lambda *_, name=name, **__: called.append(name))
    resolver.feed(make_frame(1, cut=True))
    assert called[0] == "finish"


@pytest.mark.parametrize("kind", [Resolver, BandedResolver])
def test_a_closed_resolver_refuses_every_method_but_close(kind: type[Resolver]) -> None:
    with Resolver(device="numpy") as resolver:
        resolver.resolve(make_frame(0))
        assert resolver.recurrent()[1].keys() > {"history"}
    methods = {name for name, _ in inspect.getmembers(kind, inspect.isfunction) if not name.startswith("_")}
    given: dict[str, list[Any]] = {"feed": [make_frame(0)], "images": [[make_frame(0)]]}
    for name in {*methods, "__enter__"} - {"close"}:
        with pytest.raises(UsageError, match=r"^the resolver is closed; make a new one$"):
            list(getattr(kind, name)(resolver, *given.get(name, [])))  # a generator begins when it is read
    with pytest.raises(UsageError, match="the resolver is closed"):
        list(resolver.images([]))
    resolver.close()


def test_frames_that_wait_when_a_resolver_closes_are_told() -> None:
    def fed() -> Resolver:
        resolver = Resolver("gather-8", "numpy", look_ahead=2)
        assert [resolver.feed(make_frame(number)) for number in range(2)] == [[], []]
        return resolver

    told = r"^the resolver closed while 2 frames waited for later ones: call flush\(\) before, for their images$"
    with pytest.warns(UserWarning, match=told) as by_block, fed():
        pass
    resolver = fed()
    with pytest.warns(UserWarning, match=told) as by_call:
        resolver.close()
    assert {each.filename for each in (*by_block, *by_call)} == {__file__}
    resolver.close()  # which tells nothing again
    with pytest.raises(ZeroDivisionError), fed():  # as little as after an exception
        raise ZeroDivisionError
    with fed() as resolver:
        assert len(resolver.flush()) == 2


def test_planes_that_found_no_memory_are_allocated_at_the_next_try(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame with nothing declared needs a second plane of counts; kernels read it wherever it is said to exist."""
    resolver, undisturbed = Resolver(device="numpy"), Resolver(device="numpy")
    allocate = Buffers._planes

    def fail(buffers: Buffers, count: int, *rest: Any, **named: Any) -> Any:
        if count == 2:
            raise ResourceError("not enough memory")
        return allocate(buffers, count, *rest, **named)

    frames = [make_frame(index, effects=None) for index in range(2)]
    with monkeypatch.context() as patch:
        patch.setattr(Buffers, "_planes", fail)
        with pytest.raises(ResourceError):
            resolver.resolve(frames[0])
    for frame in frames:
        assert np.array_equal(bits(resolver.resolve(frame)), bits(undisturbed.resolve(frame)))


def test_a_camera_is_as_it_was_when_its_frame_was_made() -> None:
    """A program may keep one view matrix and change it in place."""
    view, own, shared = np.eye(4), Resolver(device="numpy"), Resolver(device="numpy")
    for index in range(3):
        view[0, 3] = -0.3 * index
        frame = make_frame(index, effects=None)
        clip = frame.camera.view_to_clip
        moved = own.resolve(replace(frame, camera=Camera(view.copy(), clip)))
        assert np.array_equal(bits(shared.resolve(replace(frame, camera=Camera(view, clip)))), bits(moved))
    assert own.plan == shared.plan
