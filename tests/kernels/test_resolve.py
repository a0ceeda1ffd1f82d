"""The fused kernel against its NumPy twin: a strict build gives the same bits, whatever is in the frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest

from cltaa.core.build import (
    FRAME_DTYPE,
    SETTINGS_DTYPE,
    Build,
    Real,
    Storage,
    prelude,
)
from cltaa.core.parameters import Choices
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame
from tests.sequence_factory import EVERY_CHANNEL, bits, make_frame, special_values

# Every choice that shapes a kernel, with the kind of its values.
CHOICES = get_type_hints(Choices)
# Those with a value that leaves others nothing to do, or that is for other kernels; test_choices_together.py has
# the rest.
ALONE = ("alpha_from", "history", "on_camera_move", "recursion", "reproject")


def turned(index: int, width: int, height: int) -> Camera:
    """A camera that turns, zooms in and moves, so that neighbouring pixels move differently."""
    camera = make_frame(0, width=width, height=height).camera
    angle = 0.01 * index
    view = camera.world_to_view.copy()
    view[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    view[2, 3] += 0.05 * index
    clip = camera.view_to_clip.copy()
    clip[[0, 1], [0, 1]] *= 1.01**index
    return Camera(view, clip)


def hard_frames(width: int = 70, height: int = 41, count: int = 3) -> Iterator[Frame]:
    """Random frames with every optional channel, and numbers that a careless path lets spread."""
    for index in range(count):
        random = np.random.default_rng(index)
        camera = turned(index, width, height)
        frame = make_frame(index, width=width, height=height, camera=camera, effects=None, **EVERY_CHANNEL)
        assert frame.motion is not None
        colour, depth, motion = frame.colour.copy(), frame.depth.copy(), 8 * frame.motion
        wild = random.random((height, width)) < 0.03
        colour[wild] = special_values(height, width)[wild][:, None]
        depth[random.random((height, width)) < 0.05] = random.choice([np.inf, np.nan, 0.0, -1.0, 1e-40])
        motion[random.random((height, width)) < 0.6] = np.nan
        if not (depth >= 0).any():  # of one pixel; a frame without any distance is refused
            depth[0, 0] = 0.0
        yield replace(frame, colour=colour, depth=depth, motion=motion)


def differing(changes: dict[str, object], frames: list[Frame], lanes: int, rows: int) -> int:
    """Values that differ between the strict kernel and its twin, over all frames."""
    preset = override(load_preset(), changes)
    device, twin = Resolver(preset, build=Build(strict=True, lanes=lanes, rows=rows)), Resolver(preset, "numpy")
    different = 0
    for frame in frames:
        resolved = device.resolve(frame)
        assert np.isfinite(resolved).all()
        different += int((bits(resolved) != bits(twin.resolve(frame))).sum())
    return different


# Eight lanes, optimised, are in test_twins.py.
@pytest.mark.parametrize(
    ("lanes", "rows"), [(1, 1), *(pytest.param(*shape, marks=pytest.mark.optimised) for shape in ((4, 3), (16, 5)))]
)
def test_same_bits_whatever_the_shape_of_the_work(lanes: int, rows: int) -> None:
    assert differing({}, list(hard_frames()), lanes, rows) == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"alpha_from": "current"},
        {"history": "frames"},
        {"on_camera_move": "reset"},
        {"reproject": "camera"},
        {"reproject": "none"},
    ],
    ids=str,
)
def test_same_bits_for_every_choice_that_stands_alone(changes: dict[str, object]) -> None:
    assert differing(changes, list(hard_frames()), 8, 7) == 0


def test_same_bits_where_numbers_lose_their_digits() -> None:
    """A box that is flat but for denormals, whose digits depend on the scale of its coordinates."""
    frames = [make_frame(index, effects=None) for index in range(3)]
    for frame in frames:
        frame.colour[...] = 0.375
        frame.colour[np.random.default_rng(frame.index).random(frame.depth.shape) < 0.1] = (0.0, 2.0**-149, 0.0)
    assert differing({"rectify": "clip-current", "box": "variance", "current_filter": "none"}, frames, 8, 7) == 0


@pytest.mark.parametrize("level", [1e-22, 1e14])
def test_same_bits_where_squares_begin_and_end(level: float) -> None:
    """Squares of differences become denormal, or infinite where history is brought to a brighter exposure."""
    device, twin = Resolver(strict=True), Resolver(device="numpy")
    for index, exposure in enumerate((1.0, 2.0**-15, 1.0)):
        frame = make_frame(index, effects=frozenset(Effect), exposure=exposure)
        frame = replace(frame, colour=frame.colour * np.float32(level))
        assert np.array_equal(bits(device.resolve(frame)), bits(twin.resolve(frame)))


# Light is tested for unless what is declared rules out that it changes. Lanes 0: as many as the device has.
@pytest.mark.parametrize(
    ("storage", "lanes", "effects"),
    [(Storage.HALF, 0, None), (Storage.HALF_STOCHASTIC, 8, frozenset({Effect.CAMERA, Effect.DISOCCLUSION}))],
    ids=["half-light", "half-stochastic"],
)
def test_same_bits_for_every_storage(storage: Storage, lanes: int, effects: frozenset[Effect] | None) -> None:
    build = Build(strict=True, storage=storage, lanes=lanes)
    device, twin = Resolver(build=build), Resolver(device="numpy", storage=storage)
    for hard in hard_frames():
        frame = replace(hard, effects=effects)
        resolved = device.resolve(frame)
        assert np.array_equal(resolved, resolved.astype(np.float16))
        assert np.array_equal(bits(resolved), bits(twin.resolve(frame)))


def test_same_numbers_in_doubles() -> None:
    # A device may contract or reorder nothing in a strict build, whatever the numbers are.
    build = Build(storage=Storage.DOUBLE, real=Real.DOUBLE, strict=True, lanes=4)
    device, twin = Resolver(build=build), Resolver(device="numpy", build=build)
    for frame in hard_frames():
        assert np.array_equal(bits(device.resolve(frame)), bits(twin.resolve(frame)))
        kept = []
        for resolver in (device, twin):
            with resolver.recurrent()[1]["history"].mapped(write=False) as planes:
                kept.append(planes.copy())
        assert kept[0].dtype == kept[1].dtype == np.float64
        assert np.array_equal(kept[0].view(np.uint64), kept[1].view(np.uint64))


def test_fast_build_is_another_program() -> None:
    # The test above would say nothing if the strict flag did not reach the compiler.
    assert prelude(Build(strict=True)) != prelude(Build(strict=False))
    assert Build(strict=True).flags() != Build(strict=False).flags()


def test_structs_have_four_byte_members() -> None:
    for dtype in (FRAME_DTYPE, SETTINGS_DTYPE):
        assert dtype.fields is not None
        assert [field[1] for field in dtype.fields.values()] == list(range(0, dtype.itemsize, 4))
