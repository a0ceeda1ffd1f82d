"""What the numerical tests share: one device launcher, so that each kernel is built once."""

from __future__ import annotations

from functools import cache

import pytest

from cltaa.opencl.launcher import DeviceLauncher


@cache
def shared(_: bool) -> DeviceLauncher:
    """One launcher for optimised kernels, and one for others."""
    return DeviceLauncher()


@pytest.fixture
def launcher(request: pytest.FixtureRequest) -> DeviceLauncher:
    """The first OpenCL device, with the kernels that were built for it so far, optimised or not."""
    return shared(request.node.get_closest_marker("optimised") is not None)
