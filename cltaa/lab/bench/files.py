"""``cltaa bench files``: how well reading, resolving and writing overlap in ``cltaa resolve``."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from cltaa.core.planes import BLOCK_POOL
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


class FilesBench(msgspec.Struct, frozen=True, kw_only=True):
    """Seconds per frame of each stage by itself, and of the command in which they overlap.

    ``processor`` is the command's time of all cores together. ``at_best`` is ``over_slowest`` if no core were ever
    idle, at least 1.
    """

    width: int
    height: int
    frames: int
    rounds: int
    environment: Environment
    compression: str
    half: bool
    read: Interval
    resolve: Interval
    write: Interval
    whole: Interval
    processor: Interval
    over_slowest: Interval  # whole over the slowest stage, round by round
    at_best: Interval


def bench_files(
    sequence: FrameSequence, preset: Preset, device: str | None, *, compression: str, half: bool, rounds: int
) -> FilesBench:
    """Time the command on ``sequence``, and its stages."""
    before, resolver = load_average(), Resolver(preset, device)
    count = len(sequence)
    # Each stage runs as in the command, with the same threads and checks.
    steps: dict[str, Callable[[Path], object]] = {
        "read": lambda _: _read_all(sequence),
        "resolve": lambda _: [
            resolver.resolve(replace(held[place % len(held)], index=place * sequence.step, cut=place == 0), half=half)
            for place in range(count)
        ],
        "write": lambda folder: _write(folder, resolved, compression, count),
        "whole": lambda folder: resolve_sequence(
            sequence, folder, resolver, half=half, compression=compression, progress=False
        ),
    }
    times: dict[str, list[float]] = {name: [] for name in steps}
    processor: dict[str, list[float]] = {name: [] for name in steps}
    with BLOCK_POOL:
        held = [sequence.frame(index) for index in sequence.numbers[:HELD]]
        resolved = image_channels(resolver.resolve(held[0], half=half))
        # The first round builds kernels and fills caches.
        for number in track(range(rounds + 1), rounds + 1, "timing", unit="rounds"):
            for name, step in steps.items():
                resolver.reset()
                # A new folder each time, outside of the timing, because a run would otherwise find finished frames.
                with TemporaryDirectory() as folder:
                    started, busy = time.perf_counter(), time.process_time()
                    step(Path(folder) / "out")
                    took, worked = time.perf_counter() - started, time.process_time() - busy
                if number:
                    times[name].append(took / count)
                    processor[name].append(worked / count)
    slowest = [max(times[name][number] for name in ("read", "resolve", "write")) for number in range(rounds)]
    ratios = [whole / alone for whole, alone in zip(times["whole"], slowest, strict=True)]
    best = [max(1.0, busy / CORES / alone) for busy, alone in zip(processor["whole"], slowest, strict=True)]
    return FilesBench(
        width=sequence.width,
        height=sequence.height,
        frames=len(sequence),
        rounds=rounds,
        environment=environment(resolver.launcher.description, before),
        compression=compression,
        half=half,
        processor=interval(processor["whole"]),
        over_slowest=interval(ratios),
        at_best=interval(best),
        **{name: interval(seconds) for name, seconds in times.items()},
    )


def _read_all(sequence: FrameSequence) -> None:
    with ReadAhead(reads(sequence, None, ())) as frames:
        for _ in frames:
            pass


def _write(folder: Path, channels: dict[str, Pixels], compression: str, count: int) -> None:
    output = OutputFolder(make_folder(folder), {}, restart=False)
    with Writer(compression=compression) as writer:
        for index in range(count):
            path = output.folder / f"alone.{index:04d}.exr"
            writer.write(path, channels, then=partial(_finish, output, path, index))


def _finish(output: OutputFolder, path: Path, number: int) -> None:
    output.finish(Written.now(path, number, Source(NO_HASH, None)))
