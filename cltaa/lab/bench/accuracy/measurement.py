"""``cltaa bench accuracy``: error and time of every variant over every sequence, in one run."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cltaa.frame import Frame, Image, format_effects
from cltaa.inputs.open import DEFAULT_READING, Reading, is_own, readings
from cltaa.io.atomic import keep, kept
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.accuracy.results import Accuracy, Cell, MeasuredSequence, Yardstick, exponential_noise, spread
from cltaa.lab.bench.accuracy.tasks import Task, load, run_all, yardstick_errors
from cltaa.lab.bench.kernels import copy_job, least_bytes
from cltaa.lab.bench.quality.cases import by_name
from cltaa.lab.judge.comparison import check_yardsticks, content_sha256, open_yardsticks, truth_of, truth_samples
from cltaa.lab.judge.metrics import METRICS, STRATIFIED_EXPONENT
from cltaa.lab.timing import (
    Clock,
    Interval,
    Job,
    Samples,
    device_seconds,
    environment,
    load_average,
    measure,
    pin_threads,
    resolve_job,
    timed_frames,
    too_noisy_among,
)
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.process import CORES
from cltaa.progress import track


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


class Timing(NamedTuple):
    """How times are taken."""

    rounds: int  # at least
    patience: float  # seconds a sequence for more rounds, while nothing can be ranked
    together: int  # sequences of the run, each with a control that may differ by chance
    units: int  # of the device: of PoCL the threads, which its description does not say
    processors: int  # that this process may use
    pixels: int | None  # of a frame that is timed, at least; None: what fills the device


def measure_sequence(
    captured: FrameSequence, tasks: Sequence[Task], output: Path, launcher: DeviceLauncher, timing: Timing
) -> MeasuredSequence:
    """Time the variants of ``tasks``, whose errors lie in ``output``, and put both together."""
    default, metrics = tasks[0].variant, tasks[0].metrics
    yardstick = _yardstick(captured, metrics, captured.width * captured.height * 1e-6)  # refuses what is no light
    jobs, pixels, moved, stages = jobs_of(captured, tasks, launcher, timing.pixels)
    megapixels = pixels * 1e-6

    def ranked(samples: Samples) -> Ranking:
        return ranking(samples, default.name, timing.together, is_cpu=launcher.device.is_cpu, units=timing.units)

    samples = measure(
        [*jobs, copy_job(launcher, moved)],
        timing.rounds,
        turn=TURN,
        enough=lambda samples: not ranked(samples).noisy,
        patience=timing.patience,
        action=f"timing {captured.folder.name}",
    )
    found = ranked(samples)
    cells = [_cell(task, output, samples, default.name, found.clock, megapixels) for task in tasks]
    one = _one_sample(yardstick)
    return MeasuredSequence(
        name=captured.folder.name,
        folder=str(captured.folder),
        frames=list(captured.numbers),
        width=captured.width,
        height=captured.height,
        effects="" if captured.effects is None else format_effects(captured.effects),
        cells=cells if found.noisy else _with_front(cells, metrics, samples, found.clock),  # no ranking out of noise
        yardstick=yardstick,
        truth_noise=_truth_noise(captured, yardstick),
        mean_noise=None if one is None else exponential_noise(one, default.settings.blend_weight),
        noisy=found.noisy,
        control=found.control,
        floor=samples.interval("copy", Clock.DEVICE).median * 1e3 / megapixels,
        stages={name: seconds * 1e3 / megapixels for name, seconds in stages.items()},
        clock=found.clock,
        rounds=len(samples.by_job[default.name]),
        timed_pixels=pixels,
        profile=captured.reading.get("profile", {}).get("name", ""),
    )


def _cell(task: Task, output: Path, samples: Samples, default: str, clock: Clock, megapixels: float) -> Cell:
    found, name = load(task, output), task.variant.name
    assert found is not None
    times = {
        str(each): samples.interval(name, each).times(1e3 / megapixels) if samples.has(name, each) else None
        for each in (Clock.DEVICE, Clock.PROCESSOR)
    }
    return Cell(
        variant=name,
        errors={metric: spread(metric, values) for metric, values in found.frames.items()},
        rounding=found.rounding,
        wall=samples.interval(name).times(1e3 / megapixels),
        **times,
        least=float(samples.seconds(name).min()) * 1e3 / megapixels,
        ratio=samples.ratio(name, default, clock),
        dominated_by={},
    )


def _with_front(cells: Sequence[Cell], metrics: Iterable[str], samples: Samples, clock: Clock) -> list[Cell]:
    """The cells, each with what beats it; the times of two are compared by what they took in the same rounds."""

    @cache
    def faster(one: str, other: str) -> bool:
        return samples.faster(one, other, clock)

    dominated: dict[str, Mapping[str, str]] = {}
    for metric in metrics:
        errors = {cell.variant: cost(metric, cell.errors[metric].mean) for cell in cells}
        dominated[metric] = dominated_by(errors, faster)
    return [
        msgspec.structs.replace(
            cell, dominated_by={metric: who[cell.variant] for metric, who in dominated.items() if cell.variant in who}
        )
        for cell in cells
    ]


def cost(metric: str, value: float) -> float:
    """An error that falls as the image gets better, whatever the metric's own direction is."""
    return -value if METRICS[metric].higher_is_better else value


