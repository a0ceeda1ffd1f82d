"""OpenCL devices: their list, the choice of one, memory on it that the host can fill and read, and its kernels."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cached_property
from math import prod
from pathlib import Path
from threading import Lock
from typing import Any, cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cltaa.core.backend import DEVICE_VARIABLE, Queue
from cltaa.core.build import Build, source
from cltaa.core.planes import LARGE_PAGE, bytes_in_large_pages
from cltaa.errors import DeviceLost, DeviceMissing, InternalError, ResourceError, UsageError
from cltaa.opencl.cache import cache_folder, check_cache, filling, save_log
from cltaa.opencl.pocl_cpu_name import cpu_facts, cpu_vendor, known_lanes, name_unknown_cpu
from cltaa.opencl.shape import SHAPES, Shape, kept_shape
from cltaa.process import OneProcess

POCL = "Portable Computing Language"  # the platform's name
POCL_VERSION = re.compile(r"PoCL (\d+)\.(\d+)")
# Order of CPU devices of several platforms, as in docs/devices.md: unmeasured ones rank between Intel's runtime and
# Rusticl.
PREFERENCE, UNMEASURED = {POCL: 0, "Intel(R) OpenCL": 1, "rusticl": 3}, 2
# Facts of a processor, as Linux names them on x86-64 and on aarch64.
PROCESSOR = ("cpu family", "model", "flags", "CPU part", "Features")
MEASURED_SHAPES = (POCL, "Intel(R) OpenCL")  # under these, CPU shapes were measured on x86-64
INTEL = "GenuineIntel"  # the processor's word for its maker; a driver may report its own as the vendor
FILL_BYTES = 2**30
# Types that kernels take by value, by their names in OpenCL C. Structs without fields: pyopencl caches fields on disk
# by their size, and would warn of a collision once one is renamed.
TYPES = {"int": np.int32, "float": np.float32, "frame_t": np.void, "settings_t": np.void}

_opened_in: int | None = None  # the process that opened the first device; its forks inherit this


def refuse_fork() -> None:
    """Raise UsageError in a fork of a process that opened a device: without the driver's threads, it would wait for
    ever."""
    global _opened_in
    _opened_in = _opened_in or os.getpid()
    if _opened_in != os.getpid():
        raise UsageError(
            "OpenCL cannot be used in a fork of a process that has opened a device",
            cure="start it anew: multiprocessing.get_context('spawn'), or open devices only in the forks",
        )


def devices() -> list[cl.Device]:
    """Return every OpenCL device: GPUs first, then CPUs by ``PREFERENCE``, PoCL's newest version first."""
    try:
        platforms = cl.get_platforms()
    except cl.LogicError:
        return []
    found: list[cl.Device] = []
    for platform in platforms:
        try:
            here = platform.get_devices()
        except cl.Error:
            continue
        found.extend(map(_named, here))
    return sorted(found, key=_order)


def _named(device: cl.Device) -> cl.Device:
    """Return a device, after PoCL's wrong name for its CPU was corrected: with it a build may end the process."""
    if device.platform.name == POCL:
        name_unknown_cpu(device.int_ptr)
    return device


def _order(device: cl.Device) -> tuple[int, tuple[int, ...]]:
    if device.type & cl.device_type.GPU:
        return -1, ()
    platform = device.platform
    number = POCL_VERSION.search(platform.version) if platform.name == POCL else None
    return PREFERENCE.get(platform.name, UNMEASURED), tuple(-int(part) for part in number.groups()) if number else (0,)


def describe(device: cl.Device) -> str:
    """Return name, platform and driver version in a line."""
    return f"{device.name.strip()} ({device.platform.name.strip()}, driver {device.driver_version.strip()})"


def is_cpu(device: cl.Device) -> bool:
    """True for a device that is the host's processor."""
    return bool(device.type & cl.device_type.CPU)


