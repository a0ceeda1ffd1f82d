"""``cltaa bench growth``: what a pixel takes, and what memory a resolve takes, from small images to large ones.

Each size is timed in turn with one size that stays, and the ratio of the two is what is reported. Images that whole do
not fit into a buffer or into memory are resolved in bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from cltaa.core.backend import Buffer
from cltaa.core.bands import BAND_ROWS, BandedResolver
from cltaa.core.build import Steps
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError
from cltaa.frame import Frame
from cltaa.lab.bench.environment import Environment, environment, load_average
from cltaa.lab.bench.frames import EFFECTS, Motion, camera_at
from cltaa.lab.timing import Clock, Interval, Job, device_seconds, measure
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.pipeline.memory import DevicePlanes, device_bytes

SIZES = (256, 512, 1024, 2048, 4096, 8192)
REFERENCE = 2048
# Pixels a side; what is larger takes seconds a frame, nearly all of them on its way to the device.
MANY_ROUNDS_TO = 4096
FEWEST_ROUNDS = 3
FLAT = 0.15
TILE = 256  # of random pixels that an image is filled with


class Growth(msgspec.Struct, frozen=True, kw_only=True):
    """One size. ``ratio`` is of the kernels' time a pixel to that of ``REFERENCE``, paired."""

    side: int
    band_rows: int  # 0: in one piece
    rounds: int
    ns_a_pixel: Interval
    least_ns: float
    ratio: Interval
    allocated: int  # bytes on the device
    formula: int  # what cltaa.pipeline.memory says


class GrowthBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement."""

    preset: str
    rounds: int
    environment: Environment
    rows: list[Growth]


class _Counting(DeviceLauncher):
    """A launcher that counts the bytes it was asked for."""

    allocated = 0

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        self.allocated += int(np.prod(shape)) * np.dtype(dtype).itemsize
        return super().allocate(shape, dtype)


class _Sized:
    """A resolver of one size with an endless sequence of frames to resolve."""

    def __init__(self, preset: Preset, device: str | None, side: int, band_rows: int) -> None:
        self.launcher = _Counting(device)
        if band_rows:
            self._resolver: Resolver = BandedResolver(preset, self.launcher, band_rows=band_rows)
        else:
            self._resolver = Resolver(preset, self.launcher)
        self._frame, self.pixels = square(side), side * side

    def run(self) -> float:
        """Resolve the next frame; the device's seconds in the kernel that resolves."""
        events: list[tuple[str, Any]] = []
        self.launcher.events = events
        self._resolver.resolve(self._frame)
        side, number = len(self._frame.depth), self._frame.index + 1
        self._frame = replace(self._frame, index=number, camera=camera_at(number, Motion.UNIFORM, side, side))
        return device_seconds([(name, event) for name, event in events if name == "resolve"])

    @property
    def steps(self) -> Steps:
        """The steps of the last frame."""
        assert self._resolver.plan is not None
        return self._resolver.plan.steps


def square(side: int) -> Frame:
    """A frame of random pixels at a distance of 1, which is its own inverse: bands leave inverse depth where depth was.

    Raises ResourceError where there is no memory for it.
    """
    random = np.random.default_rng(0)
    times = -(-side // TILE)
    try:
        planes = np.tile(random.random((3, TILE, TILE), dtype=np.float32), (1, times, times))[:, :side, :side]
        colour, depth = np.moveaxis(np.ascontiguousarray(planes), 0, -1), np.ones((side, side), np.float32)
    except (MemoryError, ValueError) as error:  # the one of what is too much, the other of what no machine has
        what = f"no memory for a frame of {side} x {side} pixels"
        raise ResourceError(what, cure="name smaller sizes with --sizes") from error
    return Frame(
        index=0,
        colour=colour,
        depth=depth,
        camera=camera_at(0, Motion.UNIFORM, side, side),
        jitter_px=(0.25, -0.125),
        scene="growth",
        effects=EFFECTS,
    )


def bench_growth(
    preset: Preset,
    device: str | None,
    sizes: Sequence[int] = SIZES,
    *,
    rounds: int,
    banded_from: int,
) -> GrowthBench:
    """Time the resolve of square images of ``sizes``; from ``banded_from`` on in bands of ``BAND_ROWS`` rows.

    Raises ResourceError where the device has too little memory for one of them.
    """
    before, reference = load_average(), _Sized(preset, device, REFERENCE, 0)
    rows = []
    for side in sizes:
        bands, count = BAND_ROWS if side >= banded_from else 0, rounds_of(side, rounds)
        sized = _Sized(preset, device, side, bands)
        jobs = [Job("size", sized.run), Job("reference", reference.run)]
        samples = measure(jobs, count, warm_up=2 if count == rounds else 1, action="timing")
        scale = 1e9 / sized.pixels
        seconds, ratio = samples.interval("size", Clock.DEVICE), samples.ratio("size", "reference", Clock.DEVICE)
        rows.append(
            Growth(
                side=side,
                band_rows=bands,
                rounds=count,
                ns_a_pixel=seconds.times(scale),
                least_ns=float(samples.seconds("size", Clock.DEVICE).min()) * scale,
                ratio=ratio.times(reference.pixels / sized.pixels),
                allocated=sized.launcher.allocated,
                formula=device_bytes(side, side, DevicePlanes(sized.steps, band_rows=bands)),
            )
        )
        del sized
    where = environment(reference.launcher.description, before)
    return GrowthBench(preset=preset.name, rounds=rounds, environment=where, rows=rows)


def rounds_of(side: int, rounds: int) -> int:
    """Rounds for a size: fewer, as the pixels grow, beyond ``MANY_ROUNDS_TO``; never below ``FEWEST_ROUNDS``."""
    return max(min(rounds, rounds * MANY_ROUNDS_TO**2 // side**2), FEWEST_ROUNDS)
