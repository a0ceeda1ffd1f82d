"""What other OpenCL runtimes lack, taken from the compiler at hand: the bits stay those of the oracle."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyopencl as cl
import pytest

from cltaa.core.build import source
from cltaa.core.resolver import Resolver
from cltaa.frame import Image
from cltaa.lab.timing import Motion, make_frames
from cltaa.opencl import device
from cltaa.opencl.device import device_flags

# Rusticl (Mesa 22.3 and 25.0) has no doubles, and a compiler that does not tell what it compiles for.
NO_DOUBLES = "-cl-single-precision-constant"
NO_TARGET = "#undef __x86_64__\n#undef __aarch64__\n#undef __AVX512F__\n#undef __F16C__\n"


def resolved(device: str | None) -> Image:
    resolver = Resolver("default", device, strict=True)
    return [resolver.resolve(frame) for frame in make_frames(40, 24, Motion.TURN)][-1]


def test_a_runtime_without_doubles_or_a_target_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "device_flags", lambda _: (NO_DOUBLES,))
    monkeypatch.setattr(device, "source", lambda kernel, build: NO_TARGET + source(kernel, build))
    assert np.array_equal(resolved(None).view(np.uint32), resolved("numpy").view(np.uint32))


@pytest.mark.parametrize(
    ("extensions", "flags"), [("cl_khr_fp16 cl_khr_fp64", ()), ("cl_khr_fp64_not", (NO_DOUBLES,)), ("", (NO_DOUBLES,))]
)
def test_literals_are_single_where_a_device_has_no_doubles(extensions: str, flags: tuple[str, ...]) -> None:
    assert device_flags([cast(Any, SimpleNamespace(extensions=extensions))]) == flags


def test_no_program_comes_from_pyopencl_s_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """A binary of Intel's runtime does not tell the names of arguments, and the second build came from one."""
    monkeypatch.setattr(cl, "_PYOPENCL_NO_CACHE", False)
    monkeypatch.setattr("pyopencl.characterize.has_src_build_cache", lambda _: False)
    monkeypatch.setattr("pyopencl.cache.create_built_program_from_source_cached", lambda *_, **__: pytest.fail("kept"))
    built = device.program_of(device.context_of(device.devices()[0]), "__kernel void named_here() {}", ())
    assert built.get_info(cl.program_info.KERNEL_NAMES) == "named_here"


def driver(platform: str, version: str, kind: int = cl.device_type.CPU) -> Any:
    named = SimpleNamespace(name=platform, version=version)
    found = SimpleNamespace(name=version, platform=named, type=kind, int_ptr=0)
    named.get_devices = lambda: [found]
    return named


@pytest.mark.parametrize(("wish", "taken"), [("pocl", 1), ("PoCL", 1), ("portable comp", 1), ("cuda", 0), ("10.1", 1)])
def test_a_device_goes_by_the_name_that_its_runtime_is_known_by(
    wish: str, taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The platform of PoCL never calls itself so."""
    names = [("NVIDIA CUDA", "580.1"), ("Portable Computing Language", "10.1")]
    found: list[Any] = [
        SimpleNamespace(name="X", platform=SimpleNamespace(name=name), driver_version=number) for name, number in names
    ]
    monkeypatch.setattr(device, "devices", lambda: found)
    assert device.choose_device(wish) is found[taken]


def test_gpus_come_first_then_runtimes_in_the_order_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """In whatever order the loader names them; a version is a number, and none is older than any."""
    ordered = [
        driver("NVIDIA CUDA", "OpenCL 3.0 CUDA 13.0", cl.device_type.GPU),
        driver("Portable Computing Language", "OpenCL 3.0 PoCL 10.1  Linux"),
        driver("Portable Computing Language", "OpenCL 3.0 PoCL 6.0  Linux"),
        driver("Portable Computing Language", "OpenCL 3.0 PoCL HEAD"),
        driver("Intel(R) OpenCL", "OpenCL 3.1 LINUX"),
        driver("rusticl", "OpenCL 3.0 "),
    ]
    monkeypatch.setattr(device, "name_unknown_cpu", lambda _: False)
    for given in permutations(ordered):
        monkeypatch.setattr(cl, "get_platforms", lambda given=given: list(given))
        assert [found.platform for found in device.devices()] == ordered