def choose_device(requested: str | None = None) -> cl.Device:
    """Return the requested device, or CLTAA_DEVICE: an index, a part of its description, ``pocl``; None: the first.
    Raises DeviceMissing without any device and UsageError where none matches."""
    found = devices()
    if not found:
        check_cache()  # PoCL lists no device where it cannot keep kernels
        cure = "install one with: pip install 'pyopencl[pocl]', or use --device numpy; see: cltaa doctor"
        raise DeviceMissing("no OpenCL device found", cure=cure)
    requested = requested or os.environ.get(DEVICE_VARIABLE)
    if not requested:
        return found[0]
    matching = [
        device
        for index, device in enumerate(found)
        if requested == str(index) or (not requested.isdigit() and requested.lower() in _known_as(device).lower())
    ]
    if not matching:
        listed = "; ".join(f"{index}: {describe(device)}" for index, device in enumerate(found))
        if requested == "numpy":  # requested of a command that needs a device
            raise UsageError("this needs an OpenCL device, which numpy is not", found=listed, cure="name one of them")
        raise UsageError(f"no OpenCL device matches {requested}", found=listed, cure="name one of them, or numpy")
    return matching[0]


def _known_as(device: cl.Device) -> str:
    """Return the text that a request can be a part of, PoCL's usual name included."""
    described = describe(device)
    return f"{described} PoCL" if POCL in described else described


def alike(requested: str | None = None) -> list[str]:
    """Return the indices of the device that ``choose_device`` returns, with its errors, and of all of its name."""
    chosen = choose_device(requested)
    same = [(each != chosen, at) for at, each in enumerate(devices()) if describe(each) == describe(chosen)]
    return [str(at) for _, at in sorted(same)]


class Memory(OneProcess):
    """A buffer on the device that the host fills or reads through ``mapped``, by pinned memory where it shares none."""

    def __init__(
        self,
        device: Device,
        shape: tuple[int, ...],
        dtype: Any,
        planes: NDArray[Any] | None = None,
        *,
        written: bool = False,
    ) -> None:
        """Allocate zeros, or use ``planes`` of the host in place; kernels only read those, unless ``written``."""
        self._device, self.shape, self.dtype = device, shape, np.dtype(dtype)
        self.size = prod(shape) * self.dtype.itemsize
        self._staging: NDArray[Any] | None = None
        if planes is not None:
            with _memory_errors(self.size, device):
                use = cl.mem_flags.READ_WRITE if written else cl.mem_flags.READ_ONLY
                self.buffer = cl.Buffer(device.context, use | cl.mem_flags.USE_HOST_PTR, hostbuf=planes)
            return
        flags = cl.mem_flags.READ_WRITE
        with _memory_errors(self.size, device):
            if device.is_cpu and self.size >= LARGE_PAGE:
                # PoCL's own allocations have pages of 4 KiB, and a kernel accesses a dozen planes at once.
                given = bytes_in_large_pages(self.size)
                self.buffer = cl.Buffer(device.context, flags | cl.mem_flags.USE_HOST_PTR, hostbuf=given)
            elif device.shares_memory:
                self.buffer = cl.Buffer(device.context, flags | cl.mem_flags.ALLOC_HOST_PTR, self.size)
            else:
                self.buffer = cl.Buffer(device.context, flags, self.size)
            # Drivers allocate on first use: touching the memory now reports a lack of it before any work is done.
            # NVIDIA's cannot fill 4 GB at once, nor beyond the first 4 GB of a buffer: there zeros are copied.
            head = min(FILL_BYTES, self.size)
            cl.enqueue_fill(device.queue, self.buffer, np.zeros(1, np.uint8), head).wait()
            for start in range(head, self.size, FILL_BYTES):
                length = min(FILL_BYTES, self.size - start)
                cl.enqueue_copy(device.queue, self.buffer, self.buffer, byte_count=length, dst_offset=start).wait()

    @contextmanager
    def mapped(self, *, write: bool) -> Iterator[NDArray[Any]]:
        """Map the contents as an array, to write all of it (``write``) or to read it."""
        queue = self._device.queue
        if self._device.shares_memory:
            with self._device.errors:
                flags, kind = cl.map_flags.WRITE if write else cl.map_flags.READ, cast(Any, self.dtype)
                array, _ = cl.enqueue_map_buffer(queue, self.buffer, flags, 0, self.shape, kind)
            try:
                yield cast(NDArray[Any], array)
            finally:
                with self._device.errors:
                    cast(Any, array.base).release(queue)
            return
        if self._staging is None:
            self._staging = self._device.pinned(self.size).view(self.dtype).reshape(self.shape)
        if not write:
            with self._device.errors:
                cl.enqueue_copy(queue, self._staging, self.buffer)
        yield self._staging
        if write:
            with self._device.errors:
                cl.enqueue_copy(queue, self.buffer, self._staging)


