"""Pair images with their truth, and check whether two sequences show the same scene.

Pixels cannot decide that: a bad resolve of the right scene can be farther from the truth than a picture of another
scene. So only the files' headers and records count; without them there is no warning.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Iterable, Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.inputs.foreign import check_named, open_pictures, stated
from cltaa.inputs.open import is_own, open_input
from cltaa.io.exr_frame import check_number
from cltaa.io.exr_layout import Part, Window
from cltaa.io.manifest import CAPTURE, Entry, Manifest, file_sha256, recorded_hashes
from cltaa.io.names import Named, Selection, selection_of
from cltaa.io.numbered import FrameRange, NumberedFiles, OnBreak, asked_alone, named_frames, ranges, shared_region
from cltaa.io.sequence import RESOLVED, FrameSequence, ImageSequence
from cltaa.printable import counted, printable


@dataclass(frozen=True, slots=True)
class Comparison:
    """A test sequence and its truth, paired by frame number, and the capture that both come from, if known."""

    test: ImageSequence
    reference: ImageSequence
    capture: FrameSequence | None
    yardsticks: Mapping[int, ImageSequence] = field(default_factory=dict)  # samples a pixel -> images of the capture
    without_truth: tuple[int, ...] = ()  # frames that test and capture had, left out of the test

    @property
    def of_itself(self) -> bool:
        """True if the test is the capture's own frames, one sample a pixel."""
        if self.capture is None or not self.test.folder.samefile(self.capture.folder):
            return False
        return self.test.path(self.test.first).name in {path.name for path in self.capture.paths}

    @property
    def region(self) -> Window | None:
        """The judged window, if the two show different regions of one display window; None: all pixels."""
        return shared_region(self.test, self.reference)

    def part_of(self, images: NumberedFiles) -> Part:
        """Return the judged rows and columns of an image of the test, its reference, the capture or a yardstick."""
        region = self.region
        return np.s_[:, :] if region is None else images.shows(region)

    @property
    def two_images(self) -> bool:
        """True for two single images, whose frame numbers may differ."""
        return self.capture is None and len(self.test) == len(self.reference) == 1

    def truth_number(self, number: int) -> int:
        """Return the reference's frame number for a frame of the test."""
        return self.reference.first if self.two_images else number

    def not_judged(self, frames: FrameRange | None) -> list[int]:
        """Return the frames in the range ``frames`` that reference and capture have and the test lacks."""
        if self.two_images:
            return []
        there = set(self.reference.numbers)
        if self.capture is not None:
            there &= set(self.capture.numbers)
        first, last = frames or (min(there), max(there))
        return sorted(number for number in there - set(self.test.numbers) if first <= number <= last)

    def judging_what_has_a_truth(self) -> Comparison:
        """Return the comparison without the captured frames that have no truth, unless none would be left."""
        captured = () if self.capture is None else self.capture.numbers
        without = tuple(n for n in self.test.numbers if n in captured and n not in self.reference.layouts)
        there = [number for number in self.test.numbers if number not in without]
        return replace(self, test=self.test.of_numbers(there), without_truth=without) if without and there else self

    def check(self) -> None:
        """Raise DataError for different sizes and for a file of another frame, InputMissing for a frame that one
        lacks."""
        shared_region(self.test, self.reference)
        if self.two_images:
            return
        both = "choose frames that both have with --frames"
        if self.capture is not None:
            _check_frames(self.test, self.capture, "single samples", both)
        _check_frames(self.test, self.reference, "reference", both)
        check_yardsticks(self.test, self.yardsticks)
        for images in (self.test, self.reference, *self.yardsticks.values()):
            for number in self.test.numbers:
                check_number(images.path(number), stated(images.path(number)), number)


def _check_frames(wanted: NumberedFiles, other: NumberedFiles, what: str, cure: str) -> None:
    for number in wanted.numbers:
        if number not in other.numbers:
            if not set(wanted.numbers) & set(other.numbers):
                cure = "the two have no frame number in common: number them alike"
            raise InputMissing(
                f"no {what} for this frame", path=other.folder, frame=number, found=ranges(other.numbers), cure=cure
            )


def check_yardsticks(wanted: NumberedFiles, found: Mapping[int, ImageSequence]) -> None:
    """Raise InputMissing if a yardstick lacks a wanted frame."""
    for count, images in found.items():
        what = f"yardstick of {counted(count, 'sample')}"
        _check_frames(wanted, images, what, "capture it again, or take the folder away")


