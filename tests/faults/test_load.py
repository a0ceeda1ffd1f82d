"""Long runs and many processes: nothing grows with the number of frames, and processes do not hinder each other."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.allocator import kept_memory
from cltaa.resolve import Resolver
from tests.sequence_factory import make_camera, make_frame, write_sequence

SIZE = 256
SETTLED = 100  # frames after which everything that is made once is there
PATIENCE = 600.0


class Held(NamedTuple):
    """What this process holds: bytes of memory, open files, threads (those of the driver, too)."""

    memory: int
    files: int
    threads: int


def held() -> Held:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    files, threads = (len(list(Path("/proc/self", name).iterdir())) for name in ("fd", "task"))
    return Held(pages * os.sysconf("SC_PAGE_SIZE"), files, threads)


class LongRun(NamedTuple):
    """What was held after ``SETTLED`` frames and at the end; seconds and processor seconds of each frame."""

    settled: Held
    ended: Held
    seconds: NDArray[np.float64]
    processor: NDArray[np.float64]


@kept_memory(4 * SIZE * SIZE)
def long_run(count: int) -> LongRun:
    """Resolve ``count`` frames one after another, with a camera that moves."""
    resolver = Resolver()
    frames = [make_frame(index, width=SIZE, height=SIZE, motion=True, effects=None) for index in range(8)]
    settled, clocks = held(), np.zeros((count + 1, 2))
    clocks[0] = time.perf_counter(), time.process_time()
    for number in range(count):
        camera = make_camera((0.01 * (number % 50), 0.0, 5.0), 1.0)
        resolver.resolve(replace(frames[number % 8], index=number, camera=camera))
        if number == SETTLED:
            settled = held()
        clocks[number + 1] = time.perf_counter(), time.process_time()
    return LongRun(settled, held(), *np.diff(clocks, axis=0).T)


@pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.big)])
def test_memory_descriptors_and_threads_stay(count: int) -> None:
    run = long_run(count)
    growth = (run.ended.memory - run.settled.memory) / (count - SETTLED)
    share = run.ended.memory / run.settled.memory - 1
    print(f"{count} frames: {growth:.0f} bytes a frame, {100 * share:.2f} % in all; {run.ended}")
    assert run.ended[1:] == run.settled[1:]
    assert share <= 0.02
    if count < 10_000:  # a page here and there weighs more in a short run, and a thousand frames make a percentile
        return
    assert growth <= 1024
    first, last = slice(SETTLED, SETTLED + 1000), slice(count - 1000, count)
    for name, times in (("time", run.seconds), ("processor time", run.processor)):
        (before, slow), (after, slow_after) = (np.percentile(times[part], [50, 99]) * 1e3 for part in (first, last))
        print(f"{name} of a frame, ms: median {before:.2f}, then {after:.2f}; p99 {slow:.2f}, then {slow_after:.2f}")
    # What else the machine does changes the time of a frame, and its processor time hardly.
    assert after <= 1.1 * before


COUNTING = """
import resource, sys
from pathlib import Path
from cltaa.pipeline import resolve_sequence
from cltaa.resolve import Resolver
from cltaa.sources import open_sequence

faults = []


class Counting(Resolver):
    def resolve(self, frame):
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
        return super().resolve(frame)


resolve_sequence(open_sequence(sys.argv[1]), Path(sys.argv[2]), Counting(), compression="none")
print((faults[-3] - faults[5]) / (len(faults) - 8))
"""


def test_a_frame_lies_in_the_memory_that_another_left(tmp_path: Path) -> None:
    """Page faults a frame of a run that has settled, against the pages that the arrays of a frame fill."""
    width, height, channels = 960, 540, 6
    folder = write_sequence(tmp_path / "in", 14, width=width, height=height, motion=True)
    run = [sys.executable, "-c", COUNTING, str(folder), str(tmp_path / "out")]
    root = Path(__file__).parents[2]
    found = subprocess.run(run, cwd=root, stdout=subprocess.PIPE, text=True, check=True)
    # The packed file (of random pixels: as large as they), the channels decoded, five moved into groups, the result.
    pages = (channels + channels + 5 + 3) * 4 * width * height / os.sysconf("SC_PAGE_SIZE")
    # How many depends on which frames are in memory at once, and on what the system has left of large pages. Seen: 0.11
    # to 0.24 of them in 61 runs, 0.45 to 0.62 without large pages; where a run maps each block from 256 kB on, 0.83 to
    # 1.03, and 1.29 to 1.55 without large pages.
    large_pages = Path("/sys/kernel/mm/transparent_hugepage/enabled")
    share = 0.75 if large_pages.exists() and "[never]" not in large_pages.read_text() else 0.95
    print(f"{float(found.stdout):.0f} faults a frame of {pages:.0f} pages")
    assert float(found.stdout) < share * pages


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
