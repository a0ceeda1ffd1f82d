"""Presets, and variants of them, judged against the truth in one pass over a sequence; finished cells stay on disk.

Two axes of error are kept apart. *Model*: against the truth that was captured. *Rounding*: against the same algorithm
in float64 throughout, arithmetic, history and counts, by the NumPy twin.

A cell is what one variant scored on one sequence: a file under ``cells/``, named by all that it depends on, so that
this process, spawned ones and a Dask cluster, mixed or cut short, add to the same result and nothing is done twice.
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
)
from cltaa.lab.judge.video_scores import SCORES, Sums, VideoScores, import_ndimage
from cltaa.pipeline.cluster import connected
from cltaa.process import CORES, configure
from cltaa.progress import track
from cltaa.reference.launcher import NumpyLauncher

Item = TypeVar("Item")

ONE_SAMPLE = "one sample"  # what was captured, judged beside its resolves
LEAST_FRESH = 100  # disoccluded pixels for a score: with fewer, single samples at other places score 0.3 to 7
COUNT_WHITE = 32  # samples in the history that the picture of them shows white

COLUMNS = (
    *(METRICS[name] for name in ("psnr", "ssim", "flip")),
    Measure("samples", "equal-quality samples a pixel, mean of the judged frames", ".1f", True),
    Measure("last", "the same in the last frame", ".1f", True),
    Measure("disoccluded", "the same over pixels in the frame in which they appear", ".2f", True),
    *SCORES,
)
ALPHA = Measure("alpha", "root mean square error of alpha")


class Judging(msgspec.Struct, frozen=True, kw_only=True):
    """What is looked at."""

    metrics: tuple[str, ...]
    settled: int = 0  # the first frame, of those there are, that is judged
    flip_every: int = 1  # frames: FLIP, which takes longest, judges the last and those so far before it
    in_time: bool = False  # also as moving pictures and in equal-quality samples, beside the single samples; and alpha
    rounding_frames: int = 0  # of the first frames, resolved in float64 too; 0 leaves that axis out
    pictures: bool = False  # of the last frame


QUALITY = Judging(metrics=("mse", "psnr", "ssim", "flip"), settled=8, flip_every=4, in_time=True)


class Rounding(msgspec.Struct, frozen=True, kw_only=True):
    """Distance from the float64 twin over the frames: root mean square and largest, relative to the image's own."""

    rms: float
    largest: float
    frames: list[float]  # rms of each

    @property
    def bits(self) -> float:
        """Bits that are right: -log2 of the relative rms error; infinite where there is none, as in a first frame."""
        return float(-np.log2(self.rms)) if self.rms > 0 else math.inf


class Judged(msgspec.Struct, kw_only=True):
    """What a variant scored on a sequence; None where there was nothing to judge."""

    scores: dict[str, float | None]
    frames: int
    not_finite: int  # values of the output that were NaN or infinite, and judged as 0
    device: str


class Cell(msgspec.Struct, kw_only=True):
    """All that was found of a variant on a sequence."""

    judged: Judged
    errors: dict[str, list[float]]  # of each judged frame, by metric
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
        """The sequence."""
        return _open(self.sequence, self.reading, self.content)

    def path(self, output: Path, variant: Variant | None) -> Path:
        """The file of the cell of a variant (None: of the single samples), whatever the variant is called."""
        ways = None if variant is None else msgspec.structs.replace(variant, name="", group="")
        device = self.device or os.environ.get(DEVICE_VARIABLE)
        whole = self.content, self.reading.step, self.judging, device, ways, code_sha256()
        return output / "cells" / f"{hashlib.sha256(msgspec.json.encode(whole)).hexdigest()[:24]}.msgpack"

    def finished(self, output: Path) -> dict[str, Cell]:
        """The cells that there are; raises DataError for a damaged one."""
        found = {name: kept(self.path(output, variant), Cell) for name, variant in self._wanted.items()}
        return {name: cell for name, cell in found.items() if cell is not None}

    def left(self, output: Path) -> Task | None:
        """The same, less what is finished; None where all is."""
        there = self.finished(output)
        if there.keys() == self._wanted.keys():
            return None
        missing = tuple(variant for variant in self.variants if variant.name not in there)
        return msgspec.structs.replace(self, variants=missing)

    def keep(self, output: Path, cells: dict[str, Cell]) -> None:
        """Keep what was found; raises StorageError."""
        for name, cell in cells.items():
            keep(self.path(output, self._wanted[name]), cell)

    @property
    def _wanted(self) -> dict[str, Variant | None]:
        single = {ONE_SAMPLE: None} if self.judging.in_time else {}
        return single | {variant.name: variant for variant in self.variants}


