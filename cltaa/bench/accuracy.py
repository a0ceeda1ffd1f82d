"""``cltaa bench accuracy``: error and time of every variant over every sequence, in one run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from cltaa.bench.baseline import copy_job
from cltaa.bench.distribution import load, run_all
from cltaa.bench.environment import environment
from cltaa.bench.environment import load as load_average
from cltaa.bench.errors_of import Task, truth_of, yardstick_errors
from cltaa.bench.front import dominated_by
from cltaa.bench.ladder import Variant
from cltaa.bench.results import Accuracy, Cell, Measured, Yardstick, exponential_noise, spread
from cltaa.bench.times_of import AGAIN, jobs_of
from cltaa.bench.timing import Interval, Samples, measure, too_noisy_among
from cltaa.build import Build
from cltaa.comparison import truth_samples
from cltaa.equal_quality import STRATIFIED_EXPONENT
from cltaa.frames import format_effects
from cltaa.kernel_files import kernel_folder
from cltaa.launch import DeviceLauncher
from cltaa.metrics import METRICS
from cltaa.sources import Sequence as Captured
from cltaa.sources import open_sequence

Progress = Callable[[Iterable[Any], int, str, str], Iterable[Any]]


def tasks_of(
    folders: Sequence[Path], variants: Sequence[Variant], device: str | None, metrics: tuple[str, ...], rounding: int
) -> list[Task]:
    """Every variant over every sequence, in a fixed order: what ``--list`` prints and ``--task`` counts."""
    return [
        Task(sequence=str(folder), variant=variant, device=device, metrics=metrics, rounding_frames=rounding)
        for folder in folders
        for variant in variants
    ]


def bench_accuracy(
    tasks: Sequence[Task], output: Path, *, rounds: int, jobs: int, dask: str | None, progress: Progress
) -> Accuracy:
    """Run what is missing of ``tasks``, time every variant here, and put both together."""
    before = load_average()
    for _ in progress(run_all(tasks, output, jobs=jobs, dask=dask), len(tasks), "measuring errors", "tasks"):
        pass
    device, metrics = tasks[0].device, tasks[0].metrics
    launcher = DeviceLauncher(device)
    sequences, folders = [], list(dict.fromkeys(task.sequence for task in tasks))
    for folder in folders:
        mine = [task for task in tasks if task.sequence == folder]
        sequences.append(_measured(open_sequence(Path(folder)), mine, output, launcher, rounds, len(folders), progress))
    return Accuracy(
        environment=environment(launcher.description, before, Build().flags(), kernel_folder()),
        metrics=list(metrics),
        rounds=rounds,
        variants=list(dict.fromkeys(task.variant for task in tasks)),
        sequences=sequences,
    )


def _measured(
    captured: Captured,
    tasks: Sequence[Task],
    output: Path,
    launcher: DeviceLauncher,
    rounds: int,
    together: int,
    progress: Progress,
) -> Measured:
    default, metrics = tasks[0].variant, tasks[0].metrics
    jobs, pixels, moved, stages = jobs_of(captured, tasks, launcher)
    megapixels = pixels * 1e-6
    samples = measure(
        [*jobs, copy_job(launcher, moved)],
        rounds,
        progress=lambda items, total: progress(items, total, f"timing {captured.folder.name}", "rounds"),
    )
    cells = [_cell(task, output, samples, default.name, megapixels) for task in tasks]
    by_device = samples.has_device_times(default.name)
    pair = f"{default.name} {AGAIN}", default.name
    control = samples.ratio(*pair, device=by_device)
    noisy = too_noisy_among(samples.ratios(*pair, device=by_device), together)
    yardstick = _yardstick(captured, metrics, captured.width * captured.height * 1e-6)
    one = _one_sample(yardstick)
    return Measured(
        name=captured.folder.name,
        folder=str(captured.folder),
        frames=list(captured.numbers),
        width=captured.width,
        height=captured.height,
        effects="" if captured.effects is None else format_effects(captured.effects),
        cells=cells if noisy else _with_front(cells, metrics),  # no ranking out of noise
        yardstick=yardstick,
        truth_noise=_truth_noise(captured, yardstick),
        mean_noise=None if one is None else exponential_noise(one, default.settings.blend_weight),
        noisy=noisy,
        control=control,
        floor=samples.interval("copy", device=True).median * 1e3 / megapixels,
        stages={name: seconds * 1e3 / megapixels for name, seconds in stages.items()},
    )


def _cell(task: Task, output: Path, samples: Samples, default: str, megapixels: float) -> Cell:
    found, name = load(task, output), task.variant.name
    assert found is not None
    by_device = samples.has_device_times(name)
    return Cell(
        variant=name,
        errors={metric: spread(values) for metric, values in found.frames.items()},
        rounding=found.rounding,
        wall=_scaled(samples.interval(name), megapixels),
        device=_scaled(samples.interval(name, device=True), megapixels) if by_device else None,
        least=float(samples.seconds(name).min()) * 1e3 / megapixels,
        ratio=samples.ratio(name, default, device=by_device),
        dominated_by={},
    )


def _with_front(cells: Sequence[Cell], metrics: Iterable[str]) -> list[Cell]:
    """The cells, each with what dominates it; times are compared by their paired ratios."""
    dominated: dict[str, Mapping[str, str]] = {}
    for metric in metrics:
        points = {cell.variant: (cell.ratio.median, cost(metric, cell.errors[metric].mean)) for cell in cells}
        dominated[metric] = dominated_by(points)
    return [
        msgspec.structs.replace(
            cell, dominated_by={metric: who[cell.variant] for metric, who in dominated.items() if cell.variant in who}
        )
        for cell in cells
    ]


def cost(metric: str, value: float) -> float:
    """An error that falls as the image gets better, whatever the metric's own direction is."""
    return -value if METRICS[metric].higher_is_better else value


def _yardstick(captured: Captured, metrics: tuple[str, ...], megapixels: float) -> list[Yardstick]:
    record = json.loads((captured.folder / "sequence.json").read_text()) if _recorded(captured) else {}
    seconds: dict[str, float] = record.get("seconds_a_frame", {})
    one = seconds.get("1")
    rows = []
    for samples, frames in yardstick_errors(captured, metrics):
        spent = seconds.get(str(samples))
        added = None if spent is None or one is None else max(spent - one, 0.0) * 1e3 / megapixels
        errors = {metric: spread(values) for metric, values in frames.items()}
        rows.append(Yardstick(samples=samples, seconds=spent, added=added, errors=errors))
    return rows


def _one_sample(yardstick: Sequence[Yardstick]) -> float | None:
    """Mean squared error of the capture itself, one sample a pixel."""
    return next((row.errors["mse"].mean for row in yardstick if row.samples == 1 and "mse" in row.errors), None)


def _truth_noise(captured: Captured, yardstick: Sequence[Yardstick]) -> float | None:
    """What the law of stratified samples leaves of one sample's error in the truth."""
    samples = truth_samples(truth_of(captured))
    one = _one_sample(yardstick)
    return None if samples is None or one is None else float(one * samples**-STRATIFIED_EXPONENT)


def _recorded(captured: Captured) -> bool:
    return (captured.folder / "sequence.json").is_file()


def _scaled(seconds: Interval, megapixels: float) -> Interval:
    scale = 1e3 / megapixels
    return Interval(median=seconds.median * scale, low=seconds.low * scale, high=seconds.high * scale)
