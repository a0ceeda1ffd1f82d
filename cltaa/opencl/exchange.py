"""How arrays of a program come to a device, and results back: in place, through pinned memory, or plainly copied."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cltaa.core.planes import flat
from cltaa.errors import UsageError
from cltaa.frame import on_device
from cltaa.opencl.device import Device, Memory, device_errors
from cltaa.process import CORES, OneProcess

# Threads between pinned memory and a program's, of which one alone is slower than the bus, and bytes that each copies
# at a time: a depth at 1920 x 1080 is two of them.
COPIERS, PART = min(8, CORES), 4 * 2**20


class Lent(NamedTuple):
    """Memory of a program's array on the device."""

    buffer: cl.Buffer


class Copiers:
    """The calling thread and others, which are begun where there is work for them, and end with ``close``."""

    def __init__(self) -> None:
        self._others: ThreadPoolExecutor | None = None

    def each(self, work: Callable[[slice], object], parts: Sequence[slice]) -> None:
        """Do ``work`` for all ``parts``, the first of them first."""
        shares = [parts[first::COPIERS] for first in range(min(COPIERS, len(parts)))]
        begun: list[Future[None]] = []
        try:
            for share in shares[1:]:
                if self._others is None:
                    self._others = ThreadPoolExecutor(COPIERS - 1, "cltaa copy")
                begun.append(self._others.submit(_in_turn, work, share))
            _in_turn(work, shares[0])
        finally:
            wait(begun)  # whatever happens here, they read and write the caller's memory
        for done in begun:
            done.result()

    def close(self) -> None:
        """End the other threads."""
        if self._others is not None:
            self._others.shutdown()
            self._others = None


def _in_turn(work: Callable[[slice], object], parts: Sequence[slice]) -> None:
    for part in parts:
        work(part)


def _is_pinned(array: Any) -> bool:
    """Whether an array lies in memory that a device has mapped, as that of ``Resolver.empty``."""
    while array is not None and not isinstance(array, cl.MemoryMap):
        array = getattr(array, "base", None)
    return array is not None


