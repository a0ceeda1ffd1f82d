"""Many resolvers take no more memory, descriptors and threads than a few."""

from __future__ import annotations

import gc
import threading
from pathlib import Path

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Frame

# Bytes by which the process may grow: 1.3 MB were seen over 900 resolvers (PoCL 3.0). A plane left behind by each would
# be 20.
GROWTH = 4_000_000
COLOUR = np.random.default_rng(0).random((36, 64, 3), np.float32)


def held() -> tuple[int, int, int]:
    """Resident bytes, open descriptors, threads of this process, Python's and others."""
    gc.collect()
    status = Path("/proc/self/status").read_text()
    resident, threads = (int(status.partition(f"{name}:")[2].split()[0]) for name in ("VmRSS", "Threads"))
    return 1024 * resident, len([*Path("/proc/self/fd").iterdir()]), threads


@pytest.mark.big
def test_a_thousand_resolvers_leave_nothing() -> None:
    """What many frames of one leave is for tests/faults/test_load.py."""
    shared, python_threads = Resolver(), threading.active_count()
    for number in range(1000):
        if number == 100:
            resident, descriptors, threads = held()
        with Resolver(device=shared.launcher) as resolver:
            for index in (number, number + 1):
                resolver.resolve(Frame(index, COLOUR))
    now = held()
    assert now[0] - resident < GROWTH
    assert now[1:] == (descriptors, threads)
    assert threading.active_count() == python_threads
