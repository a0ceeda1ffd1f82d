"""Launcher of the kernels' NumPy twins: the float32 oracle, which is also the fallback without OpenCL."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cltaa.core.backend import Buffer, Exchange
from cltaa.core.build import Build
from cltaa.core.planes import Layout, flat
from cltaa.errors import UsageError
from cltaa.frame import on_device


class _Array:
    """Memory of the NumPy launcher."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array

    @contextmanager
    def mapped(self, *, write: bool) -> Iterator[NDArray[Any]]:
        planes = self.array.view()
        planes.flags.writeable = write  # a device discards writes to memory that was mapped for reading
        yield planes


def _lent(array: Any) -> _Array:
    if on_device(array):
        raise UsageError("an array of a device cannot be resolved by NumPy", cure="cltaa.Resolver(device=array.queue)")
    return _Array(cast(NDArray[Any], flat(array)))


class _Exchange:
    """A program's arrays, used in place."""

    def lend(self, name: str, array: Any) -> Any:
        """The array's own memory."""
        return _lent(array)

    def receive(self, out: Any) -> Any:
        """The output array's own memory."""
        return _lent(out)

    def hand_over(self, out: Any, received: Any, done: Any) -> None:
        """Nothing to copy."""

    def give_back(self) -> None:
        """Nothing to release."""

    def close(self) -> None:
        """No threads to end."""


class NumpyLauncher:
    """Runs the NumPy twins of the kernels, in float32 and in the kernels' order."""

    description = "NumPy (float32 oracle)"
    shares_memory = False  # so that a twin in another type than that of files has its own memory
    takes_bands = False
    stages = False

    def build(self, plan_build: Build) -> Build:
        """The build unchanged: the oracle has no lanes."""
        return plan_build

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Zeroed arrays."""
        return _Array(np.zeros(shape, dtype))

    def take(self, planes: NDArray[np.float32]) -> Buffer:
        """The planes themselves."""
        return _Array(planes)

    def pinned(self, size: int) -> NDArray[np.uint8]:
        """Ordinary memory."""
        return np.empty(size, np.uint8)

    def exchange(self) -> Exchange:
        """An exchange that uses arrays in place."""
        return _Exchange()

    def empty(self, like: Any, shape: tuple[int, ...], dtype: Any) -> Any:
        """Refuse a device's array."""
        return _lent(like)

    def prepare(self, kernel: str, build: Build) -> None:
        """Nothing to build."""

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        """Run the twin of a kernel at once."""
        from cltaa.reference import KERNELS

        given = {name: value.array if isinstance(value, _Array) else value for name, value in arguments.items()}
        KERNELS[kernel](build, layout, **given)

    def copy(self, source: Buffer, target: Buffer, offset: int, start: int = 0) -> None:
        """Copy at once."""
        assert isinstance(source, _Array)
        assert isinstance(target, _Array)
        read, written = source.array.reshape(-1)[start:], target.array.reshape(-1)[offset:]
        count = min(read.size, written.size)
        written[:count] = read[:count]

    def finish(self) -> None:
        """Nothing is ever pending."""
