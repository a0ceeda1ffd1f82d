"""``cltaa bench accuracy``: error and time of every variant on every sequence, in one run."""

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
from cltaa.printable import printable
from cltaa.process import CORES
from cltaa.progress import track


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """An error over the frames of a sequence; the PSNR of an identical frame is infinite, null in JSON."""

    mean: float
    p5: float
    p95: float
    largest: float
    frames: list[float]


class Measured(msgspec.Struct, frozen=True, kw_only=True):
    """One variant on one sequence. Times are milliseconds per megapixel of the kernels alone."""

    variant: str
    errors: dict[str, Spread]
    rounding: Rounding | None
    time: Interval  # by the clock that ranks the sequence
    ratio: Interval  # of that time to the default's, paired
    dominated_by: dict[str, str] = {}  # metric -> a variant with no more error that is faster beyond chance


class Yardstick(msgspec.Struct, frozen=True, kw_only=True):
    """Supersampling: ``added`` is the drawing time beyond one sample a pixel, milliseconds per megapixel."""

    samples: int
    seconds: float | None  # per frame
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
    control: Interval  # ratio of the default's own copy to the default, by the clock
    floor: float  # milliseconds per megapixel: the default's least bytes at the bandwidth of a copy
    truth_noise: float | None  # mean squared error of the truth itself, by its samples; smaller errors are invisible
    mean_noise: float | None  # limit of the mean squared error of an exponential mean of independent samples
    stages: dict[str, float]  # milliseconds per megapixel of the default's steps, medians
    clock: Clock = Clock.DEVICE  # clock of the ranking
    rounds: int = 0  # number of timing rounds
    timed_pixels: int = 0  # of the enlarged frame
    profile: str = ""  # reader profile of another tool's files


class _Kept(msgspec.Struct, frozen=True):
    """A finished sequence in a file, and where and when it was measured."""

    measured: MeasuredSequence
    environment: Environment


