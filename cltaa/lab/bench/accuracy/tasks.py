"""Tasks of an accuracy measurement, in this process, in spawned ones or on a Dask cluster, and their results on disk.

A finished task is a file under ``tasks/``, named by what it depends on, so that any of these ways, mixed or cut short,
adds to the same result and nothing is done twice. Errors may be spread over machines; timings never are.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from cltaa.errors import DataError, ResourceError
from cltaa.io.atomic import atomic_path, make_folder
from cltaa.lab.bench.accuracy.variants import Errors, Task, run_task
from cltaa.pipeline.cluster import connected
from cltaa.process import CORES, configure

Kept = TypeVar("Kept")


def keep(path: Path, finished: object) -> None:
    """Write a struct into a file, atomically; raises OutputError and StorageError."""
    make_folder(path.parent)
    with atomic_path(path) as temporary:
        temporary.write_bytes(msgspec.msgpack.encode(finished))


def kept(path: Path, kind: type[Kept]) -> Kept | None:
    """The struct of a file, or None where there is none; raises DataError for a damaged one."""
    if not path.is_file():
        return None
    try:
        return msgspec.msgpack.decode(path.read_bytes(), type=kind)
    except msgspec.DecodeError as error:
        what = f"no finished part of a measurement: {error}"
        raise DataError(what, path=path, cure="delete it and run again") from None


FOLDER = "tasks"
RETRIES = 3  # of a task whose worker was lost


def path_of(task: Task, output: Path) -> Path:
    """The file of a task's result."""
    return output / FOLDER / f"{task.key()}.msgpack"


def load(task: Task, output: Path) -> Errors | None:
    """What a task found, or None where it has not been done; raises DataError for a damaged file."""
    return kept(path_of(task, output), Errors)


def run_all(tasks: Iterable[Task], output: Path, *, jobs: int = 1, dask: str | None = None) -> Iterator[Task]:
    """Run the tasks whose files are missing, and yield each task when its file is there, once.

    ``jobs`` processes are spawned, never forked: a forked child hangs once PoCL was used. ``dask`` is the address of a
    scheduler whose workers see the sequences under the same paths. Raises ResourceError where a worker dies for good.
    """
    waiting = []
    for task in {task.key(): task for task in tasks}.values():
        if path_of(task, output).is_file():
            yield task
        else:
            waiting.append(task)
    if dask is not None:
        yield from _on_dask(waiting, output, dask)
    elif jobs > 1:
        for task, errors in _in_processes(waiting, jobs):
            keep(path_of(task, output), errors)
            yield task
    else:
        for task in waiting:
            keep(path_of(task, output), run_task(task))
            yield task


def _in_processes(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Errors]]:
    """Each task with what it found, as they end."""
    context = multiprocessing.get_context("spawn")
    threads = max(CORES // jobs, 1)
    with ProcessPoolExecutor(jobs, context, initializer=share_processors, initargs=(threads,)) as pool:
        tasks_of = {pool.submit(run_encoded, msgspec.msgpack.encode(task)): task for task in tasks}
        try:
            for future in as_completed(tasks_of):
                yield tasks_of[future], msgspec.msgpack.decode(future.result(), type=Errors)
        except BrokenProcessPool as error:
            cure = "run the same again, with fewer --jobs; what is finished is kept"
            raise ResourceError("a worker process was killed", cure=cure) from error
        finally:
            pool.shutdown(cancel_futures=True)  # after an error, what has not begun need not begin


def share_processors(threads: int) -> None:
    """Let what this process has not loaded yet, PoCL and OpenMP, use that many threads: its fellows have the others.

    For a process that was started for its work alone.
    """
    configure()
    os.environ |= {"POCL_MAX_PTHREAD_COUNT": str(threads), "POCL_AFFINITY": "0", "OMP_NUM_THREADS": str(threads)}


def _on_dask(tasks: list[Task], output: Path, address: str) -> Iterator[Task]:
    with connected(address) as client:
        futures = {
            client.submit(run_encoded, msgspec.msgpack.encode(task), key=task.key(), pure=True, retries=RETRIES): task
            for task in tasks
        }
        distributed: Any = import_module("distributed")
        for future in distributed.as_completed(futures, loop=client.loop):
            keep(path_of(futures[future], output), msgspec.msgpack.decode(future.result(), type=Errors))
            yield futures[future]


def run_encoded(task: bytes) -> bytes:
    """``run_task`` between processes and machines: bytes in, bytes out."""
    return msgspec.msgpack.encode(run_task(msgspec.msgpack.decode(task, type=Task)))
