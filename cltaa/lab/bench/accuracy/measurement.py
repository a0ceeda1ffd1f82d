"""``cltaa bench accuracy``: error and time of every variant over every sequence, in one run."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cltaa.frame import Frame, Image, format_effects
from cltaa.inputs.open import DEFAULT_READING, Reading, readings
from cltaa.io.atomic import keep, kept
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.cases import by_name
from cltaa.lab.bench.cells import Cell, Judging, Rounding, Task, run_all, task_of
from cltaa.lab.bench.kernels import copy_job, least_bytes
from cltaa.lab.bench.variants import Variant
from cltaa.lab.judge.comparison import check_yardsticks, content_sha256, open_yardsticks, truth_of, truth_samples
from cltaa.lab.judge.metrics import METRICS, STRATIFIED_EXPONENT, finite, mean_of, measure, named_metrics
from cltaa.lab.timing import (
    Clock,
    Environment,
    Interval,
    Job,
    Samples,
    device_seconds,
    environment,
    load_average,
    pin_threads,
    resolve_job,
    timed_frames,
    timed_numbers,
    too_noisy_among,
)
from cltaa.lab.timing import measure as measure_times
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.process import CORES
from cltaa.progress import track


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """An error over the frames of a sequence; the PSNR of an identical frame is infinite, in JSON null."""

    mean: float
    p5: float
    p95: float
    largest: float
    frames: list[float]


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """One variant over one sequence. Times are milliseconds a megapixel, of the kernels alone."""

    variant: str
    errors: dict[str, Spread]
    rounding: Rounding | None
    time: Interval  # by the clock that the sequence is ranked by
    ratio: Interval  # of that time to the default's, paired
    dominated_by: dict[str, str] = {}  # metric: a variant with no more error that is faster beyond chance


class Yardstick(msgspec.Struct, frozen=True, kw_only=True):
    """Supersampling: ``added`` is what drawing cost beyond one sample a pixel, milliseconds a megapixel."""

    samples: int
    seconds: float | None  # a frame
    added: float | None
    errors: dict[str, Spread]


class MeasuredSequence(msgspec.Struct, frozen=True, kw_only=True):
    """Everything about one sequence."""

    name: str
    folder: str
    frames: list[int]
    width: int
    height: int
    effects: str
    cells: list[Measured]
    yardstick: list[Yardstick]
    noisy: bool
    control: Interval  # the default against its own copy, by the clock
    floor: float  # milliseconds a megapixel: the default's least bytes at the bandwidth of a copy
    truth_noise: float | None  # mean squared error of the truth itself, by its samples: nothing can be seen below it
    mean_noise: float | None  # mean squared error that an exponential mean of independent samples ends with
    stages: dict[str, float]  # milliseconds a megapixel of the default's steps, medians
    clock: Clock = Clock.DEVICE  # that times are ranked by
    rounds: int = 0  # of timing, as many as it took
    timed_pixels: int = 0  # of the enlarged frame
    profile: str = ""  # that another tool's files were read by


class Accuracy(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement; what the report is drawn from."""

    environment: Environment
    metrics: list[str]
    rounds: int
    variants: list[Variant]
    sequences: list[MeasuredSequence]


def exponential_noise(one_sample: float, weight: float) -> float:
    """Mean squared error that m <- m + ``weight`` (x - m) ends with, where one sample x has ``one_sample``.

    The variance of a geometric sum of independent samples: weight^2 sum (1 - weight)^2k = weight / (2 - weight). A mean
    whose samples are spread evenly over the pixel, or one that counts, may be better; this one never is.
    """
    return one_sample * weight / (2.0 - weight)


def spread(metric: str, values: Sequence[float]) -> Spread:
    """Mean (as ``cltaa compare`` takes it), 5th and 95th percentile and largest of an error over the frames."""
    # Of the values themselves: between two PSNR one of which is infinite there is none.
    p5, p95 = np.percentile(values, [5, 95], method="nearest")
    return Spread(mean=mean_of(metric, values), p5=float(p5), p95=float(p95), largest=max(values), frames=[*values])