def _yardstick(captured: FrameSequence, metrics: tuple[str, ...], megapixels: float) -> list[Yardstick]:
    seconds: dict[str, float] = captured.sequence_json.get("seconds_a_frame", {})
    one = seconds.get("1")
    rows = []
    for samples, frames in yardstick_errors(captured, metrics).items():
        spent = seconds.get(str(samples))
        added = None if spent is None or one is None else max(spent - one, 0.0) * 1e3 / megapixels
        errors = {metric: spread(metric, values) for metric, values in frames.items()}
        rows.append(Yardstick(samples=samples, seconds=spent, added=added, errors=errors))
    return rows


def _one_sample(yardstick: Sequence[Yardstick]) -> float | None:
    """Mean squared error of the capture itself, one sample a pixel."""
    return next((row.errors["mse"].mean for row in yardstick if row.samples == 1 and "mse" in row.errors), None)


def _truth_noise(captured: FrameSequence, yardstick: Sequence[Yardstick]) -> float | None:
    """What the law of stratified samples leaves of one sample's error in the truth."""
    samples = truth_samples(truth_of(captured))
    one = _one_sample(yardstick)
    return None if samples is None or one is None else float(one * samples**-STRATIFIED_EXPONENT)


TIMES = "times"  # folder of what is finished of each sequence


def tasks_of(
    folders: Sequence[Path],
    variants: Sequence[Variant],
    device: str | None,
    metrics: tuple[str, ...],
    rounding: int,
    reading: Reading = DEFAULT_READING,
) -> list[Task]:
    """Every variant over every sequence.

    ``reading`` is for all of them (``readings``). Raises UsageError for two sequences of one name, and what opening
    another tool's raises.
    """
    by_name(folders, "sequences")
    tasks = []
    for folder, how in readings(folders, reading).items():
        # Another tool's files have no record that tells one rendering from the next, nor their reading from another.
        other = not is_own(folder) or how != Reading(step=how.step)
        files = content_sha256(how.open(folder)) if other else ""
        tasks += [
            Task(
                sequence=str(folder),
                variant=variant,
                device=device,
                metrics=metrics,
                rounding_frames=rounding,
                reading=how,
                files=files,
            )
            for variant in variants
        ]
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
    """Run those of ``tasks`` that are missing, time every variant here, and put all together.

    A sequence that is finished is kept in ``output``.
    """
    before = load_average()
    for task in {task.sequence: task for task in tasks}.values():
        sequence = task.open()  # what lacks is missed now, and not after the sequences before it
        truth_of(sequence)
        check_yardsticks(sequence, open_yardsticks(sequence))
    pin_threads()
    launcher = DeviceLauncher(tasks[0].device)
    folders = list(dict.fromkeys(task.sequence for task in tasks))
    units = launcher.device.cl_device.max_compute_units
    timing = Timing(rounds, patience, len(folders), units, CORES, pixels)
    for _ in track(run_all(tasks, output, jobs=jobs, dask=dask), len(tasks), "measuring errors", "tasks"):
        pass
    sequences = list[MeasuredSequence]()
    for folder in folders:
        mine, path = [task for task in tasks if task.sequence == folder], _path(output, tasks, folder, launcher, timing)
        measured = kept(path, MeasuredSequence)
        if measured is None:
            measured = measure_sequence(mine[0].open(), mine, output, launcher, timing)
            keep(path, measured)
        sequences.append(measured)
    return Accuracy(
        environment=environment(launcher.description, before, units=units),
        metrics=list(tasks[0].metrics),
        rounds=rounds,
        variants=list(dict.fromkeys(task.variant for task in tasks)),
        sequences=sequences,
    )


def _path(output: Path, tasks: Sequence[Task], folder: str, launcher: DeviceLauncher, timing: Timing) -> Path:
    """The file of a finished sequence, named by everything that it depends on."""
    keys = [task.key() for task in tasks if task.sequence == folder]
    digest = hashlib.sha256("\0".join([*keys, launcher.description, repr(timing)]).encode())
    return output / TIMES / f"{digest.hexdigest()[:16]}.msgpack"
