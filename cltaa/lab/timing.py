"""Reliable timing on a shared machine (docs/performance.md, Method): shuffled rounds, paired ratios, intervals, A/A.

Each round gives every job one turn in a newly shuffled order. Ratios compare two jobs within one round, so that varying
load affects both. The statistic is the median of these ratios; resampling the rounds gives its interval.
``Environment`` records everything besides the code on which a measurement depends. The timed frames are those of a
sequence, or synthetic (``make_frames``).
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from importlib.metadata import version
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa import __version__
from cltaa.core.backend import Launcher
from cltaa.core.build import Build, code_sha256
from cltaa.core.parameters import HistoryKind
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.frame import Camera, Effect, Frame, Image
from cltaa.io.sequence import FrameSequence
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.pocl_cpu_name import cpu_flags, cpu_name
from cltaa.printable import counted
from cltaa.process import CORES, is_own
from cltaa.progress import track

RESAMPLES = 4000
CONFIDENCE = 0.95
WIDEST = 0.02  # largest half width of the A/A interval that allows a ranking
MOST_RUNS = 5  # most runs of a job in one turn, however short
FEWEST_RUNS = 2  # least runs in a timed turn, because a single run may have been delayed
LONG = 4  # a run of this many turns runs only once


class Clock(StrEnum):
    """The source of a time; the names are those of the fields of Sample."""

    WALL = "wall"  # the host's clock: includes transfers to the device and back
    DEVICE = "device"  # the profiling events of a device's kernels
    PROCESSOR = "processor"  # processor time of this process's threads: excludes waiting for a processor


class Sample(NamedTuple):
    """Seconds of a run by each available clock, the least of several runs in one turn.

    Other programs can only add to the first two, and add most to long runs. They hardly change processor time. With a
    device clock, processor time is that of the device's threads, without the calling thread.
    """

    wall: float
    device: float | None = None
    processor: float | None = None


# A timed task: does it once and waits for its end; returns the device's own seconds, or None.
Job = Callable[[], float | None]


class Interval(msgspec.Struct, frozen=True, kw_only=True):
    """A median and its 95 % interval by resampling."""

    median: float
    low: float
    high: float

    def times(self, factor: float) -> Interval:
        """Return the interval times ``factor``, in another unit."""
        return Interval(median=self.median * factor, low=self.low * factor, high=self.high * factor)

    @property
    def half_width(self) -> float:
        """Half the width of the interval over its median."""
        return (self.high - self.low) / (2.0 * self.median)

    @property
    def excludes_one(self) -> bool:
        """True if a ratio differs from 1 beyond chance."""
        return not self.low <= 1.0 <= self.high


@dataclass(slots=True)
class Samples:
    """The times of every job, round by round."""

    by_job: dict[str, list[Sample]] = field(default_factory=dict)

    def add(self, job: str, sample: Sample) -> None:
        """Add the time of ``job`` in the next round."""
        self.by_job.setdefault(job, []).append(sample)

    def seconds(self, job: str, clock: Clock) -> NDArray[np.float64]:
        """Return all times of a job by a clock, by the host's if that has none."""
        found = ((getattr(sample, clock), sample.wall) for sample in self.by_job[job])
        return np.array([wall if seconds is None else seconds for seconds, wall in found])

    def has(self, job: str, clock: Clock) -> bool:
        """Return True if that clock timed every run of the job."""
        return all(getattr(sample, clock) is not None for sample in self.by_job[job])

    def interval(self, job: str, clock: Clock) -> Interval:
        """Return the median seconds of a job with its interval."""
        return interval(self.seconds(job, clock))

    def ratio(self, job: str, base: str, clock: Clock) -> Interval:
        """Return the time of a job over that of ``base``: the median over the rounds."""
        return interval(self.ratios(job, base, clock))

    def faster(self, job: str, other: str, clock: Clock) -> bool:
        """Return whether a job is faster than another beyond chance: the interval of their ratio ends below 1."""
        ratios = self.ratios(job, other, clock)
        return float(np.median(ratios)) < 1.0 and interval(ratios).high < 1.0  # most pairs end at the median

    def ratios(self, job: str, base: str, clock: Clock) -> NDArray[np.float64]:
        """Return the ratio of each round, whose median is ``ratio``."""
        return self.seconds(job, clock) / self.seconds(base, clock)


