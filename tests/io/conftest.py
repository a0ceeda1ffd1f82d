"""What the tests of the core share."""

from __future__ import annotations

import OpenEXR
import pytest

from cltaa.exr import core as exr_core


@pytest.fixture
def three_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The core is there, and decodes in as many threads on every machine: with one core the caller would decode."""
    assert exr_core.core() is not None
    monkeypatch.setattr(OpenEXR, "global_thread_count", lambda: 3)
