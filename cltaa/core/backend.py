"""What runs kernels: an OpenCL device (``device_launcher``), or NumPy (``numpy_launcher``)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from cltaa.core.build import Build, Storage
from cltaa.core.planes import Layout
from cltaa.errors import UsageError

DEVICE_VARIABLE = "CLTAA_DEVICE"  # the variable that names a device where nothing else does


class Buffer(Protocol):
    """Memory of a launcher that the host can fill or read."""

    def mapped(self, *, write: bool) -> AbstractContextManager[NDArray[Any]]:
        """The contents as an array, for writing all of it or for reading."""


class Queue(Protocol):
    """A ``pyopencl.CommandQueue``."""

    context: Any
    device: Any


class Exchange(Protocol):
    """The way of one resolver's arrays to a launcher and back."""

    def lend(self, name: str, array: Any) -> Any:
        """Memory that kernels read ``array`` from, where ``places`` says, until the next of that ``name``.

        An array of the host is one that ``planes.flat`` takes. Raises UsageError for an array of another device.
        """

    def receive(self, out: Any) -> Any:
        """Memory that ``pack`` fills for ``out``."""

    def hand_over(self, out: Any, received: Any, done: Any) -> None:
        """Bring what was ``received``, and packed when ``done`` happens, into ``out``, a device's in the order of its
        queue."""

    def give_back(self) -> None:
        """Forget arrays of the host, which nothing reads any more."""

    def close(self) -> None:
        """End the threads that it takes."""


class Launcher(Protocol):
    """Allocates memory and runs kernels by name."""

    description: str
    stages: bool  # arrays are copied to memory of its own, which is kept from frame to frame
    shares_memory: bool  # with the host, so that what is there already need not be copied
    takes_bands: bool  # runs kernels over bands of rows, not over whole images alone

    def build(self, plan_build: Build) -> Build:
        """The build shaped for this launcher (lanes, rows)."""

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Zeroed memory."""

    def take(self, planes: NDArray[np.float32]) -> Buffer:
        """Memory that kernels read, which are ``planes`` of the host, where this launcher shares its memory."""

    def pinned(self, size: int) -> NDArray[np.uint8]:
        """Bytes of the host that arrays come from and go to fastest."""

    def exchange(self) -> Exchange:
        """The way of a resolver's arrays to the launcher and back."""

    def empty(self, like: Any, shape: tuple[int, ...], dtype: Any) -> Any:
        """A new array on the device of ``like``."""

    def prepare(self, kernel: str, build: Build) -> None:
        """Build a kernel before it is run."""

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> Any:
        """Run a kernel over an image of ``layout``; arguments are buffers, struct records, whole numbers or None.

        Returns what happens at its end.
        """

    def copy(self, source: Buffer, target: Buffer, offset: int, start: int = 0) -> None:
        """Copy ``source`` from its element ``start`` on into ``target`` from ``offset`` on, to the end of the shorter;
        both hold the same numbers."""

    def finish(self) -> None:
        """Wait for everything that was started."""


def storage_dtype(build: Build) -> Any:
    """NumPy type of the history."""
    return {Storage.FLOAT: np.float32, Storage.DOUBLE: np.float64}.get(build.storage, np.float16)


def launcher_for(device: str | int | Launcher | Queue | None) -> Launcher:
    """A launcher as it is, that of a program's queue, or that of ``--device`` or CLTAA_DEVICE: ``numpy``, or a wish for
    ``choose_device``."""
    if device is not None and not isinstance(device, str | int) and not hasattr(device, "context"):
        if not hasattr(device, "build"):
            raise UsageError("no device", expected="index, part of a name, numpy, or queue", found=repr(device))
        return device
    from cltaa.opencl.launcher import DeviceLauncher
    from cltaa.reference.launcher import NumpyLauncher

    if not isinstance(device, str | int | None):
        return DeviceLauncher(cast(Queue, device))
    requested = str(device) if isinstance(device, int) else device or os.environ.get(DEVICE_VARIABLE)
    return NumpyLauncher() if requested == "numpy" else DeviceLauncher(requested)