def dominated_by(errors: Mapping[str, float], faster: Callable[[str, str], bool]) -> dict[str, str]:
    """For each name that is beaten, what beats it with the least error.

    ``errors`` are exact, less is better. ``faster(a, b)`` says whether ``a`` takes less time than ``b`` beyond chance:
    of two whose times cannot be told apart neither beats the other, whatever their errors.
    """
    order = sorted(errors, key=lambda name: errors[name])
    result = {}
    for name in order:
        no_worse = (other for other in order if other != name and errors[other] <= errors[name])
        found = next((other for other in no_worse if faster(other, name)), None)
        if found is not None:
            result[name] = found
    return result


CONTROL = "(A/A)"
# What fills each compute unit of a CPU and of a GPU, in pixels, and the limits of a frame: with less it is launches
# that are timed, and the wait for the last of many threads.
FILLING_A_UNIT = {True: 40_000, False: 15_000}
LIMITS = {True: (250_000, 2_000_000), False: (1_000_000, 4_000_000)}
PLANES = ("colour", "depth", "motion", "alpha", "reactive")  # of a frame
STAGE_PASSES = 5  # over which the time of each stage is a median
TURN = 0.02  # seconds that a job runs again and again for in a round: its least is what nothing held up


class Ranking(NamedTuple):
    """By which clock variants are compared, and what the default against its own copy says of that."""

    clock: Clock
    control: Interval
    noisy: bool


def enlargement(captured: FrameSequence, launcher: DeviceLauncher, pixels: int | None) -> int:
    """How many times as wide and high frames must be to have ``pixels`` at least; None: to fill the device."""
    is_cpu, units = launcher.device.is_cpu, launcher.device.cl_device.max_compute_units
    least, most = LIMITS[is_cpu]
    filling = pixels or min(max(FILLING_A_UNIT[is_cpu] * units, least), most)
    return math.ceil(math.sqrt(filling / (captured.width * captured.height)))


def jobs_of(
    captured: FrameSequence, variants: Sequence[Variant], launcher: DeviceLauncher, least_pixels: int | None
) -> tuple[list[Job], int, int, dict[str, float]]:
    """A job for each variant and a copy of the default's; pixels and least bytes of a frame; the default's steps."""
    factor = enlargement(captured, launcher, least_pixels)
    frames = [enlarged(frame, factor) for frame in timed_frames(captured)]
    pixels = frames[0].width * frames[0].height
    resolvers = [variant.resolver(launcher) for variant in variants]
    jobs = [resolve_job(each.name, resolver, frames)[0] for each, resolver in zip(variants, resolvers, strict=True)]
    moved = least_bytes(resolvers[0]) * pixels
    copy = Job(f"{jobs[0].name} {CONTROL}", jobs[0].run)
    return [*jobs, copy], pixels, moved, stage_seconds(variants[0], launcher, frames)


def ranking(samples: Samples, default: str, controls: int, *, is_cpu: bool, units: int) -> Ranking:
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
    given: dict[str, Image | None] = {name: getattr(frame, name) for name in PLANES}
    large: dict[str, Any] = {
        name: image.repeat(factor, 0).repeat(factor, 1) for name, image in given.items() if image is not None
    }
    if "motion" in large:
        large["motion"] *= np.float32(factor)
    return replace(frame, **large)


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


class Timing(NamedTuple):
    """How times are taken."""

    rounds: int  # at least
    patience: float  # seconds a sequence for more rounds, while nothing can be ranked
    together: int  # sequences of the run, each with a control that may differ by chance
    units: int  # of the device: of PoCL the threads, which its description does not say
    processors: int  # that this process may use
    pixels: int | None  # of a frame that is timed, at least; None: what fills the device


