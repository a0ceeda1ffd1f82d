"""Work on rows by several threads: every row once, and errors where they were asked for."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa import cores
from cltaa.cores import FEWEST_ROWS, in_rows


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("height", [1, FEWEST_ROWS, 2 * FEWEST_ROWS, 5 * FEWEST_ROWS + 3, 1080])
def test_every_row_is_worked_on_once(monkeypatch: pytest.MonkeyPatch, threads: int, height: int) -> None:
    monkeypatch.setattr(cores, "THREADS", threads)
    cores._threads.cache_clear()
    seen, parts = np.zeros(height, np.int64), list[slice]()

    def work(rows: slice) -> None:
        seen[rows] += 1
        parts.append(rows)

    in_rows(height, work)
    cores._threads.cache_clear()
    assert (seen == 1).all()
    assert len(parts) <= max(1, min(threads, height // FEWEST_ROWS))


def test_an_error_in_a_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "THREADS", 4)
    cores._threads.cache_clear()

    def work(rows: slice) -> None:
        if rows.start:
            raise MemoryError("no room")

    with pytest.raises(MemoryError, match="no room"):
        in_rows(1080, work)
    cores._threads.cache_clear()
