"""Tasks in this process, in spawned ones, on a Dask cluster, or one by one on a render farm.

A finished task is a file under ``tasks/``, named by what it depends on, so that any of these ways, mixed or cut short,
adds to the same result and nothing is done twice. Errors may be spread over machines; timings never are.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import msgspec

from cltaa.atomic import atomic_path, make_folder
from cltaa.bench.errors_of import Errors, Task, run_task
from cltaa.errors import DataError, ResourceError, UsageError
from cltaa.extras import import_extra

FOLDER = "tasks"
RETRIES = 3  # of a task whose worker was lost


def path_of(task: Task, output: Path) -> Path:
    """The file of a task's result."""
    return output / FOLDER / f"{task.key()}.msgpack"


def load(task: Task, output: Path) -> Errors | None:
    """What a task found, or None where it has not been done; raises DataError for a damaged file."""
    path = path_of(task, output)
    if not path.is_file():
        return None
    try:
        return msgspec.msgpack.decode(path.read_bytes(), type=Errors)
    except msgspec.DecodeError as error:
        raise DataError(f"not the result of a task: {error}", path=path, cure="delete it and run again") from None


def save(task: Task, errors: Errors, output: Path) -> None:
    """Write the result of a task, atomically."""
    make_folder(output / FOLDER)
    with atomic_path(path_of(task, output)) as temporary:
        temporary.write_bytes(msgspec.msgpack.encode(errors))


def run_all(tasks: Iterable[Task], output: Path, *, jobs: int = 1, dask: str | None = None) -> Iterator[Task]:
    """Run the tasks whose files are missing, and yield each task when its file is there.

    ``jobs`` processes are spawned, never forked: a forked child hangs once PoCL was used. ``dask`` is the address of a
    scheduler whose workers see the sequences under the same paths. Raises ResourceError where a worker dies for good.
    """
    waiting = []
    for task in tasks:
        if path_of(task, output).is_file():
            yield task
        else:
            waiting.append(task)
    if dask is not None:
        yield from _on_dask(waiting, output, dask)
    elif jobs > 1:
        yield from _in_processes(waiting, output, jobs)
    else:
        for task in waiting:
            save(task, run_task(task), output)
            yield task


def _in_processes(tasks: list[Task], output: Path, jobs: int) -> Iterator[Task]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        futures = {pool.submit(run_encoded, msgspec.msgpack.encode(task)): task for task in tasks}
        try:
            for future in as_completed(futures):
                save(futures[future], msgspec.msgpack.decode(future.result(), type=Errors), output)
                yield futures[future]
        except BrokenProcessPool as error:
            cure = "run the same again, with fewer --jobs; what is finished is kept"
            raise ResourceError("a worker process was killed", cure=cure) from error
        finally:
            pool.shutdown(cancel_futures=True)  # after an error, what has not begun need not begin


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
            save(futures[future], msgspec.msgpack.decode(future.result(), type=Errors), output)
            yield futures[future]


def run_encoded(task: bytes) -> bytes:
    """``run_task`` between processes and machines: bytes in, bytes out."""
    return msgspec.msgpack.encode(run_task(msgspec.msgpack.decode(task, type=Task)))