class Accuracy(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement, the source of the report. The date and the load before and after are those from the first
    sequence to the last, where an earlier run measured some of them."""

    environment: Environment
    metrics: list[str]
    rounds: int
    variants: list[Variant]
    sequences: list[MeasuredSequence]


def exponential_noise(one_sample: float, weight: float) -> float:
    """Return the limit of the mean squared error of m <- m + ``weight`` (x - m), if one sample x has ``one_sample``.

    The variance of a geometric sum of independent samples: weight^2 sum (1 - weight)^2k = weight / (2 - weight). Evenly
    spread samples, or a mean with a sample count, can have less error.
    """
    return one_sample * weight / (2.0 - weight)


def spread(metric: str, values: Sequence[float]) -> Spread:
    """Return mean (as in ``cltaa compare``), 5th and 95th percentile and largest of an error over the frames."""
    # No interpolation, which is undefined beside an infinite PSNR.
    p5, p95 = np.percentile(values, [5, 95], method="nearest")
    return Spread(mean=mean_of(metric, values), p5=float(p5), p95=float(p95), largest=max(values), frames=[*values])


def dominated_by(errors: Mapping[str, float], faster: Callable[[str, str], bool]) -> dict[str, str]:
    """Return for each dominated name the one that dominates it with the least error.

    ``errors`` are exact, less is better. ``faster(a, b)`` says whether ``a`` is faster than ``b`` beyond chance: of two
    with indistinguishable times neither dominates, whatever their errors.
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
# Pixels that fill a compute unit of a CPU (True) and of a GPU, and the limits of a frame: smaller frames would time
# mostly launches and the wait for the last of many threads.
FILLING_A_UNIT = {True: 40_000, False: 15_000}
LIMITS = {True: (250_000, 2_000_000), False: (1_000_000, 4_000_000)}
PLANES = ("colour", "depth", "motion", "alpha", "reactive")  # the images of a frame
STAGE_PASSES = 5  # passes for the median time of each stage
TURN = 0.02  # seconds of repeated runs of a job in a round; the least of them is undisturbed


class Ranking(NamedTuple):
    """The clock that compares variants, and its ratio of the default's own copy to the default."""

    clock: Clock
    control: Interval
    noisy: bool


def enlargement(captured: FrameSequence, launcher: DeviceLauncher, pixels: int | None) -> int:
    """Return the factor of width and height that gives frames at least ``pixels``; None: enough to fill the device."""
    is_cpu, units = launcher.device.is_cpu, launcher.device.cl_device.max_compute_units
    least, most = LIMITS[is_cpu]
    filling = pixels or min(max(FILLING_A_UNIT[is_cpu] * units, least), most)
    return math.ceil(math.sqrt(filling / (captured.width * captured.height)))


def jobs_of(
    captured: FrameSequence, variants: Sequence[Variant], launcher: DeviceLauncher, least_pixels: int | None
) -> tuple[dict[str, Job], int, int, dict[str, float]]:
    """Return a job for each variant and a copy of the default's; pixels and least bytes of a frame; the default's
    stage times."""
    factor = enlargement(captured, launcher, least_pixels)
    frames = [enlarged(frame, factor) for frame in timed_frames(captured)]
    pixels = frames[0].width * frames[0].height
    resolvers = [variant.resolver(launcher) for variant in variants]
    jobs = {v.name: resolve_job(resolver, frames)[0] for v, resolver in zip(variants, resolvers, strict=True)}
    moved = least_bytes(resolvers[0]) * pixels
    default = variants[0].name
    jobs[f"{default} {CONTROL}"] = jobs[default]
    return jobs, pixels, moved, stage_seconds(variants[0], launcher, frames)


def ranking(samples: Samples, default: str, controls: int, *, is_cpu: bool, units: int) -> Ranking:
    """Rank by the device's clock, or on a CPU, if that is too noisy, by processor time, if that is not.

    With one thread (``units``) processor time comes first: it is the device's clock without waiting for the processor.
    Long kernels on a shared processor always wait, which the default and its copy, both short, do not show.
    ``controls`` is the number of sequences ranked in one run, each of which may exclude 1 by chance.
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
    """Return the frame with every pixel repeated ``factor`` times along both axes, and its motion scaled by it."""
    given: dict[str, Image | None] = {name: getattr(frame, name) for name in PLANES}
    there = {name: image for name, image in given.items() if image is not None and (name != "depth" or frame.has_depth)}
    large: dict[str, Any] = {name: image.repeat(factor, 0).repeat(factor, 1) for name, image in there.items()}
    if "motion" in large:
        large["motion"] *= np.float32(factor)
    return replace(frame, **{"depth": None} | large)


def stage_seconds(variant: Variant, launcher: DeviceLauncher, frames: Sequence[Frame]) -> dict[str, float]:
    """Return median seconds of upload, each kernel by the device's clock, and read-back, over ``STAGE_PASSES``."""
    resolver = variant.resolver(launcher)
    seen: dict[str, list[float]] = {}
    for _ in range(STAGE_PASSES):
        for frame in frames:
            events = launcher.timed(partial(resolver.resolve, frame))
        seen.setdefault("upload", []).append(resolver.times.upload)
        for kernel in dict.fromkeys(name for name, _ in events):
            own = [(name, event) for name, event in events if name == kernel]
            seen.setdefault(kernel, []).append(device_seconds(own))
        seen.setdefault("read back", []).append(resolver.times.read_back)
    return {name: float(np.median(values)) for name, values in seen.items()}


class Timing(NamedTuple):
    """Settings of the timing."""

    rounds: int  # least number of rounds
    patience: float  # extra seconds per sequence for more rounds, while it is too noisy to rank
    together: int  # number of sequences, each with a control that may differ by chance
    units: int  # compute units of the device, for PoCL its threads, which its description omits
    processors: int  # processors that this process may use
    pixels: int | None  # least pixels of a timed frame; None: enough to fill the device


def measure_sequence(
    captured: FrameSequence, cells: Mapping[Variant, Cell], launcher: DeviceLauncher, timing: Timing
) -> MeasuredSequence:
    """Time the variants whose errors are in ``cells``, the default first, and combine errors and times."""
    variants = [*cells]
    default, metrics = variants[0], [*cells[variants[0]].errors]
    yardstick = _yardstick(captured, metrics)  # raises for NaN and infinity before the timing
    jobs, pixels, moved, stages = jobs_of(captured, variants, launcher, timing.pixels)
    unit = 1e9 / pixels  # seconds to milliseconds per megapixel

    def ranked(samples: Samples) -> Ranking:
        return ranking(samples, default.name, timing.together, is_cpu=launcher.device.is_cpu, units=timing.units)

    samples = measure_times(
        jobs | {"copy": copy_job(launcher, moved)},
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
        **_named(captured),
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


def _named(captured: FrameSequence) -> dict[str, str]:
    """Return the name and the folder of a sequence as text that any file can hold."""
    return {"name": printable(captured.folder.name), "folder": printable(captured.folder)}


def _spreads(errors: Mapping[str, Sequence[float]]) -> dict[str, Spread]:
    return {metric: spread(metric, values) for metric, values in errors.items()}


def _with_front(cells: Sequence[Measured], metrics: Iterable[str], samples: Samples, clock: Clock) -> list[Measured]:
    """Return the cells, each with the variants that dominate it; compares times within the same rounds."""
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
    """Return an error that falls as the image gets better, for metrics of either direction."""
    return -value if METRICS[metric].higher_is_better else value


def yardstick_errors(sequence: FrameSequence, metrics: Iterable[str]) -> dict[int, dict[str, list[float]]]:
    """Return errors per frame of each supersampled sequence, by samples a pixel; one sample is the capture itself.

    Non-finite values in the capture become black, as in ``cltaa bench quality``. Raises DataError for NaN or infinity
    in a supersampled image or the truth.
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


def drawing_seconds(captured: FrameSequence) -> dict[str, float]:
    """Return the seconds a frame of a capture by samples a pixel, as far as its record has numbers there."""
    told = captured.sequence_json.get("seconds_a_frame")
    seconds = told.items() if isinstance(told, dict) else ()
    return {samples: each for samples, each in seconds if isinstance(each, int | float) and math.isfinite(each)}


def _yardstick(captured: FrameSequence, metrics: Iterable[str]) -> list[Yardstick]:
    seconds = drawing_seconds(captured)
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
    """Return a task for every variant on every sequence.

    ``reading`` applies to all (``readings``). Raises UsageError for two sequences of one name, what ``task_of`` raises,
    InputMissing if a yardstick lacks a frame, and DataError for a sequence of one frame.
    """
    by_name(folders, "sequences")
    tasks = []
    for folder, how in readings(folders, reading).items():
        sequence = how.open(folder)
        task = task_of(sequence, (), device, judging, how)
        check_yardsticks(sequence, open_yardsticks(sequence))  # fails now and not after earlier sequences
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
    """Run the unfinished ``tasks``, each of one variant, time every variant here, and combine all.

    Stores each finished sequence in ``output``.
    """
    before = load_average()
    pin_threads()
    launcher = DeviceLauncher(tasks[0].device)
    names = dict.fromkeys(task.sequence for task in tasks)
    of = {sequence: [task for task in tasks if task.sequence == sequence] for sequence in names}
    units = launcher.device.cl_device.max_compute_units
    timing = Timing(rounds, patience, len(of), units, CORES, pixels)
    for _ in track(run_all(tasks, output, jobs=jobs, dask=dask), len(tasks), "measuring errors", "tasks"):
        pass
    here = partial(environment, launcher.description, before, units=units)
    sequences, places = list[MeasuredSequence](), list[Environment]()
    for mine in of.values():
        cells = cells_of(mine, output)
        captured = mine[0].open()
        path = _path(output, mine, captured, here(), timing)
        found = kept(path, _Kept)
        if found is None:
            measured = measure_sequence(captured, cells, launcher, timing)
            found = _Kept(measured, here())
            keep(path, found)
        # Measured once, the same frames may lie elsewhere now, and under another name.
        sequences.append(msgspec.structs.replace(found.measured, **_named(captured)))
        places.append(found.environment)
    return Accuracy(
        environment=_during(places),
        metrics=list(tasks[0].judging.metrics),
        rounds=rounds,
        variants=list(dict.fromkeys(variant for task in tasks for variant in task.variants)),
        sequences=sequences,
    )


def cells_of(tasks: Iterable[Task], output: Path) -> dict[Variant, Cell]:
    """Return the cells of finished tasks, by variant."""
    return {variant: task.finished(output)[variant.name] for task in tasks for variant in task.variants}


def _path(output: Path, tasks: Sequence[Task], captured: FrameSequence, here: Environment, timing: Timing) -> Path:
    """Return the file of a finished sequence, named by a hash of everything that it depends on."""
    # With the names of the variants, which what was measured holds, and a file of parameters may have another now.
    cells = [f"{task.path(output, variant).name} {variant.name}" for task in tasks for variant in task.variants]
    beside = content_sha256(captured, open_yardsticks(captured).values()), repr(captured.sequence_json)
    place = repr(msgspec.structs.replace(here, date="", load_before=0.0, load_after=0.0))
    digest = hashlib.sha256("\0".join([*cells, *beside, place, repr(timing)]).encode())
    return output / "times" / f"{digest.hexdigest()[:16]}.msgpack"


def _during(places: Sequence[Environment]) -> Environment:
    """Return the environment of measurements that differ in time alone."""
    first, *_, last = sorted([*places, *places], key=lambda place: place.date)
    date = " to ".join(dict.fromkeys([first.date, last.date]))
    return msgspec.structs.replace(last, date=date, load_before=first.load_before)
