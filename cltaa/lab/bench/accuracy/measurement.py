"""``cltaa bench accuracy``: error and time of every variant over every sequence, in one run."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from pathlib import Path

from cltaa.errors import ResourceError
from cltaa.inputs.open import DEFAULT_READING, Reading, is_own, readings
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.accuracy.results import Accuracy, MeasuredSequence
from cltaa.lab.bench.accuracy.sequence import Timing, measure_sequence
from cltaa.lab.bench.accuracy.tasks import (
    Program,
    build_all,
    dearest_first,
    keep,
    kept,
    path_of,
    programs_needed,
    run_all,
)
from cltaa.lab.bench.accuracy.variants import Task
from cltaa.lab.bench.environment import environment, load_average, pin_threads
from cltaa.lab.bench.quality.cases import by_name
from cltaa.lab.judge.comparison import check_yardsticks, open_yardsticks, stamps, truth_of
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.process import CORES
from cltaa.progress import track

TIMES = "times"  # folder of what is finished of each sequence
ERRORS_SHARE = 0.6  # of a limit of time, after which no error is begun and what is complete is timed


def tasks_of(
    folders: Sequence[Path],
    variants: Sequence[Variant],
    device: str | None,
    metrics: tuple[str, ...],
    rounding: int,
    reading: Reading = DEFAULT_READING,
) -> list[Task]:
    """Every variant over every sequence, in a fixed order: what ``--list`` prints and ``--task`` counts.

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
    time_limit: float,
) -> Accuracy:
    """Build what ``tasks`` need in ``jobs`` processes, run what is missing, time every variant here; all together.

    A sequence that is finished is kept in ``output``. No error is begun after ``ERRORS_SHARE`` of ``time_limit``
    seconds, but on Dask, where all begin at once; then those sequences are timed whose errors are complete, and none
    but the first that would end beyond the limit. The others are ``missing``; raises ResourceError where that is all.
    """
    before, begun = load_average(), time.monotonic()
    for task in {task.sequence: task for task in tasks}.values():
        sequence = task.open()  # what lacks is missed now, and not after the sequences before it
        truth_of(sequence)
        check_yardsticks(sequence, open_yardsticks(sequence))
    pin_threads()
    launcher = DeviceLauncher(tasks[0].device)
    folders = list(dict.fromkeys(task.sequence for task in tasks))
    units = launcher.device.cl_device.max_compute_units
    timing = Timing(rounds, patience, len(folders), units, CORES, pixels)
    paths = {folder: _path(output, tasks, folder, launcher, timing) for folder in folders}
    open_ones = [task for task in tasks if not paths[task.sequence].is_file()]
    until = begun + ERRORS_SHARE * time_limit
    if jobs > 1 and dask is None:
        build_programs(open_ones, launcher, pixels=pixels, jobs=jobs, until=until)
    work = run_all(tasks, output, jobs=jobs, dask=dask, until=until)
    for _ in track(work, len(tasks), "measuring errors", "tasks"):
        pass
    sequences, slowest = list[MeasuredSequence](), 0.0
    for folder in folders:
        mine, started = [task for task in tasks if task.sequence == folder], time.monotonic()
        complete = all(path_of(task, output).is_file() for task in mine)
        if not paths[folder].is_file() and started + slowest < begun + time_limit and complete:
            captured = mine[0].open()
            keep(paths[folder], measure_sequence(captured, mine, output, launcher, timing))
            slowest = max(slowest, time.monotonic() - started)
        if (measured := kept(paths[folder], MeasuredSequence)) is not None:
            sequences.append(measured)
    if not sequences:
        raise _none_finished(tasks, output, time.monotonic() - begun, time_limit)
    finished = {measured.folder for measured in sequences}
    return Accuracy(
        environment=environment(launcher.description, before, units=units),
        metrics=list(tasks[0].metrics),
        rounds=rounds,
        variants=list(dict.fromkeys(task.variant for task in tasks)),
        sequences=sequences,
        missing=[Path(folder).name for folder in folders if folder not in finished],
    )


def _none_finished(tasks: Sequence[Task], output: Path, spent: float, time_limit: float) -> ResourceError:
    """The error where ``spent`` seconds finished no sequence: for want of errors, or of time after them."""
    again = "run the same again, which goes on from here, or allow more time"
    lacking = {task.sequence for task in tasks if not path_of(task, output).is_file()}
    if lacking != {task.sequence for task in tasks}:
        what = f"the {time_limit:g} s of --time-limit were over before a sequence was timed"
        return ResourceError(what, path=output, found=f"{spent:.3g} s", cure=again)
    done = sum(path_of(task, output).is_file() for task in tasks)
    share = f"{ERRORS_SHARE * 100:g} % of --time-limit {time_limit:g}"
    return ResourceError(
        "no sequence has all of its errors",
        path=output,
        found=f"{done} of {len(tasks)} after {spent:.3g} s",
        cure=f"none is begun after {share}, which leaves the rest for times: {again}",
    )


def build_programs(
    tasks: Sequence[Task], launcher: DeviceLauncher, *, pixels: int | None, jobs: int, until: float
) -> int:
    """Build every program that errors and times of ``tasks`` need, each once; returns how many there are."""
    found = set[Program]()
    sequences = len({task.sequence for task in tasks})
    for _ in track(programs_needed(tasks, launcher, pixels, found), sequences, "planning", "sequences"):
        pass
    building = build_all(dearest_first(found), tasks[0].device, jobs=jobs, until=until) if found else ()
    for _ in track(building, len(found), "building", "programs"):
        pass
    return len(found)


def _path(output: Path, tasks: Sequence[Task], folder: str, launcher: DeviceLauncher, timing: Timing) -> Path:
    """The file of a finished sequence, named by everything that it depends on."""
    keys = [task.key() for task in tasks if task.sequence == folder]
    digest = hashlib.sha256("\0".join([*keys, launcher.description, repr(timing)]).encode())
    return output / TIMES / f"{digest.hexdigest()[:16]}.msgpack"
