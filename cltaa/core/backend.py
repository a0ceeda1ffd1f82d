"""Launchers, which run kernels: on an OpenCL device (``cltaa.opencl``), or as NumPy twins (``cltaa.reference``)."""

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

DEVICE_VARIABLE = "CLTAA_DEVICE"  # names a device where no argument does


class Buffer(Protocol):
    """Memory of a launcher that the host can fill or read."""

    def mapped(self, *, write: bool) -> AbstractContextManager[NDArray[Any]]:
        """Map the contents as an array, to write all of it or to read it."""


class Queue(Protocol):
    """A ``pyopencl.CommandQueue``."""

    context: Any
    device: Any


class Exchange(Protocol):
    """Brings the arrays of one resolver to a launcher and back."""

    def lend(self, name: str, array: Any) -> Any:
        """Return memory from which kernels read ``array`` as ``places`` says, until the next call with that ``name``;
        raises UsageError for an array of another device."""

    def receive(self, out: Any) -> Any:
        """Return the memory that ``pack`` fills for ``out``."""

    def hand_over(self, out: Any, received: Any, done: Any) -> None:
        """Copy ``received``, which is packed when ``done`` happens, into ``out``, in the order of a device's queue."""

    def give_back(self) -> None:
        """Drop references to arrays of the host, which nothing reads any more."""

    def close(self) -> None:
        """End its copying threads."""


class Launcher(Protocol):
    """Allocates memory and runs kernels by name."""

    description: str
    stages: bool  # copies arrays to memory of its own, which it keeps from frame to frame
    shares_memory: bool  # with the host, so that arrays there need no copy
    takes_bands: bool  # runs kernels over bands of rows, not only over whole images

    def build(self, plan_build: Build) -> Build:
        """Return the build with this launcher's shape (lanes, rows)."""

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Allocate zeroed memory."""

    def take(self, planes: NDArray[np.float32]) -> Buffer:
        """Return memory that kernels read in place: ``planes`` of the host, where this launcher shares its memory."""

    def pinned(self, size: int) -> NDArray[np.uint8]:
        """Allocate bytes of the host with the fastest transfers to and from the launcher."""

    def exchange(self) -> Exchange:
        """Return a new exchange for the arrays of one resolver."""

    def empty(self, like: Any, shape: tuple[int, ...], dtype: Any) -> Any:
        """Allocate an array on the device of ``like``."""

    def prepare(self, kernel: str, build: Build) -> None:
        """Build a kernel before it is run."""

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> Any:
        """Run a kernel over an image of ``layout``, on buffers, structs, numbers or None; returns its event."""

    def copy(self, source: Buffer, target: Buffer, offset: int, start: int = 0) -> None:
        """Copy from element ``start`` of ``source`` to ``offset`` of ``target``, of one type, as much as fits."""

    def finish(self) -> None:
        """Wait for all work that was started."""


def storage_dtype(build: Build) -> Any:
    """Return the NumPy type of the history."""
    return {Storage.FLOAT: np.float32, Storage.DOUBLE: np.float64}.get(build.storage, np.float16)


def launcher_for(device: str | int | Launcher | Queue | None) -> Launcher:
    """Return a launcher unchanged, that of a program's queue, or that named by ``device`` or CLTAA_DEVICE."""
    if device is not None and not isinstance(device, str | int) and not hasattr(device, "context"):
        if not hasattr(device, "build"):
            raise UsageError("no device", expected="index, part of a name, numpy, or queue", found=repr(device))
        return device
    from cltaa.opencl.launcher import DeviceLauncher
    from cltaa.reference.launcher import NumpyLauncher

    if not isinstance(device, str | int | None):
        return DeviceLauncher(cast(Queue, device))
    if device == "":  # an unset variable of a script, which every device's name contains
        raise UsageError("the name of a device is empty", cure="leave it out for the first device")
    requested = str(device) if isinstance(device, int) else device or os.environ.get(DEVICE_VARIABLE)
    return NumpyLauncher() if requested == "numpy" else DeviceLauncher(requested)
