"""The process that cltaa runs in: its cores, what the command line changes of it, and commands in other processes.

A program that imports cltaa keeps its environment, signal handlers, standard streams, and settings of other libraries:
all changes hang on ``configure``.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, SupportsIndex

from cltaa.errors import InternalError, UsageError

# Where nothing else is asked for: pyopencl's cache would only repeat the drivers', and its lock outlives a killed
# process. NumPy's linear algebra starts a thread a core, which then waits busily, and our matrices are 4x4. FLIP's
# module brings an OpenMP of its own, whose threads spin while they wait: nine times as long on a busy machine.
ENVIRONMENT = {"PYOPENCL_NO_CACHE": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}

# glibc's malloc.h: which parameter of mallopt, and its value.
M_TRIM_THRESHOLD, NEVER = -1, 2**31 - 1  # bytes of free memory at the end of the heap that go back to the system
M_MMAP_THRESHOLD, LARGEST = -3, 32 * 2**20  # bytes from which on a block is mapped on its own; glibc takes no more

_own = False
_waiting: list[Callable[[], None]] = []


def configure() -> None:
    """Take this process for cltaa's own, and set it up: before NumPy, pyopencl and flip_evaluator are imported.

    For the command line and processes that it starts; another call changes nothing.
    """
    global _own
    _own = True
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with suppress(RuntimeError):  # a folder of our own keeps other programs out of PoCL's cache
        os.environ.setdefault("POCL_CACHE_DIR", str(user_cache() / "cltaa" / "pocl"))
    _keep_heap()
    while _waiting:
        _waiting.pop()()


def _keep_heap() -> None:
    """Let glibc keep what is freed: OpenEXR's module allocates the channels of each frame anew, and pages that were
    given back fault again, which takes a third of the time of reading."""
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):  # other C libraries have none
        library.mallopt(M_TRIM_THRESHOLD, NEVER)
        library.mallopt(M_MMAP_THRESHOLD, LARGEST)


def is_own() -> bool:
    """Whether the process is cltaa's own; else it is that of a program that uses the library."""
    return _own


def once_own(change: Callable[[], None]) -> None:
    """Change the process now, or when it is configured, or never."""
    if _own:
        change()
    else:
        _waiting.append(change)


def user_cache() -> Path:
    """The user's folder for what can be made again; raises RuntimeError where the user has no home."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


CORES, MANY_CORES = len(os.sched_getaffinity(0)), 8


class OneProcess:
    """Neither copied nor pickled, which is one line: UsageError."""

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """Refuse what ``copy`` and ``pickle`` ask for."""
        raise no_copy(self)


def no_copy(held: object) -> UsageError:
    """The error for something that cannot be copied, since it holds a device."""
    what = f"a {type(held).__name__} holds a device of this process and cannot be copied or pickled"
    return UsageError(what, cure="make one in each process")


def call_cltaa(arguments: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, whatever its exit code; what it prints is kept, its standard error goes to ours."""
    command = [sys.executable, "-m", "cltaa.cli", *arguments]
    # What a shell asks of us to complete is not asked of the child.
    environment = {name: value for name, value in os.environ.items() if name != "_CLTAA_COMPLETE"}
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=environment)


def run_cltaa(arguments: list[str]) -> str:
    """What a command prints; raises InternalError where it fails, with its own words above."""
    done = call_cltaa(arguments)
    if done.returncode:
        raise InternalError(f"cltaa {' '.join(arguments)} failed", found=f"exit code {done.returncode}")
    return done.stdout
