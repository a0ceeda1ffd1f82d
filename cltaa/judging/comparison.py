"""Which image is judged against which: a test, its truth, and the single samples that it was made from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.exr.layout import Part, Window
from cltaa.frames import Image
from cltaa.inputs.opening import is_own, open_input
from cltaa.inputs.pictures import open_pictures, stated
from cltaa.judging.equal_quality import equal_quality_samples, falls, samples_on_curve
from cltaa.judging.metrics import light_mse
from cltaa.printable import counted
from cltaa.sequences.frame_numbers import OnBreak, ranges
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

    def pairs(self) -> Iterator[tuple[int, Image, Image]]:
        """Yield frame number, test and reference [H, W, 3], linear; raises DataError for a file that is wrong."""
        mine, truth = self.part_of(self.test), self.part_of(self.reference)
        for number in self.test.numbers:
            other = self.reference.first if self._two_images else number
            yield number, self.test.image(number)[mine], self.reference.image(other)[truth]

    def truth_path(self, number: int) -> Path:
        """The file that a frame of the test is judged against."""
        return self.reference.path(self.reference.first if self._two_images else number)

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
    test: Path,
    reference: Path | None,
    frames: tuple[int, int] | None = None,
    *,
    side_file: Path | None = None,
    step: int = 1,
    verify: bool = True,
    **reading: Any,
) -> Comparison:
    """Open a test (folder or file) and its reference (folder or file, or a capture that holds one).

    Without a reference the test must be a capture, and its single samples are judged against its own truth.
    ``frames`` are the first and the last frame number to take, both included; all unless given.
    ``verify`` is that of ``open_sequence``; ``reading`` are ``profile`` and ``assignments`` of ``open_input``, for what
    another tool wrote; ``side_file`` and ``step`` are those of the capture.
    Raises UsageError, InputMissing and DataError where the two do not belong together.
    """
    capture = _capture(test if reference is None else reference, verify, step, reading | {"side_file": side_file})
    images = open_pictures(test, verify=verify, frames=frames, **reading)
    truth = None if capture is None else capture.known_reference()
    if truth is None:
        if reference is None:
            cure = "name the reference: cltaa compare TEST REFERENCE"
            raise UsageError("nothing to compare with: no folder reference/ in it", path=test, cure=cure)
        truth = open_pictures(reference, verify=verify, gaps=OnBreak.RESET, **reading)
    comparison = Comparison(images, truth, capture, {} if capture is None else open_yardsticks(capture))
    comparison.check()
    return comparison


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

    Raises what opening images does, and DataError for another size.
    """
    named = {path.name.removeprefix("reference-"): path for path in capture.folder.glob("reference-*")}
    folders = sorted((int(name), path) for name, path in named.items() if name.isdecimal())
    return {count: capture.open_supersampled(path) for count, path in folders}


def supersampling_curve(comparison: Comparison, one_sample_mse: float, stops: float = 0.0) -> list[tuple[int, float]]:
    """Measured mean squared error against samples a pixel, from the folders ``reference-<n>/`` of a capture.

    It begins with the single samples; without an error is what was drawn as the truth itself was, which is left out.
    """
    curve = [(1, one_sample_mse)]
    for count, images in comparison.yardsticks.items():
        numbers = comparison.test.numbers
        part, truth = comparison.part_of(images), comparison.part_of(comparison.reference)
        errors = [
            light_mse(images.image(number)[part], comparison.reference.image(number)[truth], stops)
            for number in numbers
        ]
        if any(errors):
            curve.append((count, sum(errors) / len(errors)))
    return curve


class EqualQuality(NamedTuple):
    """Equal-quality samples of a test, how they were found, and whether there may be more of them, or fewer."""

    samples: float
    method: str  # "measured", or "n^-1.5 law"
    bound: str | None  # "at least" and "at most" where the curve, or the truth, ends


def equal_quality(comparison: Comparison, test_mse: float, one_sample_mse: float, stops: float = 0.0) -> EqualQuality:
    """Equal-quality samples of a test, read off its capture's yardsticks where their errors fall, else by the law.

    The errors are means of ``light_mse`` over the frames of the test. Raises UsageError where no capture is known.
    """
    if comparison.capture is None:
        raise UsageError("equal-quality samples need the capture", cure="give the captured sequence as the reference")
    curve = supersampling_curve(comparison, one_sample_mse, stops)
    if falls(curve):
        bound = "at most" if test_mse > one_sample_mse else "at least" if test_mse < curve[-1][1] else None
        return EqualQuality(samples_on_curve(test_mse, curve), "measured", bound)
    count = truth_samples(comparison.reference)
    samples = equal_quality_samples(test_mse, one_sample_mse, truth_samples=count)
    return EqualQuality(samples, "n^-1.5 law", "at least" if samples == count else None)
