"""Memory on a device: all of it is touched at once, by commands that every driver can carry out."""

from __future__ import annotations

import mmap
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cltaa.core.planes import LARGE_PAGE
from cltaa.opencl import device as module
from cltaa.opencl.device import Device

PIECE = 1000  # bytes; not a divisor of what is allocated


def test_zeros_reach_the_end_of_a_buffer_though_only_its_beginning_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    # NVIDIA's driver (580.159) ends with an illegal access where it fills beyond the first 4 GB: 32 frames in the ring
    # of 3840 x 2160 could not be allocated. So what is beyond the first piece may only be copied. Sevens for zeros,
    # which fresh memory holds anyway.
    fill, filled = cl.enqueue_fill, []

    def sevens(queue: Any, memory: Any, pattern: Any, size: int, offset: int = 0) -> Any:
        filled.append(offset + size)
        return fill(queue, memory, pattern + pattern.dtype.type(7), size, offset=offset)

    monkeypatch.setattr(cl, "enqueue_fill", sevens)
    monkeypatch.setattr(module, "FILL_BYTES", PIECE)
    memory = Device().allocate((7, 321), np.uint16)
    assert filled == [PIECE]
    with memory.mapped(write=False) as held:
        assert (held == 0x0707).all()


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="only Linux tells how memory is mapped")
def test_planes_on_a_cpu_lie_in_as_many_large_pages_as_they_fill() -> None:
    device = Device()
    if not device.is_cpu:
        pytest.skip("the memory of a GPU is its driver's")
    size = 3 * LARGE_PAGE + 4096
    memory = device.allocate((size // 4,))
    with memory.mapped(write=False) as held:
        address = held.ctypes.data
    assert address % mmap.PAGESIZE == 0
    assert [wants_large_pages(address + offset) for offset in (0, 3 * LARGE_PAGE - 1, size - 1)] == [True, True, False]


def wants_large_pages(address: int) -> bool:
    """Whether the mapping that holds ``address`` is flagged so (proc(5), smaps)."""
    inside = False
    for line in Path("/proc/self/smaps").read_text(encoding="utf-8").splitlines():
        if bounds := re.match(r"([0-9a-f]+)-([0-9a-f]+) ", line):
            inside = int(bounds[1], 16) <= address < int(bounds[2], 16)
        elif inside and line.startswith("VmFlags:"):
            return "hg" in line.split()
    return False
