"""Long runs and many processes: nothing grows with the number of frames, and processes do not hinder each other."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from cltaa.allocator import return_freed_frames
from cltaa.resolve import Resolver
from tests.sequence_factory import make_camera, make_frame

SIZE = 256
SETTLED = 100  # frames after which everything that is made once is there
PATIENCE = 600.0


def held() -> tuple[int, int, int]:
    """Bytes of memory, open files and threads of this process now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE"), len(list(Path("/proc/self/fd").iterdir())), threading.active_count()


@pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.big)])
def test_memory_descriptors_and_threads_stay(count: int) -> None:
    return_freed_frames()
    resolver = Resolver()
    frames = [make_frame(index, width=SIZE, height=SIZE, motion=True, effects=None) for index in range(8)]
    before = (0, 0, 0)
    for number in range(count):
        camera = make_camera((0.01 * (number % 50), 0.0, 5.0), 1.0)
        resolver.resolve(replace(frames[number % 8], index=number, camera=camera))
        if number == SETTLED:
            before = held()
    after = held()
    growth = (after[0] - before[0]) / (count - SETTLED)
    print(f"{count} frames: {growth:.0f} bytes a frame, {100 * (after[0] / before[0] - 1):.2f} % in all")
    assert after[1:] == before[1:]
    assert after[0] <= 1.02 * before[0]
    # A page here and there weighs more in a short run.
    assert growth <= 1024 or count < 10_000


WORKER = """
import sys
from dataclasses import replace
from cltaa.resolve import Resolver
from tests.sequence_factory import make_frame
resolver, frames = Resolver(), [make_frame(index, width=512, height=512, effects=None) for index in range(4)]
number = 0
for line in sys.stdin:
    for _ in range(int(line)):
        resolver.resolve(replace(frames[number % 4], index=number))
        number += 1
    print("done", flush=True)
"""


def timed(workers: list[subprocess.Popen[str]], frames: int) -> float:
    """Seconds until each of the workers has resolved ``frames`` frames."""
    begin = time.perf_counter()
    for worker in workers:
        assert worker.stdin is not None
        worker.stdin.write(f"{frames}\n")
        worker.stdin.flush()
    for worker in workers:
        assert worker.stdout is not None
        assert worker.stdout.readline() == "done\n"
    return time.perf_counter() - begin


@pytest.mark.big
def test_eight_processes_have_the_throughput_of_one() -> None:
    """Paired rounds: 8 processes with 20 frames each against one with 160, ratio of the times."""
    root = Path(__file__).parents[2]
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER], cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(8)
    ]  # fmt: skip
    try:
        timed(workers, 3)  # builds
        ratios = [timed(workers[:1], 160) / timed(workers, 20) for _ in range(7)]
    finally:
        for worker in workers:
            assert worker.stdin is not None
            worker.stdin.close()
            worker.wait(PATIENCE)
            assert worker.stdout is not None
            worker.stdout.close()
    print(f"throughput of 8 over that of 1: {statistics.median(ratios):.3f}, {[f'{ratio:.2f}' for ratio in ratios]}")
    assert statistics.median(ratios) >= 0.9
