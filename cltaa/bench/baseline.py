"""What the resolve is timed against: the same algorithm as an engineer would first write it, and the oracle.

``BASELINE`` is the widely used core (3x3 variance, the nearest surface's motion, 16 taps of Catmull-Rom, clip, weighted
blend, a counter) without what cltaa adds in its settings; the choices, which decide the time, are those of that core.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.devices.launch import storage_dtype
from cltaa.errors import InternalError
from cltaa.frames import Frame, Image
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Real, Storage, settings_record
from cltaa.parameters.choices import Accumulate, Box, Choices, Dilation, Rectify, Reject, Settings
from cltaa.parameters.presets import Preset
from cltaa.resolve.frame_record import Past, frame_record
from cltaa.resolve.resolver import Resolver
from cltaa.resolve.timed_resolve import device_seconds
from cltaa.timing import Job

BASELINE = Preset(
    name="baseline",
    description="the core that the plain ports compute too",
    choices=Choices(
        box=Box.VARIANCE,
        rectify=Rectify.CLIP,
        dilation=Dilation.CLOSEST,
        reject=Reject.NONE,
        accumulate=Accumulate.EXPONENTIAL,
    ),
    settings=Settings(resample_cost=0.0, pull_cost=0.0, fresh_blur=0.0),
)
PLAIN_GROUP = {True: (64, 1), False: (16, 16)}  # work-items a group of the plain port: on a CPU, on a GPU
COPY_BYTES = 16  # a work-item of copy.cl
# In float: two orders of the same operations, one with the cancelling variance; 999 of 1000 pixels are within 8e-6 at
# 1920 x 1080. In half: OpenGL may cut off what does not fit, 2^-10 a frame, where OpenCL rounds; 999 are within 9e-4.
TOLERANCE = {True: 2.0**-14, False: 4 * 2.0**-10}
# Past the border the nearest surface is a tie, which either may break; the history filter carries that 2 px a frame.
BORDER = 8
# Where a pixel is just outside its box, or the image: decisions that rounding takes.
ODD_PIXELS = 1e-3


class PlainPort:
    """``kernels/bench/plain.cl`` on a device: interleaved pixels, one a work-item, no halo."""

    def __init__(self, launcher: DeviceLauncher, storage: Storage, width: int, height: int) -> None:
        self._launcher, self._size = launcher, (width, height)
        build = Build(choices=BASELINE.choices, real=Real.FLOAT, storage=storage, lanes=1, rows=1)
        self._kernel = launcher.kernel("bench/plain", build)
        pixels = storage_dtype(build)
        self._current = launcher.allocate((height, width, 4))
        self._closeness = launcher.allocate((height, width))
        self._history, self._output = (launcher.allocate((height, width, 4), pixels) for _ in range(2))
        self._record: np.ndarray[Any, Any] | None = None

    def resolve(self, frame: Frame, previous: Frame | None) -> Image:
        """The resolved image [H, W, 3] float32 of ``frame``, whose history is the output of the call before."""
        with self._current.mapped(write=True) as pixels:
            pixels[..., :3], pixels[..., 3] = frame.colour, 1.0
        with self._closeness.mapped(write=True) as plane:
            np.divide(np.float32(1.0), frame.depth, out=plane)
        past = None if previous is None else Past.of(previous)
        self._record = frame_record(frame, past, Layout(frame.width, frame.height))
        self._history, self._output = self._output, self._history
        self.run()
        with self._output.mapped(write=False) as pixels:
            return pixels[..., :3].astype(np.float32)

    def run(self) -> float:
        """Run the kernel on what the last ``resolve`` was given; return the device's seconds."""
        buffers = {
            "current": self._current, "closeness": self._closeness, "history": self._history, "output": self._output,
        }  # fmt: skip
        given: dict[str, Any] = {name: getattr(memory, "buffer", None) for name, memory in buffers.items()}
        given |= {"frame": self._record, "settings": settings_record(BASELINE.settings)}
        group = PLAIN_GROUP[self._launcher.device.is_cpu]
        columns, rows = (-(-extent // items) * items for extent, items in zip(self._size, group, strict=True))
        event = self._kernel.enqueue(self._launcher.device.queue, (columns, rows), group, given)
        self._launcher.finish()
        return device_seconds([(self._kernel.name, event)])


def copy_job(launcher: DeviceLauncher, moved: int) -> Job:
    """A job that moves ``moved`` bytes, half of them read and half written: the floor of whatever must move as many."""
    items = max(moved // (2 * COPY_BYTES), 1)
    source, target = (launcher.allocate((items, COPY_BYTES // 4)) for _ in range(2))
    kernel = launcher.kernel("bench/copy", Build(lanes=1, rows=1))
    given = {"from": getattr(source, "buffer", None), "to": getattr(target, "buffer", None)}

    def run() -> float:
        event = kernel.enqueue(launcher.device.queue, (items,), None, given)
        launcher.finish()
        return device_seconds([(kernel.name, event)])

    return Job("copy", run)


def least_bytes(resolver: Resolver, storage: Storage) -> int:
    """Bytes a pixel that the resolve of the last frame must move: each input read and each output written once."""
    assert resolver.plan is not None
    steps, choices = resolver.plan.steps, resolver.plan.choices
    real, kept = 4, np.dtype(storage_dtype(Build(storage=storage))).itemsize
    history = int(kept) * (4 if steps.alpha else 3)
    planes = 3 + 1 + 1 + 1  # colour, closeness, count read, count written
    planes += 2 * steps.own_motion + steps.alpha + steps.reactive + (choices.reject is Reject.DEPTH)
    return real * planes + 2 * history


def check_same(name: str, image: Image, expected: Image, storage: Storage) -> float:
    """The largest difference over the brightest value; raises InternalError where images are not of one algorithm."""
    inside = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    tolerance = TOLERANCE[storage is Storage.FLOAT]
    apart = np.abs(image - expected).max(axis=-1)[inside] / float(np.abs(expected).max())
    share = float((apart > tolerance).mean())
    if share > ODD_PIXELS:
        raise InternalError(
            f"{name} does not compute what the resolve computes",
            expected=f"at most {ODD_PIXELS:.2%} of the pixels apart by more than {tolerance:.1e} of the brightest",
            found=f"{share:.2%}",
            cure="its time would say nothing; see docs/performance.md",
        )
    return float(apart.max())
