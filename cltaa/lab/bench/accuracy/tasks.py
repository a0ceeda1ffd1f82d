"""Tasks of an accuracy measurement: the error of a variant over a sequence, wherever it is worked out, and kept.

Two axes are kept apart. *Model*: against the truth that was captured. *Rounding*: against the same algorithm in float64
throughout, arithmetic, history and counts, by the NumPy twin.

A finished task is a file under ``tasks/``, named by what it depends on, so that this process, spawned ones and a Dask
cluster, mixed or cut short, add to the same result and nothing is done twice. Errors may be spread over machines;
timings never are.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from cltaa.core.backend import DEVICE_VARIABLE, Buffer, Launcher, launcher_for
from cltaa.core.build import Build, Real, Storage
from cltaa.core.kernel_source import code_sha256
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError
from cltaa.frame import Frame, Image
from cltaa.inputs.open import DEFAULT_READING, Reading
from cltaa.io.atomic import keep, kept
from cltaa.io.display import Picture, heat, to_picture
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.judge.comparison import open_yardsticks, truth_of
from cltaa.lab.judge.metrics import METRICS, finite, flip_map, measure
from cltaa.pipeline.cluster import connected
from cltaa.process import CORES, configure
from cltaa.reference.launcher import NumpyLauncher

KEY_DIGITS = 16  # hexadecimal
COUNT_WHITE = 32  # samples in the history that the picture of them shows white


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """One variant over one sequence, on one device."""

    sequence: str  # folder
    variant: Variant
    device: str | None
    metrics: tuple[str, ...]
    rounding_frames: int  # of the first frames; 0 leaves that axis out
    reading: Reading = DEFAULT_READING
    files: str = ""  # what vouches for the files of another tool, which record nothing, and for how they are read

    def open(self) -> FrameSequence:
        """The sequence."""
        return self.reading.open(Path(self.sequence))

    def key(self) -> str:
        """What the result depends on, as a name for its file: another sequence or other code has another key."""
        digest = hashlib.sha256(msgspec.json.encode(self) + code_sha256().encode())
        if self.device is None:  # whatever is chosen where nothing is named
            digest.update(os.environ.get(DEVICE_VARIABLE, "").encode())
        for name in ("sequence.json", "resolve.json"):
            path = Path(self.sequence) / name
            digest.update(path.read_bytes() if path.is_file() else b"")
        return digest.hexdigest()[:KEY_DIGITS]


class Rounding(msgspec.Struct, frozen=True, kw_only=True):
    """Distance from the float64 twin over the frames: root mean square and largest, relative to the image's own."""

    rms: float
    largest: float
    frames: list[float]  # rms of each

    @property
    def bits(self) -> float:
        """Bits that are right: -log2 of the relative rms error; infinite where there is none, as in a first frame."""
        return float(-np.log2(self.rms)) if self.rms > 0 else float("inf")


class Errors(msgspec.Struct, frozen=True, kw_only=True):
    """What a task found; ``frames`` is {metric: [a value a frame]}, ``pictures`` {name: PNG}."""

    frames: dict[str, list[float]]
    rounding: Rounding | None
    pictures: dict[str, bytes]


