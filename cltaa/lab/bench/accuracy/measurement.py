"""``cltaa bench accuracy``: error and time of every variant over every sequence, in one run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from cltaa.frame import format_effects
from cltaa.inputs.open import DEFAULT_READING, Reading, is_own, readings
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.accuracy.results import Accuracy, Cell, MeasuredSequence, Yardstick, exponential_noise, spread
from cltaa.lab.bench.accuracy.tasks import keep, kept, load, run_all
from cltaa.lab.bench.accuracy.variants import TURN, Ranking, Task, jobs_of, ranking, yardstick_errors
from cltaa.lab.bench.contenders import copy_job
from cltaa.lab.bench.environment import environment, load_average, pin_threads
from cltaa.lab.bench.quality.cases import by_name
from cltaa.lab.judge.comparison import check_yardsticks, open_yardsticks, stamps, truth_of, truth_samples
from cltaa.lab.judge.equal_quality import STRATIFIED_EXPONENT
from cltaa.lab.judge.metrics import METRICS
from cltaa.lab.timing import Clock, Samples, measure
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


class Timing(NamedTuple):
    """How times are taken."""

    rounds: int  # at least
    patience: float  # seconds a sequence for more rounds, while nothing can be ranked
    together: int  # sequences of the run, each with a control that may differ by chance
    units: int  # of the device: of PoCL the threads, which its description does not say
    processors: int  # that this process may use
    pixels: int | None  # of a frame that is timed, at least; None: what fills the device


def measure_sequence(
    captured: FrameSequence,
    tasks: Sequence[Task],
    output: Path,
    launcher: DeviceLauncher,
    timing: Timing,
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
        files = stamps(how.open(folder)) if other else ""
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
