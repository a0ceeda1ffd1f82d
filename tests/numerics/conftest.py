"""What the numerical tests share: one device launcher, so that each kernel is built once."""

from __future__ import annotations

import pytest

from cltaa.opencl.launcher import DeviceLauncher


@pytest.fixture(scope="session")
def launcher() -> DeviceLauncher:
    """The first OpenCL device, with the kernels that were built for it so far."""
    return DeviceLauncher()