class DoubleTwin(NumpyLauncher):
    """The NumPy twin with float64 everywhere: inputs as they are, arithmetic, history and counts in double."""

    description = "NumPy (float64)"

    def build(self, plan_build: Build) -> Build:
        """The same algorithm in double."""
        return msgspec.structs.replace(plan_build, real=Real.DOUBLE, storage=Storage.FLOAT)

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Zeros; numbers with a fraction are float64, whatever is asked for."""
        return super().allocate(shape, np.float64 if np.dtype(dtype).kind == "f" else dtype)


@cache
def opened(device: str | None) -> Launcher:
    """A launcher of a device for all tasks of this process: to open one anew takes a GPU as long as many frames."""
    return launcher_for(device)


def run_task(task: Task) -> Errors:
    """Resolve the whole sequence and measure; raises InputMissing where the sequence has no truth."""
    sequence = task.open()
    truth = truth_of(sequence)
    resolver = task.variant.resolver(opened(task.device or os.environ.get(DEVICE_VARIABLE)))
    twin = Resolver(task.variant.preset, DoubleTwin()) if task.rounding_frames else None
    frames: dict[str, list[float]] = {name: [] for name in task.metrics}
    apart: list[tuple[float, float]] = []
    image: Image = np.empty(0, np.float32)
    for place, frame in enumerate(sequence):
        image = resolver.resolve(frame)[..., :3]
        found = measure(image, truth.image(frame.index), [METRICS[name] for name in task.metrics], frame=frame.index)
        for name, value in found.items():
            frames[name].append(value)
        if twin is not None and place < task.rounding_frames:
            twin.resolve(frame)
            apart.append(_apart(_kept(resolver, frame), _kept(twin, frame)))
    pictures = {"picture": png(to_picture(image)), "count": png(heat(_count(resolver, sequence), COUNT_WHITE))}
    if "flip" in task.metrics:
        pictures["flip"] = png(heat(flip_map(image, truth.image(sequence.last))))
    return Errors(frames=frames, rounding=_rounding(apart), pictures=pictures)


def yardstick_errors(sequence: FrameSequence, metrics: tuple[str, ...]) -> dict[int, dict[str, list[float]]]:
    """Errors a frame of each supersampled sequence there is, by samples a pixel; one sample is the capture itself.

    What is not finite in the capture is black, as in the table of ``cltaa bench quality``. Raises DataError for NaN or
    infinity in a supersampled image or the truth.
    """
    truth, chosen, yardsticks = truth_of(sequence), [METRICS[name] for name in metrics], open_yardsticks(sequence)
    found: dict[int, dict[str, list[float]]] = {n: {name: [] for name in metrics} for n in (1, *yardsticks)}
    for number in sequence.numbers:
        reference, truth_path = truth.image(number), truth.path(number)
        for samples, frames in found.items():
            if samples in yardsticks:
                image, path = yardsticks[samples].image(number), yardsticks[samples].path(number)
            else:
                image, path = finite(sequence.frame(number).colour), sequence.path(number)
            values = measure(image, reference, chosen, path=path, truth_path=truth_path, frame=number)
            for name, value in values.items():
                frames[name].append(value)
    return found


def png(picture: Picture) -> bytes:
    """An 8-bit picture as the bytes of a PNG."""
    stream = BytesIO()
    Pillow.fromarray(np.ascontiguousarray(picture)).save(stream, format="PNG")
    return stream.getvalue()


def _count(resolver: Resolver, sequence: FrameSequence) -> Image:
    """Samples that the history of each pixel stands for, [H, W]."""
    with _written(resolver, "output_count").mapped(write=False) as planes:
        count: Image = Layout(sequence.width, sequence.height).inside(planes)[0].astype(np.float32)
    return count


def _kept(resolver: Resolver, frame: Frame) -> NDArray[np.float64]:
    """The image that was made of ``frame`` in the numbers that the history is kept in, [H, W, 3]."""
    with _written(resolver, "output").mapped(write=False) as planes:
        return np.moveaxis(Layout(frame.width, frame.height).inside(planes)[:3].astype(np.float64), 0, -1)


def _written(resolver: Resolver, name: str) -> Buffer:
    """The memory that the last frame's result lies in; beside a ring it is not what recurs."""
    assert resolver.last is not None
    written: Buffer = resolver.last.arguments[name]
    return written


def _apart(image: NDArray[np.float64], exact: NDArray[np.float64]) -> tuple[float, float]:
    """Relative root mean square and largest distance."""
    difference = image - exact
    size = float(np.sqrt(np.mean(np.square(exact)))) or 1.0
    return float(np.sqrt(np.mean(np.square(difference)))) / size, float(np.abs(difference).max()) / size


def _rounding(apart: list[tuple[float, float]]) -> Rounding | None:
    if not apart:
        return None
    rms = [value for value, _ in apart]
    return Rounding(rms=float(np.sqrt(np.mean(np.square(rms)))), largest=max(value for _, value in apart), frames=rms)


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