def interval(values: NDArray[np.float64] | Sequence[float]) -> Interval:
    """Return the median of ``values`` [n] with its percentile-bootstrap interval over ``RESAMPLES`` resamples."""
    random = np.random.default_rng(0)
    picks = random.integers(0, len(values), (RESAMPLES, len(values)))
    medians = np.median(np.asarray(values)[picks], axis=1)
    low, high = np.quantile(medians, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(median=float(np.median(values)), low=float(low), high=float(high))


def too_noisy(control: Interval) -> bool:
    """Return whether the ratio of a job to its own copy (A/A) shows that this machine is too noisy to rank anything."""
    return control.excludes_one or control.half_width > WIDEST


def too_noisy_among(ratios: NDArray[np.float64], controls: int) -> bool:
    """Return ``too_noisy`` for one of several ``controls``; even on a quiet machine one in twenty excludes 1.

    A difference below WIDEST counts only if the exact sign test is significant at (1 - CONFIDENCE) / ``controls``
    (Bonferroni), so that chance reports any of them noisy in at most 1 - CONFIDENCE of all runs.
    """
    control = interval(ratios)
    if control.half_width > WIDEST or not control.excludes_one:
        return control.half_width > WIDEST
    return abs(control.median - 1) > WIDEST or sign_test(ratios) < (1 - CONFIDENCE) / controls


def sign_test(ratios: NDArray[np.float64]) -> float:
    """Return the two-sided p-value of the sign test: the chance of such ratios if above and below 1 are as likely."""
    above, below = int((ratios > 1).sum()), int((ratios < 1).sum())
    count = above + below
    tail = sum(math.comb(count, least) for least in range(min(above, below) + 1))
    return min(1.0, 2.0 * tail / 2.0**count)


def measure(
    jobs: Mapping[str, Job],
    rounds: int,
    *,
    warm_up: int = 5,
    turn: float = 0.0,
    enough: Callable[[Samples], bool] | None = None,
    patience: float = 0.0,
    action: str | None = None,
) -> Samples:
    """Time ``jobs``, by name, in ``rounds`` rounds after ``warm_up`` untimed runs of each.

    A turn is one run, or with ``turn`` as many as fill that many seconds, from FEWEST_RUNS to MOST_RUNS; a job as long
    as LONG turns runs once, also to warm up. Until ``enough`` accepts the samples, more rounds follow for at most
    ``patience`` seconds. With an ``action``, shows progress under that name (``cltaa.progress.track``).
    """
    runs = {name: _runs(job, warm_up, turn) for name, job in jobs.items()}
    random, names = np.random.default_rng(0), [*jobs]
    samples = Samples()

    def play() -> None:
        for place in random.permutation(len(names)):
            name = names[place]
            samples.add(name, _turn(jobs[name], runs[name]))

    numbers = range(rounds)
    for _ in numbers if action is None else track(numbers, rounds, action, unit="rounds"):
        play()
    deadline = time.monotonic() + patience
    while enough is not None and not enough(samples) and time.monotonic() < deadline:
        play()
    return samples


def _runs(job: Job, warm_up: int, turn: float) -> int:
    """Warm up, and return the number of runs in a turn of the job."""
    least = math.inf
    for _ in range(warm_up):
        least = min(least, _turn(job, 1).wall)
        if 0.0 < LONG * turn <= least:
            return 1
    return 1 if turn == 0.0 else min(max(math.ceil(turn / max(least, 1e-9)), FEWEST_RUNS), MOST_RUNS)


def _turn(job: Job, runs: int) -> Sample:
    walls, devices, worked = list[float](), list[float](), list[float]()
    for _ in range(runs):
        begun, asked, started = time.process_time(), time.thread_time(), time.perf_counter()
        device = job()
        walls.append(time.perf_counter() - started)
        host = 0.0 if device is None else time.thread_time() - asked
        worked.append(time.process_time() - begun - host)
        devices += [] if device is None else [device]
    processor = min(worked)
    return Sample(min(walls), min(devices, default=None), processor if processor > 0.0 else None)


def timed_numbers(sequence: FrameSequence) -> list[int]:
    """Return the numbers of the last two frames without a cut between them; raises DataError for a single frame."""
    numbers = list(sequence.numbers)
    if len(numbers) < 2:
        cure = "capture more"
        raise DataError("nothing to time", path=sequence.folder, expected="2 frames or more", found=1, cure=cure)
    last = next((n for n in reversed(numbers[1:]) if not sequence.outline(n).cut), numbers[-1])
    return [number for number in numbers if last - sequence.step <= number <= last]


def timed_frames(sequence: FrameSequence) -> list[Frame]:
    """Return the frames of ``timed_numbers``."""
    return [sequence.frame(number) for number in timed_numbers(sequence)]


# Synthetic frames: content that no cache or compiler can predict, under two kinds of camera motion.
DISTANCE = 5.0  # of the visible plane, scene units
SHIFT_PX = (0.37, -0.61)  # uniform motion, pixels a frame
TURN_RADIANS = 0.01  # rotation about the viewing axis per frame
ZOOM = 1.004  # factor of the focal length per frame
SCALE = 1.0 / np.tan(np.radians(60.0) / 2)
STEPS = 8  # depth steps over the picture's width
EFFECTS = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.HDR})