class Staged:
    """Bytes of a device with memory of its own. Those of the host come and go as they are from pinned memory of a
    program, and all else through as many pinned bytes of ours."""

    def __init__(self, device: Device, size: int) -> None:
        self._device, self.size = device, size
        self.buffer = device.allocate((size,), np.uint8).buffer
        self._parts = [slice(start, min(start + PART, size)) for start in range(0, size, PART)]
        self._moving: list[cl.Event] = []

    @cached_property
    def _pinned(self) -> NDArray[np.uint8]:
        return self._device.pinned(self.size)

    def upload(self, content: NDArray[np.uint8], copiers: Copiers) -> None:
        """Enqueue bytes of the host, each piece while the next is copied. Waits for those of the call before."""
        with device_errors(self._device):
            while self._moving:
                self._moving.pop().wait()
        if _is_pinned(content):
            self._enqueue(content, 0)
            return
        pinned = self._pinned

        def move(part: slice) -> None:
            np.copyto(pinned[part], content[part])
            self._enqueue(pinned[part], part.start)

        copiers.each(move, self._parts)

    def _enqueue(self, pinned: NDArray[np.uint8], start: int) -> None:
        with device_errors(self._device):
            self._moving.append(
                cl.enqueue_copy(self._device.queue, self.buffer, pinned, dst_offset=start, is_blocking=False)
            )

    def download(self, content: NDArray[np.uint8], copiers: Copiers) -> None:
        """Fill bytes of the host with them, each piece as soon as it has come to pinned memory."""
        if _is_pinned(content):
            with device_errors(self._device):
                cl.enqueue_copy(self._device.queue, content, self.buffer)
            return
        with device_errors(self._device):
            self._moving = [
                cl.enqueue_copy(
                    self._device.queue, self._pinned[part], self.buffer, src_offset=part.start, is_blocking=False
                )
                for part in self._parts
            ]
            self._device.queue.flush()

        def take(part: slice) -> None:
            with device_errors(self._device):
                self._moving[part.start // PART].wait()
            np.copyto(content[part], self._pinned[part])

        copiers.each(take, self._parts)
        self._moving = []


class Exchange(OneProcess):
    """The way of one resolver's arrays to a device and back, and the memory and the threads that it takes."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._lent: dict[str, Memory | Staged | Lent] = {}
        self._result: Staged | None = None  # that the last one came through
        self._others: list[cl.CommandQueue] = []  # of a program, whose arrays were lent
        self._copiers = Copiers()

    def lend(self, name: str, array: Any) -> Memory | Staged | Lent:
        """Memory that kernels read an array from, until the next of that ``name``: the host's where that is shared,
        else a copy.

        What the queue of an array of this device was given before is waited for on the device. Raises UsageError for
        one of another context.
        """
        if on_device(array):
            lent: Memory | Staged | Lent = self._lent_by(array)
        elif self._device.shares_memory:
            content = _bytes_of(array)
            lent = Memory(self._device, content.shape, np.uint8, content)
        else:
            content, staged = _bytes_of(array), self._lent.get(name)
            if not isinstance(staged, Staged) or staged.size != content.size:
                staged = Staged(self._device, content.size)
            staged.upload(content, self._copiers)
            lent = staged
        self._lent[name] = lent
        return lent

    def receive(self, out: Any) -> Memory | Staged | Lent:
        """Memory that a kernel writes for ``out``, which is handed over then."""
        if on_device(out):
            return self._lent_by(out)
        content = _bytes_of(out)
        if self._device.shares_memory:
            return Memory(self._device, content.shape, np.uint8, content, written=True)
        if self._result is None or self._result.size != content.size:
            self._result = Staged(self._device, content.size)
        return self._result

    def hand_over(self, out: Any, received: Memory | Staged | Lent, done: cl.Event) -> None:
        """Bring what was ``received``, and written when an event is ``done``, to ``out``: into the host's memory, which
        is waited for, or before what its queue is given next."""
        if isinstance(received, Memory):
            with received.mapped(write=False):
                return
        if isinstance(received, Staged):
            received.download(_bytes_of(out), self._copiers)
            return
        with device_errors(self._device):
            self._device.queue.flush()
        out.add_event(done)
        with device_errors(self._device):
            while self._others:
                cl.enqueue_barrier(self._others.pop(), wait_for=[done])

    def give_back(self) -> None:
        """Forget arrays of the host, which nothing reads any more."""
        if self._device.shares_memory:
            self._lent.clear()

    def close(self) -> None:
        """End the threads; the memory goes with what holds it."""
        self._copiers.close()

    def _lent_by(self, array: Any) -> Lent:
        if array.context != self._device.context:
            raise UsageError("an array lies in another OpenCL context", cure="cltaa.Resolver(device=array.queue)")
        with device_errors(self._device):
            # What our own queue was given comes before anyway.
            before = [event for event in array.events if event.command_queue != self._device.queue]
            if array.queue is not None and array.queue != self._device.queue:
                before.append(cl.enqueue_marker(array.queue))
                array.queue.flush()
                if array.queue not in self._others:
                    self._others.append(array.queue)
            if before:
                cl.enqueue_barrier(self._device.queue, wait_for=before)
        return Lent(array.base_data)


def _bytes_of(array: NDArray[Any]) -> NDArray[np.uint8]:
    return cast(NDArray[Any], flat(array)).view(np.uint8)


def array_on(device: Device, array: NDArray[Any]) -> Any:
    """A ``pyopencl.array.Array`` on the queue of ``device`` that holds what ``array`` does."""
    import pyopencl.array as cl_array  # here: few programs hold arrays there

    return cl_array.to_device(device.queue, np.ascontiguousarray(array))


class PlainCopies:
    """The loop that a program would write: its arrays to the device, and as many bytes as a result has back."""

    def __init__(self, device: Device, arrays: Sequence[NDArray[Any]], result: NDArray[Any], *, pinned: bool) -> None:
        """With ``pinned`` the arrays lie in memory that the device moves at the speed of its bus, which no array of a
        program does by itself."""
        self._device = device
        self._sources = [self._placed(np.ascontiguousarray(array), pinned) for array in arrays]
        self._result = self._placed(result, pinned)
        flags = cl.mem_flags.READ_WRITE
        self._there = [cl.Buffer(device.context, flags, source.nbytes) for source in self._sources]
        self._back = cl.Buffer(device.context, flags, self._result.nbytes)

    def _placed(self, array: NDArray[Any], pinned: bool) -> NDArray[Any]:
        if not pinned:
            return array
        place = self._device.pinned(array.nbytes)
        place[...] = array.reshape(-1).view(np.uint8)
        return place

    def run(self) -> None:
        """Copy all of it once, and wait."""
        queue = self._device.queue
        for source, there in zip(self._sources, self._there, strict=True):
            cl.enqueue_copy(queue, there, source, is_blocking=False)
        cl.enqueue_copy(queue, self._result, self._back, is_blocking=False)
        queue.finish()
