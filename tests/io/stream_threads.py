"""What the tests of reading ahead and writing behind share: threads to wait for, and something to read and write."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np

from cltaa.errors import DataError

PATIENCE = 300.0  # seconds after which a thread that should have ended counts as hung, on a machine however busy


def stream_threads() -> list[str]:
    """Threads of this module's subject alone: those that copy to and from a device outlive its resolvers."""
    names = ("cltaa read ahead", "cltaa write behind")
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(names)]


def wait_for(condition: object) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline
        time.sleep(0.001)


def image(value: float, size: int = 8) -> dict[str, np.ndarray]:
    return {name: np.full((size, size), value, np.float32) for name in "RGB"}


class Counted:
    """Numbers up to ``count`` that remembers how many were asked for; fails before ``failing``."""

    def __init__(self, count: int, failing: int | None = None) -> None:
        self.count, self.failing, self.made = count, failing, 0

    def __iter__(self) -> Iterator[int]:
        """Yield the numbers."""
        for number in range(self.count):
            if number == self.failing:
                raise DataError("damaged", frame=number)
            self.made += 1
            yield number