class Motion(StrEnum):
    """Camera motion, which decides how fast a CPU's vector loads are."""

    UNIFORM = "uniform"  # parallel to a plane that it faces: one displacement for all pixels
    TURN = "turn"  # rotation about the viewing axis with a zoom: each pixel has another displacement


def camera_at(index: int, motion: Motion, width: int, height: int) -> Camera:
    """Return the camera of frame ``index``."""
    view, zoom = np.eye(4), 1.0
    if motion is Motion.UNIFORM:
        # A plane at DISTANCE moves by focal length / DISTANCE a unit of travel.
        metre = np.array([SCALE * height / width * width / 2, SCALE * height / 2]) / DISTANCE
        view[:2, 3] = np.array(SHIFT_PX) / metre * index
    else:
        angle = TURN_RADIANS * index
        view[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        zoom = ZOOM**index
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = zoom * SCALE * height / width, zoom * SCALE
    clip[2, 2], clip[2, 3], clip[3, 2] = -1.0, -0.2, -1.0
    return Camera(world_to_view=view, view_to_clip=clip)


def make_frames(width: int, height: int, motion: Motion, count: int = 3) -> list[Frame]:
    """Make ``count`` frames of smooth waves, noise per frame and some bright pixels, with depth in steps.

    For ``UNIFORM`` motion the depth is one plane, because the displacement would vary with it.
    """
    random = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    waves = 1.0 + 0.5 * np.sin(x[..., None] / np.array([7.0, 11.0, 13.0], np.float32))
    waves *= 1.0 + 0.4 * np.cos(y[..., None] / np.array([5.0, 9.0, 17.0], np.float32))
    depth = np.full((height, width), DISTANCE, np.float32)
    if motion is Motion.TURN:
        # Tilted, so that no two neighbours are equally near, and the nearest does not depend on the order of tests.
        depth += np.floor(x * STEPS / width) + np.float32(0.17) * x / width + np.float32(0.1) * y / height
    return [_frame(index, motion, waves.astype(np.float32), depth, random) for index in range(count)]


def _frame(index: int, motion: Motion, waves: Image, depth: Image, random: np.random.Generator) -> Frame:
    height, width = depth.shape
    colour = waves * (0.75 + 0.5 * random.random((height, width, 1), dtype=np.float32))
    colour[random.random((height, width)) < 1e-4] *= 50.0
    jitter = tuple(random.random(2) - 0.5)
    return Frame(
        index=index,
        colour=np.moveaxis(np.ascontiguousarray(np.moveaxis(colour, -1, 0)), 0, -1),
        depth=depth,
        camera=camera_at(index, motion, width, height),
        jitter_px=(float(jitter[0]), float(jitter[1])),
        scene=f"bench {motion}",
        effects=EFFECTS,
    )


def resolve_job(resolver: Resolver, frames: list[Frame]) -> tuple[Job, Image]:
    """Return a job that repeats the kernels of the last of two or more ``frames``, and their image [H, W, 3 or 4].

    The job returns device seconds, or None on NumPy. Raises what ``Resolver.resolve`` raises.
    """
    if resolver.preset.choices.history is HistoryKind.FRAMES:
        _keep_before(resolver, frames[0])
    last = frames[-1]
    ahead = [replace(last, index=last.index + last.step * n) for n in range(1, resolver.look_ahead + 1)]
    image = [image for frame in (*frames, *ahead) for image in resolver.feed(frame)][-1]
    return lambda: kernel_seconds(resolver.launcher, lambda: resolver.run_again(last, frames[-2])), image


def _keep_before(resolver: Resolver, frame: Frame) -> None:
    """Fill the frame ring with copies of ``frame``, as if each had been resolved, if its plan gathers."""
    count = resolver.preset.settings.history_frames
    if resolver.look_ahead:
        for ago in range(count, 0, -1):
            resolver.feed(replace(frame, index=frame.index - frame.step * ago))
        return
    before = replace(frame, index=frame.index - frame.step)
    resolver.resolve(before)
    resolver.keep_again(before, count)


def kernel_seconds(launcher: Launcher, work: Callable[[], object]) -> float | None:
    """Return the device seconds of the kernels that ``work`` starts and waits for; None on NumPy."""
    if not isinstance(launcher, DeviceLauncher):
        work()
        return None
    return device_seconds(launcher.timed(work))


def device_seconds(events: list[tuple[str, Any]]) -> float:
    """Return the device seconds of these finished kernels of one queue, without the gaps between them.

    Gaps belong to the host: they count in the wall time, and vanish if the host runs ahead of the device.
    """
    return float(sum(event.profile.end - event.profile.start for _, event in events)) * 1e-9


# The CPU flags that decide the speed of vector code.
TELLING_FLAGS = ("sse4_2", "avx", "avx2", "fma", "f16c", "avx512f", "avx512bw", "avx512_fp16", "asimd", "sve")
LIBRARIES = ("numpy", "pyopencl")


class Environment(msgspec.Struct, frozen=True, kw_only=True):
    """Place and time of a measurement."""

    date: str  # UTC
    system: str
    cpu: str
    cores: int
    cpu_flags: list[str]
    load_before: float  # mean number of runnable processes over a minute
    load_after: float
    device: str
    libraries: dict[str, str]
    kernels_sha256: str  # includes the constants of their build
    options: list[str]  # of the OpenCL compiler
    units: int = 0  # compute units of the device, for PoCL its threads; 0 if not requested

    @property
    def hardware(self) -> str:
        """The device, and the number of its units that worked, if known."""
        return f"{self.device}, {counted(self.units, 'compute unit')}" if self.units else self.device

    @property
    def line(self) -> str:
        """One line with everything that decides whether numbers are comparable."""
        return (
            f"{self.hardware}; {self.cpu}, {counted(self.cores, 'core')}, {' '.join(self.cpu_flags)}; "
            f"load {self.load_before} to {self.load_after}; {self.date} UTC; kernels {self.kernels_sha256[:12]}"
        )


def load_average() -> float:
    """Return the mean number of runnable processes over the last minute."""
    return os.getloadavg()[0]


def pin_threads() -> None:
    """Let PoCL pin its threads to processors, if this process is our own, has not loaded PoCL yet and may use them all.

    Otherwise two threads may share a core while another idles, which takes half as long again in some runs.
    """
    if is_own() and os.cpu_count() == CORES:
        os.environ.setdefault("POCL_AFFINITY", "1")


def environment(device: str, load_before: float, *, units: int = 0) -> Environment:
    """Return the environment of a measurement that has just ended; ``load_before`` was the load at its start."""
    flags = cpu_flags()
    return Environment(
        date=time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
        system=platform.platform(terse=True),
        cpu=cpu_name(),
        cores=CORES,
        cpu_flags=[flag for flag in TELLING_FLAGS if flag in flags],
        load_before=round(load_before, 2),
        load_after=round(load_average(), 2),
        device=device,
        libraries={"cltaa": __version__} | {name: version(name) for name in LIBRARIES},
        kernels_sha256=code_sha256(),
        options=list(Build().flags()),
        units=units,
    )