def pair_up(
    tests: Many[Named],
    reference: Named | None,
    frames: FrameRange | None = None,
    *,
    side_file: str | Path | None = None,
    step: int = 1,
    verify: bool = True,
    gaps: OnBreak = OnBreak.ERROR,
    **reading: Any,
) -> list[Comparison]:
    """Open tests (folders, files or patterns) and their one reference (likewise, or a capture with a truth).

    Without a reference the only test is a capture, whose frames are judged against its own truth.
    ``frames`` are the first and the last frame number to judge, both included; by default all that have a truth.
    ``verify`` is that of ``open_sequence``; ``reading`` are ``profile`` and ``assignments`` of ``open_input``, for
    files of another tool; ``gaps`` says whether a test may lack frames between others; ``side_file`` and ``step`` are
    those of the capture.
    Raises UsageError, InputMissing and DataError for sequences that do not match.
    """
    against = selection_of(tests[0] if reference is None else reference)
    told = {"side_file": side_file, **({} if is_own(against) else reading)}
    capture = asked_alone(lambda only: _capture(against, verify, step, told | {"frames": only}), frames)
    images = [open_pictures(test, verify=verify, gaps=gaps, frames=frames, **reading) for test in tests]
    truth = None if capture is None else capture.known_reference()
    if truth is None:
        if reference is None:
            cure = "name the reference: cltaa compare TEST REFERENCE"
            raise UsageError("nothing to compare with: no folder reference/ in it", path=str(against), cure=cure)
        how: Any = reading | {"verify": verify, "gaps": OnBreak.RESET}
        truth = asked_alone(lambda only: open_pictures(against, frames=only, **how), frames)
        check_named([*tests, against], [*images, truth], **reading)
    yardsticks = {} if capture is None else open_yardsticks(capture)
    comparisons = [Comparison(test, truth, capture, yardsticks) for test in images]
    if frames is None:
        comparisons = [comparison.judging_what_has_a_truth() for comparison in comparisons]
    for comparison in comparisons:
        comparison.check()
    return comparisons


def _capture(place: Selection, verify: bool, step: int, reading: Mapping[str, Any]) -> FrameSequence | None:
    if place.alone or not (place.folder / "reference").is_dir():  # a picture named by itself is no capture
        if reading["side_file"] is not None:
            cure = "leave it out, or name a capture with its truth in reference/"
            raise UsageError("--camera is of a capture", path=str(place), cure=cure)
        return None
    # A missing frame becomes an error when it is read.
    return open_input(place, verify=verify, gaps=OnBreak.RESET, step=step, **reading)


def truth_of(sequence: FrameSequence) -> ImageSequence:
    """Return the truth of a sequence; raises InputMissing if there is none, UsageError for the output of a resolve."""
    if sequence.reference is None:
        sequence.refuse_result()
        cure = (
            "capture it with --reference 256, best also --yardstick 2,4,8,16,32,64; or render it there yourself, with"
            " many samples a pixel and the names of the frames; or say by --truth DIR where it is"
        )
        raise InputMissing("no truth to measure against", path=sequence.folder / "reference", cure=cure)
    truth = sequence.reference
    ours, theirs = stated(sequence.path(sequence.first)), stated(truth.path(truth.first))
    if told := _other_scene(ours, theirs, printable(str(sequence.folder)), "its truth"):
        warnings.warn(told, stacklevel=2)
    return truth


def truth_samples(reference: ImageSequence) -> int | None:
    """Return the samples a pixel of a truth, from attribute ``cltaa:samples`` of its first frame, or None."""
    path = reference.path(reference.first)
    count = stated(path).get("cltaa:samples")
    if count is None or (isinstance(count, int) and count > 0):
        return count
    what = "attribute cltaa:samples is wrong"
    raise DataError(what, path=path, expected="a positive int", found=repr(count), cure="capture the reference again")


def open_yardsticks(capture: FrameSequence) -> dict[int, ImageSequence]:
    """Open the folders ``reference-<n>/`` of a capture, the same frames with n samples a pixel, by n, fewest first.

    Skips n = 1, which the capture itself already has. Raises what opening images raises, and DataError for another
    size.
    """
    named = {path.name.removeprefix("reference-"): path for path in capture.folder.glob("reference-*")}
    folders = sorted((int(name), path) for name, path in named.items() if name.isdecimal() and int(name) > 1)
    return {count: capture.open_supersampled(path) for count, path in folders}


VIEW = "cltaa:worldToView"


def _other_scene(ours: Mapping[str, object], theirs: Mapping[str, object], one: str, other: str) -> str:
    """Return a sentence where two headers name different scenes, else an empty one."""
    scenes = [str(attributes.get("cltaa:scene", "")) for attributes in (ours, theirs)]
    differ = all(scenes) and scenes[0] != scenes[1]
    return f"{one} shows scene {printable(scenes[0])} and {other} scene {printable(scenes[1])}" if differ else ""


PRIMARIES = "chromaticities"  # x and y of red, green, blue and white
SAME_PRIMARIES = 1e-3  # files usually state them in three digits
NO_TRUTH = (
    "which has no truth in a folder reference/: the figures are no errors; capture it with --reference 64, or render"
    " the truth there, with many samples a pixel"
)
SAME_VIEW = 1e-6  # relative to the largest entry of both matrices; those of a still camera are bit-equal


