"""The bytes of an input file: opened without surprises, read once, checked against the SHA-256 that was recorded.

A name in a folder may be anything: a folder, a pipe that never answers, a device without an end. Only regular files are
read. They are read, not mapped: a mapped file that somebody cuts short kills the process that looks at it.
"""

from __future__ import annotations

import hashlib
import mmap
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, cast

from cltaa.errors import DataError, InputMissing, ResourceError, StorageError

_CGROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")


@contextmanager
def open_regular(path: Path, expected: str = "an EXR file") -> Iterator[BinaryIO]:
    """Open a file that is no folder, pipe or device, for reading bytes; ``expected`` says what it should be.

    Raises InputMissing where there is no such file or it may not be read, DataError where it is of another kind, and
    StorageError where reading fails, in the block too.
    """
    try:
        # O_NONBLOCK: to open a pipe that nobody writes into would wait for ever.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        try:
            _check_kind(path, os.fstat(descriptor), expected)
            with os.fdopen(descriptor, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(descriptor)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputMissing("the file is missing", path=path, cure="check the name") from error
    except PermissionError as error:
        raise InputMissing("the file cannot be read: permission denied", path=path) from error
    except OSError as error:
        raise StorageError(f"reading failed: {error.strerror or error}", path=path) from error


def read_bytes(path: Path, expected: str, largest: int) -> bytes:
    """Read a file of at most ``largest`` bytes; raises what ``open_regular`` raises, and DataError for a larger one."""
    with open_regular(path, expected) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise DataError(f"too large for {expected}", path=path, expected=f"at most {largest} bytes")
    return content


def read_text(path: Path, expected: str, largest: int) -> str:
    """Read a text of at most ``largest`` bytes; errors as ``read_bytes``, and DataError for what is no UTF-8.

    The mark that some editors and spreadsheets put before UTF-8 is no part of it.
    """
    try:
        return read_bytes(path, expected, largest).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"not UTF-8: {error}", path=path, expected=expected) from None


def read_all(path: Path, file: BinaryIO, sha256: str | None) -> mmap.mmap:
    """Read the whole file into memory of its own, which is a stream as well, and goes when it is dropped.

    Raises DataError where its SHA-256, in hexadecimal, is not the given one, or where the file changes meanwhile.
    """
    # Memory of no file. Not bytes, which come from the heap a small page at a time and are copied into a stream again.
    content = mmap.mmap(-1, file_size(file) or 1, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    with suppress(OSError):  # a system without large pages
        content.madvise(mmap.MADV_HUGEPAGE)
    file.seek(0)
    if cast(BufferedReader, file).readinto(content) < len(content):
        raise DataError("the file changed while it was read", path=path, cure="run again")
    if sha256 is not None:
        found = hashlib.sha256(content).hexdigest()
        if found != sha256:
            raise DataError(
                "the content is not what was recorded when it was written", path=path,
                expected=f"SHA-256 {sha256[:12]}...", found=f"{found[:12]}...", cure="capture or copy the file again",
            )  # fmt: skip
    return content


def file_size(file: BinaryIO) -> int:
    """Size of an open file in bytes."""
    return os.fstat(file.fileno()).st_size


def check_memory(path: Path, needed: int) -> None:
    """Raise ResourceError where ``needed`` bytes are more than all the memory that there is."""
    limit = memory_limit()
    if needed > limit:
        raise ResourceError(
            "the picture does not fit into memory", path=path, expected=f"at most {limit / 1e9:.1f} GB",
            found=f"{needed / 1e9:.1f} GB", cure="use smaller frames or a machine with more memory",
        )  # fmt: skip


def memory_limit() -> int:
    """Bytes of memory that this process may ever have: those of the machine, or fewer where its group is limited."""
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        return min(machine, int(_CGROUP_LIMIT.read_text()))
    except (OSError, ValueError):  # no such group, or "max"
        return machine


def _check_kind(path: Path, status: os.stat_result, expected: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise DataError("this is a folder", path=path, expected=expected)
    if not stat.S_ISREG(status.st_mode):
        raise DataError("this is a pipe or a device", path=path, expected=expected)
