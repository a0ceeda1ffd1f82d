"""``cltaa bench files``: how far ``cltaa resolve`` hides reading, resolving and writing behind each other."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
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
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import ReadAhead, Writer
from cltaa.lab.timing import Environment, Interval, environment, interval, load_average
from cltaa.pipeline.output import OutputFolder, Source, Written, image_channels, reads
from cltaa.pipeline.run import resolve_sequence
from cltaa.process import CORES
from cltaa.progress import track

HELD = 3  # frames in memory while a stage is timed alone
NO_HASH = "0" * 64
ALONE, WHOLE = "alone", "whole"  # folders of what is written


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
    stages: list[Stages]


def bench_files(
    sequence: FrameSequence,
    preset: Preset,
    device: str | None,
    *,
    commands: Sequence[tuple[str, bool]] = (("zip", False),),
    rounds: int = 5,
) -> FilesBench:
    """Time the command over ``sequence`` beside its stages; ``commands`` are codecs with whether to write halves."""
    before, resolver = load_average(), Resolver(preset, device)
    with TemporaryDirectory() as folder, pooled_memory():
        stages = [_stages(Path(folder), sequence, resolver, codec, half, rounds) for codec, half in commands]
    return FilesBench(
        width=sequence.width,
        height=sequence.height,
        frames=len(sequence),
        rounds=rounds,
        environment=environment(resolver.launcher.description, before),
        stages=stages,
    )


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
