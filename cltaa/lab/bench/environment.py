"""What a measurement depends on beside the code: kept beside the numbers, so that nobody compares apples and pears."""

from __future__ import annotations

import hashlib
import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

import msgspec

from cltaa import __version__
from cltaa.core.build import Build
from cltaa.core.kernel_source import kernel_folder
from cltaa.opencl.pocl_cpu_name import cpu_flags, cpu_name
from cltaa.printable import counted
from cltaa.process import CORES, is_own

# What of the CPU decides the speed of vector code, among its hundred flags.
TELLING_FLAGS = ("sse4_2", "avx", "avx2", "fma", "f16c", "avx512f", "avx512bw", "avx512_fp16", "asimd", "sve")
LIBRARIES = ("numpy", "pyopencl")


class Environment(msgspec.Struct, frozen=True, kw_only=True):
    """Where and when something was measured."""

    date: str  # UTC
    system: str
    cpu: str
    cores: int
    cpu_flags: list[str]
    load_before: float  # runnable processes, mean of a minute
    load_after: float
    device: str
    libraries: dict[str, str]
    kernels_sha256: str
    options: list[str]  # of the OpenCL compiler
    units: int = 0  # compute units of the device, of PoCL threads; 0 where they were not asked for

    @property
    def hardware(self) -> str:
        """The device, and how many units of it worked, where that is known."""
        return f"{self.device}, {counted(self.units, 'compute unit')}" if self.units else self.device

    @property
    def line(self) -> str:
        """All that decides how far the numbers may be compared, in a line."""
        return (
            f"{self.hardware}; {self.cpu}, {counted(self.cores, 'core')}, {' '.join(self.cpu_flags)}; "
            f"load {self.load_before} to {self.load_after}; {self.date} UTC; kernels {self.kernels_sha256[:12]}"
        )


def load_average() -> float:
    """Runnable processes, mean of the last minute."""
    return os.getloadavg()[0]


def pin_threads() -> None:
    """Let PoCL, if this process is our own and has not loaded it yet, keep each thread on a processor, of them all.

    Two threads that share a core while another idles take half as long again, in one run and not in the next.
    """
    if is_own() and os.cpu_count() == CORES:
        os.environ.setdefault("POCL_AFFINITY", "1")


def kernels_sha256(folder: Path) -> str:
    """One SHA-256 over every kernel file and its name."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.[ch]*")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def environment(device: str, load_before: float, *, units: int = 0) -> Environment:
    """The environment of a measurement that has just ended and began at ``load_before``."""
    flags = cpu_flags()
    return Environment(
        date=time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
        system=platform.platform(terse=True),
        cpu=cpu_name(),
        cores=CORES,
        cpu_flags=[flag for flag in TELLING_FLAGS if flag in flags],
        load_before=round(load_before, 2),
        load_after=round(load_average(), 2),
        device=device,
        libraries={"cltaa": __version__} | {name: version(name) for name in LIBRARIES},
        kernels_sha256=kernels_sha256(kernel_folder()),
        options=list(Build().flags()),
        units=units,
    )
