"""A name for a CPU that is newer than the compiler inside PoCL (docs/decisions/0008).

PoCL asks its LLVM for the host's name and hands it on as the target. For a CPU younger than itself LLVM answers
"generic", which PoCL's compiler then refuses: "unknown target CPU 'generic'", whatever is built (PoCL's issue 1049); or
"znver3", if it is of the family of AMD's Zen 3, while PoCL sees AVX-512 and offers sixteen lanes: then LLVM gives up in
the middle of a build, "Cannot select", and ends the process. PoCL 3.0, the newest that is published as a wheel, has no
setting for it, so the name is put right where PoCL keeps it: in the record of the device.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from pathlib import Path

RECORD_BYTES = 4096  # more than PoCL's record of a device in any release; what is not mapped is not read
POINTER_BYTES = 8
HIGHEST_ADDRESS = 2**47 - 1  # of a process on x86-64

# The levels of the x86-64 psABI, best first, and the flags by which Linux names what each adds. Every LLVM since 12
# knows these names.
V2 = ("cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3")
V3 = ("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe")
V4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
AVX_512 = b"x86-64-v4"
LEVELS: tuple[tuple[bytes, frozenset[str]], ...] = (
    (AVX_512, frozenset(V2 + V3 + V4)),
    (b"x86-64-v3", frozenset(V2 + V3)),
    (b"x86-64-v2", frozenset(V2)),
    (b"x86-64", frozenset()),
)
REFUSED, ZEN_3 = b"generic", b"znver3"
_names = {name: ctypes.create_string_buffer(name) for name, _ in LEVELS}  # PoCL keeps the address: never freed


def cpu_flags() -> frozenset[str]:
    """What the CPU can do, in Linux' words; empty where that is not told."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return frozenset()
    return frozenset(next((line.partition(":")[2] for line in lines if line.startswith("flags")), "").split())


def level_of(flags: frozenset[str]) -> bytes:
    """The highest level of x86-64 that a CPU with these flags has."""
    return next(name for name, needed in LEVELS if needed <= flags)


def name_unknown_cpu(record: int) -> bool:
    """Replace a name that does not fit in PoCL's record of a device, at address ``record``; True where there was one.

    Only on Linux on x86-64. Nothing but a pointer to exactly the text ``generic``, or with AVX-512 ``znver3``, is
    touched.
    """
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        return False
    level = level_of(cpu_flags())
    wrong = {name + b"\0" for name in ((REFUSED, ZEN_3) if level == AVX_512 else (REFUSED,))}
    longest = max(map(len, wrong))
    try:
        memory = os.open("/proc/self/mem", os.O_RDONLY)
    except OSError:
        return False
    try:
        for address in range(record, record + RECORD_BYTES, POINTER_BYTES):
            field = _read(memory, address, POINTER_BYTES)
            if len(field) < POINTER_BYTES:
                return False
            text = _read(memory, int.from_bytes(field, sys.byteorder), longest)
            if any(text.startswith(name) for name in wrong):
                ctypes.c_uint64.from_address(address).value = ctypes.addressof(_names[level])
                return True
    finally:
        os.close(memory)
    return False


def _read(memory: int, address: int, count: int) -> bytes:
    """What stands at ``address`` of this process, asked of the system: where nothing can be read it says so, and other
    threads may unmap memory at any time. Behind the record lies what is no pointer at all."""
    try:
        return os.pread(memory, count, address) if address <= HIGHEST_ADDRESS else b""
    except OSError:
        return b""
