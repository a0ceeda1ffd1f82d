"""A process that resolves as many frames of a moving camera as each line of its input says, and answers each line with
a line of JSON, a ``Turn``: ``python -m tests.faults.resolving_process SIDE``."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path

import msgspec
import numpy as np

from cltaa.core.planes import BLOCK_POOL
from cltaa.core.resolver import Resolver
from cltaa.process import configure
from tests.sequence_factory import make_camera, make_frame

TOP = Path(__file__).parents[2]
PATIENCE = 600.0  # seconds that it may take to end
FRAMES = 8  # different ones


class Turn(msgspec.Struct):
    """What the process holds after its frames, the driver's threads among them: bytes, open files, threads. Seconds of
    a frame, the median and the 99th percentile, and of the processor for all frames: waiting for one is not in it."""

    memory: int
    files: int
    threads: int
    processor: float
    median: float
    slow: float


class Resolving:
    """Such a process as its parent sees it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def ask(self, frames: int) -> None:
        """Let it resolve ``frames`` more."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{frames}\n")
        self.process.stdin.flush()

    def answer(self) -> Turn:
        """Wait until it has."""
        assert self.process.stdout is not None
        return msgspec.json.decode(self.process.stdout.readline(), type=Turn)

    def has_answered(self, within: float) -> bool:
        """Whether an answer is there, or comes within so many seconds."""
        assert self.process.stdout is not None
        return bool(select.select([self.process.stdout], [], [], within)[0])

    def resolve(self, frames: int) -> Turn:
        """Ask for them, and wait."""
        self.ask(frames)
        return self.answer()


@contextmanager
def resolving(side: int, ends: int = 0) -> Iterator[Resolving]:
    """Start one that resolves square frames; it ends with the block, with ``ends`` for its exit code."""
    command = [sys.executable, "-m", "tests.faults.resolving_process", str(side)]
    with subprocess.Popen(command, cwd=TOP, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield Resolving(process)
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(PATIENCE) == ends


def main(side: int) -> None:
    """Resolve for the parent until it closes the input."""
    resolver, numbers = Resolver(), count()
    frames = [make_frame(index, width=side, height=side, motion=True, effects=None) for index in range(FRAMES)]

    def resolve() -> float:
        number, begin = next(numbers), time.perf_counter()
        camera = make_camera((0.01 * (number % 50), 0.0, 5.0), 1.0)
        resolver.resolve(replace(frames[number % FRAMES], index=number, camera=camera))
        return time.perf_counter() - begin

    with BLOCK_POOL:
        for line in sys.stdin:
            begin = time.process_time()
            seconds = array("d", (resolve() for _ in range(int(line))))
            processor = time.process_time() - begin
            median, slow = np.percentile(seconds, [50, 99])
            files, threads = (len(list(Path("/proc/self", name).iterdir())) for name in ("fd", "task"))
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
            turn = Turn(pages * os.sysconf("SC_PAGE_SIZE"), files, threads, processor, float(median), float(slow))
            print(msgspec.json.encode(turn).decode(), flush=True)


if __name__ == "__main__":
    configure()
    main(int(sys.argv[1]))
