"""Judge presets and variants of them against the truth in one pass over a sequence; keep finished cells on disk.

Two kinds of error are separate. *Model*: against the captured truth. *Rounding*: against the same algorithm entirely in
float64 (arithmetic, history and counts) by the NumPy twin.

A cell holds the scores of one variant on one sequence: a file under ``cells/``, named by a hash of everything it
depends on, so that this process, spawned ones and a Dask cluster, even after interruptions, add to the same result and
repeat nothing.
"""

from __future__ import annotations

import hashlib
import math
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from cltaa.core.backend import DEVICE_VARIABLE, Buffer, Launcher, launcher_for
from cltaa.core.build import Build, Real, Storage, code_sha256
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, DataError, ResourceError
from cltaa.frame import Frame, Image
from cltaa.inputs.open import DEFAULT_READING, Reading
from cltaa.io.atomic import keep, kept
from cltaa.io.display import Picture, heat, shown_light, to_picture
from cltaa.io.sequence import FrameSequence, ImageSequence
from cltaa.io.streams import read_ahead
from cltaa.lab.bench.cases import redrawn_of
from cltaa.lab.bench.variants import Variant
from cltaa.lab.judge.comparison import content_sha256, truth_of, truth_samples
from cltaa.lab.judge.correspondence import Mask
from cltaa.lab.judge.metrics import (
    ALPHA,
    METRICS,
    Measure,
    check_finite,
    equal_quality_samples,
    finite,
    flip_map,
    mean_of,
    measure,
    mse,
    named_metrics,
    versions_of,
)
from cltaa.lab.judge.video_scores import SCORES, Sums, VideoScores, import_ndimage
from cltaa.pipeline.cluster import connected
from cltaa.process import CORES, configure
from cltaa.progress import track
from cltaa.reference.launcher import NumpyLauncher

Item = TypeVar("Item")

ONE_SAMPLE = "one sample"  # the captured frames, judged beside their resolves
LEAST_FRESH = 100  # least disoccluded pixels for a score: with fewer, single samples of another jitter score 0.3 to 7
COUNT_WHITE = 32  # sample count that its picture shows as white

COLUMNS = (
    *(METRICS[name] for name in ("psnr", "ssim", "flip")),
    Measure("samples", "equal-quality samples a pixel, mean of the judged frames", ".1f", True),
    Measure("last", "the same in the last frame", ".1f", True),
    Measure("disoccluded", "the same over pixels in the frame in which they appear", ".2f", True),
    *SCORES,
)


