"""Folders of numbered files: which frames exist, which are missing, and what is wrong with single ones.

cltaa writes ``<name>.<frame:04d>.exr``. Other tools put ``_``, ``-`` or nothing before the number, or have no name at
all: Blender writes ``0001.exr`` by default, a denoiser ``shot.0001.denoised.exr``.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from collections.abc import Sequence as Many
from enum import StrEnum
from itertools import pairwise
from math import gcd
from numbers import Integral
from pathlib import Path
from typing import Any, NoReturn, Self, TypeVar

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.io.exr_header import read_layout
from cltaa.io.exr_layout import OTHER_TOOLS, Layout, Part, Window
from cltaa.io.manifest import CAPTURE, REFERENCE, recorded_hashes
from cltaa.io.names import (
    Named,
    Selection,
    has_suffix,
    leads_nowhere,
    pattern_of,
    renumbered,
    selection_of,
    without_copies,
)
from cltaa.printable import counted, printable, shell_word

DEEPEST = 3  # levels of folders below the named one; a project's folder can hold millions of files
MOST_FOLDERS = 500
MOST_NAMES = 5


def captures_below(folder: Path) -> list[Path]:
    """Return folders right below with a capture's record or a reference of their own."""
    marks = [*folder.glob(f"*/{CAPTURE}"), *folder.glob("*/reference")]
    return sorted({path.parent for path in marks if not REFERENCE.fullmatch(path.parent.name)})


def sequences_below(folder: Path) -> list[Path]:
    """Return some folders below that hold EXR files or a ``sequence.json``, in order, but no references."""
    found: list[Path] = []
    for looked_at, (name, folders, files) in enumerate(os.walk(folder)):
        place = Path(name)
        if looked_at == MOST_FOLDERS:
            break
        if place != folder and (CAPTURE in files or any(file.lower().endswith(".exr") for file in files)):
            found.append(place)
        deep = len(place.relative_to(folder).parts) >= DEEPEST
        folders[:] = [] if deep else sorted(f for f in folders if f[0] != "." and not REFERENCE.fullmatch(f))
    return found


def only_below(folder: Path, found: list[Path]) -> InputMissing:
    """Return the error for a folder without frames of its own, but with sequences below it."""
    names = [printable(str(path.relative_to(folder))) for path in found[:MOST_NAMES]]
    more = f" and {len(found) - MOST_NAMES} more" if len(found) > MOST_NAMES else ""
    what = "no frames in the folder itself, but sequences below it"
    cure = f"name one of them, such as {shell_word(found[0])}"
    return InputMissing(what, path=folder, found=", ".join(names) + more, cure=cure)


FrameRange = tuple[int, int]  # numbers of the first and the last frame, both included
Files = TypeVar("Files")


class OnBreak(StrEnum):
    """How to handle a break in a sequence: a missing frame, or another size."""

    ERROR = "error"  # refuse the sequence
    RESET = "reset"  # begin a new history after it

    @classmethod
    def _missing_(cls, value: object) -> NoReturn:
        raise UsageError("unknown way to continue after a break", expected=", ".join(cls), found=value)


def chosen_numbers(numbers: Many[int], frames: FrameRange | None, folder: Path) -> list[int]:
    """Return the sorted frame ``numbers`` that are asked for; raises UsageError unless both ends exist."""
    if frames is None:
        return list(numbers)
    first, last = checked_range(frames, folder)
    for end in frames:
        if end not in numbers:
            raise no_such_frame(folder, end, numbers)
    return [number for number in numbers if first <= number <= last]


def asked_alone(opened: Callable[[FrameRange | None], Files], frames: FrameRange | None) -> Files:
    """Return the ``frames`` alone, ``opened`` by their range; all, if an end is missing, of which the caller tells."""
    try:
        return opened(frames)
    except UsageError:
        return opened(None)


def first_of(numbers: Many[int], count: int, place: object) -> FrameRange:
    """Return the first and the last of the first ``count`` of ``numbers``, those of ``place``; warns of fewer."""
    if len(numbers) < count:
        warnings.warn(f"{place}: of the first {count} frames only {len(numbers)} exist", stacklevel=2)
    chosen = numbers[:count]
    return chosen[0], chosen[-1]