class Device(OneProcess):
    """One OpenCL device with its context, its queue and its shape of kernels."""

    def __init__(self, requested: str | Queue | None = None) -> None:
        refuse_fork()
        if requested is not None and not isinstance(requested, str):
            self._take(cast(cl.CommandQueue, requested))
            return
        self.cl_device = choose_device(requested)
        try:
            self.context = context_of(self.cl_device)
            self.queue = cl.CommandQueue(self.context)
        except cl.Error as error:
            raise DeviceMissing(f"{self.description} cannot be opened: {error}", cure="see: cltaa doctor") from error
        self._describe()

    def _take(self, queue: cl.CommandQueue) -> None:
        """Use the context of a program's queue, and the queue itself if it is in order."""
        self.cl_device, self.context, self.queue = _named(queue.device), queue.context, queue
        if queue.properties & cl.command_queue_properties.OUT_OF_ORDER_EXEC_MODE_ENABLE:
            self.queue = cl.CommandQueue(self.context, self.cl_device)
        self._describe()

    def time_commands(self) -> None:
        """Let events tell the device's time of their commands, which costs a GPU's driver 4 us for each."""
        timed = cl.command_queue_properties.PROFILING_ENABLE
        if not self.queue.properties & timed:
            self.finish()
            self.queue = cl.CommandQueue(self.context, properties=timed)

    def _describe(self) -> None:
        self.errors = DriverErrors(self.cl_device)  # around each call
        self.is_cpu = is_cpu(self.cl_device)
        self.shares_memory = bool(self.cl_device.host_unified_memory)

    @property
    def description(self) -> str:
        """Return name, platform and driver version in a line."""
        return describe(self.cl_device)

    @cached_property
    def shape(self) -> Shape:
        """The shape of kernels for this device."""
        return SHAPES[chosen_shape(self.cl_device)[0]]

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Memory:
        """Allocate zeroed device memory; raises ResourceError where there is not enough."""
        return Memory(self, shape, dtype)

    def take(self, planes: NDArray[Any]) -> Memory:
        """Use ``planes`` in place, on a device that shares the host's memory; raises ResourceError."""
        return Memory(self, planes.shape, planes.dtype, planes)

    def pinned(self, size: int) -> NDArray[np.uint8]:
        """Allocate bytes of the host that the device transfers at the speed of the bus; raises ResourceError."""
        with _memory_errors(size, self):
            host = cl.Buffer(self.context, cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR, size)
        both = cl.map_flags.WRITE | cl.map_flags.READ
        with self.errors:
            bytes_ = cast(Any, np.uint8)
            array, _ = cl.enqueue_map_buffer(self.queue, host, cast(cl.map_flags, both), 0, (size,), bytes_)
        return cast(NDArray[np.uint8], array)

    def copy(self, source: Any, target: Any, offset: int, start: int) -> None:
        """Enqueue a copy from element ``start`` of ``source`` to ``offset`` of ``target``, as much as fits; raises
        DeviceLost."""
        read, written = start * source.dtype.itemsize, offset * target.dtype.itemsize
        with self.errors:
            cl.enqueue_copy(
                self.queue,
                target.buffer,
                source.buffer,
                byte_count=min(source.size - read, target.size - written),
                src_offset=read,
                dst_offset=written,
            )

    def finish(self) -> None:
        """Wait until the queue is empty; raises DeviceLost."""
        with self.errors:
            self.queue.finish()

    def first_use(self, kernel: str) -> AbstractContextManager[None]:
        """Return the lock to hold while ``kernel``, a hash, is built and first runs: PoCL then fills its cache."""
        return filling(kernel) if self.cl_device.platform.name == POCL else nullcontext()


