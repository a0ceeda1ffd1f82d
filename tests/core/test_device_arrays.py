"""Frames and results in memory of the device: the bits are those of NumPy's arrays, and nothing comes to the host."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pyopencl as cl
import pyopencl.array as cl_array
import pytest

from cltaa.core import planes
from cltaa.core.presets import Preset, load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, ResourceError, UsageError
from cltaa.frame import Frame
from cltaa.opencl import exchange
from cltaa.opencl.device import Memory, choose_device
from cltaa.opencl.launcher import DeviceLauncher
from tests.sequence_factory import bits, make_camera, make_frame


@pytest.fixture(scope="module")
def queue() -> cl.CommandQueue:
    return cl.CommandQueue(cl.Context([choose_device()]))


def frame_of(index: int) -> Frame:
    camera = make_camera((0.2 * index, 0.0, 5.0))
    return make_frame(index, width=160, height=40, camera=camera, motion=True, alpha=True, reactive=True, effects=None)


def on(queue: cl.CommandQueue, frame: Frame, dtype: type[Any] = np.float32) -> Frame:
    """The frame with its arrays on the device."""
    names = ("colour", "depth", "motion", "alpha", "reactive")
    arrays: dict[str, Any] = {name: cl_array.to_device(queue, getattr(frame, name).astype(dtype)) for name in names}
    return replace(frame, **arrays)


@pytest.mark.parametrize("half", [False, True])
def test_what_is_on_the_device_stays_there(queue: cl.CommandQueue, half: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    there, here = Resolver(device=queue), Resolver()
    for index in range(3):
        frame = frame_of(index)
        given = on(queue, frame)
        with monkeypatch.context() as patch:
            if index:  # the first frame builds kernels, and waits
                patch.setattr(Memory, "mapped", None)
                patch.setattr(exchange.Staged, "__init__", None)
                patch.setattr(there.launcher, "finish", None)
            image: Any = there.resolve(given, half=half)
        assert isinstance(image, cl_array.Array)
        assert np.array_equal(bits(image.get()), bits(here.resolve(frame, half=half)))


def test_the_result_of_arrays_without_a_queue_is_on_the_resolvers(queue: cl.CommandQueue) -> None:
    frame = frame_of(0)
    given = on(queue, frame)
    given = replace(given, colour=cast(Any, given.colour).with_queue(None))
    image: Any = Resolver(device=queue).resolve(given)
    assert np.array_equal(bits(image.get()), bits(Resolver().resolve(frame)))


def test_halves_are_the_floats_that_they_round_to(queue: cl.CommandQueue) -> None:
    there, here = Resolver(device=queue), Resolver()
    for index in range(2):
        given = on(queue, frame_of(index), np.float16)
        arrays = {name: getattr(given, name).get() for name in ("colour", "depth", "motion", "alpha", "reactive")}
        found: Any = there.resolve(given)
        floats = {name: array.astype(np.float32) for name, array in arrays.items()}
        assert np.array_equal(bits(found.get()), bits(here.resolve(replace(frame_of(index), **floats))))


def test_a_result_goes_to_the_array_that_is_given(queue: cl.CommandQueue) -> None:
    """Or from the device to the host, or from the host to the device, planar as well."""
    there, here = Resolver(device=queue), Resolver()
    memory = cl_array.zeros(queue, 2 * 4 * 40 * 160, np.float32)
    planar = memory[4 * 40 * 160 :].reshape(4, 40, 160).transpose((1, 2, 0))
    host = np.empty((40, 160, 4), np.float32)
    for index, (out, moved) in enumerate(((planar, True), (planar, False), (host, True), (host, False))):
        frame = frame_of(index)
        found: Any = there.resolve(on(queue, frame) if moved else frame, out=out)
        assert found is out
        image = np.moveaxis(memory.get()[4 * 40 * 160 :].reshape(4, 40, 160), 0, -1) if out is planar else host
        assert np.array_equal(bits(image.copy()), bits(here.resolve(frame)))
    assert not memory.get()[: 4 * 40 * 160].any()


def test_an_array_waits_for_its_last_result_alone(queue: cl.CommandQueue) -> None:
    """Earlier events of it would be waited for in vain, by the host as well, and asked for their queues every frame."""
    resolver, out = Resolver(device=queue), cl_array.zeros(queue, (40, 160, 4), np.float32)
    before = cl.UserEvent(queue.context)
    for index in range(3):
        given = on(queue, frame_of(index))
        if index == 2:
            out.add_event(before)
        resolver.resolve(given, out=out)
        (done,) = out.events
        if index == 2:
            assert done.command_execution_status != cl.command_execution_status.COMPLETE
            before.set_status(cl.command_execution_status.COMPLETE)
        done.wait()


@pytest.mark.parametrize("in_order", [False, True])
def test_another_queue_of_the_context_is_waited_for(queue: cl.CommandQueue, in_order: bool) -> None:
    any_order = cl.command_queue_properties.OUT_OF_ORDER_EXEC_MODE_ENABLE
    other = cl.CommandQueue(queue.context) if in_order else cl.CommandQueue(queue.context, properties=any_order)
    there, here = Resolver(device=queue if in_order else other), Resolver()
    for index in range(3):
        given = on(other, frame_of(index))
        zero, frame = cl_array.zeros(other, given.colour.shape, np.float32), frame_of(index)
        changes: dict[str, Any] = {"colour": zero}
        before = cl.UserEvent(queue.context)
        cl.enqueue_barrier(other, wait_for=[before])
        zero += given.colour  # held up by the barrier, as a renderer's kernels may be
        if not index:  # the first frame builds kernels, and waits
            before.set_status(cl.command_execution_status.COMPLETE)
        found: Any = there.resolve(replace(given, **changes))
        if index:
            before.set_status(cl.command_execution_status.COMPLETE)
        assert found.queue == other
        doubled = found + found
        assert np.array_equal(doubled.get(), 2 * here.resolve(frame))


def copying_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("cltaa copy")]


@pytest.mark.parametrize("preset", ["default", load_preset("gather-8").replace(illumination="static")])
def test_a_device_with_memory_of_its_own_gives_the_same_bits(
    preset: str | Preset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through pinned memory, in pieces, as on a GPU; the threads that copy them end with the resolver."""
    here = Resolver(preset)
    monkeypatch.setattr(exchange, "PART", 4096)
    monkeypatch.setattr(exchange, "COPIERS", 3)
    launcher = DeviceLauncher()
    launcher.device.shares_memory = launcher.shares_memory = False
    launcher.stages = True
    apart, out = Resolver(preset, launcher), np.moveaxis(np.zeros((4, 40, 160), np.float16), 0, -1)
    for index in range(4):
        frame = frame_of(index)
        expected = here.resolve(frame, half=index == 2)
        image = apart.resolve(frame, out=out) if index == 2 else apart.resolve(frame)
        assert np.array_equal(bits(image.copy()), bits(expected.copy()))
        assert copying_threads()
    apart.close()
    assert copying_threads() == []


