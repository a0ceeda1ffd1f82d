"""Tasks in this process, in spawned ones, on a Dask cluster, or one by one on a render farm.

A finished task is a file under ``tasks/``, named by what it depends on, so that any of these ways, mixed or cut short,
adds to the same result and nothing is done twice. Errors may be spread over machines; timings never are.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from cltaa.bench.accuracy.kept import keep, kept
from cltaa.bench.accuracy.programs import Program
from cltaa.bench.accuracy.variant_errors import Errors, Task, opened, run_task
from cltaa.cores import CORES
from cltaa.devices.launch import WISH
from cltaa.errors import ResourceError, UsageError
from cltaa.extras import import_extra
from cltaa.process import configure

FOLDER = "tasks"
RETRIES = 3  # of a task whose worker was lost

Item = TypeVar("Item", Task, Program)


def path_of(task: Task, output: Path) -> Path:
    """The file of a task's result."""
    return output / FOLDER / f"{task.key()}.msgpack"


def load(task: Task, output: Path) -> Errors | None:
    """What a task found, or None where it has not been done; raises DataError for a damaged file."""
    return kept(path_of(task, output), Errors)


def run_all(
    tasks: Iterable[Task], output: Path, *, jobs: int = 1, dask: str | None = None, until: float = math.inf
) -> Iterator[Task]:
    """Run the tasks whose files are missing, and yield each task when its file is there, once.

    ``jobs`` processes are spawned, never forked: a forked child hangs once PoCL was used. ``dask`` is the address of a
    scheduler whose workers see the sequences under the same paths. When the monotonic clock shows ``until``, what has
    not begun is left. Raises ResourceError where a worker dies for good.
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
        for task, errors in _in_processes(run_encoded, waiting, jobs, until):
            keep(path_of(task, output), msgspec.msgpack.decode(errors, type=Errors))
            yield task
    else:
        for task in waiting:
            if time.monotonic() > until:
                return
            keep(path_of(task, output), run_task(task))
            yield task


def build_all(
    programs: Iterable[Program], device: str | None, *, jobs: int, until: float = math.inf
) -> Iterator[Program]:
    """Have the driver build, and keep, each of ``programs`` in one of ``jobs`` processes, in their order; yield each.

    A driver that keeps nothing builds them for nothing. ``until`` and errors as for ``run_all``.
    """
    for program, _ in _in_processes(partial(build_encoded, device), programs, jobs, until):
        yield program


def _in_processes(
    function: Callable[[bytes], bytes], items: Iterable[Item], jobs: int, until: float
) -> Iterator[tuple[Item, bytes]]:
    """Each of ``items`` with what ``function`` makes of it, as they end."""
    context = multiprocessing.get_context("spawn")
    threads = max(CORES // jobs, 1)
    with ProcessPoolExecutor(jobs, context, initializer=share_processors, initargs=(threads,)) as pool:
        items_of = {pool.submit(function, msgspec.msgpack.encode(item)): item for item in items}
        pending = set(items_of)
        try:
            while pending:
                left = None if until == math.inf else max(until - time.monotonic(), 0.0)
                done, pending = wait(pending, left, FIRST_COMPLETED)
                if not done:  # the time is up: what has begun ends, the rest is left
                    pool.shutdown(cancel_futures=True)
                    done, pending = {future for future in pending if not future.cancelled()}, set()
                for future in done:
                    yield items_of[future], future.result()
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
    distributed: Any = import_extra("distributed", package="distributed", extra="dask", purpose="--dask")
    try:
        client = distributed.Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(f"no Dask scheduler answers at {address}: {error}", cure="start one: dask scheduler") from None
    with client:
        futures = {
            client.submit(run_encoded, msgspec.msgpack.encode(task), key=task.key(), pure=True, retries=RETRIES): task
            for task in tasks
        }
        for future in distributed.as_completed(futures):
            keep(path_of(futures[future], output), msgspec.msgpack.decode(future.result(), type=Errors))
            yield futures[future]


def run_encoded(task: bytes) -> bytes:
    """``run_task`` between processes and machines: bytes in, bytes out."""
    return msgspec.msgpack.encode(run_task(msgspec.msgpack.decode(task, type=Task)))


def build_encoded(device: str | None, program: bytes) -> bytes:
    """Build a program of ``build_all`` on a device of this process; answers nothing."""
    asked = msgspec.msgpack.decode(program, type=Program)
    opened(device or os.environ.get(WISH)).prepare(asked.kernel, asked.build)
    return b""
