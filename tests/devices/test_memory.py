"""Memory on a device: all of it is touched at once, by commands that every driver can carry out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cltaa.devices import device as module
from cltaa.devices.device import Device

PIECE = 1000  # bytes; not a divisor of what is allocated


def test_zeros_reach_the_end_of_a_buffer_though_only_its_beginning_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    # NVIDIA's driver (580.159) ends with an illegal access where it fills beyond the first 4 GB: 32 kept frames of
    # 3840 x 2160 could not be allocated. So what is beyond the first piece may only be copied. Sevens for zeros, which
    # fresh memory holds anyway.
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
