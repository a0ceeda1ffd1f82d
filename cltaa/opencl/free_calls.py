"""Calls of OpenCL in which other threads may use the interpreter.

pyopencl holds it while it enqueues, and a CPU's driver wakes the threads that work meanwhile. Where cores are busy they
push aside the thread that woke them, and every other one waits for the interpreter until a core is free again.
"""

from __future__ import annotations

from ctypes import CDLL, POINTER, Array, byref, c_int, c_int32, c_size_t, c_ubyte, c_uint, c_uint64, c_void_p
from functools import cache, lru_cache
from typing import Any, cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Size = tuple[int, ...]

BLOCKING = 1  # CL_TRUE


def start_kernel(queue: cl.CommandQueue, kernel: cl.Kernel, size: Size, group: Size | None) -> cl.Event:
    """Enqueue a kernel whose arguments are set; raises what pyopencl raises."""
    calls = free_calls()
    if calls is not None:
        event, sizes = c_void_p(), (_in_c(size), None if group is None else _in_c(group))
        failed = calls.clEnqueueNDRangeKernel(
            queue.int_ptr, kernel.int_ptr, len(size), None, *sizes, 0, None, byref(event)
        )
        if not failed and event.value:
            return cl.Event.from_int_ptr(event.value, False)
    return cl.enqueue_nd_range_kernel(queue, kernel, size, group)  # which says what is wrong


def map_memory(queue: cl.CommandQueue, buffer: cl.Buffer, size: int, *, write: bool) -> Bytes:
    """The ``size`` bytes of a buffer, for writing all of them or for reading, once all that was enqueued is done."""
    calls, flags = free_calls(), cl.map_flags.WRITE if write else cl.map_flags.READ
    if calls is not None:
        failed, around = c_int32(), (queue.int_ptr, buffer.int_ptr, BLOCKING, int(flags), 0, size)
        address = calls.clEnqueueMapBuffer(*around, 0, None, None, byref(failed))
        if address and not failed.value:
            memory: Any = (c_ubyte * size).from_address(address)
            return np.frombuffer(memory, np.uint8)
    kind: Any = np.uint8
    return cast(Bytes, cl.enqueue_map_buffer(queue, buffer, flags, 0, (size,), kind)[0])  # which says what is wrong


def unmap_memory(queue: cl.CommandQueue, buffer: cl.Buffer, mapped: Bytes) -> None:
    """Give back what ``map_memory`` returned, which nobody may look at from then on; raises what pyopencl raises."""
    calls = free_calls()
    if isinstance(mapped.base, cl.MemoryMap) or calls is None:
        cast(Any, mapped.base).release(queue)
        return
    failed = calls.clEnqueueUnmapMemObject(queue.int_ptr, buffer.int_ptr, mapped.ctypes.data, 0, None, None)
    if failed:
        raise cl.RuntimeError(cl._cl._ErrorRecord("clEnqueueUnmapMemObject", failed, ""))


@cache
def free_calls() -> Any | None:
    """OpenCL's own functions, in the library that pyopencl has loaded; None where they cannot be reached."""
    events = (c_uint, c_void_p, c_void_p)
    sizes, place = (c_void_p,) * 3, (c_uint, c_uint64, c_size_t, c_size_t)
    try:
        library = CDLL(cl._cl.__file__)
        for name, answer, arguments in (
            ("clEnqueueNDRangeKernel", c_int, (c_void_p, c_void_p, c_uint, *sizes, *events)),
            ("clEnqueueMapBuffer", c_void_p, (c_void_p, c_void_p, *place, *events, POINTER(c_int32))),
            ("clEnqueueUnmapMemObject", c_int, (c_void_p, c_void_p, c_void_p, *events)),
        ):
            function = getattr(library, name)
            function.argtypes, function.restype = arguments, answer
    except (OSError, AttributeError, TypeError):
        return None
    return library


@lru_cache(maxsize=64)
def _in_c(size: Size) -> Array[c_size_t]:
    return (c_size_t * len(size))(*size)
