"""``cltaa bench files``: what packing and unpacking cost, and how far ``cltaa resolve`` hides stages behind others."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np

from cltaa.core.planes import pooled_memory
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.io.atomic import make_folder
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.io.openexr import OpenEXR
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import ReadAhead, Writer
from cltaa.lab.bench.environment import Environment, environment, load_average
from cltaa.lab.timing import Interval, Job, interval, measure
from cltaa.pipeline.output import OutputFolder, Source, Written, image_channels, reads
from cltaa.pipeline.run import resolve_sequence
from cltaa.process import CORES
from cltaa.progress import track

# Those that lose nothing and that most programs read; zstd is new.
CODECS = ("none", "rle", "zips", "zip", "piz", "zstd")
HELD = 3  # frames in memory while a stage is timed alone
NO_HASH = "0" * 64
ALONE, WHOLE = "alone", "whole"  # folders of what is written


class Packing(msgspec.Struct, frozen=True, kw_only=True):
    """One way to write a resolved image. Milliseconds."""

    codec: str
    half: bool
    threads: int
    write: Interval
    read: Interval
    megabytes: float


class Stages(msgspec.Struct, frozen=True, kw_only=True):
    """Seconds a frame: of each stage with nothing beside it, and of the command in which they overlap.

    ``processor`` is what the command takes of all cores together, ``at_best`` what ``over_slowest`` would be if none of
    them was ever idle, and 1 where the slowest stage takes longer than that.
    """

    codec: str
    half: bool
    read: Interval
    resolve: Interval
    write: Interval
    whole: Interval
    processor: Interval
    over_slowest: Interval  # whole over the slowest stage, round by round
    at_best: Interval


class FilesBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement."""

    width: int
    height: int
    frames: int
    rounds: int
    environment: Environment
    packings: list[Packing]
    stages: list[Stages]


def bench_files(
    sequence: FrameSequence,
    preset: Preset,
    device: str | None,
    *,
    codecs: Sequence[str] = CODECS,
    threads: Sequence[int] = (),
    commands: Sequence[tuple[str, bool]] = (("zip", False),),
    rounds: int = 5,
) -> FilesBench:
    """Time writing and reading a resolved frame of ``sequence`` in every codec, and the command with its stages.

    ``threads`` are OpenEXR's, none: as many as it has now. ``commands`` are codecs with whether to write halves.
    """
    before, resolver = load_average(), Resolver(preset, device)
    channels = image_channels(resolver.resolve(sequence.frame(sequence.first)))
    resolver.reset()
    counts = threads or (OpenEXR.global_thread_count(),)
    with TemporaryDirectory() as folder, pooled_memory():
        packings = [
            packing
            for half in (False, True)
            if codecs
            for packing in _packings(Path(folder), _as_half(channels, half), codecs, counts, rounds)
        ]
        stages = [_stages(Path(folder), sequence, resolver, codec, half, rounds) for codec, half in commands]
    return FilesBench(
        width=sequence.width,
        height=sequence.height,
        frames=len(sequence),
        rounds=rounds,
        environment=environment(resolver.launcher.description, before),
        packings=packings,
        stages=stages,
    )


def _as_half(channels: dict[str, Pixels], half: bool) -> dict[str, Pixels]:
    return {name: pixels.astype("float16") if half else pixels for name, pixels in channels.items()}


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """OpenEXR with ``count`` threads of its own."""
    before = OpenEXR.global_thread_count()
    OpenEXR.set_global_thread_count(count)
    try:
        yield
    finally:
        OpenEXR.set_global_thread_count(before)


def _packings(
    folder: Path, channels: dict[str, Pixels], codecs: Sequence[str], threads: Sequence[int], rounds: int
) -> Iterator[Packing]:
    half = channels["R"].dtype == "float16"
    for count in threads:
        with _threads(count):
            jobs = []
            for codec in codecs:
                path = folder / f"{codec}.exr"
                jobs.append(Job(f"write {codec}", partial(write_image, path, channels, compression=codec)))
                jobs[-1].run()
                jobs.append(Job(f"read {codec}", partial(_read, path)))
            samples = measure(jobs, rounds, warm_up=1, action="timing")
            for codec in codecs:
                yield Packing(
                    codec=codec,
                    half=half,
                    threads=count,
                    write=samples.interval(f"write {codec}").times(1e3),
                    read=samples.interval(f"read {codec}").times(1e3),
                    megabytes=(folder / f"{codec}.exr").stat().st_size * 1e-6,
                )


def _read(path: Path) -> None:
    read_image(path)


def _stages(folder: Path, sequence: FrameSequence, resolver: Resolver, codec: str, half: bool, rounds: int) -> Stages:
    times: dict[str, list[float]] = {"read": [], "resolve": [], "write": [], "whole": []}
    processor: list[float] = []
    held = [sequence.frame(index) for index in sequence.numbers[:HELD]]
    count = len(sequence)
    # The first round builds kernels and fills caches.
    for number in track(range(rounds + 1), rounds + 1, f"timing {codec}{', half' if half else ''}", unit="rounds"):
        resolver.reset()
        # Each as the command does it, in as many threads, with all that belongs to it.
        steps: dict[str, Callable[[], object]] = {
            "read": partial(_read_all, sequence),
            "resolve": lambda: [
                resolver.resolve(replace(held[index % len(held)], index=index, cut=index == 0), half=half)
                for index in range(count)
            ],
            "write": partial(_write, folder, image_channels(resolver.resolve(held[0], half=half)), codec, count),
            "whole": partial(
                resolve_sequence, sequence, folder / WHOLE, resolver, half=half, compression=codec, progress=False
            ),
        }
        for name, step in steps.items():
            resolver.reset()
            for written in (ALONE, WHOLE):  # outside of the times: with --restart alone a run deletes what was there
                shutil.rmtree(folder / written, ignore_errors=True)
            started, busy = time.perf_counter(), time.process_time()
            step()
            if number:
                times[name].append((time.perf_counter() - started) / count)
            if number and name == "whole":
                processor.append((time.process_time() - busy) / count)
    slowest = [max(times[name][number] for name in ("read", "resolve", "write")) for number in range(rounds)]
    ratios = [whole / alone for whole, alone in zip(times["whole"], slowest, strict=True)]
    best = [max(1.0, busy / CORES / alone) for busy, alone in zip(processor, slowest, strict=True)]
    return Stages(
        codec=codec,
        half=half,
        processor=_interval(processor),
        over_slowest=_interval(ratios),
        at_best=_interval(best),
        **{name: _interval(seconds) for name, seconds in times.items()},
    )


def _read_all(sequence: FrameSequence) -> None:
    with ReadAhead(reads(sequence, None, ())) as frames:
        for _ in frames:
            pass


def _write(folder: Path, channels: dict[str, Pixels], codec: str, count: int) -> None:
    output = OutputFolder(make_folder(folder / ALONE), {})
    with Writer(compression=codec) as writer:
        for index in range(count):
            path = output.folder / f"alone.{index:04d}.exr"
            writer.write(path, channels, then=partial(_finish, output, path, index))


def _finish(output: OutputFolder, path: Path, number: int) -> None:
    output.finish(Written.now(path, number, Source(NO_HASH, None)))


def _interval(values: list[float]) -> Interval:
    return interval(np.array(values))
