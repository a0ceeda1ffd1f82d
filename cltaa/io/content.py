"""The bytes of an input file: opened safely, read once, checked against the recorded SHA-256.

A name in a folder may be anything: a folder, a pipe that never answers, an endless device. Only regular files are read.
They are copied, not mapped: truncating a mapped file kills the process that reads it.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from mmap import mmap
from pathlib import Path
from typing import BinaryIO, Self

from cltaa.core.planes import BLOCK_POOL
from cltaa.errors import DataError, InputMissing, ResourceError, StorageError, disk_cure

ReadAt = Callable[[int, int], bytes]  # the bytes from a place on, as many as asked for or fewer where the file ends

_CGROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")


@contextmanager
def open_regular(path: Path, expected: str = "an EXR file") -> Iterator[BinaryIO]:
    """Open a regular file for reading bytes, no folder, pipe or device; ``expected`` says what it should be.

    Raises InputMissing, DataError where it is of another kind, and StorageError where reading fails, in the block too.
    """
    try:
        # O_NONBLOCK: opening a pipe without a writer would wait for ever.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        try:
            mode = os.fstat(descriptor).st_mode
            if not stat.S_ISREG(mode):
                what = "this is a folder" if stat.S_ISDIR(mode) else "this is a pipe or a device"
                raise DataError(what, path=path, expected=expected)
            with os.fdopen(descriptor, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(descriptor)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputMissing("the file is missing", path=path, cure="check the name") from error
    except PermissionError as error:
        raise InputMissing("the file cannot be read: permission denied", path=path) from error
    except OSError as error:
        what = f"reading failed: {error.strerror or error}"  # from the file, or into the copy in memory
        raise StorageError(what, path=path, cure=disk_cure(error)) from error


def read_bytes(path: Path, expected: str, largest: int) -> bytes:
    """Read a file of at most ``largest`` bytes; raises as ``open_regular``, and DataError for a larger one."""
    with open_regular(path, expected) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise DataError(f"too large for {expected}", path=path, expected=f"at most {largest} bytes")
    return content


def read_text(path: Path, expected: str, largest: int) -> str:
    """Read a text of at most ``largest`` bytes, without a byte order mark; errors as ``read_bytes``, and DataError
    where it is not UTF-8."""
    try:
        return read_bytes(path, expected, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"not UTF-8: {error}", path=path, expected=expected) from None


class FileCopy:
    """A copy of a file's bytes in an anonymous memory file, which nobody else can change."""

    size: int

    def __init__(self) -> None:
        self._descriptor = os.memfd_create("content")
        self._memory: mmap | None = None

    def fill(self, path: Path, file: BinaryIO) -> None:
        """Copy a file of its present size, in as few calls as possible; raises DataError where it changes."""
        size = file_size(file)
        os.ftruncate(self._descriptor, size)  # reuses the pages of an earlier file, up to there
        if size and (self._memory is None or len(self._memory) < size):
            self._memory = mmap(self._descriptor, size)
        self.size, place = size, 0
        with self.view() as content:
            while place < size:
                length = os.preadv(file.fileno(), [content[place:]], place)
                if not length:
                    raise DataError("the file changed while it was read", path=path, cure="run again")
                place += length

    def hold(self, pieces: Sequence[bytes]) -> None:
        """Hold these bytes, one piece after another, in place of a file's."""
        self.size = sum(map(len, pieces))
        os.ftruncate(self._descriptor, self.size)
        self._memory, place = mmap(self._descriptor, self.size), 0
        for piece in pieces:
            self._memory[place : place + len(piece)] = piece
            place += len(piece)

    def overwrite(self, places: Iterable[int], byte: int) -> None:
        """Write ``byte`` at each of ``places``."""
        for place in places:
            os.pwrite(self._descriptor, bytes([byte]), place)

    def read_at(self, place: int, size: int) -> bytes:
        """Return ``size`` bytes from ``place`` on."""
        with self.view() as content:
            return content[place : place + size].tobytes()

    def view(self) -> memoryview:
        """Return a view of the last copy; release it before the next file."""
        return memoryview(self._memory or b"")[: self.size]

    def check_sha256(self, path: Path, sha256: str) -> None:
        """Raise DataError where the copy of ``path`` has another SHA-256, in hexadecimal."""
        with self.view() as content:  # in one call: with many threads each acquisition of the GIL has to wait
            found = hashlib.sha256(content).hexdigest()
        if found != sha256:
            what, cure = "the content is not what was recorded when it was written", "capture or copy the file again"
            expected, other = f"SHA-256 {sha256[:12]}...", f"{found[:12]}..."
            raise DataError(what, path=path, expected=expected, found=other, cure=cure)

    def fileno(self) -> int:
        """Return the descriptor, by whose name other libraries open the memory."""
        return self._descriptor

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the memory to the next file, in a run that pools it."""
        BLOCK_POOL.leave(FileCopy, self)

    def __del__(self) -> None:
        """Free the memory."""
        with suppress(AttributeError):  # where no descriptor could be created
            os.close(self._descriptor)


def copied(path: Path, file: BinaryIO) -> FileCopy:
    """Copy a file into memory, for use in a ``with`` block; raises DataError where it changes meanwhile."""
    copy = BLOCK_POOL.take(FileCopy) or FileCopy()
    copy.fill(path, file)
    return copy


def file_size(file: BinaryIO) -> int:
    """Return the size of an open file in bytes."""
    return os.fstat(file.fileno()).st_size


def check_memory(path: Path, needed: int) -> None:
    """Raise ResourceError where ``needed`` bytes exceed all memory."""
    limit = memory_limit()
    if needed > limit:
        expected, found = f"at most {limit / 1e9:.1f} GB", f"{needed / 1e9:.1f} GB"
        what, cure = "the picture does not fit into memory", "use smaller frames or a machine with more memory"
        raise ResourceError(what, path=path, expected=expected, found=found, cure=cure)


def memory_limit() -> int:
    """Return the bytes of memory that this process may ever have: the machine's, or those of its group."""
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        return min(machine, int(_CGROUP_LIMIT.read_text()))
    except (OSError, ValueError):  # no such group, or "max"
        return machine
