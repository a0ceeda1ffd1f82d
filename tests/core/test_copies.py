"""A resolver is copied and sent to other processes only where that is possible, and says so where it is not."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.opencl.device import Memory
from tests.sequence_factory import bits, make_frame

COPIES: list[Callable[[Any], Any]] = [copy.copy, copy.deepcopy, pickle.dumps]
HELD = "holds a device of this process and cannot be copied or pickled; make one in each process"
SHARED = "a copy of a resolver would write to the same memory; make another one, or take copy.deepcopy on NumPy"


@pytest.mark.parametrize("copied", COPIES)
def test_what_holds_a_device_is_not_copied(copied: Callable[[Any], Any]) -> None:
    resolver = Resolver()
    resolver.resolve(make_frame(0))
    device = resolver.launcher.device  # type: ignore[attr-defined]
    memory = device.allocate((4,))
    assert isinstance(memory, Memory)
    kernel = next(iter(resolver.launcher._kernels.values()))  # type: ignore[attr-defined]
    for held in (device, memory, kernel, resolver.launcher):
        with pytest.raises(UsageError, match=rf"^a {type(held).__name__} {HELD}$"):
            copied(held)
    with pytest.raises(UsageError, match=SHARED if copied is copy.copy else f"^a Resolver {HELD}"):
        copied(resolver)


def test_a_resolver_on_numpy_is_copied_with_its_history() -> None:
    resolver = Resolver(device="numpy")
    resolver.resolve(make_frame(0))
    with pytest.raises(UsageError, match=SHARED):
        copy.copy(resolver)
    for other in (copy.deepcopy(resolver), pickle.loads(pickle.dumps(resolver))):
        assert (bits(other.resolve(make_frame(1))) == bits(copy.deepcopy(resolver).resolve(make_frame(1)))).all()


FORKS = """
import os, threading
from cltaa.core.resolver import Resolver
from tests.sequence_factory import make_frame
first = Resolver()
first.resolve(make_frame(0))
for work in (lambda: first.resolve(make_frame(1)), Resolver, first.close):
    child = os.fork()
    if not child:
        try:
            work()
        except Exception as error:
            print(error, flush=True)
        os._exit(0)
    limit = threading.Timer(20.0, os.kill, (child, 9))
    limit.start()
    assert os.waitpid(child, 0)[1] == 0
    limit.cancel()
first.resolve(make_frame(1))
"""


def test_a_fork_of_a_process_with_a_device_is_refused_one() -> None:
    """It lacks the driver's threads, for which it would wait for ever."""
    child = subprocess.run([sys.executable, "-c", FORKS], capture_output=True, text=True, check=False)
    assert (child.returncode, child.stderr) == (0, "")
    told = child.stdout.splitlines()
    assert told == [told[0]] * 2
    assert "a fork of a process that has opened a device; start it anew: multiprocessing" in told[0]
