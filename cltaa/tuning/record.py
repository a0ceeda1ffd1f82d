"""The finished trials of a search on disk, so that one that was interrupted goes on where it stopped.

The sampler asks for the same settings again when it is told the same outcomes, so a trial that was measured is looked
up by its place. A record of another search, or what a kill left of a line, counts as nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

import msgspec

from cltaa.devices.kernel_files import code_sha256
from cltaa.errors import StorageError, room_cure
from cltaa.files.content import read_text
from cltaa.judging.decided_by import stamps
from cltaa.sequences.sources import Sequence

LARGEST = 1 << 26  # bytes; a trial takes 500


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One set of settings with what it brought over the sequences of the search."""

    values: dict[str, str | float]
    error: float
    milliseconds: float  # a frame, least of ROUNDS, the mean over the sequences


def key_of(*decided: object, sequences: Collection[Sequence]) -> str:
    """A hash of everything that decides what a trial finds: what was asked for, the code, files and their reading."""
    return hashlib.sha256(msgspec.json.encode([*decided, code_sha256(), *map(stamps, sequences)])).hexdigest()


class Record:
    """The trials of the search that ``key`` stands for, in a hidden file beside its ``output``; None keeps none."""

    def __init__(self, output: Path | None, key: str) -> None:
        self._path = None if output is None else output.with_name(f".{output.name}.trials")
        self._trials = [] if self._path is None else _trials(self._path, key)
        self._kept = 0
        if self._path is not None:
            self._write(self._path, "w", key, *(msgspec.json.encode(trial).decode() for trial in self._trials))

    def replay(self, values: dict[str, str | float]) -> Trial | None:
        """The next trial where it was measured before with these settings; what stands behind another is dropped."""
        if self._kept < len(self._trials) and self._trials[self._kept].values == values:
            self._kept += 1
            return self._trials[self._kept - 1]
        self._trials = self._trials[: self._kept]
        return None

    def add(self, trial: Trial) -> None:
        """Keep a trial that was measured now."""
        self._trials.append(trial)
        self._kept += 1
        if self._path is not None:
            self._write(self._path, "a", msgspec.json.encode(trial).decode())

    def clear(self) -> None:
        """Delete the record: the search has ended."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    @staticmethod
    def _write(path: Path, mode: str, *lines: str) -> None:
        try:
            with path.open(mode, encoding="utf-8") as stream:
                stream.writelines(f"{line}\n" for line in lines)
        except OSError as error:
            what = f"a trial cannot be kept: {error.strerror}"
            raise StorageError(what, path=path, cure=room_cure(error)) from error


def _trials(path: Path, key: str) -> list[Trial]:
    if not path.is_file():
        return []
    first, *lines = read_text(path, "a record of trials", LARGEST).splitlines() or [""]
    trials: list[Trial] = []
    with suppress(msgspec.DecodeError):  # the last line, of a process that was killed
        for line in lines if first == key else ():
            trials.append(msgspec.json.decode(line, type=Trial))  # one by one: those before a damaged one are kept
    return trials