def device_flags(devices: Iterable[cl.Device]) -> tuple[str, ...]:
    """Return the compiler options that these devices need in addition to those of a build.

    The literals of K are doubles cast to its precision. Clang also casts them where a device has no doubles, but with a
    warning that belongs to no group, and -Werror makes it an error; the option avoids that and changes no bit.
    """
    doubles = all("cl_khr_fp64" in device.extensions.split() for device in devices)
    return () if doubles else ("-cl-single-precision-constant",)


def context_of(device: cl.Device) -> cl.Context:
    """Open a device."""
    return cl.Context([device])


def program_of(context: cl.Context, text: str, options: tuple[str, ...]) -> cl.Program:
    """Build a program without pyopencl's cache, whose binaries of Intel's runtime lack the names of arguments."""
    program = cl.Program(context, text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # to ask before the build avoids that cache
        program.get_info(cl.program_info.REFERENCE_COUNT)
    built: cl.Program = program.build(options=list(options))
    return built


class Kernel(OneProcess):
    """One built kernel; call ``enqueue`` with its arguments by name."""

    def __init__(self, context: cl.Context, name: str, build: Build) -> None:
        self.name, self.build = name, build
        try:
            with warnings.catch_warnings():
                # Some drivers print remarks for every build; -Werror has made errors of the warnings among them.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                options = (*build.flags(), *device_flags(context.devices))
                program = program_of(context, source(name, build), options)
        except cl.RuntimeError as error:
            said = (line.strip() for line in str(error).splitlines() if not line.startswith("(options:"))  # -Werror
            reason = next((line for line in said if "error" in line), None)
            log = save_log(Path(name).name, str(error), source(name, build))
            told = f"the whole log and text: {log}; " if log else ""
            cure = f"{told}check the driver and its kernel cache with: cltaa doctor"
            if reason is None:
                other = f"if parts of the kernel cache {cache_folder()} are another user's"
                cure += f"; {other}, set POCL_CACHE_DIR to a folder of your own"
            what = f"kernel {name} does not build: {reason or 'the compiler gave no reason'}"
            raise InternalError(what, cure=cure) from error
        self._kernel = cl.Kernel(program, f"{Path(name).name}_kernel")
        # Argument names, in order.
        self.arguments = [str(name) for name in self._of_arguments(cl.kernel_arg_info.NAME)]
        self._named = frozenset(self.arguments)
        # With their types all are set in two calls; otherwise pyopencl tries several types for each, 10 us a number.
        kinds = self._of_arguments(cl.kernel_arg_info.TYPE_NAME)
        self._kernel.set_scalar_arg_dtypes([TYPES.get(kind) for kind in kinds])
        self._starting = Lock()  # arguments are state of the kernel: threads start it one at a time

    def enqueue(
        self, queue: cl.CommandQueue, size: tuple[int, ...], group: tuple[int, ...] | None, arguments: Mapping[str, Any]
    ) -> cl.Event:
        """Start the kernel over ``size`` work-items in groups of ``group``; memory is a ``cl.Buffer``, or has one as
        ``buffer``. Raises InternalError for a wrong name."""
        if arguments.keys() != self._named:
            raise InternalError(
                f"kernel {self.name}: arguments do not match",
                expected=", ".join(self.arguments),
                found=", ".join(arguments),
            )
        values = [getattr(value, "buffer", value) for value in map(arguments.__getitem__, self.arguments)]
        with self._starting:
            self._kernel.set_args(*values)
            return cl.enqueue_nd_range_kernel(queue, self._kernel, size, group)

    def _of_arguments(self, what: cl.kernel_arg_info) -> list[Any]:
        return [self._kernel.get_arg_info(index, what) for index in range(self._kernel.num_args)]


def chosen_shape(device: cl.Device) -> tuple[str, str]:
    """The name of a device's shape, and whether it is measured (``cltaa bench devices``), built in or a guess."""
    kept = kept_shape(measured_on(device), candidate_shapes(device))
    return (kept, "measured") if kept else usual_shape(device)


def usual_shape(device: cl.Device) -> tuple[str, str]:
    """As ``chosen_shape``, without measurements on the device itself."""
    runtime = device.platform.name
    if not is_cpu(device):
        return ("nvidia", "built in") if runtime == "NVIDIA CUDA" else ("gpu", "a guess")
    width, known = device.native_vector_width_float, known_lanes()
    # Only x86-64 has needed four lanes: without AVX, LLVM 14 fails over eight.
    name = cpu_shape(max(width, 8) if known is None else min(width, known), cpu_vendor())
    return name, "built in" if known and runtime in MEASURED_SHAPES else "a guess"


def cpu_shape(width: int, vendor: str) -> str:
    """Return the shape for a CPU of ``vendor`` (the processor's word) whose registers hold ``width`` floats."""
    if width >= 16:
        return "intel-16" if vendor == INTEL else "cpu-16"
    return "cpu-8" if width >= 8 else "cpu-4"


def candidate_shapes(device: cl.Device) -> list[str]:
    """Return the shapes worth measuring on a device: the usual one, then the others, the quickest to build first.

    On a CPU only lanes vary, since rows and prefetching make no difference that two cores show; one lane suits a
    runtime that vectorises over work-items. With more lanes than the CPU has, the compiler may end the process.
    """
    usual, _ = usual_shape(device)
    if not is_cpu(device):
        return [usual, *(name for name in ("gpu", "gpu-long") if name != usual)]
    most, lanes = known_lanes() or 16, SHAPES[usual].lanes
    return [usual, *(name for name in ("gpu", "cpu-4", "cpu-8", "cpu-16") if lanes != SHAPES[name].lanes <= most)]


def measured_on(device: cl.Device) -> dict[str, str]:
    """Return the facts for which a measured shape is valid: device, runtime, compiler, a CPU's model and features."""
    facts = {
        "device": describe(device),
        "runtime": f"{device.platform.version} {device.opencl_c_version}",
        "units": str(device.max_compute_units),
    }
    told = cpu_facts() if is_cpu(device) else {}
    return facts | {key: told[key] for key in PROCESSOR if key in told}


@contextmanager
def _memory_errors(needed: int, device: Device) -> Iterator[None]:
    refuse_fork()
    try:
        yield
    except (MemoryError, cl.MemoryError, cl.RuntimeError, cl.LogicError) as error:
        largest, whole = device.cl_device.max_mem_alloc_size, device.cl_device.global_mem_size
        what, expected = f"not enough memory on {device.description}", f"{needed} bytes in one buffer"
        found = f"largest buffer {largest} bytes, all its memory {whole} bytes"
        cure = "use a smaller size or another --device, or run again when others have ended"
        raise ResourceError(what, expected=expected, found=found, cure=cure) from error


# Codes that the driver also returns for a lost device, though the call was right.
_GONE = frozenset({cl.status_code.INVALID_COMMAND_QUEUE, cl.status_code.INVALID_CONTEXT})


class DriverErrors:
    """Raises errors of a device's driver as DeviceLost, or as InternalError where the call itself was wrong.

    A class, with one object a device: each call is in it, and a generator would take ten times as long.
    """

    def __init__(self, device: cl.Device) -> None:
        self._device = device

    def __enter__(self) -> None:
        """Raise UsageError in a fork."""
        refuse_fork()

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Raise the error that replaces the driver's."""
        if not isinstance(error, cl.Error):
            return
        description = describe(self._device)
        if isinstance(error, cl.LogicError) and error.code not in _GONE:
            raise InternalError(f"{description} refused a call: {error}") from error
        cure = "run the same command again: it goes on from there; if this comes back, use a smaller size or --device"
        raise DeviceLost(f"{description} stopped working: {error}", cure=cure) from error
