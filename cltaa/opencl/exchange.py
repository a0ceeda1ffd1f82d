"""Transfers of a program's arrays to a device, and of results back: in place, through pinned memory, or by plain
copies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cached_property
from typing import Any, cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cltaa.core.planes import flat
from cltaa.errors import UsageError
from cltaa.frame import on_device
from cltaa.opencl.device import Device, Memory
from cltaa.process import CORES, OneProcess

# Threads that copy between pinned memory and a program's, because one is slower than the bus, and bytes that each
# copies at a time: a depth at 1920 x 1080 is two of them.
COPIERS, PART = min(12, CORES), 4 * 2**20


class Copiers:
    """The calling thread and others, which start when there is work for them, and end with ``close``."""

    def __init__(self) -> None:
        self._others: ThreadPoolExecutor | None = None

    def each(self, work: Callable[[slice], object], parts: Sequence[slice]) -> None:
        """Call ``work`` for all ``parts``, the first of them first."""
        shares = [parts[first::COPIERS] for first in range(min(COPIERS, len(parts)))]
        begun: list[Future[None]] = []
        try:
            for share in shares[1:]:
                if self._others is None:
                    self._others = ThreadPoolExecutor(COPIERS - 1, "cltaa copy")
                begun.append(self._others.submit(_in_turn, work, share))
            _in_turn(work, shares[0])
        finally:
            wait(begun)  # in any case: they read and write the caller's memory
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
    """True where an array lies in memory that a device has mapped, such as that of ``Resolver.empty``."""
    while array is not None and not isinstance(array, cl.MemoryMap):
        array = getattr(array, "base", None)
    return array is not None


class Staged:
    """Bytes on a device with memory of its own. Pinned memory of a program is transferred directly, all other memory of
    the host through as many pinned bytes of ours."""

    def __init__(self, device: Device, size: int) -> None:
        self._device, self.size = device, size
        self.buffer = device.allocate((size,), np.uint8).buffer
        self._parts = [slice(start, min(start + PART, size)) for start in range(0, size, PART)]
        self._moving: list[cl.Event] = []

    @cached_property
    def _pinned(self) -> NDArray[np.uint8]:
        return self._device.pinned(self.size)

    def upload(self, content: NDArray[np.uint8], copiers: Copiers) -> None:
        """Enqueue the upload of host bytes, each part while the next is copied. Waits for the previous upload."""
        with self._device.errors:
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
        with self._device.errors:
            self._moving.append(
                cl.enqueue_copy(self._device.queue, self.buffer, pinned, dst_offset=start, is_blocking=False)
            )

    def download(self, content: NDArray[np.uint8], copiers: Copiers) -> None:
        """Download into host bytes, each part as soon as it has reached pinned memory."""
        if _is_pinned(content):
            with self._device.errors:
                cl.enqueue_copy(self._device.queue, content, self.buffer)
            return
        with self._device.errors:
            self._moving = [
                cl.enqueue_copy(
                    self._device.queue, self._pinned[part], self.buffer, src_offset=part.start, is_blocking=False
                )
                for part in self._parts
            ]
            self._device.queue.flush()

        def take(part: slice) -> None:
            with self._device.errors:
                self._moving[part.start // PART].wait()
            np.copyto(content[part], self._pinned[part])

        copiers.each(take, self._parts)
        self._moving = []


Lent = Memory | Staged | cl.Buffer  # the last: that of a program's own array on the device


class Exchange(OneProcess):
    """Transfers of one resolver's arrays to a device and back, with the memory and the threads that they need."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._lent: dict[str, Lent] = {}
        self._result: Staged | None = None  # memory of the last one
        self._others: list[cl.CommandQueue] = []  # a program's queues, whose arrays were lent
        self._copiers = Copiers()

    def lend(self, name: str, array: Any) -> Lent:
        """Return memory from which kernels read an array, until the next call with that ``name``: the host's where that
        is shared, else a copy.

        For an array of this device, the device waits for earlier commands of the array's queue. Raises UsageError for
        an array of another context.
        """
        if on_device(array):
            lent: Lent = self._lent_by(array)
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

    def receive(self, out: Any) -> Lent:
        """Return memory that a kernel writes for ``out``; ``hand_over`` follows."""
        if on_device(out):
            return self._lent_by(out)
        content = _bytes_of(out)
        if self._device.shares_memory:
            return Memory(self._device, content.shape, np.uint8, content, written=True)
        if self._result is None or self._result.size != content.size:
            self._result = Staged(self._device, content.size)
        return self._result

    def hand_over(self, out: Any, received: Lent, done: cl.Event) -> None:
        """Copy ``received``, which is written when the event ``done`` happens, to ``out``. Waits for an array of the
        host; for one of the device, later commands of its queue wait."""
        if isinstance(received, Memory):
            with received.mapped(write=False):
                return
        if isinstance(received, Staged):
            received.download(_bytes_of(out), self._copiers)
            return
        out.events.clear()  # ``done`` comes after all of them (``_lent_by``)
        out.add_event(done)
        with self._device.errors:
            self._device.queue.flush()
            while self._others:
                cl.enqueue_barrier(self._others.pop(), wait_for=[done])

    def give_back(self) -> None:
        """Drop references to arrays of the host, which nothing reads any more."""
        if self._device.shares_memory:
            self._lent.clear()

    def close(self) -> None:
        """End the threads; the memory is freed with its owners."""
        self._copiers.close()

    def _lent_by(self, array: Any) -> cl.Buffer:
        if array.context != self._device.context:
            raise UsageError("an array lies in another OpenCL context", cure="cltaa.Resolver(device=array.queue)")
        with self._device.errors:
            # Commands of our own queue come before in any case.
            queue = self._device.queue
            before = [event for event in array.events if event.command_queue != queue]
            if array.queue not in (None, queue):
                before.append(cl.enqueue_marker(array.queue))
                array.queue.flush()
                if array.queue not in self._others:
                    self._others.append(array.queue)
            if before:
                cl.enqueue_barrier(queue, wait_for=before)
        return cast(cl.Buffer, array.base_data)


def _bytes_of(array: NDArray[Any]) -> NDArray[np.uint8]:
    return cast("NDArray[Any]", flat(array)).view(np.uint8)


def array_on(device: Device, array: NDArray[Any]) -> Any:
    """Copy ``array`` to a ``pyopencl.array.Array`` on the queue of ``device``."""
    import pyopencl.array as cl_array  # imported here: few programs hold arrays there

    return cl_array.to_device(device.queue, np.ascontiguousarray(array))


class PlainCopies:
    """The copies that a program would write itself, to compare: its arrays to the device, and a result's bytes back."""

    def __init__(self, device: Device, arrays: Sequence[NDArray[Any]], result: NDArray[Any], *, pinned: bool) -> None:
        """With ``pinned`` the arrays lie in memory that the device transfers at the speed of its bus, unlike a
        program's own arrays."""
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
        """Copy everything once, and wait."""
        queue = self._device.queue
        for source, there in zip(self._sources, self._there, strict=True):
            cl.enqueue_copy(queue, there, source, is_blocking=False)
        cl.enqueue_copy(queue, self._result, self._back, is_blocking=False)
        queue.finish()
