"""Which shape a device's kernels get, and that what they fetch ahead changes no bit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cltaa.bench.frames import Motion, make_frames
from cltaa.build import Storage
from cltaa.device import INTEL, Device
from cltaa.frames import Image
from cltaa.launch import DeviceLauncher
from cltaa.resolve import Resolver
from cltaa.shape import CPU_8, CPU_16, INTEL_16, Shape

AMD = 0x1022


@pytest.mark.parametrize(
    ("vendor", "width", "shape"),
    [(INTEL, 16, INTEL_16), (AMD, 16, CPU_16), (INTEL, 8, CPU_8), (AMD, 8, CPU_8)],
)
def test_a_cpu_gets_the_shape_of_its_vectors_and_its_maker(vendor: int, width: int, shape: Shape) -> None:
    device = Device.__new__(Device)
    device.is_cpu = True
    device.cl_device = cast(Any, SimpleNamespace(vendor_id=vendor, native_vector_width_float=width))
    assert device.shape == shape


def resolved(shape: Shape, storage: Storage, monkeypatch: pytest.MonkeyPatch) -> tuple[int, Image]:
    monkeypatch.setattr(Device, "shape", shape)
    resolver = Resolver("default", DeviceLauncher(), storage=storage)
    image = [resolver.resolve(frame) for frame in make_frames(150, 90, Motion.TURN)][-1]
    assert resolver.last is not None
    return resolver.last.build.columns_ahead, image


@pytest.mark.parametrize("storage", [Storage.FLOAT, Storage.HALF])
def test_columns_fetched_ahead_change_no_bit(storage: Storage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever CPU the tests run on: one of the two is not what its own shape builds."""
    near, next_one = resolved(CPU_16, storage, monkeypatch)
    far, third = resolved(INTEL_16, storage, monkeypatch)
    assert (near, far) == (0, INTEL_16.columns_ahead)
    assert np.array_equal(next_one.view(np.uint32), third.view(np.uint32))
