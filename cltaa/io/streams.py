"""Reading ahead and writing behind: threads beside the work on a frame, a bounded number of frames in memory.

OpenEXR, NumPy and SHA-256 release the GIL while they work, so threads are enough. All of them are stopped and joined
when their owner is closed or collected, or the program ends: a thread that dies inside OpenEXR aborts the process.
"""

from __future__ import annotations

import threading
import time
import weakref
from array import array
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice, repeat
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_layout import Windows
from cltaa.io.exr_write import write_image
from cltaa.process import CORES, MANY_CORES

# Frames that are decoded ahead, and results that wait to be written, each in a thread of its own: several, because a
# thread spends half of the time on work that the unpacking and packing threads do not share: the file's bytes, SHA-256,
# planes, flushes. With many cores one more of each (docs/decisions/13-io-pipeline.md).
AHEAD = BEHIND = 3 if CORES >= MANY_CORES else 2

Item = TypeVar("Item")
Task = Callable[[], Item]


class ReadAhead(Iterator[Item]):
    """Items made by tasks in ``threads`` threads, up to ``depth`` of them ahead of use, in the order of the tasks.

    With a ``depth`` of 0 each is made on demand. An exception is raised in place of its item, and ends the iteration.
    ``seconds`` holds the time of each item.
    """

    def __init__(self, tasks: Iterable[Task[Item]], depth: int = AHEAD, threads: int = AHEAD) -> None:
        self.seconds = array("d")
        self._tasks, self._items, self._depth = iter(tasks), deque[Future[Item]](), depth
        self._pool = ThreadPoolExecutor(threads, "cltaa read ahead")
        self._finalizer = weakref.finalize(self, self._pool.shutdown, cancel_futures=True)
        self._start(depth)

    def _start(self, count: int) -> None:
        for task in islice(self._tasks, count):
            self._items.append(self._pool.submit(_timed, task, self.seconds))

    def __next__(self) -> Item:
        """Return the next item, after a wait if need be."""
        if self._depth == 0:
            self._start(1)
        if not self._items:
            self.close()
            raise StopIteration
        try:
            item = self._items.popleft().result()
        except BaseException:
            self.close()
            raise
        if self._depth > 0:
            self._start(1)
        return item

    def close(self) -> None:
        """Stop the threads and wait for them; unused items are dropped."""
        self._finalizer()
        self._tasks = iter(())
        self._items.clear()

    def __enter__(self) -> Self:
        """Return itself; the threads run already."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the threads, whatever ended the block."""
        self.close()


def read_ahead(source: Iterable[Item], depth: int = AHEAD) -> ReadAhead[Item]:
    """Iterate ``source`` in a thread up to ``depth`` items ahead of use: ``for frame in read_ahead(sequence)``."""
    # The source's StopIteration is raised in place of the item after the last, and ends the iteration.
    return ReadAhead(repeat(partial(next, iter(source))), depth, 1)


def _timed(task: Task[Item], seconds: array[float]) -> Item:
    begin = time.perf_counter()
    item = task()
    seconds.append(time.perf_counter() - begin)
    return item


class Writer:
    """Writes images in ``threads`` threads; ``write`` waits while ``depth`` of them are unfinished.

    The arrays handed over belong to the writer until ``close``. The first failure is raised by a later ``write``,
    ``flush`` or by ``close``; images queued after it are dropped. If a ``with`` block ends by an exception, the queued
    images are still written and that exception is raised. ``seconds`` holds the time of each image.
    """

    def __init__(self, depth: int = BEHIND, *, compression: str = "zip", threads: int = BEHIND) -> None:
        self.seconds = array("d")
        self._compression, self._depth = compression, depth
        self._images, self._failed = deque[Future[None]](), threading.Event()
        self._pool = ThreadPoolExecutor(threads, "cltaa write behind")
        self._finalizer = weakref.finalize(self, self._pool.shutdown)

    def write(
        self,
        path: Path,
        channels: Mapping[str, Pixels] | Callable[[], Mapping[str, Pixels]],
        attributes: Mapping[str, object] | None = None,
        then: Callable[[], None] | None = None,
        windows: Windows | None = None,
    ) -> None:
        """Queue one image for ``write_image``, and the call ``then`` after it; the thread may make ``channels``."""
        if not self._finalizer.alive:
            raise ValueError("the writer is closed")
        while len(self._images) >= self._depth or self._failed.is_set():
            self._finish_one()
        compression = self._compression  # not the writer itself, which a queued image would keep alive

        def write() -> None:
            planes = channels() if callable(channels) else channels
            write_image(path, planes, attributes, compression=compression, windows=windows)

        self._images.append(self._pool.submit(_write, write, then, self._failed, self.seconds))

    def _finish_one(self) -> None:
        """Wait for the oldest image; if it failed, stop."""
        failure = self._images.popleft().exception()
        if failure is not None:
            self._stop()
            raise failure

    def flush(self) -> None:
        """Wait until every queued image is written; raises the first failure, once."""
        while self._images:
            self._finish_one()

    def close(self) -> None:
        """Finish the queued images and stop the threads; raises the first failure, once."""
        self._finalizer()
        self.flush()

    def _stop(self) -> None:
        self._finalizer()
        self._images.clear()

    def __enter__(self) -> Self:
        """Return itself; the threads run already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the queued images; raise their failure unless another exception is being raised."""
        if error is None:
            self.close()
        else:
            self._stop()


def _write(
    write: Callable[[], None], then: Callable[[], None] | None, failed: threading.Event, seconds: array[float]
) -> None:
    """Write an image unless an earlier one failed."""
    if failed.is_set():
        return
    begin = time.perf_counter()
    try:
        write()
        if then is not None:
            then()
    except BaseException:
        failed.set()
        raise
    seconds.append(time.perf_counter() - begin)
