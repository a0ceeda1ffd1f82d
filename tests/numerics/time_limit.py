"""A plugin of pytest: no test is begun once the seconds of ``CLTAA_SECONDS_OF_TESTS`` are over."""

from __future__ import annotations

import os
import time

import pytest

VARIABLE = "CLTAA_SECONDS_OF_TESTS"
TOLD = "the time for tests is up"
STARTED = time.monotonic()


def pytest_runtest_teardown(item: pytest.Item) -> None:
    if time.monotonic() > STARTED + float(os.environ[VARIABLE]):
        item.session.shouldstop = TOLD
