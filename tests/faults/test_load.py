"""Long runs and many processes: nothing grows with the number of frames, and processes do not hinder each other."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from tests.faults.resolving_process import Resolving, Turn, resolving
from tests.sequence_factory import write_sequence

pytestmark = pytest.mark.optimised  # of hundreds of frames: kernels take longer than their builds

SETTLED = 100  # frames after which everything that is made once is there
FRESH, ROUNDS, TURN = 5, 400, 4  # processes to compare with, how often each has its turn, and frames of a turn
# Processor time over that of processes that have just begun. Of those over each other 0.98 to 1.02 was seen, 12 times
# (2026-11-23, two cores at load 10), 1.01 of the old one at load 16; 60 turns of 16 frames give 0.88 to 1.17.
ALIKE = 1.05
PATIENCE = 120.0  # seconds that three small frames may take, which no machine takes for them


def check_held(settled: Turn, ended: Turn) -> None:
    """Files and threads stay, and memory hardly grows: by a page here and there."""
    grown = ended.memory - settled.memory
    print(f"{grown} bytes more, {100 * grown / settled.memory:.2f} %; {ended.files} files, {ended.threads} threads")
    assert (ended.files, ended.threads) == (settled.files, settled.threads)
    assert grown <= 0.01 * settled.memory


def test_memory_descriptors_and_threads_stay() -> None:
    with resolving(256) as process:
        check_held(process.resolve(SETTLED), process.resolve(200))


@pytest.mark.big
def test_ten_thousand_frames_take_what_the_first_took() -> None:
    """Beside processes that have just begun, turn about: what else the machine does hits all of them."""
    with ExitStack() as stack:
        old = stack.enter_context(resolving(256))
        settled, early, _, late = (old.resolve(frames) for frames in (SETTLED, 1000, 7900, 1000))
        check_held(settled, late)
        for name, turn in (("first", early), ("last", late)):
            median, slow = 1e3 * turn.median, 1e3 * turn.slow
            print(f"{name} 1000: {median:.2f} ms a frame, p99 {slow:.2f}, {turn.processor:.2f} ms of the processor")
        fresh = [stack.enter_context(resolving(256)) for _ in range(FRESH)]
        for process in fresh:
            process.resolve(SETTLED)
        ratio = paired(old, fresh)
    print(f"processor time over that of {FRESH} others that have just begun: {ratio:.3f}")
    assert ratio <= ALIKE


def paired(one: Resolving, others: list[Resolving]) -> float:
    """Processor time of one process over the middle one of the others, the middle of ``ROUNDS`` in shuffled order."""
    shuffled, ratios = np.random.default_rng(0), list[float]()
    for _ in range(ROUNDS):
        turn = {place: [one, *others][place].resolve(TURN).processor for place in shuffled.permutation(1 + len(others))}
        ratios.append(turn.pop(0) / statistics.median(turn.values()))
    return statistics.median(ratios)


COUNTING = """
import resource, sys
from pathlib import Path
from cltaa.pipeline.run import resolve_sequence
from cltaa.core.resolver import Resolver
from cltaa.io.sequence import open_sequence

faults = []


class Counting(Resolver):
    def resolve(self, frame, **options):
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
        return super().resolve(frame, **options)


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


def timed(workers: list[Resolving], frames: int) -> float:
    """Seconds until each of the workers has resolved ``frames`` frames."""
    begin = time.perf_counter()
    for worker in workers:
        worker.ask(frames)
    for worker in workers:
        worker.answer()
    return time.perf_counter() - begin


@pytest.mark.big
def test_eight_processes_have_the_throughput_of_one() -> None:
    """Paired rounds: 8 processes with 20 frames each against one with 160, ratio of the times.

    One process does not fill the cores, so that eight are faster (1.3 to 1.8 times, docs/reliability.md): less than 0.9
    is for threads that spin where they should wait, or memory that runs out. Processes that wait for one another would
    still have the throughput of one; that is for the test below.
    """
    with ExitStack() as stack:
        workers = [stack.enter_context(resolving(512)) for _ in range(8)]
        timed(workers, 3)  # builds
        ratios = [timed(workers[:1], 160) / timed(workers, 20) for _ in range(7)]
    print(f"throughput of 8 over that of 1: {statistics.median(ratios):.3f}, {[f'{ratio:.2f}' for ratio in ratios]}")
    assert statistics.median(ratios) >= 0.9


def test_a_stopped_process_blocks_no_other() -> None:
    """Stopped at moments of its frames, where it would hold whatever two processes could wait for each other by."""
    with resolving(64) as other, resolving(64, ends=-signal.SIGKILL) as stopped:
        stopped.resolve(3)
        stopped.ask(1_000_000)
        try:
            for pause in np.random.default_rng(0).uniform(0.0, 0.02, 8):
                time.sleep(pause)
                stopped.process.send_signal(signal.SIGSTOP)
                other.ask(3)
                assert other.has_answered(within=PATIENCE)
                other.answer()
                stopped.process.send_signal(signal.SIGCONT)
            assert not stopped.has_answered(within=0.0)  # it was at work all the time
        finally:
            stopped.process.kill()
