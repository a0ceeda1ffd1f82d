"""OpenCL is called without the interpreter, to the same result, and what is wrong with a call is still told."""

from __future__ import annotations

import ctypes.util
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cltaa.core.build import FRAME_DTYPE, Build
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.errors import InternalError
from cltaa.opencl import free_calls
from cltaa.opencl.device import Device
from cltaa.opencl.launcher import DeviceLauncher
from tests.sequence_factory import bits, make_frame


def test_the_functions_are_found() -> None:
    assert free_calls.free_calls() is not None


def test_a_library_without_them_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for file in ("/nowhere.so", ctypes.util.find_library("c")):
        monkeypatch.setattr(cl, "_cl", SimpleNamespace(__file__=file))
        assert free_calls.free_calls.__wrapped__() is None


def test_without_them_results_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [make_frame(index) for index in range(2)]
    found = [Resolver().resolve(frame) for frame in frames]
    monkeypatch.setattr(free_calls, "free_calls", lambda: None)
    for frame, image in zip(frames, found, strict=True):
        np.testing.assert_array_equal(bits(Resolver().resolve(frame)), bits(image))


def test_two_threads_with_one_launcher_do_not_mix_their_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one begins where the first has set its arguments and has not started the kernel."""
    launcher, frames, reached = DeviceLauncher(), [make_frame(seed=seed) for seed in range(2)], threading.Event()
    expected = [Resolver(device=launcher).resolve(frame) for frame in frames]
    found: dict[int, NDArray[np.float32]] = {}

    def resolve(place: int) -> None:
        found[place] = Resolver(device=launcher).resolve(frames[place])

    second = threading.Thread(target=resolve, args=(1,))

    def start(*given: Any) -> cl.Event:
        if threading.current_thread() is second:
            reached.set()
        elif second.ident is None:
            second.start()
            reached.wait(0.5)  # which is for nothing where the second one waits
        return free_calls.start_kernel(*given)

    monkeypatch.setattr("cltaa.opencl.program.start_kernel", start)
    resolve(0)
    second.join()
    for place, image in enumerate(expected):
        np.testing.assert_array_equal(bits(found[place]), bits(image))


@pytest.mark.parametrize("found", [True, False])
def test_a_wrong_start_is_told(found: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    launcher, layout = DeviceLauncher(), Layout(16, 8)
    if not found:
        monkeypatch.setattr(free_calls, "free_calls", lambda: None)
    monkeypatch.setattr(DeviceLauncher, "_range", lambda *_: ((16, 8), (3, 8)))  # no multiple of its group
    memory = launcher.allocate((1, layout.rows, layout.stride))
    given = {"image": memory, "floats": memory, "planes": 1, "more": 0, "frame": np.zeros((), FRAME_DTYPE)}
    with pytest.raises(InternalError, match="refused a call: clEnqueueNDRangeKernel"):
        launcher.run("extend_edges", launcher.build(Build()), layout, given)


def test_memory_holds_what_was_written_while_it_was_mapped() -> None:
    memory = Device().allocate((2, 3, 5), np.float16)
    for number in (1.5, -2.0):
        with memory.mapped(write=True) as written:
            assert (written.shape, written.dtype.name) == ((2, 3, 5), "float16")
            written[...] = number
        with memory.mapped(write=False) as read:
            assert (read == number).all()


def test_a_wrong_map_and_unmap_are_told() -> None:
    device = Device()
    memory = device.allocate((4,))
    with pytest.raises(cl.LogicError, match="clEnqueueMapBuffer"):
        free_calls.map_memory(device.queue, memory.buffer, 1000, write=False)  # beyond its end
    with pytest.raises(cl.Error, match="clEnqueueUnmapMemObject"):
        free_calls.unmap_memory(device.queue, memory.buffer, np.zeros(16, np.uint8))  # which is not mapped