def test_pinned_arrays_go_to_the_device_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """And results come so; views of them too, while what lies elsewhere goes through memory of ours."""
    launcher, here = DeviceLauncher(), Resolver()
    launcher.device.shares_memory = launcher.shares_memory = False
    launcher.stages = True
    apart = Resolver(device=launcher)
    planar, depth = np.moveaxis(apart.empty((3, 40, 160)), 0, -1), apart.empty((40, 160), "float16")
    out = apart.empty((40, 160, 3))
    monkeypatch.setattr(exchange.Staged, "_pinned", None)
    for index in range(3):
        frame = replace(frame_of(index), motion=None, alpha=None, reactive=None)
        planar[...], depth[...] = frame.colour, frame.depth
        assert apart.resolve(replace(frame, colour=planar, depth=depth), out=out) is out
        expected = here.resolve(replace(frame, depth=depth.astype(np.float32)))
        assert np.array_equal(bits(out.copy()), bits(expected))
    with pytest.raises(TypeError, match="NoneType"):
        apart.resolve(replace(frame, index=3, colour=frame.colour.copy()), out=out)


@pytest.mark.parametrize("device", [None, "numpy", "staged"])
def test_an_empty_array_is_as_asked_for(device: str | None) -> None:
    launcher = DeviceLauncher()
    launcher.stages = True
    resolver = Resolver(device=launcher if device == "staged" else device)
    for shape in [(4, 5), (0, 5), ()]:
        given = resolver.empty(shape, np.float16)
        assert given.shape == shape, shape
        assert given.dtype == np.float16, shape
        given[...] = 1
        assert (given == 1).all(), shape


