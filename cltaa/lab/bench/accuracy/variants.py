"""One variant of an accuracy measurement: its error over a sequence, and the time of its kernels.

Two axes are kept apart. *Model*: against the truth that was captured. *Rounding*: against the same algorithm in float64
throughout, arithmetic, history and counts, by the NumPy twin.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from cltaa.core.backend import DEVICE_VARIABLE, Buffer, Launcher, launcher_for
from cltaa.core.build import Build, Real, Storage
from cltaa.core.kernel_source import code_sha256
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame, Image
from cltaa.inputs.open import DEFAULT_READING, Reading
from cltaa.io.display import Picture, heat, to_picture
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.contenders import least_bytes
from cltaa.lab.judge.comparison import open_yardsticks, truth_of
from cltaa.lab.judge.metrics import METRICS, finite, flip_map, measure
from cltaa.lab.timing import Clock, Interval, Job, Samples, device_seconds, resolve_job, timed_frames, too_noisy_among
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher

KEY_DIGITS = 16  # hexadecimal
COUNT_WHITE = 32  # samples in the history that the picture of them shows white


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """One variant over one sequence, on one device."""

    sequence: str  # folder
    variant: Variant
    device: str | None
    metrics: tuple[str, ...]
    rounding_frames: int  # of the first frames; 0 leaves that axis out
    reading: Reading = DEFAULT_READING
    files: str = ""  # what vouches for the files of another tool, which record nothing, and for how they are read

    def open(self) -> FrameSequence:
        """The sequence."""
        return self.reading.open(Path(self.sequence))

    def key(self) -> str:
        """What the result depends on, as a name for its file: another sequence or other code has another key."""
        digest = hashlib.sha256(msgspec.json.encode(self) + code_sha256().encode())
        if self.device is None:  # whatever is chosen where nothing is named
            digest.update(os.environ.get(DEVICE_VARIABLE, "").encode())
        for name in ("sequence.json", "resolve.json"):
            path = Path(self.sequence) / name
            digest.update(path.read_bytes() if path.is_file() else b"")
        return digest.hexdigest()[:KEY_DIGITS]


class Rounding(msgspec.Struct, frozen=True, kw_only=True):
    """Distance from the float64 twin over the frames: root mean square and largest, relative to the image's own."""

    rms: float
    largest: float
    frames: list[float]  # rms of each

    @property
    def bits(self) -> float:
        """Bits that are right: -log2 of the relative rms error; infinite where there is none, as in a first frame."""
        return float(-np.log2(self.rms)) if self.rms > 0 else float("inf")


class Errors(msgspec.Struct, frozen=True, kw_only=True):
    """What a task found; ``frames`` is {metric: [a value a frame]}, ``pictures`` {name: PNG}."""

    frames: dict[str, list[float]]
    rounding: Rounding | None
    pictures: dict[str, bytes]