def measure_sequence(
    captured: FrameSequence, cells: Mapping[Variant, Cell], launcher: DeviceLauncher, timing: Timing
) -> MeasuredSequence:
    """Time the variants whose errors are in ``cells``, the default first, and put both together."""
    variants = [*cells]
    default, metrics = variants[0], [*cells[variants[0]].errors]
    yardstick = _yardstick(captured, metrics)  # refuses what is no light
    jobs, pixels, moved, stages = jobs_of(captured, variants, launcher, timing.pixels)
    unit = 1e9 / pixels  # milliseconds a megapixel

    def ranked(samples: Samples) -> Ranking:
        return ranking(samples, default.name, timing.together, is_cpu=launcher.device.is_cpu, units=timing.units)

    samples = measure_times(
        [*jobs, copy_job(launcher, moved)],
        timing.rounds,
        turn=TURN,
        enough=lambda samples: not ranked(samples).noisy,
        patience=timing.patience,
        action=f"timing {captured.folder.name}",
    )
    found = ranked(samples)
    measured = [
        Measured(
            variant=variant.name,
            errors=_spreads(cell.errors),
            rounding=cell.rounding,
            time=samples.interval(variant.name, found.clock).times(unit),
            ratio=samples.ratio(variant.name, default.name, found.clock),
        )
        for variant, cell in cells.items()
    ]
    one = next((row.errors["mse"].mean for row in yardstick if row.samples == 1 and "mse" in row.errors), None)
    drawn = truth_samples(truth_of(captured))
    return MeasuredSequence(
        name=captured.folder.name,
        folder=str(captured.folder),
        frames=list(captured.numbers),
        width=captured.width,
        height=captured.height,
        effects="" if captured.effects is None else format_effects(captured.effects),
        cells=measured if found.noisy else _with_front(measured, metrics, samples, found.clock),  # no ranking of noise
        yardstick=yardstick,
        truth_noise=None if one is None or drawn is None else float(one * drawn**-STRATIFIED_EXPONENT),
        mean_noise=None if one is None else exponential_noise(one, default.settings.blend_weight),
        noisy=found.noisy,
        control=found.control,
        floor=samples.interval("copy", Clock.DEVICE).median * unit,
        stages={name: seconds * unit for name, seconds in stages.items()},
        clock=found.clock,
        rounds=len(samples.by_job[default.name]),
        timed_pixels=pixels,
        profile=captured.reading.get("profile", {}).get("name", ""),
    )


def _spreads(errors: Mapping[str, Sequence[float]]) -> dict[str, Spread]:
    return {metric: spread(metric, values) for metric, values in errors.items()}


def _with_front(cells: Sequence[Measured], metrics: Iterable[str], samples: Samples, clock: Clock) -> list[Measured]:
    """The cells, each with what beats it; the times of two are compared by what they took in the same rounds."""
    dominated: dict[str, Mapping[str, str]] = {}
    for metric in metrics:
        errors = {cell.variant: cost(metric, cell.errors[metric].mean) for cell in cells}
        dominated[metric] = dominated_by(errors, partial(samples.faster, clock=clock))
    return [
        msgspec.structs.replace(
            cell, dominated_by={metric: who[cell.variant] for metric, who in dominated.items() if cell.variant in who}
        )
        for cell in cells
    ]


def cost(metric: str, value: float) -> float:
    """An error that falls as the image gets better, whatever the metric's own direction is."""
    return -value if METRICS[metric].higher_is_better else value


def yardstick_errors(sequence: FrameSequence, metrics: Iterable[str]) -> dict[int, dict[str, list[float]]]:
    """Errors a frame of each supersampled sequence there is, by samples a pixel; one sample is the capture itself.

    What is not finite in the capture is black, as in the table of ``cltaa bench quality``. Raises DataError for NaN or
    infinity in a supersampled image or the truth.
    """
    truth, chosen, yardsticks = truth_of(sequence), named_metrics(metrics), open_yardsticks(sequence)
    found: dict[int, dict[str, list[float]]] = {
        samples: {metric.name: [] for metric in chosen} for samples in (1, *yardsticks)
    }
    for number in sequence.numbers:
        reference, truth_path = truth.image(number), truth.path(number)
        for samples, frames in found.items():
            source = yardsticks.get(samples, sequence)
            image = finite(sequence.frame(number).colour) if samples == 1 else yardsticks[samples].image(number)
            about: dict[str, Any] = {"path": source.path(number), "truth_path": truth_path, "frame": number}
            for name, value in measure(image, reference, chosen, **about).items():
                frames[name].append(value)
    return found


