"""Honest timing on a shared machine (docs/performance.md, Method): shuffled rounds, paired ratios, intervals, A/A.

Each round gives every job one turn in a freshly shuffled order; what two jobs took in one round is compared, so that a
load that comes and goes hits both. The statistic is the median of these ratios; resampling rounds gives its interval.
What a measurement depends on beside the code is kept beside its numbers (``Environment``). Frames to time on are those
of a sequence, or made here (``make_frames``).
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Callable, Sequence
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
WIDEST = 0.02  # half width of the A/A interval beyond which nothing is ranked
MOST_RUNS = 5  # of a job in one turn, however short they are
FEWEST_RUNS = 2  # where turns are asked for: of one run alone nothing says whether it was held up
LONG = 4  # turns that a run takes of which one is enough


class Clock(StrEnum):
    """What a time is read from; the names are those of the fields of Sample."""

    WALL = "wall"  # the host's: the way to the device and back is in it
    DEVICE = "device"  # the profiling events of a device's kernels
    PROCESSOR = "processor"  # what the threads of this process worked: waiting for a processor is not in it


class Sample(NamedTuple):
    """Seconds of a run by each clock that there is, of several runs in one turn the least.

    Whatever else runs can only add to the first two, and adds most to what runs long. Processor time it hardly touches;
    beside a device's clock it is that of the device's threads, without the one that asks.
    """

    wall: float
    device: float | None = None
    processor: float | None = None


@dataclass(frozen=True, slots=True)
class Job:
    """Something to time. ``run`` does it once and waits for the end; it returns the device's own seconds, or None."""

    name: str
    run: Callable[[], float | None]


class Interval(msgspec.Struct, frozen=True, kw_only=True):
    """A median and the 95 % interval that resampling gives it."""

    median: float
    low: float
    high: float

    def times(self, factor: float) -> Interval:
        """The same in another unit."""
        return Interval(median=self.median * factor, low=self.low * factor, high=self.high * factor)

    @property
    def half_width(self) -> float:
        """Half the interval over its median."""
        return (self.high - self.low) / (2.0 * self.median)

    @property
    def excludes_one(self) -> bool:
        """True where a ratio differs from 1 beyond chance."""
        return not self.low <= 1.0 <= self.high


@dataclass(slots=True)
class Samples:
    """What every job took, round after round."""

    by_job: dict[str, list[Sample]] = field(default_factory=dict)

    def add(self, job: str, sample: Sample) -> None:
        """Note what ``job`` took in the next round."""
        self.by_job.setdefault(job, []).append(sample)

    def seconds(self, job: str, clock: Clock) -> NDArray[np.float64]:
        """All times of a job by a clock, by the host's where that has none."""
        return np.array([_seconds(sample, clock) for sample in self.by_job[job]])

    def has(self, job: str, clock: Clock) -> bool:
        """True where that clock timed every run of the job."""
        return all(getattr(sample, clock) is not None for sample in self.by_job[job])

    def interval(self, job: str, clock: Clock) -> Interval:
        """Median seconds of a job with its interval."""
        return interval(self.seconds(job, clock))

    def ratio(self, job: str, base: str, clock: Clock) -> Interval:
        """How many times as long as ``base`` a job takes: the median over the rounds."""
        return interval(self.ratios(job, base, clock))

    def faster(self, job: str, other: str, clock: Clock) -> bool:
        """Whether a job takes less time than another beyond chance: the interval of their ratio ends below 1."""
        ratios = self.ratios(job, other, clock)
        return float(np.median(ratios)) < 1.0 and interval(ratios).high < 1.0  # most pairs end at the median

    def ratios(self, job: str, base: str, clock: Clock) -> NDArray[np.float64]:
        """What ``ratio`` is the median of: one a round."""
        return self.seconds(job, clock) / self.seconds(base, clock)


def _seconds(sample: Sample, clock: Clock) -> float:
    seconds: float | None = getattr(sample, clock)
    return sample.wall if seconds is None else seconds


