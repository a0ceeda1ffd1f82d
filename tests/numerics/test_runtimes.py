"""Every OpenCL runtime for CPUs, where there are several: strict bits are the oracle's, fast ones within bounds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cltaa.core.presets import BASE, preset_names
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa.opencl.device import devices, is_cpu
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.test_resolve import hard_frames
from tests.numerics.test_bounds import DEFAULT, check, rows_of
from tests.sequence_factory import bits

ONE = "one OpenCL runtime for CPUs is installed, and all other tests run on it; on two: sh scripts/runtimes"
FEW = ["fast", "default", "gather-8", "basic", "karis"]


def runtimes() -> list[DeviceLauncher]:
    """The first device of each runtime for CPUs; skips where there is one runtime."""
    cpus = [(device.platform.version, index) for index, device in enumerate(devices()) if is_cpu(device)]
    first = dict(reversed(cpus))
    if len(first) < 2:
        pytest.skip(ONE)
    return [DeviceLauncher(str(index)) for index in first.values()]


def images(resolver: Resolver, frames: list[Frame]) -> NDArray[Any]:
    """The images of all frames, also of presets that look ahead."""
    return np.stack([image for frame in frames for image in resolver.feed(frame)] + resolver.flush())


@pytest.mark.optimised
@pytest.mark.parametrize(
    "preset",
    [*FEW, *(pytest.param(name, marks=pytest.mark.big) for name in [BASE, *preset_names()] if name not in FEW)],
)
def test_strict_bits_are_the_oracle_s_on_every_runtime(preset: str) -> None:
    """``karis`` stands for the transcriptions, unless every preset is asked for."""
    launchers = runtimes()
    frames = [replace(frame, alpha=None, reactive=None) for frame in hard_frames(28, 24, 3)]
    expected = bits(images(Resolver(preset, "numpy"), frames))
    ours = {each.description: bits(images(Resolver(preset, each, strict=True), frames)) for each in launchers}
    apart = {name: int((found != expected).sum()) for name, found in ours.items()}
    assert apart == dict.fromkeys(apart, 0)


@pytest.mark.optimised
def test_the_fast_default_lies_inside_its_bound_on_every_runtime() -> None:
    for launcher in runtimes():
        check(rows_of("resolve", DEFAULT, on=launcher))


@pytest.mark.parametrize("kind", [cl.device_type.CPU, cl.device_type.GPU])
def test_with_one_runtime_the_report_says_why_they_are_skipped(
    kind: int, monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config
) -> None:
    """A second device of a runtime is no second runtime, nor is one for GPUs."""
    here = SimpleNamespace(platform=SimpleNamespace(version="PoCL 3.0"), type=cl.device_type.CPU)
    other = SimpleNamespace(platform=here.platform if kind == cl.device_type.CPU else SimpleNamespace(version="CUDA"))
    other.type = kind
    monkeypatch.setattr("tests.numerics.test_runtimes.devices", lambda: [here, other])
    with pytest.raises(pytest.skip.Exception, match="on two: sh scripts/runtimes"):
        runtimes()
    assert "a" in pytestconfig.getoption("reportchars")  # pytest shows reasons of skips
