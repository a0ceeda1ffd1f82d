"""The name that a CPU younger than PoCL's compiler gets, and that nothing else is touched."""

from __future__ import annotations

import ctypes
import platform
import subprocess
import sys

import pytest

from cltaa import unknown_cpu
from cltaa.unknown_cpu import LEVELS, V2, V3, V4, cpu_flags, level_of, name_unknown_cpu

FLAGS = dict(LEVELS)
ZEN_3, ZEN_4 = frozenset(V2 + V3), frozenset(V2 + V3 + V4)
needs_linux = pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"), reason="PoCL's record is only touched there"
)


@pytest.mark.parametrize("level", FLAGS)
def test_a_level_needs_all_its_flags(level: bytes) -> None:
    assert level_of(FLAGS[level]) == level
    for missing in FLAGS[level]:
        assert level_of(FLAGS[level] - {missing}) != level


@needs_linux
def test_only_the_refused_name_is_replaced() -> None:
    texts = [ctypes.create_string_buffer(text) for text in (b"generically", b"znver2", b"generic", b"pthread")]
    addresses = [0, 1, *map(ctypes.addressof, texts)]  # 0 and 1 are no addresses: they must not be followed
    record = (ctypes.c_uint64 * 512)(*addresses)
    assert name_unknown_cpu(ctypes.addressof(record))
    assert list(record[:4]) == addresses[:4]
    assert ctypes.string_at(record[4]) == level_of(cpu_flags())
    assert record[5] == addresses[5]
    assert not name_unknown_cpu(ctypes.addressof(record))


@needs_linux
@pytest.mark.parametrize(("flags", "replaced"), [(ZEN_3, False), (ZEN_4, True)])
def test_a_zen_4_is_not_taken_for_a_zen_3(
    flags: frozenset[str], replaced: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PoCL gives it sixteen lanes, for which the compiler of a CPU without AVX-512 has no instructions."""
    monkeypatch.setattr(unknown_cpu, "cpu_flags", lambda: flags)
    name = ctypes.create_string_buffer(b"znver3")
    record = (ctypes.c_uint64 * 512)(ctypes.addressof(name))
    assert name_unknown_cpu(ctypes.addressof(record)) == replaced
    assert ctypes.string_at(record[0]) == (b"x86-64-v4" if replaced else b"znver3")


# A thread that maps and unmaps the page at which every word of the record points, as threads that free memory do.
UNMAPPED_MEANWHILE = """
import ctypes, mmap, threading
from cltaa.unknown_cpu import name_unknown_cpu
libc = ctypes.CDLL(None)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t] + [ctypes.c_int] * 3 + [ctypes.c_long]
libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
FLAGS = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
page = libc.mmap(None, 4096, mmap.PROT_READ | mmap.PROT_WRITE, FLAGS, -1, 0)
record = (ctypes.c_uint64 * 512)(*[page] * 512)
done = False
def change():
    while not done:
        libc.munmap(page, 4096)
        assert libc.mmap(page, 4096, mmap.PROT_READ | mmap.PROT_WRITE, FLAGS, -1, 0) == page
thread = threading.Thread(target=change)
thread.start()
for _ in range(200):
    assert not name_unknown_cpu(ctypes.addressof(record))
done = True
thread.join()
"""


@needs_linux
def test_memory_that_is_unmapped_meanwhile_is_not_followed() -> None:
    done = subprocess.run([sys.executable, "-c", UNMAPPED_MEANWHILE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
