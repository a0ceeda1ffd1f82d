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

from cltaa.core.kernel_source import code_sha256
from cltaa.errors import StorageError, disk_space_cure
from cltaa.io.atomic import atomic_path
from cltaa.io.content import read_text
from cltaa.io.sequence import FrameSequence
from cltaa.lab.judge.comparison import stamps

LARGEST = 1 << 26  # bytes; a trial takes 500


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One set of settings with what it brought over the sequences of the search."""

    values: dict[str, str | float]
    error: float
    milliseconds: float  # a frame, least of ROUNDS, the mean over the sequences


def key_of(*decided: object, sequences: Collection[FrameSequence]) -> str:
    """A hash of everything that decides what a trial finds: what was asked for, the code, files and their reading."""
    return hashlib.sha256(msgspec.json.encode([*decided, code_sha256(), *map(stamps, sequences)])).hexdigest()


class Record:
    """The trials of the search that ``key`` stands for, in a hidden file beside its ``output``."""

    def __init__(self, output: Path, key: str) -> None:
        """Read what there is; raises OutputError and StorageError where no trial can be kept."""
        self._path, self._key = output.with_name(f".{output.name}.trials"), key
        self._trials = _trials(self._path, key)
        self._kept = 0
        self._write()

    def replay(self, values: dict[str, str | float]) -> Trial | None:
        """The next trial where it was measured before with these settings; what stands behind another is dropped."""
        if self._kept == len(self._trials):
            return None
        if self._trials[self._kept].values == values:
            self._kept += 1
            return self._trials[self._kept - 1]
        self._trials = self._trials[: self._kept]
        self._write()
        return None

    def add(self, trial: Trial) -> None:
        """Keep a trial that was measured now; raises StorageError."""
        self._trials.append(trial)
        self._kept += 1
        try:
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(_line(trial))
        except OSError as error:
            what = f"a trial cannot be kept: {error.strerror}"
            raise StorageError(what, path=self._path, cure=disk_space_cure(error)) from error

    def clear(self) -> None:
        """Delete the record: the search has ended."""
        self._path.unlink(missing_ok=True)

    def _write(self) -> None:
        """Write all of it anew: what was measured is there, as it was or as it is, whenever this ends."""
        with atomic_path(self._path) as temporary:
            temporary.write_text("".join([f"{self._key}\n", *map(_line, self._trials)]), encoding="utf-8")


def _line(trial: Trial) -> str:
    return f"{msgspec.json.encode(trial).decode()}\n"


def _trials(path: Path, key: str) -> list[Trial]:
    if not path.is_file():
        return []
    first, *lines = read_text(path, "a record of trials", LARGEST).splitlines() or [""]
    trials: list[Trial] = []
    with suppress(msgspec.DecodeError):  # the last line, of a process that was killed
        for line in lines if first == key else ():
            trials.append(msgspec.json.decode(line, type=Trial))  # one by one: those before a damaged one are kept
    return trials
