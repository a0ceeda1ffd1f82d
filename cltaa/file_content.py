"""The bytes of an input file: opened without surprises, read once, checked against the SHA-256 that was recorded.

A name in a folder may be anything: a folder, a pipe that never answers, a device without an end. Only regular files are
read. They are read, not mapped: a mapped file that somebody cuts short kills the process that looks at it.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, cast

from cltaa.errors import DataError, InputMissing, ResourceError, StorageError, room_cure

PIECE = 1 << 20  # bytes that are read at a time: few calls of Python a file, and hashed while a core's cache has them
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
        cure = room_cure(error) if error.errno in (errno.EFBIG, errno.ENOSPC) else None  # of the copy in memory
        raise StorageError(f"reading failed: {error.strerror or error}", path=path, cure=cure) from error


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


def read_all(path: Path, file: BinaryIO, sha256: str | None) -> BinaryIO:
    """Copy the whole file into memory, which is a file of no folder, so that nobody can change it; close it to free it.

    Raises DataError where its SHA-256, in hexadecimal, is not the given one, or where the file changes meanwhile.
    """
    content = os.fdopen(os.memfd_create("content"), "w+b")
    try:
        found = _copy(path, file, content, hashed=sha256 is not None)
        if sha256 is not None and found != sha256:
            raise DataError(
                "the content is not what was recorded when it was written", path=path,
                expected=f"SHA-256 {sha256[:12]}...", found=f"{found[:12]}...", cure="capture or copy the file again",
            )  # fmt: skip
    except BaseException:
        content.close()
        raise
    return content


def _copy(path: Path, file: BinaryIO, content: BinaryIO, *, hashed: bool) -> str:
    """Copy a file of the size that it has now; returns the SHA-256 of what was copied, where that is wanted."""
    digest, piece, left = hashlib.sha256(), memoryview(bytearray(PIECE)), file_size(file)
    file.seek(0)
    while left:
        length = cast(BufferedReader, file).readinto(piece[:left])
        if not length:
            raise DataError("the file changed while it was read", path=path, cure="run again")
        if hashed:
            digest.update(piece[:length])
        content.write(piece[:length])
        left -= length
    content.flush()
    return digest.hexdigest()


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
