"""What the numerical tests share: a device."""

from __future__ import annotations

import pytest

from cltaa.opencl.launcher import DeviceLauncher


@pytest.fixture
def launcher() -> DeviceLauncher:
    """The first OpenCL device."""
    return DeviceLauncher()
