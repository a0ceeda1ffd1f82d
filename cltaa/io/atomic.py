"""Files that are either complete or absent (write beside the final name, flush, rename), in folders of one owner."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import msgspec

from cltaa.errors import DataError, OutputError, StorageError, disk_cure
from cltaa.printable import printable

Kept = TypeVar("Kept")

LONGEST_NAME = 200  # bytes of a final name in that of its temporary file; file systems end at 255

_TEMPORARY = re.compile(r"\..+\.tmp\.\d+", re.DOTALL)


def make_folder(folder: Path) -> Path:
    """Create an output folder with its parents and return it; raises OutputError where that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"the folder cannot be created: {error.strerror}"
        raise OutputError(what, path=folder, cure="choose another output folder") from error
    return folder


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Lock ``folder`` until the block or this process ends, however suddenly; OutputError where another holds it."""
    try:
        descriptor = os.open(make_folder(folder), os.O_RDONLY)
    except OSError as error:
        raise OutputError(f"the folder cannot be opened: {error.strerror}", path=folder) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            cure = "wait until it has ended, or name another folder"
            raise OutputError("another process is writing into the folder", path=folder, cure=cure) from error
        yield
    finally:
        os.close(descriptor)


def check_ownable(folder: Path) -> None:
    """Raise OutputError unless ``owned`` can lock the folder; removes the folders that this creates."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    with owned(folder):
        pass
    with suppress(OSError):  # another process may have started there since
        for path in missing:
            path.rmdir()


def check_creatable(path: Path) -> None:
    """Raise OutputError unless a file of that name can be written; to call before the work that fills it."""
    _create(path).unlink()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary name in the folder of ``path``; on a clean exit its content becomes ``path``, durably.

    The order (flush the file, rename, flush the folder) leaves the old file or the new one under the final name
    whenever the machine stops. A failed flush is final: the system may have dropped the pages, so that a second attempt
    would succeed without writing them. Raises OutputError where the file cannot be created, and StorageError.
    """
    temporary = _create(path)
    try:
        try:
            yield temporary
            _flush(temporary)
            temporary.replace(path)
            _flush(path.parent)
        except OSError as error:
            what = f"writing failed: {error.strerror or error}"
            raise StorageError(what, path=path, cure=disk_cure(error)) from error
    finally:
        temporary.unlink(missing_ok=True)


def keep(path: Path, finished: object) -> None:
    """Write a struct into a file, and create its folder if need be; raises OutputError and StorageError."""
    make_folder(path.parent)
    with atomic_path(path) as temporary:
        temporary.write_bytes(msgspec.msgpack.encode(finished))


def kept(path: Path, kind: type[Kept]) -> Kept | None:
    """Return the struct of a file, or None where there is none; raises DataError for a damaged one."""
    if not path.is_file():
        return None
    try:
        return msgspec.msgpack.decode(path.read_bytes(), type=kind)
    except msgspec.DecodeError as error:
        what = f"no finished part of a measurement: {error}"
        raise DataError(what, path=path, cure="delete it and run again") from None


@contextmanager
def temporary_folder(folder: Path) -> Iterator[Path]:
    """Yield a new folder inside of ``folder`` for other processes to fill until the block ends; raises OutputError."""
    place = folder / f".{secrets.token_hex(4)}.tmp.{os.getpid()}"
    make_folder(place)
    try:
        yield place
    finally:
        _remove_folder(place)


def move_into(path: Path, folder: Path) -> None:
    """Move a finished file into ``folder`` on the same disk, durably; raises StorageError."""
    target = folder / path.name
    try:
        path.replace(target)
        _flush(folder)
    except OSError as error:
        what = f"moving it to {printable(folder)} failed: {error.strerror or error}"
        raise StorageError(what, path=path, cure=disk_cure(error)) from error


def remove_stale_temporaries(folder: Path) -> None:
    """Delete the half-written files of killed processes in ``folder``, into which no other process writes."""
    for entry in folder.iterdir():
        if _TEMPORARY.fullmatch(entry.name):
            if entry.is_dir() and not entry.is_symlink():
                _remove_folder(entry)
            else:
                entry.unlink(missing_ok=True)


def _remove_folder(folder: Path) -> None:
    """Delete a folder that others may still be writing into: renamed first, it is gone for them at once."""
    gone = folder.with_name(f".{secrets.token_hex(4)}.tmp.{os.getpid()}")
    with suppress(OSError):
        shutil.rmtree(folder.replace(gone), ignore_errors=True)


def _create(path: Path) -> Path:
    """Create a temporary file beside ``path``, which is absent or a file."""
    try:
        if path.exists() and not path.is_file():  # a file would replace a device such as /dev/null
            what = "this is a folder" if path.is_dir() else "this is a pipe or a device"
            raise OutputError(what, path=path, expected="the name of a file")
        # The end of the name, which holds the frame number: the whole can be as long as a file system allows.
        name = os.fsdecode(os.fsencode(path.name)[-LONGEST_NAME:])
        temporary = path.with_name(f".{name}.tmp.{os.getpid()}")
        temporary.touch()
        return temporary
    except OSError as error:
        what = f"the file cannot be created: {error.strerror}"
        raise OutputError(what, path=path, cure="check the folder and its permissions") from error


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
