"""The process that cltaa runs in: its cores, its settings, and commands in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any, SupportsIndex

from cltaa.errors import InternalError, UsageError

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