def _yardstick(captured: FrameSequence, metrics: Iterable[str]) -> list[Yardstick]:
    seconds: dict[str, float] = captured.sequence_json.get("seconds_a_frame", {})
    one, unit = seconds.get("1"), 1e9 / (captured.width * captured.height)
    rows = []
    for samples, errors in yardstick_errors(captured, metrics).items():
        spent = seconds.get(str(samples))
        added = None if spent is None or one is None else max(spent - one, 0.0) * unit
        rows.append(Yardstick(samples=samples, seconds=spent, added=added, errors=_spreads(errors)))
    return rows


def tasks_of(
    folders: Sequence[Path],
    variants: Sequence[Variant],
    device: str | None,
    judging: Judging,
    reading: Reading = DEFAULT_READING,
) -> list[Task]:
    """Every variant over every sequence, each by itself.

    ``reading`` is for all of them (``readings``). Raises UsageError for two sequences of one name, what ``task_of``
    raises, InputMissing where a yardstick lacks a frame, and DataError for a sequence of a single one.
    """
    by_name(folders, "sequences")
    tasks = []
    for folder, how in readings(folders, reading).items():
        sequence = how.open(folder)
        task = task_of(sequence, (), device, judging, how)
        check_yardsticks(sequence, open_yardsticks(sequence))  # missed now, and not after the sequences before it
        timed_numbers(sequence)  # likewise
        tasks += [msgspec.structs.replace(task, variants=(variant,)) for variant in variants]
    return tasks


def bench_accuracy(
    tasks: Sequence[Task],
    output: Path,
    *,
    rounds: int,
    patience: float,
    pixels: int | None,
    jobs: int,
    dask: str | None,
) -> Accuracy:
    """Run those of ``tasks``, each of one variant, that are missing, time every variant here, and put all together.

    A sequence that is finished is kept in ``output``.
    """
    before = load_average()
    pin_threads()
    launcher = DeviceLauncher(tasks[0].device)
    of = {
        sequence: [task for task in tasks if task.sequence == sequence] for sequence in {t.sequence: 0 for t in tasks}
    }
    units = launcher.device.cl_device.max_compute_units
    timing = Timing(rounds, patience, len(of), units, CORES, pixels)
    for _ in track(run_all(tasks, output, jobs=jobs, dask=dask), len(tasks), "measuring errors", "tasks"):
        pass
    sequences = list[MeasuredSequence]()
    for mine in of.values():
        cells = cells_of(mine, output)
        captured = mine[0].open()
        path = _path(output, mine, captured, launcher, timing)
        measured = kept(path, MeasuredSequence)
        if measured is None:
            measured = measure_sequence(captured, cells, launcher, timing)
            keep(path, measured)
        sequences.append(measured)
    return Accuracy(
        environment=environment(launcher.description, before, units=units),
        metrics=list(tasks[0].judging.metrics),
        rounds=rounds,
        variants=list(dict.fromkeys(variant for task in tasks for variant in task.variants)),
        sequences=sequences,
    )


def cells_of(tasks: Iterable[Task], output: Path) -> dict[Variant, Cell]:
    """The cells of finished tasks, by variant."""
    return {variant: task.finished(output)[variant.name] for task in tasks for variant in task.variants}


def _path(
    output: Path, tasks: Sequence[Task], captured: FrameSequence, launcher: DeviceLauncher, timing: Timing
) -> Path:
    """The file of a finished sequence, named by everything that it depends on."""
    cells = [task.path(output, variant).name for task in tasks for variant in task.variants]
    beside = content_sha256(captured, open_yardsticks(captured).values()), repr(captured.sequence_json)
    digest = hashlib.sha256("\0".join([*cells, *beside, launcher.description, repr(timing)]).encode())
    return output / "times" / f"{digest.hexdigest()[:16]}.msgpack"
