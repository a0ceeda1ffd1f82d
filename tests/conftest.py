"""What every test may rely on."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from cltaa.process import configure

TOP = Path(__file__).parents[1]

# Tests call the command line in their own process; what the library leaves alone is for tests/test_host_process.py.
configure()
# Built kernels stay where they are for any command; of all else that the user keeps, as the shape of a device, no test
# knows. Other libraries keep their own there, as fonts and shaders, from run to run.
CACHE = TOP / ".pytest_cache" / "user"
CACHE.mkdir(parents=True, exist_ok=True)
os.environ["XDG_CACHE_HOME"] = str(CACHE)

import pyopencl as cl  # noqa: E402

import cltaa.opencl.device  # noqa: E402
from cltaa.opencl.device import POCL  # noqa: E402

# A busy machine is slow, and no property of ours is one of time.
# The same examples in every run; many, and new ones each time, where asked for: pytest --hypothesis-profile=big
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.register_profile("big", settings.get_profile("patient"), max_examples=500, derandomize=False)
settings.load_profile("patient")

# The tests spend most of their time on builds of kernels, and PoCL builds one in a quarter of the time without LLVM's
# optimisation and with calls in place of inlined functions. Those that are about what users have ask for both; the bits
# are the same. Other drivers build as ever.
# PoCL reads a variable of its own for this, but once in a process.
OPTIONS = "PYOPENCL_BUILD_OPTIONS"
if {platform.name for platform in cl.get_platforms()} == {POCL}:
    os.environ.setdefault(OPTIONS, "-cl-opt-disable -DSTAGE=static")


@pytest.fixture(autouse=True)
def optimised_if_marked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Build kernels as users have them, where a test says that it is about these."""
    if request.node.get_closest_marker("optimised"):
        monkeypatch.delenv(OPTIONS, raising=False)


@pytest.fixture(autouse=True, scope="session")
def programs_built_once() -> Iterator[None]:
    """Let all launchers of this process share a context, and each program that one of them has built.

    PoCL takes a tenth of a second even for a program that lies in its cache, and hundreds of tests open a launcher.
    """
    context_of, program_of = cache(cltaa.opencl.device.context_of), cltaa.opencl.device.program_of

    @cache
    def built(_: str | None, context: cl.Context, text: str, options: tuple[str, ...]) -> cl.Program:
        return program_of(context, text, options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cltaa.opencl.device.context_of", context_of)
        patch.setattr("cltaa.opencl.device.program_of", lambda *asked: built(os.environ.get(OPTIONS), *asked))
        yield


@pytest.fixture(autouse=True, scope="session")
def packages_in_child_processes() -> None:
    """Let child processes find the packages that pytest finds by its setting ``pythonpath``, installed or not."""
    folders = [str(TOP / name) for name in ("", "capture", "datasets_gen")]
    os.environ["PYTHONPATH"] = os.pathsep.join([*folders, *filter(None, [os.environ.get("PYTHONPATH")])])


@pytest.fixture(autouse=True, scope="session")
def as_wide_as_a_pipe() -> None:
    """Take away the width that xdist gives its processes: tables would be parted there as in a narrow terminal."""
    os.environ.pop("COLUMNS", None)


@pytest.fixture(autouse=True, scope="session")
def interrupts_interrupt() -> None:
    """Let SIGINT do what it does in a terminal: a shell that starts the tests in the background has them, and every
    process that they start, ignore it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