def interval(values: NDArray[np.float64] | Sequence[float]) -> Interval:
    """Median of ``values`` [n] with its percentile-bootstrap interval over ``RESAMPLES`` resamples."""
    random = np.random.default_rng(0)
    picks = random.integers(0, len(values), (RESAMPLES, len(values)))
    medians = np.median(np.asarray(values)[picks], axis=1)
    low, high = np.quantile(medians, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(median=float(np.median(values)), low=float(low), high=float(high))


def too_noisy(control: Interval) -> bool:
    """Whether the ratio of a job to its own copy (A/A) says that this machine cannot rank anything now."""
    return control.excludes_one or control.half_width > WIDEST


def too_noisy_among(ratios: NDArray[np.float64], controls: int) -> bool:
    """``too_noisy`` of one of several ``controls``, of which one in twenty excludes 1 on the quietest machine too.

    So that chance calls any of them noisy in at most 1 - CONFIDENCE of all runs, a difference below WIDEST counts where
    the exact sign test finds it at that share of it (Bonferroni).
    """
    control = interval(ratios)
    if control.half_width > WIDEST or not control.excludes_one:
        return control.half_width > WIDEST
    return abs(control.median - 1) > WIDEST or sign_test(ratios) < (1 - CONFIDENCE) / controls


def sign_test(ratios: NDArray[np.float64]) -> float:
    """How likely ratios that are above 1 as often as below it are at least as lopsided as these, both ways."""
    above, below = int((ratios > 1).sum()), int((ratios < 1).sum())
    count = above + below
    tail = sum(math.comb(count, least) for least in range(min(above, below) + 1))
    return min(1.0, 2.0 * tail / 2.0**count)


def measure(
    jobs: Sequence[Job],
    rounds: int,
    *,
    warm_up: int = 5,
    turn: float = 0.0,
    enough: Callable[[Samples], bool] | None = None,
    patience: float = 0.0,
    action: str | None = None,
) -> Samples:
    """Time ``jobs`` in ``rounds`` rounds after ``warm_up`` untimed runs of each.

    A turn is one run; with ``turn`` as many as fill so many seconds, from FEWEST_RUNS to MOST_RUNS, and what takes LONG
    turns runs once, to warm up too. Where ``enough`` does not find the samples good enough, more rounds follow for at
    most ``patience`` seconds. Where ``action`` says what is being done, progress is shown (``cltaa.progress.track``).
    """
    runs = {job.name: _runs(job, warm_up, turn) for job in jobs}
    random = np.random.default_rng(0)
    samples = Samples()

    def play() -> None:
        for place in random.permutation(len(jobs)):
            job = jobs[place]
            samples.add(job.name, _turn(job, runs[job.name]))

    numbers = range(rounds)
    for _ in numbers if action is None else track(numbers, rounds, action, unit="rounds"):
        play()
    deadline = time.monotonic() + patience
    while enough is not None and not enough(samples) and time.monotonic() < deadline:
        play()
    return samples


def _runs(job: Job, warm_up: int, turn: float) -> int:
    """Warm up, and say how many runs a turn of the job has."""
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
        device = job.run()
        walls.append(time.perf_counter() - started)
        host = 0.0 if device is None else time.thread_time() - asked
        worked.append(time.process_time() - begun - host)
        devices += [] if device is None else [device]
    processor = min(worked)
    return Sample(min(walls), min(devices, default=None), processor if processor > 0.0 else None)


def timed_numbers(sequence: FrameSequence) -> list[int]:
    """The numbers of the last two frames of which the later goes on from the earlier: what is timed of a sequence.

    Raises DataError for one of a single frame.
    """
    numbers = list(sequence.numbers)
    if len(numbers) < 2:
        cure = "capture more"
        raise DataError("nothing to time", path=sequence.folder, expected="2 frames or more", found=1, cure=cure)
    last = next((n for n in reversed(numbers[1:]) if not sequence.outline(n).cut), numbers[-1])
    return [number for number in numbers if last - sequence.step <= number <= last]


def timed_frames(sequence: FrameSequence) -> list[Frame]:
    """The frames of ``timed_numbers``."""
    return [sequence.frame(number) for number in timed_numbers(sequence)]


# Of frames that are made: content that no cache or compiler can guess, under two kinds of camera motion.
DISTANCE = 5.0  # of the plane that is seen, scene units
SHIFT_PX = (0.37, -0.61)  # uniform motion, pixels a frame
TURN_RADIANS = 0.01  # rotation about the viewing axis, a frame
ZOOM = 1.004  # of the focal length, a frame
SCALE = 1.0 / np.tan(np.radians(60.0) / 2)
STEPS = 8  # in depth, over the picture's width
EFFECTS = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.HDR})


class Motion(StrEnum):
    """How the camera moves: what a CPU's vector loads depend on."""

    UNIFORM = "uniform"  # along a plane that it faces: one displacement for all pixels
    TURN = "turn"  # rotation about the viewing axis with a zoom: another one at every pixel


