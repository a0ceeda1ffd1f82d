"""The name that a CPU younger than PoCL's compiler gets, and that nothing else is touched."""

from __future__ import annotations

import ctypes
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from cltaa.opencl import pocl_cpu_name as unknown_cpu
from cltaa.opencl.pocl_cpu_name import LEVELS, cpu_flags, known_lanes, level_of, name_unknown_cpu

FLAGS = {level.name: level.flags for level in LEVELS}
needs_linux = pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"), reason="PoCL's record is only touched there"
)


@pytest.mark.parametrize("level", FLAGS)
def test_a_level_needs_all_its_flags(level: bytes) -> None:
    assert level_of(FLAGS[level]).name == level
    for missing in FLAGS[level]:
        assert level_of(FLAGS[level] - {missing}).name != level


@needs_linux
def test_only_the_refused_name_is_replaced() -> None:
    texts = [ctypes.create_string_buffer(text) for text in (b"generically", b"cortex-a57", b"generic", b"pthread")]
    no_addresses = [0, 1, 2**47, 2**64 - 1]  # which must not be followed
    addresses = [*no_addresses, *map(ctypes.addressof, texts)]
    record = (ctypes.c_uint64 * 512)(*addresses)
    assert name_unknown_cpu(ctypes.addressof(record))
    assert list(record[:6]) == addresses[:6]
    assert ctypes.string_at(record[6]) == level_of(cpu_flags()).name
    assert record[7] == addresses[7]
    files = len(list(Path("/proc/self/fd").iterdir()))
    assert not name_unknown_cpu(ctypes.addressof(record))
    assert len(list(Path("/proc/self/fd").iterdir())) == files


@needs_linux
def test_nothing_behind_a_name_that_was_replaced_is_touched() -> None:
    # PoCL's record is shorter than what is read; behind it other memory of the program may hold such names.
    names = [ctypes.create_string_buffer(b"generic") for _ in range(2)]
    record = (ctypes.c_uint64 * 512)(*map(ctypes.addressof, names))
    assert name_unknown_cpu(ctypes.addressof(record))
    assert not name_unknown_cpu(ctypes.addressof(record))
    assert record[1] == ctypes.addressof(names[1])


@needs_linux
@pytest.mark.parametrize(
    ("level", "name", "fits"),
    [
        (b"x86-64-v4", b"znver3", False),  # a Zen 4: PoCL gives it sixteen lanes, of which a Zen 3 knows nothing
        (b"x86-64-v3", b"znver3", True),
        (b"x86-64-v4", b"sapphirerapids", True),
        (b"x86-64-v3", b"icelake-server", False),  # a virtual machine that hides AVX-512
        (b"x86-64-v3", b"goldmont", False),  # a Raptor Lake, which is younger than LLVM 14: it has clflushopt and sha
        (b"x86-64-v2", b"skylake", False),  # a Pentium, which has no AVX
        (b"sandybridge", b"ivybridge", True),
        (b"x86-64-v2", b"sandybridge", False),  # a name of LLVM's that is a level's too
        (b"x86-64-v2", b"nehalem", True),
    ],
)
def test_a_name_is_replaced_where_it_is_not_of_the_cpu_s_level(
    level: bytes, name: bytes, fits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unknown_cpu, "cpu_flags", lambda: FLAGS[level])
    given = ctypes.create_string_buffer(name)
    record = (ctypes.c_uint64 * 512)(ctypes.addressof(given))
    assert name_unknown_cpu(ctypes.addressof(record)) != fits
    assert ctypes.string_at(record[0]) == (name if fits else level)