def checked_range(frames: FrameRange, folder: Path) -> FrameRange:
    """Return ``frames``; raises UsageError unless they are a first and a last number in their order."""
    if not (isinstance(frames, tuple | list) and len(frames) == 2 and all(isinstance(n, Integral) for n in frames)):
        expected = "the first and the last of them, as (8, 47)"
        raise UsageError("invalid range of frames", path=folder, expected=expected, found=repr(frames))
    first, last = frames
    if first > last:
        raise UsageError("the range of frames is empty", path=folder, found=f"{first}-{last}")
    return first, last


def checked_step(step: object) -> int:
    """Return ``step``; raises UsageError unless it is a whole number from 1 on."""
    if not isinstance(step, Integral) or step < 1:
        raise UsageError("the step between frames is wrong", expected="a whole number from 1 on", found=repr(step))
    return int(step)


def check_steps(paths: Mapping[int, Path], frames: FrameRange, step: int, gaps: OnBreak) -> None:
    """Raise DataError for a number between two steps, InputMissing for a missing one unless ``gaps`` allows that,
    UsageError for a step below 1."""
    first, last = frames
    checked_step(step)
    numbers = [number for number in sorted(paths) if first <= number <= last]
    for number in numbers:
        if (number - first) % step:
            what, expected = "the frame number lies between two steps", f"every {step}. frame from {first} on"
            cure = "leave --step out, or move the others elsewhere"
            raise DataError(what, path=paths[number], frame=number, expected=expected, cure=cure)
    for number in range(first, last + 1, step) if gaps is OnBreak.ERROR else ():
        if number not in paths:
            apart = even_step(numbers)
            its, path = next(iter(paths.items()))
            path = renumbered(path, number, its)
            raise frame_missing(path, number, 1 if apart == step else apart)


def even_step(numbers: Many[int]) -> int:
    """Return the step of three or more sorted numbers, most of them that far apart and others by multiples, else 1."""
    apart = [after - before for before, after in pairwise(numbers)]
    even = gcd(*apart)
    return even if len(apart) > 1 and 2 * apart.count(even) > len(apart) else 1


def missing_from(numbers: Many[int], step: int) -> list[int]:
    """Return the numbers missing between the first and the last of the sorted ``numbers``, ``step`` apart."""
    return sorted(set(range(numbers[0], numbers[-1] + 1, step)) - set(numbers))


def no_such_frame(folder: Path, number: int, numbers: Many[int]) -> UsageError:
    """Return the error for a requested frame that is none of the sorted ``numbers``."""
    if isinstance(number, Integral):
        return UsageError("no such frame", path=folder, frame=int(number), expected=ranges(numbers))
    return UsageError("no such frame", path=folder, expected=ranges(numbers), found=repr(number))


def no_truth(path: Path, number: int, wanted: Iterable[int], there: Collection[int]) -> InputMissing:
    """Return the error for a frame without its reference, which has the numbers ``there``."""
    cure = "capture it again, or render it"
    if not set(wanted) & set(there):
        cure = "the two have no frame number in common: number them alike"
    what = "the reference of this frame is missing"
    return InputMissing(what, path=path, frame=number, found=ranges(there), cure=cure)


def frame_missing(path: Path, number: int, apart: int = 1) -> InputMissing:
    """Return the error for a missing frame; ``apart`` above 1 is the step that was meant, and was not given."""
    what, again = "the frame is missing", "capture or render it again"
    if path.is_file():  # beside a list of files or a pattern
        what, again = "the frame is not among the files named", "name it too"
    cure = f"{again}, or go on without it by cltaa resolve --gaps reset or cltaa compare --frames A-B"
    if apart > 1:
        cure = f"the frames are {apart} apart: --step {apart} takes each as the one after the last"
    return InputMissing(what, path=path, frame=number, cure=cure)