def camera_at(index: int, motion: Motion, width: int, height: int) -> Camera:
    """The camera of frame ``index``."""
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
    """``count`` frames: smooth waves, noise from frame to frame, some bright pixels; depth in steps where it may vary.

    Under ``UNIFORM`` motion the depth is one plane, else the displacement would vary with it.
    """
    random = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    waves = 1.0 + 0.5 * np.sin(x[..., None] / np.array([7.0, 11.0, 13.0], np.float32))
    waves *= 1.0 + 0.4 * np.cos(y[..., None] / np.array([5.0, 9.0, 17.0], np.float32))
    depth = np.full((height, width), DISTANCE, np.float32)
    if motion is Motion.TURN:
        # Slanted, so that no two neighbours are equally near and which of them leads is no matter of order.
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


def resolve_job(name: str, resolver: Resolver, frames: list[Frame]) -> tuple[Job, Image]:
    """A job that runs the kernels of the last of two or more ``frames`` again, and the image [H, W, 3 or 4] they give.

    Its clock is the device's, in seconds, and there is none on NumPy. Raises what ``Resolver.resolve`` raises.
    """
    if resolver.preset.choices.history is HistoryKind.FRAMES:
        _keep_before(resolver, frames[0])
    last = frames[-1]
    ahead = [replace(last, index=last.index + last.step * n) for n in range(1, resolver.look_ahead + 1)]
    image = [image for frame in (*frames, *ahead) for image in resolver.feed(frame)][-1]

    def run() -> float | None:
        return kernel_seconds(resolver.launcher, lambda: resolver.run_again(frames[-1], frames[-2]))

    return Job(name, run), image


def _keep_before(resolver: Resolver, frame: Frame) -> None:
    """Keep ``frame`` as often as the preset keeps frames, as if each had been resolved, if its plan gathers at all."""
    count = resolver.preset.settings.history_frames
    if resolver.look_ahead:
        for ago in range(count, 0, -1):
            resolver.feed(replace(frame, index=frame.index - frame.step * ago))
        return
    before = replace(frame, index=frame.index - frame.step)
    resolver.resolve(before)
    resolver.keep_again(before, count)


def kernel_seconds(launcher: Launcher, work: Callable[[], object]) -> float | None:
    """Seconds that the device works on the kernels that ``work`` starts and waits for; None on NumPy."""
    if not isinstance(launcher, DeviceLauncher):
        work()
        return None
    events: list[tuple[str, Any]] = []
    launcher.events = events
    work()
    launcher.events = None
    return device_seconds(events)


def device_seconds(events: list[tuple[str, Any]]) -> float:
    """Seconds that the device worked on these finished kernels of one queue; the gaps between them left out.

    A gap is the host's: it is in the wall time, and vanishes where the host runs ahead of the device.
    """
    return float(sum(event.profile.end - event.profile.start for _, event in events)) * 1e-9


# What of the CPU decides the speed of vector code, among its hundred flags.
TELLING_FLAGS = ("sse4_2", "avx", "avx2", "fma", "f16c", "avx512f", "avx512bw", "avx512_fp16", "asimd", "sve")
LIBRARIES = ("numpy", "pyopencl")


class Environment(msgspec.Struct, frozen=True, kw_only=True):
    """Where and when something was measured."""

    date: str  # UTC
    system: str
    cpu: str
    cores: int
    cpu_flags: list[str]
    load_before: float  # runnable processes, mean of a minute
    load_after: float
    device: str
    libraries: dict[str, str]
    kernels_sha256: str  # and of the constants that they are built with
    options: list[str]  # of the OpenCL compiler
    units: int = 0  # compute units of the device, of PoCL threads; 0 where they were not asked for

    @property
    def hardware(self) -> str:
        """The device, and how many units of it worked, where that is known."""
        return f"{self.device}, {counted(self.units, 'compute unit')}" if self.units else self.device

    @property
    def line(self) -> str:
        """All that decides how far the numbers may be compared, in a line."""
        return (
            f"{self.hardware}; {self.cpu}, {counted(self.cores, 'core')}, {' '.join(self.cpu_flags)}; "
            f"load {self.load_before} to {self.load_after}; {self.date} UTC; kernels {self.kernels_sha256[:12]}"
        )


def load_average() -> float:
    """Runnable processes, mean of the last minute."""
    return os.getloadavg()[0]


def pin_threads() -> None:
    """Let PoCL, if this process is our own and has not loaded it yet, keep each thread on a processor, of them all.

    Two threads that share a core while another idles take half as long again, in one run and not in the next.
    """
    if is_own() and os.cpu_count() == CORES:
        os.environ.setdefault("POCL_AFFINITY", "1")


def environment(device: str, load_before: float, *, units: int = 0) -> Environment:
    """The environment of a measurement that has just ended and began at ``load_before``."""
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
