"""A plugin of pytest: no test is begun once the processor seconds of ``CLTAA_SECONDS_OF_TESTS`` are spent.

Seconds of the processor, its children's included, so that a busy machine asks as many tests as an idle one.
"""

from __future__ import annotations

import os

import pytest

VARIABLE = "CLTAA_SECONDS_OF_TESTS"
TOLD = "the time for tests is up"


def pytest_runtest_teardown(item: pytest.Item) -> None:
    if sum(os.times()[:4]) > float(os.environ[VARIABLE]):
        item.session.shouldstop = TOLD
