"""A name for a CPU that is newer than the compiler inside PoCL (docs/decisions/0008).

PoCL asks its LLVM for the host's name. For a CPU younger than itself LLVM answers "generic", which PoCL hands on as the
target and its compiler then refuses: "unknown target CPU 'generic'", whatever is built (PoCL's issue 1049). PoCL 3.0,
the newest that is published as a wheel, has no setting for it, so the name is put right where PoCL keeps it: in the
record of the device.
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
REFUSED = b"generic"

# The levels of the x86-64 psABI, best first, and the flags by which Linux names what each adds. Every LLVM since 12
# knows these names.
V2 = ("cx16", "lahf_lm", "popcnt", "pni", "sse4_1", "sse4_2", "ssse3")
V3 = ("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe")
V4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
LEVELS: tuple[tuple[bytes, frozenset[str]], ...] = (
    (b"x86-64-v4", frozenset(V2 + V3 + V4)),
    (b"x86-64-v3", frozenset(V2 + V3)),
    (b"x86-64-v2", frozenset(V2)),
    (b"x86-64", frozenset()),
)
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
    """Replace the refused name in PoCL's record of a device, at address ``record``; True where there was one.

    Only on Linux on x86-64. Nothing but a pointer to exactly the text ``generic`` is touched.
    """
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        return False
    text = REFUSED + b"\0"
    try:
        memory = os.open("/proc/self/mem", os.O_RDONLY)
    except OSError:
        return False
    try:
        for address in range(record, record + RECORD_BYTES, POINTER_BYTES):
            field = _read(memory, address, POINTER_BYTES)
            if len(field) < POINTER_BYTES:
                return False
            if _read(memory, int.from_bytes(field, sys.byteorder), len(text)) == text:
                ctypes.c_uint64.from_address(address).value = ctypes.addressof(_names[level_of(cpu_flags())])
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