def doubts(comparison: Comparison, *, followed: bool) -> list[str]:
    """Return the strongest reason why A may not show what B shows, or B is no truth; empty if there is none.

    With ``followed``, which uses the motion in B's files, also checks that they are read as for the resolve.
    Raises what reading a header and a manifest raises.
    """
    truth = stated(comparison.reference.path(comparison.reference.first))
    if comparison.capture is not None and RESOLVED in truth:
        return [f"the truth of B, {printable(comparison.reference.folder)}, was written by a resolve: capture it again"]
    if comparison.of_itself:
        return []
    if RESOLVED in truth:
        return ["B is itself a result of cltaa resolve and no truth: the figures are no errors; name the truth last"]
    test = comparison.test
    other: NumberedFiles = comparison.reference if comparison.capture is None else comparison.capture
    number = test.first if test.first in other.numbers else other.first
    ours, theirs = (stated(path) for path in (test.path(test.first), other.path(number)))
    if told := _other_scene(ours, theirs, "A", "B"):
        return [told]
    numbers = [attributes.get("cltaa:frame") for attributes in (ours, theirs)]
    if comparison.two_images and None not in numbers and numbers[0] != numbers[1]:
        return [f"A is frame {numbers[0]} and B frame {numbers[1]}: name two pictures of one frame"]
    if apart := [n for n in test.numbers if n in other.layouts and _differ(*_views(test.path(n), other.path(n)))]:
        return [f"A and B are seen by different cameras in {named_frames(apart)}"]
    if _other_primaries(ours.get(PRIMARIES), truth.get(PRIMARIES)):
        return ["A and B state different primaries (attribute chromaticities), and neither is converted"]
    manifest, capture = Manifest(test.folder), comparison.capture
    entry = manifest.entries.get(test.path(test.first).name)
    if capture is None:
        without = _no_truth(comparison, entry, truth)
        return [f"{without}, {NO_TRUTH}"] if without else []
    if entry is None or test.first not in capture.numbers:
        return []
    if capture.sha256(test.first) not in (None, entry.input_sha256):
        return ["A was resolved from other frames than those of B: another seed or jitter, or before a new capture"]
    if followed and _read_otherwise(capture, test.first, manifest.settings, entry):
        return [
            "A was resolved from B as other options read it: give --profile, --input, --camera and --step as then,"
            " for by B's depth, vectors and matrices things are followed"
        ]
    return []


def _views(*paths: Path) -> list[object]:
    """Return the view matrices that the headers state, None for those that state none."""
    return [stated(path).get(VIEW) for path in paths]


def _differ(one: object, other: object) -> bool:
    """Return True if both are matrices and differ."""
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.shape == other.shape):
        return False
    return bool(np.abs(one - other).max() > SAME_VIEW * max(np.abs(one).max(), np.abs(other).max()))


def _other_primaries(one: object, other: object) -> bool:
    """Return True if both are stated and differ."""
    if not (isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other)):
        return False
    return bool(np.abs(np.subtract(one, other)).max() > SAME_PRIMARIES)


def _no_truth(comparison: Comparison, entry: Entry | None, attributes: Mapping[str, object]) -> str | None:
    """Return the evidence that B, with these attributes, is the input of a resolve; None without evidence."""
    reference = comparison.reference
    source = reference.path(comparison.truth_number(comparison.test.first))
    if entry is not None and entry.input_sha256 == file_sha256(source):
        return "A was resolved from the frames of B"
    # A truth is in a subfolder of the capture, and only the capture's folder has the record.
    drawn = (reference.folder / CAPTURE).exists() and RESOLVED not in attributes
    return "B is a capture of one sample a pixel" if drawn else None


def _read_otherwise(capture: FrameSequence, number: int, settings: Mapping[str, Any] | None, entry: Entry) -> bool:
    """Return True if a resolve's manifest states another profile or step, or other matrices for that frame."""
    if settings is None:
        return False
    reading = json.loads(json.dumps(capture.reading))  # as it comes back from a manifest
    otherwise = any(settings.get(key) != value for key, value in reading.items())
    return otherwise or entry.beside_sha256 != capture.beside_sha256(number)


def content_sha256(sequence: FrameSequence, others: Iterable[NumberedFiles] = ()) -> str:
    """Return one SHA-256 of the frames, the truth and ``others``, from the capture's record, else from the files.

    For another tool's files it also covers how they are read. For cltaa's own that is only the step, which is left out.
    """
    recorded: dict[str, str] = {}
    paths: list[Path] = []
    truth = [] if sequence.reference is None else [sequence.reference]
    for images in (sequence, *truth, *others):
        paths += images.paths
        place = _name(images.folder, sequence)
        below = "" if images.folder == sequence.folder else f"{place}/"
        recorded |= {f"{below}{name}": found for name, found in recorded_hashes(images.folder).items()}
    digest = hashlib.sha256()
    for path in paths:
        name = _name(path, sequence)
        digest.update(os.fsencode(f"{name} {recorded.get(name) or file_sha256(path)}\n"))
    for number in sequence.numbers:
        if (beside := sequence.beside_sha256(number)) is not None:
            digest.update(f"{number} {beside}\n".encode())
    if sequence.reading.keys() - {"step"}:
        digest.update(msgspec.json.encode(sequence.reading))
    return digest.hexdigest()


def _name(path: Path, sequence: FrameSequence) -> str:
    """Return a path relative to the sequence's folder if it is inside, else unchanged."""
    inside = path.is_relative_to(sequence.folder)
    return (path.relative_to(sequence.folder) if inside else path).as_posix()
