"""What a program does itself with pyopencl: arrays on a device, and plain copies of arrays there and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl.array as cl_array
from numpy.typing import NDArray

from cltaa.opencl.device import Device


def array_on(device: Device, array: NDArray[Any]) -> Any:
    """A ``pyopencl.array.Array`` on the queue of ``device`` that holds what ``array`` does."""
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
