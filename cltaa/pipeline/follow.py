"""A folder that is still being written: its frames in order, each as soon as all of its files are whole."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.found import check_headers
from cltaa.inputs.open import open_input
from cltaa.inputs.roles import file_sets
from cltaa.io.content import open_regular
from cltaa.io.exr_header import checked_outline
from cltaa.io.names import Selection, leads_nowhere, pattern_of, renumbered, selection_of
from cltaa.io.numbered import FrameRange, OnBreak, checked_range, checked_step, frame_missing
from cltaa.io.sequence import FrameSequence, other_effects
from cltaa.printable import shell_word
from cltaa.process import Stop

POLL = 0.2  # seconds between two checks of a folder
WITHOUT = "resolve the finished folder without --follow"


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
        """Store the arguments; nothing is read yet. Raises UsageError for a wrong range or step."""
        self._source, self._idle, self._reading, self._guided = Path(source), idle, reading, guided
        self._step, self._gaps = checked_step(reading.get("step", 1)), OnBreak(reading.get("gaps", OnBreak.ERROR))
        self._first: int | None = None
        self._end: int | None = None
        if frames is not None:
            self._first, last = checked_range(frames, self._source)
            self._end = last - (last - self._first) % self._step  # the last number that can come
        self._last: int | None = None  # the last number that was taken
        self._taken: list[list[Path]] = []  # the files of each frame
        self._begun: FrameSequence | None = None  # with the first frame
        self._latest: FrameSequence | None = None  # with the last one
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
        return self._made(self._opened(self._taken))

    def _wait(self, stop: Stop) -> FrameSequence | None:
        since = time.monotonic()
        while not stop.requested:
            late = self._idle is not None and time.monotonic() - since >= self._idle
            if ready := self._ready(skip=late and self._gaps is OnBreak.RESET):
                opened = self._next(ready)
                self._taken += ready.values()
                self._last = max(ready)
                self.ended = self._last == self._end
                return opened
            if late:
                break
            time.sleep(POLL)
        return None

    def _next(self, ready: Mapping[int, list[Path]]) -> FrameSequence:
        """Open the frames that are ``ready``; later ones beside the first frame and the last one that was taken, as in
        a finished folder."""
        if self._begun is None or self._latest is None:
            self._begun = self._latest = self._made(self._opened(ready.values()))
            return self._begun
        known = {self._begun.first: self._begun, self._latest.last: self._latest}
        # Between the first frame and the last are others, so that these have no gap.
        opened = self._opened([self._taken[0], self._taken[-1], *ready.values()], gaps=OnBreak.RESET)
        part = opened.select(min(ready), max(ready))
        for number, earlier in known.items():
            if opened.layouts[number].region != earlier.layouts[number].region:
                what = "--follow: the data windows differ, which decides about earlier results"
                raise DataError(what, path=part.path(part.first), frame=part.first, cure=WITHOUT)
        if part.effects != opened.effects:
            raise other_effects(part.path(part.first), part.first, opened.effects, part.effects)
        if self.found is not None:
            check_headers(opened, self.found, path=self._source)
        self._latest = self._made(part)
        return self._latest

    def _made(self, opened: FrameSequence) -> FrameSequence:
        """Return what was opened with the effects and the guides to use."""
        opened.found = self.found
        return opened.with_guides()[0] if self._guided else opened

    def _opened(self, frames: Iterable[list[Path]], **reading: Any) -> FrameSequence:
        place, files = self._place(), tuple(dict.fromkeys(path for files in frames for path in files))
        named = Selection(place.folder, files, place.words, place.numbers)
        opened = open_input(named, **{**self._reading, **reading})
        if isinstance(opened, ForeignSequence):
            profile = opened.intake.profile
            if profile.jitter.source == "projection":
                what = "--follow: jitter in the projection shows over a whole shot"
                raise UsageError(what, path=self._source, cure=WITHOUT)
            if profile.jitter.delay or profile.camera.delay:
                what = "--follow: a delay of jitter or camera needs frames that are not there yet"
                raise UsageError(what, path=self._source, cure=WITHOUT)
        return opened

    def _place(self) -> Selection:
        try:
            return selection_of(self._source)
        except InputMissing:  # a pattern that matches no file yet
            return Selection(self._source.parent, (), (str(self._source),))

    def _sets(self) -> list[dict[int, Path]]:
        """Return the files of each name by number, without names that the first frame is not read from."""
        place = self._place()
        try:
            sets = [*file_sets(place).values()] if place.files != () else []
        except InputMissing:  # no folder yet, or nothing in it
            return []
        if self._begun is None:
            return sets
        read, first = self._begun.files_of(self._begun.first), self._begun.first
        kept = [files for files in sets if files.get(first) in read]
        others = [files[first] for files in sets if first in files]
        if others and not kept:
            what, cure = "--follow: the first frame has another name now", "name the frames by a pattern"
            one = f"{cure}: {shell_word(pattern_of(others[0], first))}"
            raise DataError(what, path=self._begun.path(first), found=others[0].name, cure=one)
        return kept

    def _files(self) -> dict[int, list[Path]]:
        """Return the files of each frame that has one in each set."""
        sets = self._sets()
        numbers = sorted({number for files in sets for number in files})
        return {n: [files[n] for files in sets] for n in numbers if all(n in files for files in sets)}

    def _due(self, ahead: list[int]) -> int | None:
        """Return the number that comes next."""
        if self._last is not None:
            return self._last + self._step
        return self._first if self._first is not None else min(ahead, default=None)

    def _ahead(self, files: Collection[int]) -> list[int]:
        last, end = self._last, self._end
        return [n for n in files if (last is None or n > last) and (end is None or n <= end)]

    def _ready(self, *, skip: bool) -> dict[int, list[Path]]:
        """Return the files of the next whole frames in a row; with ``skip`` the row may begin later."""
        files = self._files()
        if skip:  # a link to a missing file is a missing frame
            files = {number: its for number, its in files.items() if not any(map(leads_nowhere, its))}
        ahead = self._ahead(files)
        due, ready, among = self._due(ahead), dict[int, list[Path]](), frozenset(ahead)
        if skip and due not in files and ahead:
            due = ahead[0]
        while due in among and self._fault(files[due]) is None:
            ready[due] = files[due]
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
        if due is None or due in files:
            return
        sets = self._sets()
        lacking = [its for its in sets if due not in its]
        partly = len(lacking) < len(sets) and self._gaps is OnBreak.ERROR  # another of its passes is there
        if ahead or partly or self._end is not None:
            its, there = next(iter(lacking[0].items())) if lacking else (None, self._source)
            raise frame_missing(renumbered(there, due, its), due)
