"""``python -m tests.faults.cold_cache TOP ROUNDS``: processes that all find an empty kernel cache, at once.

As in ``forked.py`` they are forks of this process, which has used no driver yet. Each round has a cache of its own.
Prints one line of JSON for each round.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from functools import partial
from pathlib import Path

import OpenEXR

from cltaa import cli
from cltaa.process import configure
from tests.faults.forked import Forks
from tests.faults.runs import check_finished
from tests.sequence_factory import digests, write_sequence

PROCESSES = 8
FRAMES = 3


def resolve(top: Path, output: Path, cache: Path) -> int:
    """One run with a cheap kernel: what is tried is who builds it, and when."""
    os.environ["POCL_CACHE_DIR"] = str(cache)
    return cli.main(["resolve", str(top / "in"), "-o", str(output), "--preset", "accumulate"])


def check(output: Path, whole: dict[str, str]) -> int:
    check_finished(output, whole)
    return 0


def try_rounds(top: Path, rounds: int) -> None:
    """Every assertion that fails ends the process."""
    forks = Forks(top)
    forks.run(lambda: bool(write_sequence(top / "in", FRAMES, motion=True)))
    assert forks.run(partial(resolve, top, top / "whole", top / "cache")) == 0, forks.said.read_text()
    whole = digests(top / "whole")
    assert len(whole) == FRAMES
    for number in range(rounds):
        here = top / str(number)
        begun = [forks.start(partial(resolve, top, here / str(n), here / "cache")) for n in range(PROCESSES)]
        codes = [forks.end(process) for process in begun]
        assert codes == [0] * PROCESSES, forks.said.read_text()
        for n in range(PROCESSES):
            forks.run(partial(check, here / str(n), whole))
        print(json.dumps({"codes": codes}), flush=True)


if __name__ == "__main__":
    warnings.simplefilter("error")
    configure()
    OpenEXR.set_global_thread_count(0)
    try_rounds(Path(sys.argv[1]), int(sys.argv[2]))