def task_of(
    sequence: FrameSequence,
    variants: Iterable[Variant],
    device: str | None,
    judging: Judging,
    reading: Reading = DEFAULT_READING,
) -> Task:
    """The task of a sequence that was opened by ``reading``; raises as ``check_judged``."""
    check_judged(sequence, judging.settled)
    redrawn = redrawn_of(sequence) if judging.in_time else None
    content = content_sha256(sequence, [] if redrawn is None else [redrawn])
    folder, chosen = str(sequence.folder), tuple(variants)
    return Task(sequence=folder, content=content, variants=chosen, device=device, judging=judging, reading=reading)


@lru_cache(maxsize=1)
def _open(folder: str, reading: Reading, _content: str) -> FrameSequence:
    """The sequence of several tasks in a row: to find its effects takes as long as many frames."""
    return reading.open(Path(folder))


def import_judges() -> None:
    """Import the libraries that judge; raises UsageError where one is missing."""
    named_metrics(QUALITY.metrics)
    import_ndimage()


def check_judged(sequence: FrameSequence, settled: int) -> ImageSequence:
    """The truth of a sequence that can be judged; raises InputMissing without one, DataError for too few frames."""
    reference = truth_of(sequence)
    if len(sequence) <= settled:
        what, cure = "the sequence is over before it is judged", "capture more, or judge sooner: --settled 0"
        expected = f"more than {settled} frames"
        raise DataError(what, path=sequence.folder, expected=expected, found=len(sequence), cure=cure)
    return reference


class DoubleTwin(NumpyLauncher):
    """The NumPy twin with float64 everywhere: inputs as they are, arithmetic, history and counts in double."""

    description = "NumPy (float64)"

    def build(self, plan_build: Build) -> Build:
        """The same algorithm in double."""
        return msgspec.structs.replace(plan_build, real=Real.DOUBLE, storage=Storage.FLOAT)

    def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
        """Zeros; numbers with a fraction are float64, whatever is asked for."""
        return super().allocate(shape, np.float64 if np.dtype(dtype).kind == "f" else dtype)


