"""What is finished of a measurement, each in a file of its own, so that one that was cut short goes on."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec

from cltaa.errors import DataError
from cltaa.files.atomic import atomic_path, make_folder

Kept = TypeVar("Kept")


def keep(path: Path, finished: object) -> None:
    """Write a struct into a file, atomically; raises OutputError and StorageError."""
    make_folder(path.parent)
    with atomic_path(path) as temporary:
        temporary.write_bytes(msgspec.msgpack.encode(finished))


def kept(path: Path, kind: type[Kept]) -> Kept | None:
    """The struct of a file, or None where there is none; raises DataError for a damaged one."""
    if not path.is_file():
        return None
    try:
        return msgspec.msgpack.decode(path.read_bytes(), type=kind)
    except msgspec.DecodeError as error:
        what = f"no finished part of a measurement: {error}"
        raise DataError(what, path=path, cure="delete it and run again") from None
