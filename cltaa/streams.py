"""Reading ahead and writing behind: one thread each beside the work on a frame, a bounded number of frames in memory.

OpenEXR lets go of the interpreter while it packs and unpacks, so threads are enough. Each thread is stopped and
joined when its owner is closed, collected or the program ends: one that dies inside OpenEXR aborts the process.
"""

from __future__ import annotations

import queue
import threading
import time
import weakref
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Generic, Self, TypeVar

from cltaa.exr import write_image
from cltaa.exr_channels import Pixels
from cltaa.exr_layout import Window

Item = TypeVar("Item")


class _Shelf(Generic[Item]):
    """What a reading thread and its owner share; apart from the owner, so that the thread does not keep that alive."""

    def __init__(self, depth: int) -> None:
        self.places = threading.Semaphore(depth)
        self.items: queue.SimpleQueue[Item | BaseException | None] = queue.SimpleQueue()
        self.stopped = threading.Event()
        self.seconds = array("d")

    def fill(self, source: Iterable[Item]) -> None:
        """Put the items of ``source``, or the exception that ends it, then None; wait for a free place before each."""
        try:
            iterator = iter(source)
            while True:
                self.places.acquire()
                if self.stopped.is_set():
                    return
                begin = time.perf_counter()
                try:
                    item = next(iterator)
                except StopIteration:
                    break
                self.seconds.append(time.perf_counter() - begin)
                self.items.put(item)
        except BaseException as error:  # handed to the owner, who raises it where the item was due
            self.items.put(error)
        self.items.put(None)


class ReadAhead(Iterator[Item]):
    """Items of an iterable, made in a thread up to ``depth`` of them ahead of use, in order.

    An exception is raised where the item that it took the place of was due. ``seconds`` holds the time that making
    each item took, waiting for a free place not counted. Close it, or use it in a ``with`` block, to stop early.
    """

    def __init__(self, source: Iterable[Item], depth: int) -> None:
        if depth < 1:
            raise ValueError(f"depth must be at least 1, not {depth}")
        shelf: _Shelf[Item] = _Shelf(depth)
        thread = threading.Thread(target=shelf.fill, args=(source,), name="cltaa read ahead", daemon=True)
        self._shelf, self._ended = shelf, False
        self._finalizer = weakref.finalize(self, _stop_reading, shelf, thread)
        thread.start()

    @property
    def seconds(self) -> array[float]:
        """Busy seconds of the thread for each item made so far."""
        return self._shelf.seconds

    def __next__(self) -> Item:
        """Return the next item, waiting for it if need be."""
        if self._ended:
            raise StopIteration
        item = self._shelf.items.get()
        self._shelf.places.release()
        if item is None or isinstance(item, BaseException):
            self._ended = True
            self.close()
            raise StopIteration if item is None else item
        return item

    def close(self) -> None:
        """Stop the thread and wait for it; what it has made and was not asked for is dropped."""
        self._ended = True
        self._finalizer()

    def __enter__(self) -> Self:
        """Return itself; the thread runs already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the thread, whatever ended the block."""
        self.close()


class InTurn(Iterator[Item]):
    """Items of an iterable, each made when it is asked for; the same interface as ``ReadAhead``, without a thread."""

    def __init__(self, source: Iterable[Item]) -> None:
        self._source, self.seconds = iter(source), array("d")

    def __next__(self) -> Item:
        """Make the next item."""
        begin = time.perf_counter()
        item = next(self._source)
        self.seconds.append(time.perf_counter() - begin)
        return item

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is to be stopped."""


def read_ahead(sequence: Iterable[Item], depth: int = 2) -> ReadAhead[Item]:
    """Iterate ``sequence`` with up to ``depth`` items decoded ahead of use: ``for frame in read_ahead(sequence)``."""
    return ReadAhead(sequence, depth)


def _stop_reading(shelf: _Shelf[Item], thread: threading.Thread) -> None:
    shelf.stopped.set()
    shelf.places.release()
    thread.join()


class _Desk:
    """What a writing thread and its owner share."""

    def __init__(self, depth: int) -> None:
        self.places = threading.Semaphore(depth)
        self.tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self.failure: BaseException | None = None
        self.seconds = array("d")

    def work(self) -> None:
        """Run tasks in order until None comes; after a failure, drop the rest."""
        while (task := self.tasks.get()) is not None:
            try:
                if self.failure is None:
                    begin = time.perf_counter()
                    task()
                    self.seconds.append(time.perf_counter() - begin)
            except BaseException as error:  # handed to the owner, who raises it at the next write or at the close
                self.failure = error
            finally:
                del task  # or the arrays of the last image would stay until the next one comes
                self.places.release()


class Writer:
    """Writes images in a thread; ``write`` waits while ``depth`` of them are unfinished.

    The arrays handed over belong to the writer until ``close``. Files are atomic, so those that exist are complete
    whatever happens. The first failure is raised by the next ``write`` or by ``close``; images queued behind it are
    dropped. In a ``with`` block that ends by an exception, the queued images are still written and that exception
    stands. ``seconds`` holds the time that each image took.
    """

    def __init__(self, depth: int = 2, *, compression: str = "zip") -> None:
        if depth < 1:
            raise ValueError(f"depth must be at least 1, not {depth}")
        desk = _Desk(depth)
        thread = threading.Thread(target=desk.work, name="cltaa write behind", daemon=True)
        self._desk, self._compression, self._depth = desk, compression, depth
        self._finalizer = weakref.finalize(self, _stop_writing, desk, thread)
        thread.start()

    @property
    def seconds(self) -> array[float]:
        """Busy seconds of the thread for each image written so far."""
        return self._desk.seconds

    def write(
        self,
        path: Path,
        channels: Mapping[str, Pixels],
        attributes: Mapping[str, object] | None = None,
        then: Callable[[], None] | None = None,
        window: Window | None = None,
    ) -> None:
        """Queue one image for ``cltaa.exr.write_image``, and what is to be done ``then``; raises an earlier failure."""
        if not self._finalizer.alive:
            raise ValueError("the writer is closed")
        self._desk.places.acquire()
        if self._desk.failure is not None:
            self.close()
        compression = self._compression

        def task() -> None:
            write_image(path, channels, attributes, compression=compression, window=window)
            if then is not None:
                then()

        self._desk.tasks.put(task)

    def flush(self) -> None:
        """Wait until every queued image is written; raises the first failure, once."""
        for _ in range(self._depth):
            self._desk.places.acquire()
        self._desk.places.release(self._depth)
        if self._desk.failure is not None:
            self.close()

    def close(self) -> None:
        """Finish the queued images and stop the thread; raises the first failure, once."""
        self._finalizer()
        failure, self._desk.failure = self._desk.failure, None
        if failure is not None:
            raise failure

    def __enter__(self) -> Self:
        """Return itself; the thread runs already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the queued images; raise their failure unless another exception is on its way."""
        if error is None:
            self.close()
        else:
            self._finalizer()


def _stop_writing(desk: _Desk, thread: threading.Thread) -> None:
    desk.tasks.put(None)
    thread.join()
