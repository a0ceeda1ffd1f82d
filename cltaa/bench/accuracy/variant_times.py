"""What is timed of the variants of an accuracy measurement: their kernels on two frames of the sequence itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cltaa.bench.accuracy.ladder import Variant
from cltaa.bench.accuracy.variant_errors import Task
from cltaa.bench.baseline import least_bytes
from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.frames import Frame, Image
from cltaa.resolve.timed_resolve import device_seconds, resolve_job, timed_frames
from cltaa.sequences.sources import Sequence as Captured
from cltaa.timing import Clock, Interval, Job, Samples, too_noisy_among

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


def enlargement(captured: Captured, launcher: DeviceLauncher, pixels: int | None = None) -> int:
    """How many times as wide and high frames must be to have ``pixels`` at least; None: to fill the device."""
    is_cpu, units = launcher.device.is_cpu, launcher.device.cl_device.max_compute_units
    least, most = LIMITS[is_cpu]
    filling = pixels or min(max(FILLING_A_UNIT[is_cpu] * units, least), most)
    return math.ceil(math.sqrt(filling / (captured.width * captured.height)))


def jobs_of(
    captured: Captured, tasks: Sequence[Task], launcher: DeviceLauncher, least_pixels: int | None
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
