"""The launcher of an OpenCL device: builds kernels, keeps them, and runs each over the work-items that it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.backend import Buffer, Queue
from cltaa.core.build import Build, source_hash
from cltaa.core.constants import PAD_X
from cltaa.core.planes import Layout
from cltaa.opencl.shape import in_place
from cltaa.process import OneProcess

if TYPE_CHECKING:
    from cltaa.core.backend import Exchange
    from cltaa.opencl.device import Kernel

SLIDING = frozenset({"resolve", "gather", "gather_windows", "mix_windows"})  # kernels whose work-items walk down rows
ARRAYS = frozenset({"unpack", "pack"})  # kernels between planes and arrays of a program
ARRAY_GROUP = 128  # work-items in a group of those
EDGE_GROUP = 256  # work-items in a group of extend_edges


class DeviceLauncher(OneProcess):
    """Runs kernels on an OpenCL device, building each once."""

    takes_bands = True

    def __init__(self, requested: str | Queue | None = None) -> None:
        from cltaa.opencl.device import Device

        self.device = Device(requested)
        self.description, self.shares_memory = self.device.description, self.device.shares_memory
        self.stages = not self.shares_memory
        self._kernels: dict[tuple[str, Build], Kernel] = {}
        self._events: list[tuple[str, Any]] | None = None
        self._started: dict[tuple[Any, ...], tuple[Kernel, tuple[int, ...], tuple[int, ...]]] = {}

    def build(self, plan_build: Build) -> Build:
        """Fill in this device's shape; lanes and rows that the build sets itself are kept."""
        shape = self.device.shape
        return msgspec.structs.replace(
            plan_build,
            lanes=plan_build.lanes or shape.lanes,
            rows=plan_build.rows or shape.rows,
            registers=shape.registers_of(plan_build),
            columns_ahead=shape.columns_ahead,
            far_first=shape.far_first and not in_place(plan_build),
        )

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Allocate zeroed device memory."""
        return self.device.allocate(shape, dtype)

    def take(self, planes: NDArray[np.float32]) -> Buffer:
        """Use the planes in place."""
        return self.device.take(planes)

    def pinned(self, size: int) -> NDArray[np.uint8]:
        """Allocate bytes, pinned where the device has memory of its own; raises ResourceError."""
        return self.device.pinned(size) if self.stages and size else np.empty(size, np.uint8)

    def exchange(self) -> Exchange:
        """Return the transfers of this device."""
        from cltaa.opencl.exchange import Exchange

        return Exchange(self.device)

    def empty(self, like: Any, shape: tuple[int, ...], dtype: Any) -> Any:
        """Allocate an array on the queue of ``like``, or else that of the device, by its allocator."""
        return type(like)(like.queue or self.device.queue, shape, dtype, allocator=like.allocator)

    def prepare(self, kernel: str, build: Build) -> None:
        """Build a kernel, or load it from the driver's cache."""
        self.kernel(kernel, build)

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> Any:
        """Enqueue a kernel, in the order of the queue, and return its event. Raises DeviceLost."""
        # Everything that decides which program is started and over how many work-items.
        key = kernel, build, layout, _banded(kernel, arguments), arguments.get("planes"), arguments.get("more")
        started = self._started.get(key)
        if started is None:
            event = self._start_first(key, kernel, self.fitted(kernel, build, layout, arguments), layout, arguments)
        else:
            with self.device.errors:
                event = started[0].enqueue(self.device.queue, *started[1:], arguments)
        if self._events is not None:
            self._events.append((kernel, event))
        return event

    def timed(self, work: Callable[[], object]) -> list[tuple[str, Any]]:
        """Return name and event of each kernel that ``work`` starts and waits for; events tell the device's time."""
        self.device.time_commands()
        events: list[tuple[str, Any]] = []
        self._events = events
        try:
            work()
        finally:
            self._events = None
        return events

    def _start_first(
        self, key: tuple[Any, ...], name: str, build: Build, layout: Layout, arguments: Mapping[str, Any]
    ) -> Any:
        """Start a kernel for the first time over an image of ``layout``, and wait for its end."""
        size, group = self._range(name, build, layout, arguments)
        with self.device.first_use(source_hash(name, build)), self.device.errors:
            kernel = self.kernel(name, build)
            event = kernel.enqueue(self.device.queue, size, group, arguments)
            self.device.finish()
        self._started[key] = kernel, size, group
        return event

    def fitted(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> Build:
        """Return the build of a kernel for planes of ``layout``: some devices compile the resolve for their size.

        The shape's default rows are then replaced by those that load the device evenly.
        """
        shape, rows = self.device.shape, build.rows
        cut = shape.cut_of(kernel)
        if cut and rows == shape.rows:
            return msgspec.structs.replace(build, rows=cut.rows, registers=cut.registers)
        if kernel != "resolve" or not shape.one_size:
            return build
        if _banded(kernel, arguments):
            return msgspec.structs.replace(build, stride=layout.stride)
        if shape.most_rows and rows == shape.rows and not in_place(build):
            units = self.device.cl_device.max_compute_units
            rows = shape.even_rows(layout.width, layout.height, build.registers, units)
        return msgspec.structs.replace(build, stride=layout.stride, plane=layout.plane, rows=rows)

    def kernel(self, name: str, build: Build) -> Kernel:
        """Return the built kernel, cached by this launcher."""
        from cltaa.opencl.device import Kernel

        key = (name, build)
        if key not in self._kernels:
            with self.device.first_use(source_hash(name, build)):
                self._kernels[key] = Kernel(self.device.context, name, build)
        return self._kernels[key]

    def _range(
        self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]
    ) -> tuple[tuple[int, ...], tuple[int, ...]]:
        if kernel == "extend_edges":
            planes = int(arguments["planes"]) + int(arguments["more"])
            items = 2 * layout.stride + 2 * PAD_X * layout.height
            return (-(-items // EDGE_GROUP) * EDGE_GROUP, planes), (EDGE_GROUP, 1)
        if kernel in ARRAYS:  # on a CPU one work-item per row
            columns, rows = (1 if build.lanes > 1 else layout.stride), layout.rows
            group = (1, 1) if build.lanes > 1 else (ARRAY_GROUP, 1)
            return (-(-columns // group[0]) * group[0], rows), group
        rows = build.rows if kernel in SLIDING else 1
        columns, steps = -(-layout.width // build.lanes), -(-layout.height // rows)
        wanted = (self.device.shape.cut_of(kernel) or self.device.shape).group
        group = (1, 1) if build.lanes > 1 else wanted  # a build may have other lanes than the shape
        return (-(-columns // group[0]) * group[0], -(-steps // group[1]) * group[1]), group

    def copy(self, source: Buffer, target: Buffer, offset: int, start: int = 0) -> None:
        """Enqueue a copy inside the device's memory. Raises DeviceLost."""
        self.device.copy(source, target, offset, start)

    def finish(self) -> None:
        """Wait until the device is idle."""
        self.device.finish()


def _banded(kernel: str, arguments: Mapping[str, Any]) -> bool:
    """True for a resolve of a band of an image."""
    return kernel == "resolve" and bool(arguments["frame"]["band_rows"])
