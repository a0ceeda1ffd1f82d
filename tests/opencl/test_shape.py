"""Which shape a device's kernels get, and that what they fetch ahead changes no bit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pyopencl as cl
import pytest

from cltaa.core.build import Build, Steps, Storage, prelude
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.frame import Image
from cltaa.lab.timing import Motion, make_frames
from cltaa.opencl.device import POCL, Device, candidate_shapes, cpu_shape, usual_shape
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import CPU_16, INTEL_16, Shape

INTEL, AMD = "GenuineIntel", "AuthenticAMD"  # as the processor itself says


@pytest.mark.parametrize(
    ("width", "vendor", "shape"),
    [(16, INTEL, "intel-16"), (16, AMD, "cpu-16"), (8, INTEL, "cpu-8"), (8, AMD, "cpu-8"), (4, INTEL, "cpu-4")],
)
def test_a_cpu_gets_the_shape_of_its_vectors_and_its_maker(width: int, vendor: str, shape: str) -> None:
    assert cpu_shape(width, vendor) == shape


@pytest.mark.parametrize(
    ("width", "known", "shape", "candidates"),
    [
        (16, 16, "cpu-16", ["cpu-16", "gpu", "cpu-4", "cpu-8"]),
        (16, 8, "cpu-8", ["cpu-8", "gpu", "cpu-4"]),
        (8, 16, "cpu-8", ["cpu-8", "gpu", "cpu-4", "cpu-16"]),
        (8, 4, "cpu-4", ["cpu-4", "gpu"]),
        (16, None, "cpu-16", ["cpu-16", "gpu", "cpu-4", "cpu-8"]),
        (4, None, "cpu-8", ["cpu-8", "gpu", "cpu-4", "cpu-16"]),
    ],
)
def test_no_more_lanes_than_the_compiler_s_target_has(
    width: int, known: int | None, shape: str, candidates: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.opencl.device.known_lanes", lambda: known)
    monkeypatch.setattr("cltaa.opencl.device.cpu_vendor", lambda: AMD)
    device = device_of(native_vector_width_float=width)
    assert usual_shape(device) == (shape, "built in" if known else "a guess")
    assert candidate_shapes(device) == candidates


@pytest.mark.parametrize(("processor", "shape"), [(AMD, "cpu-16"), (INTEL, "intel-16")])
@pytest.mark.parametrize("driver", ["Intel(R) Corporation", "AuthenticAMD", "The pocl project"])
def test_the_processor_s_maker_decides_not_the_driver_s(
    processor: str, shape: str, driver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = f"processor\t: 0\nvendor_id\t: {processor}\n\nprocessor\t: 1\n"
    monkeypatch.setattr("cltaa.opencl.pocl_cpu_name.Path.read_text", lambda *_, **__: told)
    monkeypatch.setattr("cltaa.opencl.device.known_lanes", lambda: None)
    device = device_of(native_vector_width_float=16, vendor=driver)
    assert usual_shape(device)[0] == shape
    assert shape in candidate_shapes(device)


@pytest.mark.parametrize(
    ("runtime", "kind", "usual", "candidates"),
    [
        ("a new one", cl.device_type.CPU, ("cpu-8", "a guess"), ["cpu-8", "gpu", "cpu-4"]),
        ("a new one", cl.device_type.GPU, ("gpu", "a guess"), ["gpu", "gpu-long"]),
        ("NVIDIA CUDA", cl.device_type.GPU, ("nvidia", "built in"), ["nvidia", "gpu", "gpu-long"]),
    ],
)
def test_what_was_not_measured_is_a_guess(
    runtime: str, kind: int, usual: tuple[str, str], candidates: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.opencl.device.known_lanes", lambda: 8)
    device = device_of(runtime, kind, native_vector_width_float=8)
    assert (usual_shape(device), candidate_shapes(device)) == (usual, candidates)


def device_of(runtime: str = POCL, kind: int = cl.device_type.CPU, **facts: object) -> cl.Device:
    return cast("cl.Device", SimpleNamespace(platform=SimpleNamespace(name=runtime), type=kind, **facts))


def resolved(shape: Shape, monkeypatch: pytest.MonkeyPatch) -> tuple[int, Image]:
    monkeypatch.setattr(Device, "shape", shape)
    resolver = Resolver("fast", DeviceLauncher(), storage=Storage.HALF)
    image = [resolver.resolve(frame) for frame in make_frames(150, 90, Motion.TURN)][-1]
    assert resolver.last is not None
    return resolver.last.build.columns_ahead, image


def test_columns_fetched_ahead_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    near, next_one = resolved(CPU_16._replace(columns_ahead=0), monkeypatch)
    far, third = resolved(CPU_16, monkeypatch)
    _, second = resolved(CPU_16._replace(far_first=False), monkeypatch)
    assert (near, far) == (0, CPU_16.columns_ahead)
    assert np.array_equal(next_one.view(np.uint32), third.view(np.uint32))
    assert np.array_equal(second.view(np.uint32), third.view(np.uint32))


@pytest.mark.parametrize(
    ("shape", "preset", "first"),
    [(CPU_16, "default", True), (CPU_16, "fast", True), (CPU_16, "accumulate", False), (INTEL_16, "default", False)],
)
def test_far_lines_come_into_the_first_cache_where_that_was_measured_to_pay(
    shape: Shape, preset: str, first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Device, "shape", shape)
    chosen = load_preset(preset)
    steps = Steps(camera_motion=preset != "accumulate", own_motion=False)
    build = DeviceLauncher().build(Build(choices=chosen.choices, steps=steps))
    assert f"#define FAR_FIRST {int(first)}\n" in prelude(build)
