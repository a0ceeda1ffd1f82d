"""``cltaa bench api``: time of a call of ``Resolver.resolve``, compared with its kernels and with the bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count, islice
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa.lab.timing import (
    Clock,
    Environment,
    Interval,
    Motion,
    camera_at,
    environment,
    kernel_seconds,
    load_average,
    make_frames,
    measure,
)
from cltaa.opencl.exchange import PlainCopies, array_on
from cltaa.opencl.launcher import DeviceLauncher

CALLS = 8  # calls in a row; their time is divided by this number


class ApiTimes(msgspec.Struct, frozen=True, kw_only=True):
    """Seconds per frame for one size."""

    width: int
    height: int
    bytes: int  # transferred to the device and back for a frame of the host
    kernels: Interval  # the device's own time of a call with device arrays
    device_arrays: Interval
    host_arrays: Interval
    pinned_arrays: Interval  # host arrays from ``Resolver.empty``
    copies: Interval  # of plain NumPy arrays
    pinned_copies: Interval  # from and to pinned memory: the speed of the bus


class ApiBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement."""

    preset: str
    rounds: int
    environment: Environment
    rows: list[ApiTimes]


def bench_api(preset: Preset, device: str | None, sizes: tuple[tuple[int, int], ...], *, rounds: int) -> ApiBench:
    """Time calls with frames of ``sizes``, colour and depth without declared effects, all kinds in turn.

    Raises UsageError for NumPy as the device, and ResourceError for too little memory.
    """
    before, launcher = load_average(), DeviceLauncher(device)
    clocked = DeviceLauncher(device)  # its clock takes time of its own
    rows = [_timed(preset, launcher, clocked, width, height, rounds) for width, height in sizes]
    where = environment(launcher.description, before)
    return ApiBench(preset=preset.name, rounds=rounds, environment=where, rows=rows)


def _timed(
    preset: Preset, launcher: DeviceLauncher, clocked: DeviceLauncher, width: int, height: int, rounds: int
) -> ApiTimes:
    (made,) = make_frames(width, height, Motion.UNIFORM, 1)
    colour, out = np.ascontiguousarray(made.colour), np.empty((height, width, 3), np.float32)
    host = replace(made, colour=colour, effects=None)
    arrays = [colour, host.depth]
    plain = PlainCopies(launcher.device, arrays, out, pinned=False)
    pinned = PlainCopies(launcher.device, arrays, out, pinned=True)
    placing = Resolver(preset, launcher)
    placed: dict[str, Any] = {name: _pinned(placing, getattr(host, name)) for name in ("colour", "depth")}
    kernels = _device_calls(preset, clocked, host, out)
    runs: dict[str, Callable[[], float | None]] = {
        "kernels": lambda: kernel_seconds(clocked, kernels),
        "device_arrays": _device_calls(preset, launcher, host, out),
        "host_arrays": _calls(Resolver(preset, launcher), host, out),
        "pinned_arrays": _calls(placing, replace(host, **placed), _pinned(placing, out)),
        "copies": _times(plain.run),
        "pinned_copies": _times(pinned.run),
    }
    samples = measure(runs, rounds, warm_up=1, action=f"timing {width} x {height}")
    return ApiTimes(
        width=width,
        height=height,
        bytes=sum(array.nbytes for array in (*arrays, out)),
        **{
            name: samples.interval(name, Clock.DEVICE if name == "kernels" else Clock.WALL).times(1 / CALLS)
            for name in runs
        },
    )


def _pinned(resolver: Resolver, array: NDArray[Any]) -> NDArray[Any]:
    place = resolver.empty(array.shape, array.dtype)
    place[...] = array
    return place


def _device_calls(preset: Preset, launcher: DeviceLauncher, host: Frame, out: NDArray[Any]) -> Callable[[], None]:
    there: dict[str, Any] = {name: array_on(launcher.device, getattr(host, name)) for name in ("colour", "depth")}
    return _calls(Resolver(preset, launcher), replace(host, **there), array_on(launcher.device, out))


def _calls(resolver: Resolver, frame: Frame, out: Any) -> Callable[[], None]:
    """Return a run of calls with frames like those of a renderer: the same arrays under a sliding camera."""
    numbers = count()

    def resolve() -> None:
        for index in islice(numbers, CALLS):
            camera = camera_at(index, Motion.UNIFORM, frame.width, frame.height)
            resolver.resolve(replace(frame, index=index, camera=camera), out=out)
        resolver.launcher.finish()

    return resolve


def _times(copy: Callable[[], None]) -> Callable[[], None]:
    def run() -> None:
        for _ in range(CALLS):
            copy()

    return run
