"""Commands of cltaa in a process of their own: what draws and what resolves share files and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys

from cltaa.errors import InternalError


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