def ranges(numbers: Iterable[int]) -> str:
    """Format frame numbers: 1, 2, 3, 7 as "1-3, 7"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(one_range(first, last) for first, last in runs)


def named_frames(numbers: Iterable[int]) -> str:
    """Format frames: "frame 5", or "frames 1-3, 7"."""
    several = list(numbers)
    return f"frame{'s' * (len(several) != 1)} {ranges(several)}"


def one_range(first: int, last: int) -> str:
    """Format the range ``first`` to ``last``."""
    return str(first) if first == last else f"{first}-{last}"


class Problems:
    """Errors by kind; each kind is reported in the words of the first frame that has it."""

    def __init__(self) -> None:
        """Begin without errors."""
        self._wrong: dict[object, tuple[str, list[int]]] = {}

    def add(self, number: int, error: CltaaError) -> None:
        """Add an error of frame ``number``; another one of the same frame and kind is ignored."""
        kind = error.what, error.channel, str(error.expected), str(error.found)
        numbers = self._wrong.setdefault(kind, (str(error), []))[1]
        if number not in numbers:
            numbers.append(number)

    @property
    def lines(self) -> list[str]:
        """A line for each kind of error, in the order of their first occurrence."""
        told = ((text, sorted(numbers[1:])) for text, numbers in self._wrong.values())
        return [f"{text}; the same in {named_frames(others)}" if others else text for text, others in told]


# Suffixes of what a folder without frames may hold in their place.
PICTURES = frozenset({".bmp", ".dpx", ".exr", ".hdr", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff"})
ONE_REGION = "render both with one display window"


class NumberedFiles:
    """EXR files of one name; frame numbers are those in the file names.

    Each file that is read must have its recorded SHA-256, if there is one, unless ``verify`` is False. ``gaps`` and
    ``on_resize`` say whether a number may be missing and whether sizes may differ. With ``frames``, the first and the
    last number, files outside them are ignored, whatever is wrong with them. ``step`` is the distance between numbers.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        paths: dict[int, Path],
        *,
        verify: bool = True,
        gaps: OnBreak = OnBreak.ERROR,
        on_resize: OnBreak = OnBreak.ERROR,
        frames: FrameRange | None = None,
        step: int = 1,
        layouts: Mapping[int, Layout] | None = None,
    ) -> None:
        """Read every layout, unless ``layouts`` holds all; raises InputMissing for a gap and DataError for damaged
        files or sizes that differ."""
        self.folder, self.name, self.verify = folder, name, verify
        self.gaps, self.on_resize = OnBreak(gaps), OnBreak(on_resize)
        self.step, self._hashes = step, dict[Path, dict[str, str]]()
        self._paths: dict[int, Path]
        self.layouts: dict[int, Layout]
        if layouts is not None:
            self._paths, self.layouts = dict(paths), {number: layouts[number] for number in paths}
            return
        if self.gaps is OnBreak.RESET:  # a link to a missing file is a missing frame
            paths = {number: path for number, path in paths.items() if not leads_nowhere(path)} or paths
        numbers = chosen_numbers(sorted(paths), frames, folder)
        check_steps(paths, (numbers[0], numbers[-1]), step, self.gaps)
        self._paths = {number: paths[number] for number in numbers}
        found = {number: self.layout_of(path) for number, path in self._paths.items()}
        self.layouts = as_pictures(found, self.on_resize)

    @staticmethod
    def layout_of(path: Path) -> Layout:
        """Return the layout of a file's picture from its header; raises InputMissing and DataError."""
        return read_layout(path)

    @property
    def paths(self) -> tuple[Path, ...]:
        """Files in frame order."""
        return tuple(self._paths.values())

    @property
    def numbers(self) -> tuple[int, ...]:
        """Frame numbers in order."""
        return tuple(self._paths)

    @property
    def first(self) -> int:
        """Number of the first frame."""
        return next(iter(self._paths))

    @property
    def last(self) -> int:
        """Number of the last frame."""
        return next(reversed(self._paths))

    @property
    def width(self) -> int:
        """Columns of the first frame."""
        return self.layouts[self.first].width

    @property
    def height(self) -> int:
        """Rows of the first frame."""
        return self.layouts[self.first].height

    @property
    def notes(self) -> list[str]:
        """Decisions about the files of another tool, line by line; none for own ones."""
        return []

    def __len__(self) -> int:
        """Return the count of frames."""
        return len(self._paths)

    def __repr__(self) -> str:
        """Show the folder, the numbers and the size."""
        numbers = f"{one_range(self.first, self.last)}, {self.width} x {self.height}"
        return f"{type(self).__name__}({str(self.folder)!r}: {counted(len(self), 'frame')}, {numbers})"

    def path(self, number: int) -> Path:
        """Return the file of a frame number; raises UsageError for one outside the sequence."""
        if number not in self._paths:
            raise no_such_frame(self.folder, number, self.numbers)
        return self._paths[number]

    def shows(self, region: Window) -> Part:
        """Return the rows and columns of an image in a region, given from the first pixel of the display window."""
        left, top, *_ = self.layouts[self.first].region
        return slice(region[1] - top, region[3] - top + 1), slice(region[0] - left, region[2] - left + 1)

    def sha256(self, number: int) -> str | None:
        """Return the SHA-256 that a frame's file must have, or None where none is recorded or verified."""
        return self.recorded(self.path(number))

    def recorded(self, path: Path) -> str | None:
        """Return the SHA-256 of a file in the record of its folder; None where it has none, or none is verified."""
        if not self.verify:
            return None
        if path.parent not in self._hashes:
            self._hashes[path.parent] = recorded_hashes(path.parent)
        return self._hashes[path.parent].get(path.name)

    def beside_sha256(self, number: int) -> str | None:
        """Return the hash of all that a frame is made from besides its file: None, for there is nothing."""
        del number
        return None

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, with their layouts among all; UsageError unless these two exist."""
        return self.of_numbers(chosen_numbers(self.numbers, (first, last), self.folder))

    def of_numbers(self, numbers: Many[int]) -> Self:
        """Return the frames of these numbers."""
        return type(self)(**self.alike() | {"paths": {number: self._paths[number] for number in numbers}})

    def alike(self) -> dict[str, Any]:
        """Return the arguments that create another one of the same files."""
        names = ("folder", "name", "verify", "gaps", "on_resize", "step", "layouts")
        return {name: getattr(self, name) for name in names} | {"paths": self._paths}


def as_pictures(layouts: Mapping[int, Layout], on_resize: OnBreak) -> dict[int, Layout]:
    """Return the layouts of frames, by number, for one history: where data windows differ, those of the display.

    A picture is the data window where all share one: a border render, or overscan. Raises DataError for display windows
    that differ, unless they may, and for pictures that lie outside of them.
    """
    runs: list[dict[int, Layout]] = []
    for number, layout in layouts.items():
        if not runs or next(iter(runs[-1].values())).display_size != layout.display_size:
            runs.append({})
        runs[-1][number] = layout
    found: dict[int, Layout] = {}
    for run in runs:
        several = len({layout.region for layout in run.values()}) > 1
        found |= {number: layout.whole() if several else layout for number, layout in run.items()}
    for before, number in pairwise(found):
        check_size(found[number], found[before], number, on_resize)
    for number, layout in found.items():
        layout.refuse_outside(number)
    return found


def check_size(layout: Layout, before: Layout, number: int, on_resize: OnBreak) -> None:
    """Raise DataError unless frame ``number`` has the size of the one before, or may have another, and its region."""
    if (layout.width, layout.height) != (before.width, before.height):
        if on_resize is OnBreak.RESET:
            return
        cure = "cltaa resolve --on-resize reset begins anew at each change; --frames A-B or a pattern"
        cure += " x.A-B#.exr chooses frames of one size"
        path, expected, found = layout.path, before.size, layout.size
        raise DataError("size differs", path=path, frame=number, expected=expected, found=found, cure=cure)
    check_region(layout, before, f"the frame before, {before.path.name}", number)


def check_region(layout: Layout, other: Layout, named: str, number: int | None = None) -> None:
    """Raise DataError where two pictures of one size show different regions of their display windows."""
    if layout.region != other.region or layout.display_size != other.display_size:
        what, path, expected = f"shows another region than {named}", layout.path, other.size
        raise DataError(what, path=path, frame=number, expected=expected, found=layout.size, cure=ONE_REGION)


def shared_region(one: NumberedFiles, other: NumberedFiles) -> Window | None:
    """Return the region of their display window that both show; None where they show one picture. Raises DataError
    where their sizes differ without one display window, or where they share no pixel."""
    first, second = one.layouts[one.first], other.layouts[other.first]
    if first.display_size != second.display_size:
        check_same_size(one, other)
        return None
    if first.region == second.region:
        return None
    left, top = (max(first.region[end], second.region[end]) for end in (0, 1))
    right, bottom = (min(first.region[end], second.region[end]) for end in (2, 3))
    if left > right or top > bottom:
        check_region(second, first, str(one.folder))
    return left, top, right, bottom


def check_same_size(one: NumberedFiles, other: NumberedFiles) -> None:
    """Raise DataError unless both have the same width and height, and show one region of one display window."""
    first, second = one.layouts[one.first], other.layouts[other.first]
    named = str(one.folder if len(one) > 1 else first.path)  # two files may lie in one folder
    if (one.width, one.height) != (other.width, other.height):
        raise DataError(f"size differs from {named}", path=second.path, expected=first.size, found=second.size)
    if first.display_size == second.display_size:  # else one of the two was written without its place
        check_region(second, first, named)


def files_in(place: Selection, suffix: str = ".exr", *, below: bool = False) -> list[Path]:
    """Return the visible files of a place with that suffix, with ``below`` also those of its folders, in order; raises
    InputMissing where the folder is missing or unreadable."""
    if place.files is not None:
        return [path for path in place.files if has_suffix(path, suffix) or place.alone]
    try:
        there = sorted(place.folder.iterdir())
    except FileNotFoundError as error:
        what, cure = "the folder is missing", "check the name"
        raise InputMissing(what, path=place.folder, cure=cure) from error
    except OSError as error:
        raise InputMissing(f"the folder cannot be read: {error.strerror}", path=place.folder) from error
    files = [entry for entry in there if has_suffix(entry, suffix) and entry.name[0] != "."]
    inner = sorted(place.folder.glob("*/*.*")) if below else []
    return files + [path for path in inner if has_suffix(path, suffix) and path.name[0] != "."]


def numbered_files(named: Named, suffix: str = ".exr") -> tuple[Path, str, dict[int, Path]]:
    """Find the frames of the one sequence that is ``named``: the folder, their name and the file of each number; errors
    as ``open_sequence``."""
    place = selection_of(named)
    files = without_copies(files_in(place, suffix))
    sets = place.by_name(files)
    if not sets:
        raise no_frames(place, files)
    # A file without a number beside frames is another sequence.
    frames = {path: number for numbers in sets.values() for number, path in numbers.items()}
    names = sorted({*sets, *(path.name for path in {*files} - {*frames})})
    if len(names) > 1:
        one = shell_word(pattern_of(*next(iter(frames.items()))))
        cure = f"name the files of one, such as {one}; {OTHER_TOOLS}"
        raise DataError("several sequences in one folder", path=place.folder, found=", ".join(names), cure=cure)
    return place.folder, names[0], sets[names[0]]


def no_frames(place: Selection, files: Iterable[Path]) -> InputMissing:
    """Return the error for a place none of whose EXR ``files`` has a number."""
    folder, paths = place.folder, [*files]
    names = [path.name for path in paths]
    suffix = Path(names[0]).suffix if names else ".exr"
    cure = f"number the frames, as in {Path(names[0]).stem}.0001{suffix}" if names else None
    marked = {re.sub("#+", "#", str(pattern_of(path))) for path in paths}
    if len(marked) == 1 < len(paths):
        cure = f"{cure}, or name them by a pattern: {shell_word(Path(*marked))}"
    if any(re.search(r"[0-9]{10,}", name) for name in names):
        cure = "numbers have nine digits at most: number the frames from 0 or 1 on"
    found = ", ".join(names)
    if not names:
        below = sequences_below(folder)
        if below:
            return only_below(folder, below)
        others = sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in PICTURES)
        found = f"no EXR, but {others[0]}" if others else "nothing"
        cure = "convert the frames to OpenEXR, in linear light" if others else None
    what, expected = "no frames in the folder", f"<name>.<frame>{suffix}"
    return InputMissing(what, path=folder, expected=expected, found=found, cure=cure)
