"""``cltaa bench accuracy``: what tells its tasks apart, what is kept of them, and other processes that run them.

On a Dask cluster of two workers one is killed midway.
"""

from __future__ import annotations

import json
import multiprocessing
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cltaa.core.build import Storage
from cltaa.errors import DataError, InputMissing
from cltaa.lab.bench.accuracy import measurement
from cltaa.lab.bench.accuracy.measurement import bench_accuracy, cells_of
from cltaa.lab.bench.cells import Cell, Judged, Rounding, Task, run_all
from cltaa.lab.timing import Environment, environment
from tests.lab.bench.accuracy_tasks import task
from tests.sequence_factory import write_sequence


def path(task: Task) -> Path:
    return task.path(Path(), task.variants[0])


def test_a_key_tells_devices_apart(sequence: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = set()
    for wish in ("one", "another"):  # by the variable, where the task names none
        monkeypatch.setenv("CLTAA_DEVICE", wish)
        keys |= {path(msgspec.structs.replace(task(sequence), device=device)) for device in (None, "0")}
    assert len(keys) == 3


def test_results_come_back_as_they_were(sequence: Path, tmp_path: Path) -> None:
    asked = task(sequence)
    name, rounding = asked.variants[0].name, Rounding(rms=1e-9, largest=1e-8, frames=[1e-9])
    judged = Judged(scores={"psnr": None}, frames=2, not_finite=0, device="none")
    cell = Cell(judged=judged, errors={"mse": [0.1, 1 / 3]}, rounding=rounding, pictures={"p": b"\0x"})
    assert asked.finished(tmp_path) == {}
    asked.keep(tmp_path, {name: cell})
    assert asked.finished(tmp_path) == {name: cell}
    assert asked.left(tmp_path) is None
    asked.path(tmp_path, asked.variants[0]).write_bytes(b"\xc1")
    with pytest.raises(DataError, match=r"no finished part of a measurement: .*; delete it and run again"):
        asked.finished(tmp_path)


def test_spawned_processes_find_the_same(sequence: Path, tmp_path: Path) -> None:
    asked = (task(sequence), task(sequence, storage=Storage.HALF))
    tasks = [msgspec.structs.replace(each, device="numpy") for each in asked]
    for folder, jobs in (("one", 1), ("two", 2)):
        assert {path(each) for each in run_all(tasks, tmp_path / folder, jobs=jobs)} == {path(each) for each in tasks}
    assert cells_of(tasks, tmp_path / "one") == cells_of(tasks, tmp_path / "two")


def test_who_stops_waits_for_no_task_that_runs(sequence: Path, tmp_path: Path) -> None:
    """As on an interrupt: the pool would run to their end as many as it has processes, twice, and drop their cells."""
    strict = (False, True)
    tasks = [
        msgspec.structs.replace(task(sequence, place, strict=each), device="numpy")
        for place in (0, 1)
        for each in strict
    ]
    running = run_all(tasks, tmp_path, jobs=2)
    finished = next(running)
    workers = multiprocessing.active_children()
    assert isinstance(running, Generator)
    running.close()
    assert [worker.exitcode for worker in workers] == [-signal.SIGTERM] * 2
    assert finished.left(tmp_path) is None


def test_what_is_finished_outlives_an_error(sequence: Path, tmp_path: Path) -> None:
    bare = write_sequence(tmp_path / "bare", 1, reference=True)
    tasks = [task(sequence), *(task(bare, strict=strict) for strict in (False, True))]
    shutil.rmtree(bare / "reference")
    with pytest.raises(InputMissing):
        list(run_all(tasks, tmp_path / "out", jobs=2))
    assert tasks[0].finished(tmp_path / "out").keys() == {tasks[0].variants[0].name}
    assert tasks[1].finished(tmp_path / "out") == {}


def test_what_is_kept_tells_when_it_was_measured(
    sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    days = count(1)

    def another_day(*given: Any, **named: Any) -> Environment:
        return msgspec.structs.replace(environment(*given, **named), date=f"2026-01-{next(days):02}")

    both = [task(sequence), task(write_sequence(tmp_path / "other", 2, reference=True, seed=1))]
    output = tmp_path / "out"

    def measured() -> Environment:
        return bench_accuracy(both, output, rounds=1, patience=0.0, pixels=1, jobs=1, dask=None).environment

    monkeypatch.setattr(measurement, "environment", another_day)
    whole = measured()
    assert measured() == whole
    next((output / "times").iterdir()).unlink()  # as if the first run had ended before it
    begun, ended = measured().date.split(" to ")
    assert begun in whole.date
    assert ended > whole.date[-len(ended) :]
    monkeypatch.setattr("cltaa.lab.timing.cpu_name", lambda: "another processor")
    assert measured().cpu == "another processor"


TASKS = 12

# A process of its own: the cluster starts others by importing this file again.
SCRIPT = """
import json, os, signal, sys
from pathlib import Path
from distributed import LocalCluster
from cltaa.lab.bench.accuracy.measurement import tasks_of
from cltaa.lab.bench.cells import Judging, run_all
from cltaa.lab.bench.variants import ladder
from cltaa.core.presets import load_preset

if __name__ == "__main__":
    sequence, output, count = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    tasks = tasks_of([sequence], ladder(load_preset())[:count], "numpy", Judging(metrics=("mse",), rounding_frames=2))
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        done, killed = [], None
        for task in run_all(tasks, output, dask=cluster.scheduler_address):
            done.append(task.variants[0].name)
            if killed is None:
                killed = next(iter(cluster.workers.values())).pid
                os.kill(killed, signal.SIGKILL)
    serial = output / "serial"
    for task in run_all(tasks[:3], serial):
        pass
    same = all(task.finished(serial) == task.finished(output) for task in tasks[:3])
    found = sum(task.left(output) is None for task in tasks)
    print(json.dumps({"done": len(set(done)), "found": found, "killed": killed, "same": same}))
"""


def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    sequence = write_sequence(tmp_path / "seq", 6, reference=True, width=97, height=61)
    script = tmp_path / "cluster.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(sequence), str(tmp_path / "out"), str(TASKS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["killed"] is not None
    assert (result["done"], result["found"], result["same"]) == (TASKS, TASKS, True)
