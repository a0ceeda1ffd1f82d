"""What every measuring test may rely on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.bench.accuracy_tasks import write_tiny
from tests.lab.bench.browser import Browser, browser
from tests.lab.bench.tiny_report import write_report


@pytest.fixture(scope="session")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a tiny report; its frames lie in ``seq`` beside it."""
    return write_report(tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="session")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four small frames, a truth, and a yardstick of two samples whose time is known."""
    return write_tiny(tmp_path_factory.mktemp("bench") / "seq")


@pytest.fixture(scope="module")
def window(report: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser that shows the report; one for each file of tests."""
    with browser(tmp_path_factory.mktemp("profile")) as found:
        found.size(1280, 900)
        found.open(report / "index.html")
        found.until("return document.getElementById('under').width === 37")
        yield found
