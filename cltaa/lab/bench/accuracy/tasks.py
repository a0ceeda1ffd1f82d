"""Tasks of an accuracy measurement, in this process, in spawned ones or on a Dask cluster, and their results on disk.

A compiler takes a second for a program, and processes that want the same one at once would each build it. Which
programs a frame calls for is decided by its header and channels, so that one pixel of each frame tells them all.

A finished task is a file under ``tasks/``, named by what it depends on, so that any of these ways, mixed or cut short,
adds to the same result and nothing is done twice. Errors may be spread over machines; timings never are.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from cltaa.core.backend import DEVICE_VARIABLE
from cltaa.core.build import Build
from cltaa.core.planes import Layout
from cltaa.errors import DataError, ResourceError
from cltaa.frame import Frame
from cltaa.io.atomic import atomic_path, make_folder
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.accuracy.variants import Errors, Task, enlargement, opened, run_task
from cltaa.lab.timing import resolve_job, timed_numbers
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.program import source
from cltaa.pipeline.cluster import connected
from cltaa.process import CORES, configure
from cltaa.reference.launcher import NumpyLauncher

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


class Program(msgspec.Struct, frozen=True, kw_only=True):
    """A kernel and all that it is built from."""

    kernel: str
    build: Build


class Rehearsal(NumpyLauncher):
    """Notes which programs another launcher would need for planes of a layout, and runs none."""

    def __init__(self, launcher: DeviceLauncher, layout: Layout) -> None:
        self._launcher, self._layout = launcher, layout
        self.programs: set[Program] = set()

    def build(self, plan_build: Build) -> Build:
        """The build as the other launcher shapes it."""
        return self._launcher.build(plan_build)

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        """Only note the program."""
        self.programs.add(Program(kernel=kernel, build=self._launcher.fitted(kernel, build, self._layout, arguments)))


def programs_of(tasks: Sequence[Task], launcher: DeviceLauncher, pixels: int | None = None) -> set[Program]:
    """What errors and times of ``tasks``, all over one sequence, need.

    ``pixels`` are those of a frame that is timed, at least; None: what fills the device.
    """
    captured = tasks[0].open()
    frames = {number: _pixel_of(captured, number) for number in captured.numbers}
    pair = [frames[number] for number in timed_numbers(captured)]
    factor = enlargement(captured, launcher, pixels)
    found: set[Program] = set()
    for task in tasks:
        whole = Rehearsal(launcher, Layout(captured.width, captured.height))
        resolver = task.variant.resolver(whole)
        for frame in frames.values():
            resolver.resolve(frame)
        timed = Rehearsal(launcher, Layout(captured.width * factor, captured.height * factor))
        resolve_job(task.variant.name, task.variant.resolver(timed), pair)
        found |= whole.programs | timed.programs
    return found


def programs_needed(
    tasks: Sequence[Task], launcher: DeviceLauncher, pixels: int | None, found: set[Program]
) -> Iterator[str]:
    """Add to ``found`` what the tasks need, and yield each sequence when that is done."""
    for folder in dict.fromkeys(task.sequence for task in tasks):
        found |= programs_of([task for task in tasks if task.sequence == folder], launcher, pixels)
        yield folder


def dearest_first(programs: Iterable[Program]) -> list[Program]:
    """In an order in which many processes end together: a compiler's time follows the length of the text."""
    return sorted(programs, key=lambda program: (-len(source(program.kernel, program.build)), repr(program)))


def _pixel_of(captured: FrameSequence, number: int) -> Frame:
    """A frame of one pixel with the header and the channels of a captured one."""
    outline = captured.outline(number)
    plane, pair = np.zeros((1, 1), np.float32), np.zeros((1, 1, 2), np.float32)
    return replace(
        outline,
        colour=np.zeros((1, 1, 3), np.float32),
        depth=plane + 1,
        motion=None if outline.motion is None else pair,
        alpha=None if outline.alpha is None else plane,
        reactive=None if outline.reactive is None else plane,
    )


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
    with connected(address) as client:
        futures = {
            client.submit(run_encoded, msgspec.msgpack.encode(task), key=task.key(), pure=True, retries=RETRIES): task
            for task in tasks
        }
        as_completed: Any = import_module("distributed").as_completed
        for future in as_completed(futures, loop=client.loop):
            keep(path_of(futures[future], output), msgspec.msgpack.decode(future.result(), type=Errors))
            yield futures[future]


def run_encoded(task: bytes) -> bytes:
    """``run_task`` between processes and machines: bytes in, bytes out."""
    return msgspec.msgpack.encode(run_task(msgspec.msgpack.decode(task, type=Task)))


def build_encoded(device: str | None, program: bytes) -> bytes:
    """Build a program of ``build_all`` on a device of this process; answers nothing."""
    asked = msgspec.msgpack.decode(program, type=Program)
    opened(device or os.environ.get(DEVICE_VARIABLE)).prepare(asked.kernel, asked.build)
    return b""
