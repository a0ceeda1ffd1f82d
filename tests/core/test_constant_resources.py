"""Many calls and many resolvers take no more memory, descriptors and threads than a few."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Frame

# Bytes by which the process may grow: 0.3 MB were seen over 9,000 calls and 1.3 over 900 resolvers (PoCL 3.0). An
# object of OpenCL left behind by each call would be 5, a plane left behind by each resolver 20.
GROWTH = 4_000_000
COLOUR = np.random.default_rng(0).random((36, 64, 3), np.float32)


def held() -> tuple[int, int, int]:
    """Resident bytes, open descriptors, threads of this process, Python's and others."""
    gc.collect()
    status = Path("/proc/self/status").read_text()
    resident, threads = (int(status.partition(f"{name}:")[2].split()[0]) for name in ("VmRSS", "Threads"))
    return 1024 * resident, len([*Path("/proc/self/fd").iterdir()]), threads


def call(shared: Resolver, number: int) -> None:
    shared.resolve(Frame(number, COLOUR))


def open_and_close(shared: Resolver, number: int) -> None:
    with Resolver(device=shared.launcher) as resolver:
        for index in (number, number + 1):
            resolver.resolve(Frame(index, COLOUR))


@pytest.mark.big
@pytest.mark.parametrize(("work", "times"), [(call, 10_000), (open_and_close, 1_000)])
def test_what_is_held_stays_constant(work: Callable[[Resolver, int], None], times: int) -> None:
    shared, python_threads = Resolver(), threading.active_count()
    for number in range(times // 10):
        work(shared, number)
    resident, descriptors, threads = held()
    for number in range(times // 10, times):
        work(shared, number)
    now = held()
    assert now[0] - resident < GROWTH
    assert now[1:] == (descriptors, threads)
    assert threading.active_count() == python_threads
