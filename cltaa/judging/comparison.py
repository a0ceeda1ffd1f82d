"""Which image is judged against which: a test, its truth, and the single samples that it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.exr.layout import Part, Window
from cltaa.inputs.opening import is_own, open_input
from cltaa.inputs.pictures import open_pictures, stated
from cltaa.printable import counted
from cltaa.sequences.frame_numbers import FrameRange, OnBreak, ranges
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.numbered import NumberedFiles, shared_region
from cltaa.sequences.sources import Sequence


@dataclass(frozen=True, slots=True)
class Comparison:
    """A test sequence and its truth, paired by frame number, and the capture that both come from, where it is known."""

    test: ImageSequence
    reference: ImageSequence
    capture: Sequence | None
    yardsticks: Mapping[int, ImageSequence] = field(default_factory=dict)  # of the capture, by samples a pixel

    @property
    def of_itself(self) -> bool:
        """True where the test is the capture's own single samples."""
        return self.capture is not None and self.test.folder.samefile(self.capture.folder)

    @property
    def region(self) -> Window | None:
        """What is judged where the two show different regions of one display window; else None, for all."""
        return shared_region(self.test, self.reference)

    def part_of(self, images: NumberedFiles) -> Part:
        """Rows and columns of an image of the test, its reference, the capture or a yardstick that are judged."""
        region = self.region
        return np.s_[:, :] if region is None else images.shows(region)

    @property
    def _two_images(self) -> bool:
        """True for two single images, whose numbers need not agree."""
        return self.capture is None and len(self.test) == len(self.reference) == 1

    def truth_number(self, number: int) -> int:
        """The frame of the reference that a frame of the test is judged against."""
        return self.reference.first if self._two_images else number

    def not_judged(self, frames: FrameRange | None = None) -> list[int]:
        """Frames, of those in the range ``frames``, that the reference and any capture have and the test has not."""
        if self._two_images:
            return []
        there = set(self.reference.numbers)
        if self.capture is not None:
            there &= set(self.capture.numbers)
        first, last = frames or (min(there), max(there))
        return sorted(number for number in there - set(self.test.numbers) if first <= number <= last)

    def check(self) -> None:
        """Raise DataError for sizes that differ and InputMissing for a frame that one of the others has not."""
        shared_region(self.test, self.reference)
        if self._two_images:
            return
        both = "choose frames that both have with --frames"
        if self.capture is not None:
            _check_frames(self.test, self.capture, "single samples", both)
        _check_frames(self.test, self.reference, "reference", both)
        check_yardsticks(self.test, self.yardsticks)


def _check_frames(wanted: NumberedFiles, other: NumberedFiles, what: str, cure: str) -> None:
    for number in wanted.numbers:
        if number not in other.numbers:
            if not set(wanted.numbers) & set(other.numbers):
                cure = "the two have no frame number in common: number them alike"
            raise InputMissing(
                f"no {what} for this frame", path=other.folder, frame=number, found=ranges(other.numbers), cure=cure
            )


def check_yardsticks(wanted: NumberedFiles, found: Mapping[int, ImageSequence]) -> None:
    """Raise InputMissing where a yardstick lacks a frame that is wanted."""
    for count, images in found.items():
        what = f"yardstick of {counted(count, 'sample')}"
        _check_frames(wanted, images, what, "capture it again, or take the folder away")


def pair_up(
    tests: Many[Path],
    reference: Path | None,
    frames: FrameRange | None = None,
    *,
    side_file: Path | None = None,
    step: int = 1,
    verify: bool = True,
    **reading: Any,
) -> list[Comparison]:
    """Open tests (folders or files) and their one reference (folder or file, or a capture that holds one).

    Without a reference there is one test, a capture, and its single samples are judged against its own truth.
    ``frames`` are the first and the last frame number to take, both included; all unless given.
    ``verify`` is that of ``open_sequence``; ``reading`` are ``profile`` and ``assignments`` of ``open_input``, for what
    another tool wrote; ``side_file`` and ``step`` are those of the capture.
    Raises UsageError, InputMissing and DataError where they do not belong together.
    """
    against = tests[0] if reference is None else reference
    capture = _capture(against, verify, step, reading | {"side_file": side_file})
    images = [open_pictures(test, verify=verify, frames=frames, **reading) for test in tests]
    truth = None if capture is None else capture.known_reference()
    if truth is None:
        if reference is None:
            cure = "name the reference: cltaa compare TEST REFERENCE"
            raise UsageError("nothing to compare with: no folder reference/ in it", path=against, cure=cure)
        truth = open_pictures(reference, verify=verify, gaps=OnBreak.RESET, **reading)
    yardsticks = {} if capture is None else open_yardsticks(capture)
    comparisons = [Comparison(test, truth, capture, yardsticks) for test in images]
    for comparison in comparisons:
        comparison.check()
    return comparisons


def _capture(path: Path, verify: bool, step: int, reading: Mapping[str, Any]) -> Sequence | None:
    if not (path / "reference").is_dir():
        return None
    # A frame that is not there is an error where it is asked for.
    return open_input(path, verify=verify, gaps=OnBreak.RESET, step=step, **({} if is_own(path) else reading))


def truth_of(sequence: Sequence) -> ImageSequence:
    """The truth of a sequence; raises InputMissing where it has none, UsageError for the results of a resolve."""
    if sequence.reference is None:
        sequence.refuse_result()
        cure = (
            "capture it with --reference 256, best also --yardstick 2,4,8,16,32,64; or render it there yourself, with"
            " many samples a pixel and the names of the frames; or say by --truth DIR where it is"
        )
        raise InputMissing("no truth to measure against", path=sequence.folder / "reference", cure=cure)
    return sequence.reference


def truth_samples(reference: ImageSequence) -> int | None:
    """Samples a pixel of a truth, as attribute ``cltaa:samples`` of its first frame tells, or None."""
    path = reference.path(reference.first)
    count = stated(path).get("cltaa:samples")
    if count is None or (isinstance(count, int) and count > 0):
        return count
    what = "attribute cltaa:samples is wrong"
    raise DataError(what, path=path, expected="a positive int", found=repr(count), cure="capture the reference again")


def open_yardsticks(capture: Sequence) -> dict[int, ImageSequence]:
    """Folders ``reference-<n>/`` of a capture, the same frames drawn with n samples a pixel, by n, fewest first.

    One sample is none of them: the capture itself has that, which would count twice. Raises what opening images does,
    and DataError for another size.
    """
    named = {path.name.removeprefix("reference-"): path for path in capture.folder.glob("reference-*")}
    folders = sorted((int(name), path) for name, path in named.items() if name.isdecimal() and int(name) > 1)
    return {count: capture.open_supersampled(path) for count, path in folders}
