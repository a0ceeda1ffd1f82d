"""A folder that is still being written: its frames in order, each as soon as all of its files are whole."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.open import open_input
from cltaa.io.content import open_regular
from cltaa.io.exr_header import checked_outline
from cltaa.io.names import Selection, renumbered, selection_of
from cltaa.io.numbered import FrameRange, OnBreak, files_in, frame_missing
from cltaa.io.sequence import FrameSequence
from cltaa.process import Stop

POLL = 0.2  # seconds between two checks of a folder


def check_whole(path: Path) -> None:
    """Raise DataError or InputMissing for an incomplete EXR file: its writer fills in the table of chunks last, and an
    incomplete copy ends before the chunks that the table names."""
    with open_regular(path) as file:
        checked_outline(path, file)


class Arrivals:
    """The frames of a folder as they are finished, with a denoiser's guides where they are ``guided``.

    It begins with the first of ``frames``, or with the lowest number found at first, and ends with the last of them, or
    when none came for ``idle`` seconds. ``reading`` are the other arguments of ``open_input``.
    """

    def __init__(
        self,
        source: str | Path,
        frames: FrameRange | None,
        idle: float | None,
        reading: Mapping[str, Any],
        *,
        guided: bool = False,
    ) -> None:
        """Store the arguments; nothing is read yet."""
        self._source, self._idle, self._reading, self._guided = Path(source), idle, reading, guided
        self._first: int | None = None if frames is None else frames[0]
        self._end: int | None = None if frames is None else frames[1]
        self._step, self._gaps = int(reading.get("step", 1)), OnBreak(reading.get("gaps", OnBreak.ERROR))
        self._last: int | None = None  # the last number that was taken
        self._taken: list[Path] = []
        self.ended = False  # after the last of the requested frames
        self.found: frozenset[Effect] | None = None  # as the run began

    @property
    def count(self) -> int | None:
        """How many frames to expect, None where that is unknown."""
        if self._first is None or self._end is None:
            return None
        return (self._end - self._first) // self._step + 1

    def first(self) -> FrameSequence:
        """Wait for the first frame; returns it and the whole ones after it, or raises the errors of ``open_input``."""
        found = self._wait(Stop())
        if found is None:
            self._raise_why()
            found = open_input(self._source, **self._reading)
        return found

    def behind(self, stop: Stop) -> Iterator[FrameSequence]:
        """Yield later frames, as many at once as are whole; ends early where ``stop`` is requested.

        Raises DataError for a frame that is never finished, and InputMissing for a missing one before others.
        """
        while not self.ended and (found := self._wait(stop)) is not None:
            yield found
        if not self.ended and not stop.requested:
            self._raise_why()

    def whole(self) -> FrameSequence:
        """Return all frames that were taken, as one sequence."""
        return self._opened(self._taken)

    def _wait(self, stop: Stop) -> FrameSequence | None:
        since = time.monotonic()
        while not stop.requested:
            late = self._idle is not None and time.monotonic() - since >= self._idle
            if numbers := self._ready(skip=late and self._gaps is OnBreak.RESET):
                files = [path for number in numbers for path in self._files()[number]]
                self._taken += files
                self._last, self.ended = numbers[-1], numbers[-1] == self._end
                return self._opened(files)
            if late:
                break
            time.sleep(POLL)
        return None

    def _opened(self, files: list[Path]) -> FrameSequence:
        place = self._place()
        opened = open_input(Selection(place.folder, tuple(files), place.words, place.numbers), **self._reading)
        if isinstance(opened, ForeignSequence) and opened.intake.profile.jitter.source == "projection":
            cure = "resolve the finished folder without --follow"
            raise UsageError("--follow: jitter in the projection shows over a whole shot", path=self._source, cure=cure)
        opened.found = self.found
        return opened.with_guides()[0] if self._guided else opened

    def _place(self) -> Selection:
        try:
            return selection_of(self._source)
        except InputMissing:  # a pattern that matches no file yet
            return Selection(self._source.parent, (), (str(self._source),))

    def _files(self) -> dict[int, list[Path]]:
        """Return the files of each frame that has one of every name."""
        place = self._place()
        try:
            names = place.by_name(files_in(place)).values()
        except InputMissing:  # no folder yet
            return {}
        numbers = sorted({number for files in names for number in files})
        return {n: [files[n] for files in names] for n in numbers if all(n in files for files in names)}

    def _due(self, ahead: list[int]) -> int | None:
        """Return the number that comes next."""
        if self._last is not None:
            return self._last + self._step
        return self._first if self._first is not None else min(ahead, default=None)

    def _ahead(self, files: Collection[int]) -> list[int]:
        last, end = self._last, self._end
        return [n for n in files if (last is None or n > last) and (end is None or n <= end)]

    def _ready(self, *, skip: bool) -> list[int]:
        """Return the numbers of the next whole frames in a row; with ``skip`` the row may begin later."""
        files = self._files()
        ahead = self._ahead(files)
        due, ready = self._due(ahead), list[int]()
        if skip and due not in files and ahead:
            due = ahead[0]
        while due in ahead and self._fault(files[due]) is None:
            ready.append(due)
            due += self._step
        return ready

    def _fault(self, files: list[Path]) -> CltaaError | None:
        for path in files:
            try:
                check_whole(path)
            except (DataError, InputMissing) as error:
                return error
        return None

    def _raise_why(self) -> None:
        """Raise the error that blocks the next frame, if any."""
        files = self._files()
        ahead = self._ahead(files)
        due = self._due(ahead)
        if due in files and (fault := self._fault(files[due])):
            raise fault
        if due is not None and due not in files and (ahead or self._end is not None):
            there = self._taken[-1] if self._taken else next(iter(files.values()), [self._source])[0]
            raise frame_missing(renumbered(there, due), due)