class Judging(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of the judgement."""

    metrics: tuple[str, ...]
    settled: int = 0  # index of the first judged frame
    flip_every: int = 1  # interval of frames for FLIP, which is slowest, counted back from the last frame
    in_time: bool = False  # also scores over time, equal-quality samples and alpha, beside the single samples
    rounding_frames: int = 0  # number of first frames also resolved in float64; 0: no rounding errors
    pictures: bool = False  # whether to keep pictures of the last frame


QUALITY = Judging(metrics=("mse", "psnr", "ssim", "flip"), settled=8, flip_every=4, in_time=True)


class Rounding(msgspec.Struct, frozen=True, kw_only=True):
    """Distance from the float64 twin over the frames: root mean square and largest, relative to the image's rms."""

    rms: float
    largest: float
    frames: list[float]  # rms of each

    @property
    def bits(self) -> float:
        """Number of right bits: -log2 of the relative rms error; infinite without error, as in a first frame."""
        return float(-np.log2(self.rms)) if self.rms > 0 else math.inf


class Judged(msgspec.Struct, kw_only=True):
    """Scores of a variant on a sequence; None for undefined ones."""

    scores: dict[str, float | None]
    frames: int
    not_finite: int  # number of NaN or infinite values in the output, judged as 0
    device: str


class Cell(msgspec.Struct, kw_only=True):
    """All results of a variant on a sequence."""

    judged: Judged
    errors: dict[str, list[float]]  # by metric, for each judged frame
    rounding: Rounding | None = None
    pictures: dict[str, bytes] = {}  # WebP


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """Some variants over one sequence, on one device, in one pass."""

    sequence: str  # folder
    content: str  # SHA-256 of the frames, the truth and how they are read
    variants: tuple[Variant, ...]
    device: str | None
    judging: Judging
    reading: Reading = DEFAULT_READING

    def open(self) -> FrameSequence:
        """Open the sequence."""
        return _open(self.sequence, self.reading, self.content)

    def path(self, output: Path, variant: Variant | None) -> Path:
        """Return the file of a variant's cell (None: the single samples'), independent of the variant's name."""
        ways = None if variant is None else msgspec.structs.replace(variant, name="", group="")
        device = self.device or os.environ.get(DEVICE_VARIABLE)
        code = code_sha256(), _versions(self.judging.metrics)
        whole = self.content, self.reading.step, self.judging, device, ways, *code
        return output / "cells" / f"{hashlib.sha256(msgspec.json.encode(whole)).hexdigest()[:24]}.msgpack"

    def finished(self, output: Path) -> dict[str, Cell]:
        """Return the finished cells; raises DataError for a damaged one."""
        found = {name: kept(self.path(output, variant), Cell) for name, variant in self._wanted.items()}
        return {name: cell for name, cell in found.items() if cell is not None}

    def left(self, output: Path) -> Task | None:
        """Return the task without its finished cells; None if all are finished."""
        there = self.finished(output)
        if there.keys() == self._wanted.keys():
            return None
        missing = tuple(variant for variant in self.variants if variant.name not in there)
        return msgspec.structs.replace(self, variants=missing)

    def keep(self, output: Path, cells: dict[str, Cell]) -> None:
        """Store cells; raises StorageError."""
        for name, cell in cells.items():
            keep(self.path(output, self._wanted[name]), cell)

    @property
    def _wanted(self) -> dict[str, Variant | None]:
        single = {ONE_SAMPLE: None} if self.judging.in_time else {}
        return single | {variant.name: variant for variant in self.variants}


@cache
def _versions(metrics: tuple[str, ...]) -> dict[str, str]:
    """Return the versions of the packages that judge, which decide a score as the kernels do."""
    return versions_of(named_metrics(metrics))


def task_of(
    sequence: FrameSequence,
    variants: Iterable[Variant],
    device: str | None,
    judging: Judging,
    reading: Reading = DEFAULT_READING,
) -> Task:
    """Return the task of a sequence that was opened by ``reading``; raises what ``check_judged`` raises."""
    check_judged(sequence, judging.settled)
    redrawn = redrawn_of(sequence) if judging.in_time else None
    content = content_sha256(sequence, [] if redrawn is None else [redrawn])
    folder, chosen = str(sequence.folder), tuple(variants)
    return Task(sequence=folder, content=content, variants=chosen, device=device, judging=judging, reading=reading)


@lru_cache(maxsize=1)
def _open(folder: str, reading: Reading, _content: str) -> FrameSequence:
    """Open a sequence, cached for consecutive tasks, because finding its effects takes as long as many frames."""
    return reading.open(Path(folder))


def import_judges() -> None:
    """Import the libraries that judging needs; raises UsageError for a missing one."""
    named_metrics(QUALITY.metrics)
    import_ndimage()


def check_judged(sequence: FrameSequence, settled: int) -> ImageSequence:
    """Return the truth of a sequence; raises InputMissing without one, DataError for too few frames."""
    reference = truth_of(sequence)
    if len(sequence) <= settled:
        what, cure = "the sequence is over before it is judged", "capture more, or judge sooner: --settled 0"
        expected = f"more than {settled} frames"
        raise DataError(what, path=sequence.folder, expected=expected, found=len(sequence), cure=cure)
    return reference


class DoubleTwin(NumpyLauncher):
    """The NumPy twin with float64 arithmetic, history and counts; inputs stay as they are."""

    description = "NumPy (float64)"

    def build(self, plan_build: Build) -> Build:
        """Return the build with the same algorithm in double."""
        return msgspec.structs.replace(plan_build, real=Real.DOUBLE, storage=Storage.FLOAT)

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Allocate zeros; floats are always float64."""
        return super().allocate(shape, np.float64 if np.dtype(dtype).kind == "f" else dtype)


@dataclass(slots=True)
class _Tally:
    """Sums of one contender."""

    video: Sums  # scores over time
    errors: dict[str, list[float]] = field(default_factory=dict)
    fresh_square: float = 0.0
    fresh_count: int = 0
    not_finite: int = 0
    alpha: list[float] = field(default_factory=list)  # mean squared errors, if both images have alpha
    apart: list[tuple[float, float]] = field(default_factory=list)  # distances from the twin
    pictures: dict[str, bytes] = field(default_factory=dict)

    def repaired(self, image: Image) -> Image:
        """Return the image with non-finite values set to 0, and count them."""
        bad = image.size - int(np.isfinite(image).sum())
        self.not_finite += bad
        return finite(image) if bad else image

    def scores(self, one: _Tally, redrawn_square: float, truth_samples: int | None) -> dict[str, float | None]:
        """Return all scores; three of them are in units of the single samples' error.

        At disoccluded pixels the unit is the error ``redrawn_square`` of ``redrawn_of``. The captured samples
        themselves selected these pixels by showing the new surface, so they are nearer to the truth than average.
        """
        single = mean_of("mse", one.errors["mse"])

        def samples(error: float, of_one: float) -> float:
            return equal_quality_samples(error, of_one, truth_samples=truth_samples) if of_one > 0 else math.nan

        enough = one.fresh_count >= 3 * LEAST_FRESH
        fresh = redrawn_square / one.fresh_count if enough else 0.0
        values = {
            **{name: mean_of(name, self.errors[name]) for name in ("psnr", "ssim", "flip")},
            "samples": samples(mean_of("mse", self.errors["mse"]), single),
            "last": samples(self.errors["mse"][-1], single),
            "disoccluded": samples(self.fresh_square / self.fresh_count, fresh) if enough else math.nan,
            **self.video.scores(),
            ALPHA.name: math.sqrt(math.fsum(self.alpha) / len(self.alpha)) if self.alpha else math.nan,
        }
        # Only an infinite PSNR is meaningful: the image equals the truth.
        return {name: value if math.isfinite(value) or name == "psnr" else None for name, value in values.items()}

    def rounding(self) -> Rounding | None:
        """Return the distance from the twin over all frames that it resolved."""
        rms = [value for value, _ in self.apart]
        whole = math.sqrt(math.fsum(value**2 for value in rms) / max(len(rms), 1))
        return Rounding(rms=whole, largest=max(value for _, value in self.apart), frames=rms) if rms else None


def judge_sequence(
    sequence: FrameSequence,
    variants: Sequence[Variant],
    launcher: Launcher,
    judging: Judging = QUALITY,
    *,
    progress: bool = False,
) -> dict[str, Cell]:
    """Resolve ``sequence`` with every variant and judge each, and with ``in_time`` also the single samples.

    Disoccluded pixels get equal-quality samples if the sequence's folder has ``again`` and enough of them. Holds the
    history of every variant in memory. Raises InputMissing for a sequence without truth, DataError for one that ends
    before it settles, and for a truth with NaN or infinity.
    """
    judges = _Pass(sequence, variants, launcher, judging)
    given = ((at, frame, judges.reference.image(frame.index, alpha=True)) for at, frame in enumerate(sequence))
    with read_ahead(given) as read:
        frames = track(read, len(sequence), f"judging {sequence.folder.name}", shown=True) if progress else read
        for frame, images in in_step(judges.resolvers.values(), frames, lambda given: given[1]):
            judges.look(*frame, images)
    return judges.cells()


class _Pass:
    """Resolvers of one sequence in step, and their sums."""

    def __init__(
        self, sequence: FrameSequence, variants: Sequence[Variant], launcher: Launcher, judging: Judging
    ) -> None:
        self.reference = check_judged(sequence, judging.settled)
        self.resolvers = {variant.name: variant.resolver(launcher) for variant in variants}
        self._twins = {each.name: Resolver(each.preset, DoubleTwin()) for each in variants if judging.rounding_frames}
        self._metrics, self._judging, self._count = named_metrics(judging.metrics), judging, len(sequence)
        names = [ONE_SAMPLE] * judging.in_time + [*self.resolvers]
        self._video = VideoScores(len(names)) if judging.in_time else None
        totals = [Sums() for _ in names] if self._video is None else self._video.totals
        self._tallies = {name: _Tally(total) for name, total in zip(names, totals, strict=True)}
        self._redrawn, self._redrawn_square = redrawn_of(sequence) if judging.in_time else None, 0.0
        self._device = launcher.description

    def look(self, place: int, frame: Frame, truth: Image, resolved: Sequence[Image]) -> None:
        """Judge the frame at index ``place`` of the sequence."""
        judged, light = place >= self._judging.settled, truth[..., :3]
        if judged or self._video is not None:  # scores over time also use frames before the first judged one
            check_finite("reference", truth, self.reference.path(frame.index), frame.index)
        single = [frame.colour] if self._judging.in_time else []
        outputs = [*single, *(image[..., :3] for image in resolved)]
        images = _shared(tally.repaired(image) for tally, image in zip(self._tallies.values(), outputs, strict=True))
        for name, twin in self._twins.items() if place < self._judging.rounding_frames else ():
            twin.resolve(frame)
            self._tallies[name].apart.append(_apart(_history(self.resolvers[name], frame), _history(twin, frame)))
        if self._video is not None:
            self._video.add(frame, light, images, judged=judged)
        if not judged:
            return
        self._measure(place, frame, light, images)
        if self._video is not None:
            self._measure_in_time(frame, truth, images, resolved, self._video.fresh)
        for (name, resolver), image in zip(self.resolvers.items(), images[len(single) :], strict=True):
            if self._judging.pictures and place == self._count - 1:
                self._tallies[name].pictures = _pictures(resolver, image, light, self._judging)

    def _measure(self, place: int, frame: Frame, light: Image, images: list[Image]) -> None:
        flip = (self._count - 1 - place) % self._judging.flip_every == 0
        metrics = [metric for metric in self._metrics if flip or metric.name != "flip"]
        path, found = self.reference.path(frame.index), dict[int, dict[str, float]]()
        for tally, image in zip(self._tallies.values(), images, strict=True):
            if id(image) not in found:
                found[id(image)] = measure(image, light, metrics, truth_path=path, frame=frame.index)
            for name, value in found[id(image)].items():
                tally.errors.setdefault(name, []).append(value)

    def _measure_in_time(
        self, frame: Frame, truth: Image, images: list[Image], resolved: Sequence[Image], fresh: Mask
    ) -> None:
        light = truth[..., :3]
        for tally, image in zip(self._tallies.values(), images, strict=True):
            tally.fresh_square += _square(image, light, fresh)
            tally.fresh_count += 3 * int(fresh.sum())
        if self._redrawn is not None and fresh.any():
            self._redrawn_square += _square(self._redrawn.image(frame.index), light, fresh)
        if frame.alpha is not None and truth.shape[2] == 4:
            alphas = [finite(frame.alpha), *(image[..., 3] for image in resolved)]
            for tally, alpha in zip(self._tallies.values(), alphas, strict=True):
                tally.alpha.append(mse(alpha, truth[..., 3]))

    def cells(self) -> dict[str, Cell]:
        """Return the cells after all frames."""
        one, samples = self._tallies.get(ONE_SAMPLE), truth_samples(self.reference) if self._judging.in_time else None
        cells = {}
        for name, tally in self._tallies.items():
            scores = {} if one is None else tally.scores(one, self._redrawn_square, samples)
            judged = Judged(scores=scores, frames=self._count, not_finite=tally.not_finite, device=self._device)
            rounding = tally.rounding()
            cells[name] = Cell(judged=judged, errors=tally.errors, rounding=rounding, pictures=tally.pictures)
        return cells


def _shared(images: Iterable[Image]) -> list[Image]:
    """Return the images, with one object for equal bits, so that it is judged once."""
    different: dict[bytes, Image] = {}
    return [different.setdefault(image.tobytes(), image) for image in images]


def _square(image: Image, truth: Image, where: Mask) -> float:
    """Return the squared differences of light clamped to the display's range, summed over pixels and channels."""
    light = shown_light(image[where]).astype(np.float64)
    return float(((light - shown_light(truth[where])) ** 2).sum())


def in_step(
    resolvers: Collection[Resolver], items: Iterable[Item], frame_of: Callable[[Item], Frame]
) -> Iterator[tuple[Item, list[Image]]]:
    """Yield each of ``items``, whose ``frame_of`` is resolved, with the images of all resolvers, once the one that
    looks ahead farthest has its image."""
    waiting, ready = deque[Item](), [deque[Image]() for _ in resolvers]

    def done() -> Iterator[tuple[Item, list[Image]]]:
        while waiting and all(ready):
            yield waiting.popleft(), [images.popleft() for images in ready]

    for item in items:
        waiting.append(item)
        for images, resolver in zip(ready, resolvers, strict=True):
            images.extend(resolver.feed(frame_of(item)))
        yield from done()
    for images, resolver in zip(ready, resolvers, strict=True):
        images.extend(resolver.flush())
    yield from done()


def packed(picture: Picture) -> bytes:
    """Encode an 8-bit picture as lossless WebP, which is about a third smaller than a PNG."""
    stream = BytesIO()
    Pillow.fromarray(np.ascontiguousarray(picture)).save(stream, format="WEBP", lossless=True, method=4)
    return stream.getvalue()


def _pictures(resolver: Resolver, image: Image, truth: Image, judging: Judging) -> dict[str, bytes]:
    """Return pictures of the last image, of its sample count, and of its FLIP error if asked for."""
    layout = Layout(image.shape[1], image.shape[0])
    with _written(resolver, "output_count").mapped(write=False) as planes:
        count: Image = layout.inside(planes)[0].astype(np.float32)
    pictures = {"picture": to_picture(image), "count": heat(count, COUNT_WHITE)}
    if "flip" in judging.metrics:
        pictures["flip"] = heat(flip_map(image, truth))
    return {name: packed(picture) for name, picture in pictures.items()}


def _history(resolver: Resolver, frame: Frame) -> NDArray[np.float64]:
    """Return the resolved image of ``frame`` [3, H, W] in the number format of the history."""
    with _written(resolver, "output").mapped(write=False) as planes:
        return Layout(frame.width, frame.height).inside(planes)[:3].astype(np.float64)


def _written(resolver: Resolver, name: str) -> Buffer:
    """Return the buffer ``name`` of the last frame's result; with a frame ring it is not the recursive history."""
    assert resolver.last is not None
    written: Buffer = resolver.last.arguments[name]
    return written


def _apart(image: NDArray[np.float64], exact: NDArray[np.float64]) -> tuple[float, float]:
    """Return the relative root mean square and largest distance."""
    difference = image - exact
    size = float(np.sqrt(np.mean(np.square(exact)))) or 1.0
    return float(np.sqrt(np.mean(np.square(difference)))) / size, float(np.abs(difference).max()) / size


RETRIES = 3  # of a task after the loss of its worker


def run_all(tasks: Iterable[Task], output: Path, *, jobs: int = 1, dask: str | None = None) -> Iterator[Task]:
    """Run the unfinished parts of the tasks, and yield each task when its cells are stored.

    Spawns ``jobs`` processes and never forks, because a forked child hangs once PoCL was used. ``dask`` is the address
    of a scheduler whose workers see the sequences under the same paths. Raises ResourceError for a killed worker.
    """
    waiting = []
    for task in tasks:
        left = task.left(output)
        if left is None:
            yield task
        else:
            waiting.append(left)
    if dask is not None:
        done = _on_dask(waiting, dask)
    else:
        done = _in_processes(waiting, jobs) if jobs > 1 else ((task, run(task)) for task in waiting)
    for task, cells in done:
        task.keep(output, cells)
        yield task


@cache
def launcher_of(device: str | None) -> Launcher:
    """Return one launcher per device for all tasks of this process; opening a GPU takes as long as many frames."""
    return launcher_for(device)


def run(task: Task) -> dict[str, Cell]:
    """Judge a task; raises what ``judge_sequence`` raises.

    Shows progress by frames if it judges all variants in one pass; else the task is one of many.
    """
    launcher, whole = launcher_of(task.device), task.judging.in_time
    return judge_sequence(task.open(), task.variants, launcher, task.judging, progress=whole)


def _in_processes(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, dict[str, Cell]]]:
    """Yield each finished task with its cells; after a failure, still waits for and yields the running tasks.

    An interrupt, or an error of whoever stores the cells, ends the processes: nobody would take what they return.
    """
    failed: list[CltaaError] = []
    strangers = multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")
    threads = max(CORES // jobs, 1)
    with ProcessPoolExecutor(jobs, context, initializer=share_processors, initargs=(threads,)) as pool:
        tasks_of = {pool.submit(run, task): task for task in tasks}
        try:
            for future in as_completed(tasks_of):
                if future.cancelled():
                    continue
                try:
                    cells = future.result()
                except CltaaError as error:
                    failed.append(error)
                    for other in tasks_of:
                        other.cancel()
                else:
                    yield tasks_of[future], cells
        except BrokenProcessPool as error:
            cure = "run the same again, with fewer --jobs; what is finished is kept"
            raise ResourceError("a worker process was killed", cure=cure) from error
        except BaseException:
            for process in multiprocessing.active_children():
                if process not in strangers:
                    process.terminate()  # else the pool waits for them, and for as many tasks again
            raise
    if failed:
        raise failed[0]


def share_processors(threads: int) -> None:
    """Limit PoCL and OpenMP, if not loaded yet, to ``threads`` threads; sibling processes use the others.

    Only for a process that was started for this work.
    """
    configure()
    os.environ |= {"POCL_MAX_PTHREAD_COUNT": str(threads), "POCL_AFFINITY": "0", "OMP_NUM_THREADS": str(threads)}


def _on_dask(tasks: Sequence[Task], address: str) -> Iterator[tuple[Task, dict[str, Cell]]]:
    distributed: Any = import_module("distributed")
    with connected(address) as client:
        futures = client.map(run, tasks, retries=RETRIES)
        tasks_of = dict(zip(futures, tasks, strict=True))
        for future in distributed.as_completed(futures, loop=client.loop):
            yield tasks_of[future], future.result()