def test_an_array_that_nothing_can_hold_is_refused() -> None:
    resolver = Resolver(device="numpy")
    with pytest.raises(UsageError, match=r"unsupported type of numbers \(expected float32 or float16, found int32\)"):
        resolver.empty((4, 5), np.int32)
    with pytest.raises(ResourceError, match="not enough memory for an array: Unable to allocate"):
        resolver.empty((2**30, 2**30))


def noted(order: list[str], name: str, method: Callable[..., None]) -> Callable[..., None]:
    def called(*given: Any) -> None:
        order.append(name)
        method(*given)

    return called


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("half", [False, True])
def test_many_frames_are_as_each_of_them(own: bool, half: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though frames change their arrays as soon as the next is asked for. Where a device has memory of its own, the
    next is brought before a result is waited for."""
    launcher, order = DeviceLauncher(), list[str]()
    for name in ("upload", "download"):
        monkeypatch.setattr(exchange.Staged, name, noted(order, name, getattr(exchange.Staged, name)))
    launcher.device.shares_memory = launcher.shares_memory = not own
    launcher.stages = own
    one, many = Resolver(), Resolver(device=launcher)

    def rendered() -> Iterator[Frame]:
        colour = np.empty((40, 160, 3), np.float32)
        for index in range(6):
            frame = frame_of(index)
            colour[...] = frame.colour
            yield replace(frame, colour=colour)
            colour[...] = np.nan

    images = list(many.images(rendered(), half=half))
    expected = [one.resolve(frame_of(index), half=half) for index in range(6)]
    assert len(images) == len({id(image) for image in images}) == 6
    assert all(np.array_equal(bits(image), bits(image2)) for image, image2 in zip(images, expected, strict=True))
    assert order == ((["upload"] * 5 + ["download"]) * 6 if own else [])


def test_arrays_are_let_go_of_at_the_end_of_a_frame() -> None:
    resolver = Resolver("accumulate")
    colour = np.zeros((40, 160, 3), np.float32)
    resolver.resolve(Frame(0, colour))
    image = resolver.resolve(Frame(1, colour))
    assert sys.getrefcount(colour) == sys.getrefcount(image) == 2


def test_what_is_elsewhere_is_refused(queue: cl.CommandQueue) -> None:
    given = on(queue, frame_of(0))
    with pytest.raises(UsageError, match=r"another OpenCL context; cltaa.Resolver\(device=array.queue\)"):
        Resolver().resolve(given)
    with pytest.raises(UsageError, match="cannot be resolved by NumPy"):
        Resolver(device="numpy").resolve(given)


@pytest.mark.parametrize("name", ["colour", "depth", "motion", "alpha", "reactive"])
def test_doubles_on_the_device_are_refused(queue: cl.CommandQueue, name: str) -> None:
    frame = frame_of(0)
    doubles: dict[str, Any] = {name: cl_array.to_device(queue, getattr(frame, name).astype(np.float64))}
    given = replace(frame, **doubles)
    said = f"{name} on the device cannot be read .expected float32 or float16, found float64.*; convert it there"
    with pytest.raises(DataError, match=said):
        Resolver(device=queue).resolve(given)


def test_results_lie_in_what_a_program_let_go_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """And never where one lies that it keeps: after one kept, one looked at and one made none is mapped anew."""
    resolver, colour, kept = Resolver("accumulate"), np.ones((600, 640, 3), np.float32), list[Any]()
    for index in range(8):
        if index == 4:
            monkeypatch.setattr(planes, "_mapped", None)
        image = resolver.resolve(Frame(index, colour * index))
        kept += [(image, image.copy())] if index == 1 else []
    assert np.array_equal(*kept[0])
