"""A target name for a CPU that PoCL's compiler does not know, or mistakes for another (docs/decisions/14).

PoCL passes the host's name from its LLVM on as the target. For a CPU younger than itself LLVM answers "generic", which
PoCL's compiler then refuses in every build: "unknown target CPU 'generic'" (PoCL's issue 1049). Or LLVM goes by the
model alone. A Zen 4, of the family of AMD's Zen 3, becomes a "znver3" though PoCL sees AVX-512 and offers sixteen
lanes: then LLVM fails during a build, "Cannot select", and ends the process. A Raptor Lake becomes a "goldmont", which
has no AVX, with the same end. A virtual machine that hides AVX-512, or a Pentium without AVX, becomes a "skylake" of
some kind, and code for that has instructions that the CPU lacks. PoCL 3.0, the newest that is published as a wheel, has
no setting for the name, so this module corrects it where PoCL keeps it: in the record of the device.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from pathlib import Path
from typing import NamedTuple

RECORD_BYTES = 4096  # more than PoCL's record of a device in any release; unmapped memory is not read
POINTER_BYTES = 8
HIGHEST_ADDRESS = 2**47 - 1  # of a process on x86-64

# Linux' flags for what each level of the x86-64 psABI adds, with Sandy Bridge between two of them.
V2 = ("cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3")
AVX = ("avx", "pclmulqdq", "xsave")
V3 = ("avx2", "bmi1", "bmi2", "f16c", "fma", "movbe")
V4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")


class Level(NamedTuple):
    """A target that every LLVM since 12 knows, the flags that it needs, and LLVM 14's names for such CPUs."""

    name: bytes
    flags: frozenset[str]
    lanes: int  # floats in a register; with more of them LLVM fails during a build
    known: tuple[bytes, ...]

    @classmethod
    def of(cls, name: str, flags: tuple[str, ...], lanes: int, known: str) -> Level:
        """Return the level with names of CPUs from a text."""
        return cls(name.encode(), frozenset(flags), lanes, tuple(known.encode().split()))


# Names from getHostCPUName in llvm/lib/Support/Host.cpp.
AVX512_CPUS = "skylake-avx512 cascadelake cooperlake cannonlake icelake-client icelake-server rocketlake tigerlake"
AVX2_CPUS = "haswell broadwell skylake alderlake bdver4 znver1 znver2 znver3"
LEVELS = (
    Level.of("x86-64-v4", V2 + AVX + V3 + V4, 16, f"{AVX512_CPUS} sapphirerapids"),
    Level.of("x86-64-v3", V2 + AVX + V3, 8, AVX2_CPUS),
    Level.of("sandybridge", V2 + AVX, 8, "ivybridge bdver1 bdver2 bdver3 btver2"),
    Level.of("x86-64-v2", V2, 4, "nehalem westmere silvermont goldmont goldmont-plus tremont"),
    Level.of("x86-64", (), 4, "core2 penryn bonnell nocona k8 k8-sse3 amdfam10 btver1"),
)
REFUSED = b"generic"
# PoCL keeps the address: never freed.
_names = {level.name: ctypes.create_string_buffer(level.name) for level in LEVELS}


def cpu_facts() -> dict[str, str]:
    """Return what Linux reports of the first processor; empty where it reports nothing."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return {}
    lines = (line.partition(":") for line in text.partition("\n\n")[0].splitlines())
    return {key.strip(): value.strip() for key, _, value in lines}


def cpu_name() -> str:
    """Return the processor's model name, or where that is unknown its type."""
    return cpu_facts().get("model name") or platform.processor() or platform.machine()


def cpu_vendor() -> str:
    """Return the processor's word for its maker, such as ``GenuineIntel``; empty where it is unknown."""
    return cpu_facts().get("vendor_id", "")


def cpu_flags() -> frozenset[str]:
    """Return the CPU's features, as Linux names them; empty where they are unknown."""
    return frozenset(cpu_facts().get("flags", "").split())


def level_of(flags: frozenset[str]) -> Level:
    """Return the highest level whose flags a CPU has."""
    return next(level for level in LEVELS if level.flags <= flags)


def known_lanes() -> int | None:
    """Return the floats in a register of this CPU's level; None where that is unknown."""
    return level_of(cpu_flags()).lanes if _applies() else None


def _applies() -> bool:
    return platform.system() == "Linux" and platform.machine() == "x86_64"


def name_unknown_cpu(record: int) -> bool:
    """Replace a wrong name in PoCL's record of a device, at address ``record``; True where there was one.

    It changes only a pointer to exactly the text ``generic``, or to one of the names of a level that is not this CPU's,
    and nothing behind one that it has changed, since the record may end there.
    """
    if not _applies():
        return False
    level = level_of(cpu_flags())
    others = (name for other in LEVELS if other != level for name in (*other.known, other.name))
    wrong = {name + b"\0" for name in (REFUSED, *others)}
    longest, right = max(map(len, wrong)), ctypes.addressof(_names[level.name])
    try:
        memory = os.open("/proc/self/mem", os.O_RDONLY)
    except OSError:
        return False
    try:
        for address in range(record, record + RECORD_BYTES, POINTER_BYTES):
            field = int.from_bytes(_read(memory, address, POINTER_BYTES), sys.byteorder)
            if field == right:
                return False
            text = _read(memory, field, longest)
            if any(text.startswith(name) for name in wrong):
                ctypes.c_uint64.from_address(address).value = right
                return True
    finally:
        os.close(memory)
    return False


def _read(memory: int, address: int, count: int) -> bytes:
    """Return the bytes at ``address`` by a system call, which fails safely where that is no pointer."""
    try:
        return os.pread(memory, count, address) if address <= HIGHEST_ADDRESS else b""
    except OSError:
        return b""