class DoubleTwin(NumpyLauncher):
    """The NumPy twin with float64 everywhere: inputs as they are, arithmetic, history and counts in double."""

    description = "NumPy (float64)"

    def build(self, plan_build: Build) -> Build:
        """The same algorithm in double."""
        return msgspec.structs.replace(plan_build, real=Real.DOUBLE, storage=Storage.FLOAT)

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Zeros; numbers with a fraction are float64, whatever is asked for."""
        return super().allocate(shape, np.float64 if np.dtype(dtype).kind == "f" else dtype)


@cache
def opened(device: str | None) -> Launcher:
    """A launcher of a device for all tasks of this process: to open one anew takes a GPU as long as many frames."""
    return launcher_for(device)


def run_task(task: Task) -> Errors:
    """Resolve the whole sequence and measure; raises InputMissing where the sequence has no truth."""
    sequence = task.open()
    truth = truth_of(sequence)
    resolver = task.variant.resolver(opened(task.device or os.environ.get(DEVICE_VARIABLE)))
    twin = Resolver(task.variant.preset, DoubleTwin()) if task.rounding_frames else None
    frames: dict[str, list[float]] = {name: [] for name in task.metrics}
    apart: list[tuple[float, float]] = []
    image: Image = np.empty(0, np.float32)
    for place, frame in enumerate(sequence):
        image = resolver.resolve(frame)[..., :3]
        found = measure(image, truth.image(frame.index), [METRICS[name] for name in task.metrics], frame=frame.index)
        for name, value in found.items():
            frames[name].append(value)
        if twin is not None and place < task.rounding_frames:
            twin.resolve(frame)
            apart.append(_apart(_kept(resolver, frame), _kept(twin, frame)))
    pictures = {"picture": png(to_picture(image)), "count": png(heat(_count(resolver, sequence), COUNT_WHITE))}
    if "flip" in task.metrics:
        pictures["flip"] = png(heat(flip_map(image, truth.image(sequence.last))))
    return Errors(frames=frames, rounding=_rounding(apart), pictures=pictures)


def yardstick_errors(sequence: FrameSequence, metrics: tuple[str, ...]) -> dict[int, dict[str, list[float]]]:
    """Errors a frame of each supersampled sequence there is, by samples a pixel; one sample is the capture itself.

    What is not finite in the capture is black, as in the table of ``cltaa bench quality``. Raises DataError for NaN or
    infinity in a supersampled image or the truth.
    """
    truth, chosen, yardsticks = truth_of(sequence), [METRICS[name] for name in metrics], open_yardsticks(sequence)
    found: dict[int, dict[str, list[float]]] = {n: {name: [] for name in metrics} for n in (1, *yardsticks)}
    for number in sequence.numbers:
        reference, truth_path = truth.image(number), truth.path(number)
        for samples, frames in found.items():
            if samples in yardsticks:
                image, path = yardsticks[samples].image(number), yardsticks[samples].path(number)
            else:
                image, path = finite(sequence.frame(number).colour), sequence.path(number)
            values = measure(image, reference, chosen, path=path, truth_path=truth_path, frame=number)
            for name, value in values.items():
                frames[name].append(value)
    return found


def png(picture: Picture) -> bytes:
    """An 8-bit picture as the bytes of a PNG."""
    stream = BytesIO()
    Pillow.fromarray(np.ascontiguousarray(picture)).save(stream, format="PNG")
    return stream.getvalue()


def _count(resolver: Resolver, sequence: FrameSequence) -> Image:
    """Samples that the history of each pixel stands for, [H, W]."""
    _, memory = resolver.recurrent()
    with memory["history_count"].mapped(write=False) as planes:
        count: Image = Layout(sequence.width, sequence.height).inside(planes)[0].astype(np.float32)
    return count


def _kept(resolver: Resolver, frame: Frame) -> NDArray[np.float64]:
    """The image that was made of ``frame`` in the numbers that the history is kept in, [H, W, 3]."""
    _, memory = resolver.recurrent()
    with memory["history"].mapped(write=False) as planes:
        return np.moveaxis(Layout(frame.width, frame.height).inside(planes)[:3].astype(np.float64), 0, -1)


def _apart(image: NDArray[np.float64], exact: NDArray[np.float64]) -> tuple[float, float]:
    """Relative root mean square and largest distance."""
    difference = image - exact
    size = float(np.sqrt(np.mean(np.square(exact)))) or 1.0
    return float(np.sqrt(np.mean(np.square(difference)))) / size, float(np.abs(difference).max()) / size


def _rounding(apart: list[tuple[float, float]]) -> Rounding | None:
    if not apart:
        return None
    rms = [value for value, _ in apart]
    return Rounding(rms=float(np.sqrt(np.mean(np.square(rms)))), largest=max(value for _, value in apart), frames=rms)


CONTROL = "(A/A)"
# What fills each compute unit of a CPU and of a GPU, in pixels, and the limits of a frame: with less it is launches
# that are timed, and the wait for the last of many threads.
FILLING_A_UNIT = {True: 40_000, False: 15_000}
LIMITS = {True: (250_000, 2_000_000), False: (1_000_000, 4_000_000)}
STAGE_PASSES = 5  # over which the time of each stage is a median
TURN = 0.02  # seconds that a job runs again and again for in a round: its least is what nothing held up


class Ranking(NamedTuple):
    """By which clock variants are compared, and what the default against its own copy says of that."""

    clock: Clock
    control: Interval
    noisy: bool


def enlargement(captured: FrameSequence, launcher: DeviceLauncher, pixels: int | None = None) -> int:
    """How many times as wide and high frames must be to have ``pixels`` at least; None: to fill the device."""
    is_cpu, units = launcher.device.is_cpu, launcher.device.cl_device.max_compute_units
    least, most = LIMITS[is_cpu]
    filling = pixels or min(max(FILLING_A_UNIT[is_cpu] * units, least), most)
    return math.ceil(math.sqrt(filling / (captured.width * captured.height)))


def jobs_of(
    captured: FrameSequence, tasks: Sequence[Task], launcher: DeviceLauncher, least_pixels: int | None
) -> tuple[list[Job], int, int, dict[str, float]]:
    """A job for each variant and a copy of the default's; pixels and least bytes of a frame; the default's steps."""
    factor = enlargement(captured, launcher, least_pixels)
    frames = [enlarged(frame, factor) for frame in timed_frames(captured)]
    pixels = frames[0].width * frames[0].height
    jobs: list[Job] = []
    moved, stages = 0, dict[str, float]()
    for place, task in enumerate(tasks):
        resolver = task.variant.resolver(launcher)
        job, _ = resolve_job(task.variant.name, resolver, frames)
        jobs.append(job)
        if place == 0:
            moved = least_bytes(resolver, task.variant.storage) * pixels
            stages = stage_seconds(task.variant, launcher, frames)
            jobs.append(Job(f"{task.variant.name} {CONTROL}", job.run))
    return jobs, pixels, moved, stages


def ranking(samples: Samples, default: str, controls: int, *, is_cpu: bool, units: int = 0) -> Ranking:
    """Rank by the device's clock, or, where that is too noisy on a CPU, by processor time, if that is not.

    Of one thread (``units``) processor time comes first: it is the device's clock without the waits for a processor,
    which a long kernel on a shared one never escapes, and of which the default and its copy, both short, say nothing.
    ``controls`` is the number of sequences that are ranked in one run, each of which may exclude 1 by chance.
    """
    found = []
    wanted = (Clock.DEVICE, Clock.PROCESSOR)[: 1 + is_cpu]
    clocks = [clock for clock in wanted[:: -1 if units == 1 else 1] if samples.has(default, clock)]
    for clock in clocks or [Clock.WALL]:
        pair = f"{default} {CONTROL}", default, clock
        noisy = too_noisy_among(samples.ratios(*pair), controls * max(len(clocks), 1))
        found.append(Ranking(clock, samples.ratio(*pair), noisy))
    return next((each for each in found if not each.noisy), found[0])


def enlarged(frame: Frame, factor: int) -> Frame:
    """The frame with every pixel repeated ``factor`` times along both axes, and motion as many times as long."""

    def repeat(image: Image | None, scale: float = 1.0) -> Image | None:
        return None if image is None else (image * np.float32(scale)).repeat(factor, 0).repeat(factor, 1)

    colour, depth = repeat(frame.colour), repeat(frame.depth)
    assert colour is not None
    assert depth is not None
    return replace(
        frame,
        colour=colour,
        depth=depth,
        motion=repeat(frame.motion, factor),
        alpha=repeat(frame.alpha),
        reactive=repeat(frame.reactive),
    )


def stage_seconds(variant: Variant, launcher: DeviceLauncher, frames: Sequence[Frame]) -> dict[str, float]:
    """Median seconds of upload, each kernel by the device's clock, and read-back, over ``STAGE_PASSES`` passes."""
    resolver = variant.resolver(launcher)
    seen: dict[str, list[float]] = {}
    for _ in range(STAGE_PASSES):
        for frame in frames:
            events: list[tuple[str, Any]] = []
            launcher.events = events
            resolver.resolve(frame)
            launcher.events = None
        seen.setdefault("upload", []).append(resolver.times.upload)
        for kernel in dict.fromkeys(name for name, _ in events):
            own = [(name, event) for name, event in events if name == kernel]
            seen.setdefault(kernel, []).append(device_seconds(own))
        seen.setdefault("read back", []).append(resolver.times.read_back)
    return {name: float(np.median(values)) for name, values in seen.items()}