@dataclass(slots=True)
class _Tally:
    """What is gathered of one contender."""

    video: Sums  # as moving pictures
    errors: dict[str, list[float]] = field(default_factory=dict)
    fresh_square: float = 0.0
    fresh_count: int = 0
    not_finite: int = 0
    alpha: list[float] = field(default_factory=list)  # mean squared errors, where both sides have it
    apart: list[tuple[float, float]] = field(default_factory=list)  # from the twin
    pictures: dict[str, bytes] = field(default_factory=dict)

    def repaired(self, image: Image) -> Image:
        """The image with 0 for what is not finite, which is counted."""
        bad = image.size - int(np.isfinite(image).sum())
        self.not_finite += bad
        return finite(image) if bad else image

    def scores(self, one: _Tally, redrawn_square: float, truth_samples: int | None) -> dict[str, float | None]:
        """All scores, with the single samples as the currency of three of them.

        Where pixels appear it is those of ``redrawn_of``, which err by ``redrawn_square`` there: that the captured
        samples show what has appeared is why these pixels are the ones, so that they are nearer to the truth than
        samples are by chance.
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
        # Of all scores only a PSNR without end says something: the image is the truth.
        return {name: value if math.isfinite(value) or name == "psnr" else None for name, value in values.items()}

    def rounding(self) -> Rounding | None:
        """What the twin says of all frames that it resolved."""
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
    """Resolve ``sequence`` with every variant and judge each, and the single samples where it is judged in time.

    Disoccluded pixels are told in equal-quality samples where the sequence's folder holds ``again`` and enough of them
    are there. The history of every variant is in memory at once. Raises InputMissing for a sequence without its truth
    and DataError for one that is over before it settles, and for a truth that is no light.
    """
    judges = _Pass(sequence, variants, launcher, judging)
    given = ((at, frame, judges.reference.image(frame.index, alpha=True)) for at, frame in enumerate(sequence))
    with read_ahead(given) as read:
        frames = track(read, len(sequence), f"judging {sequence.folder.name}", shown=True) if progress else read
        for frame, images in in_step(judges.resolvers.values(), frames, lambda given: given[1]):
            judges.look(*frame, images)
    return judges.cells()


class _Pass:
    """Resolvers of one sequence in step, and what is gathered of them."""

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
        """Judge the frame at a place of the sequence."""
        judged, light = place >= self._judging.settled, truth[..., :3]
        if judged or self._video is not None:  # which follows light from frames that are not judged
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
        """What was found, once all frames were looked at."""
        one, samples = self._tallies.get(ONE_SAMPLE), truth_samples(self.reference) if self._judging.in_time else None
        cells = {}
        for name, tally in self._tallies.items():
            scores = {} if one is None else tally.scores(one, self._redrawn_square, samples)
            judged = Judged(scores=scores, frames=self._count, not_finite=tally.not_finite, device=self._device)
            rounding = tally.rounding()
            cells[name] = Cell(judged=judged, errors=tally.errors, rounding=rounding, pictures=tally.pictures)
        return cells


def _shared(images: Iterable[Image]) -> list[Image]:
    """The images, of the same bits one, so that it is judged once."""
    different: dict[bytes, Image] = {}
    return [different.setdefault(image.tobytes(), image) for image in images]


def _square(image: Image, truth: Image, where: Mask) -> float:
    """Squared differences of the light that a screen can show, summed over some pixels and the channels."""
    light = shown_light(image[where]).astype(np.float64)
    return float(((light - shown_light(truth[where])) ** 2).sum())


def in_step(
    resolvers: Collection[Resolver], items: Iterable[Item], frame_of: Callable[[Item], Frame]
) -> Iterator[tuple[Item, list[Image]]]:
    """Each of ``items``, of which ``frame_of`` is resolved, with the images of all resolvers, once the last one that
    looks ahead has its own."""
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
    """An 8-bit picture as a lossless WebP, which is about a third smaller than a PNG."""
    stream = BytesIO()
    Pillow.fromarray(np.ascontiguousarray(picture)).save(stream, format="WEBP", lossless=True, method=4)
    return stream.getvalue()


def _pictures(resolver: Resolver, image: Image, truth: Image, judging: Judging) -> dict[str, bytes]:
    """The last image, the samples that the history of each pixel stands for, and where it errs."""
    layout = Layout(image.shape[1], image.shape[0])
    with _written(resolver, "output_count").mapped(write=False) as planes:
        count: Image = layout.inside(planes)[0].astype(np.float32)
    pictures = {"picture": to_picture(image), "count": heat(count, COUNT_WHITE)}
    if "flip" in judging.metrics:
        pictures["flip"] = heat(flip_map(image, truth))
    return {name: packed(picture) for name, picture in pictures.items()}


def _history(resolver: Resolver, frame: Frame) -> NDArray[np.float64]:
    """The image that was made of ``frame`` in the numbers that the history is kept in, [3, H, W]."""
    with _written(resolver, "output").mapped(write=False) as planes:
        return Layout(frame.width, frame.height).inside(planes)[:3].astype(np.float64)


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


RETRIES = 3  # of a task whose worker was lost


def run_all(tasks: Iterable[Task], output: Path, *, jobs: int = 1, dask: str | None = None) -> Iterator[Task]:
    """Run what is left of the tasks, and yield each when its cells are there.

    ``jobs`` processes are spawned, never forked: a forked child hangs once PoCL was used. ``dask`` is the address of a
    scheduler whose workers see the sequences under the same paths. Raises ResourceError where a worker dies for good.
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
    """A launcher of a device for all tasks of this process: to open one anew takes a GPU as long as many frames."""
    return launcher_for(device)


def run(task: Task) -> dict[str, Cell]:
    """Judge what is asked for; raises what ``judge_sequence`` does.

    Progress is shown of frames where all variants are judged in one pass; else that is one task of many.
    """
    launcher, whole = launcher_of(task.device), task.judging.in_time
    return judge_sequence(task.open(), task.variants, launcher, task.judging, progress=whole)


def _in_processes(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, dict[str, Cell]]]:
    """Each task with what it found, as they end; what has begun when one fails is waited for, and kept too."""
    failed: list[CltaaError] = []
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
        finally:
            pool.shutdown(cancel_futures=True)  # after an error, what has not begun need not begin
    if failed:
        raise failed[0]


def share_processors(threads: int) -> None:
    """Let what this process has not loaded yet, PoCL and OpenMP, use that many threads: its fellows have the others.

    For a process that was started for its work alone.
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