@needs_linux
@pytest.mark.parametrize("broken", ["memory that cannot be opened", "another system"])
def test_where_nothing_can_be_done_nothing_is(broken: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given = ctypes.create_string_buffer(b"generic")
    record = (ctypes.c_uint64 * 512)(ctypes.addressof(given))
    if broken == "another system":
        monkeypatch.setattr(platform, "system", lambda: "Darwin")
        assert known_lanes() is None
    else:
        monkeypatch.setattr(os, "open", lambda *_: os.close(-1))  # EBADF
    assert not name_unknown_cpu(ctypes.addressof(record))
    assert record[0] == ctypes.addressof(given)


# Of a Zen 5 in a virtual machine: 2026-11-23, Linux 6.1.
FLAGS_OF_ZEN_5 = (
    "fpu vme de pse tsc msr pae mce cx8 apic sep mtrr pge mca cmov pat pse36 clflush mmx fxsr sse sse2 ht syscall nx "
    "mmxext fxsr_opt pdpe1gb rdtscp lm constant_tsc rep_good nopl xtopology nonstop_tsc cpuid extd_apicid "
    "tsc_known_freq pni pclmulqdq ssse3 fma cx16 pcid sse4_1 sse4_2 x2apic movbe popcnt tsc_deadline_timer aes xsave "
    "avx f16c rdrand hypervisor lahf_lm cmp_legacy cr8_legacy abm sse4a misalignsse 3dnowprefetch osvw topoext vmmcall "
    "fsgsbase tsc_adjust bmi1 avx2 smep bmi2 erms invpcid avx512f avx512dq adx smap avx512ifma clflushopt clwb "
    "avx512cd sha_ni avx512bw avx512vl xsaveopt xsavec xgetbv1 xsaves avx_vnni avx512_bf16 clzero xsaveerptr arat"
)


@pytest.mark.parametrize(
    ("without", "level"),
    [
        ((), b"x86-64-v4"),
        (("avx512f",), b"x86-64-v3"),
        (("avx512f", "avx2"), b"sandybridge"),
        (("avx512f", "avx2", "avx"), b"x86-64-v2"),
        (("avx512f", "avx2", "avx", "sse4_2"), b"x86-64"),
    ],
)
def test_the_level_follows_from_linux_s_flags(
    without: tuple[str, ...], level: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the first processor: the second is of another kind."""
    flags = " ".join(flag for flag in FLAGS_OF_ZEN_5.split() if flag not in without)
    told = tmp_path / "cpuinfo"
    told.write_text(f"processor\t: 0\nflags\t\t: {flags}\n\nprocessor\t: 1\nflags\t\t: fpu\n\n", encoding="utf-8")
    monkeypatch.setattr(unknown_cpu, "Path", lambda _: told)
    assert level_of(cpu_flags()).name == level


# The default as a CPU of a level gets it: PoCL's name for this one, whatever it is, replaced by that level's.
RESOLVED_AT = """
import sys, ctypes
import numpy as np
from cltaa.opencl import device, pocl_cpu_name as unknown_cpu
from cltaa.lab.timing import Motion, make_frames
from cltaa.core.resolver import Resolver
level = next(level for level in unknown_cpu.LEVELS if level.name == sys.argv[1].encode())
unknown_cpu.level_of = lambda flags: level
resolver = Resolver()
assert resolver.launcher.device.shape.lanes == level.lanes
image = [resolver.resolve(frame) for frame in make_frames(70, 41, Motion.TURN)][-1]
assert np.isfinite(image).all()
"""


# Of the levels with as many lanes the one with the fewest instructions.
LEAST = [b"x86-64-v4", b"sandybridge", b"x86-64"]


@needs_linux
@pytest.mark.optimised
@pytest.mark.parametrize("level", [level for level in LEAST if FLAGS[level] <= cpu_flags()])
def test_the_resolve_is_built_for_the_levels_that_this_cpu_has(level: bytes, tmp_path: Path) -> None:
    """LLVM ends the process where it finds no instruction for a vector."""
    environment = {**os.environ, "POCL_CACHE_DIR": str(tmp_path), "CLTAA_DEVICE": "pthread"}
    command = [sys.executable, "-c", RESOLVED_AT, level.decode()]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# A program's own queue, of a device that it found without cltaa, whose name is a wrong one for this level.
OF_A_PROGRAM = """
import pyopencl as cl
from cltaa import Resolver
from cltaa.opencl import pocl_cpu_name as unknown_cpu
queue = next(
    cl.CommandQueue(cl.Context([device]))
    for platform in cl.get_platforms() if platform.name == "Portable Computing Language"
    for device in platform.get_devices()
)
unknown_cpu.level_of = lambda flags: unknown_cpu.LEVELS[-1]
Resolver(device=queue)
assert not unknown_cpu.name_unknown_cpu(queue.device.int_ptr), "the wrong name was still there"
"""


@needs_linux
def test_the_name_of_the_device_of_a_program_s_queue_is_corrected_too() -> None:
    done = subprocess.run([sys.executable, "-c", OF_A_PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# A thread that maps and unmaps the page at which every word of the record points, as threads that free memory do.
UNMAPPED_MEANWHILE = """
import ctypes, mmap, threading
from cltaa.opencl.pocl_cpu_name import name_unknown_cpu
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
for _ in range(20):
    assert not name_unknown_cpu(ctypes.addressof(record))
done = True
thread.join()
"""


@needs_linux
def test_memory_that_is_unmapped_meanwhile_is_not_followed() -> None:
    done = subprocess.run([sys.executable, "-c", UNMAPPED_MEANWHILE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
