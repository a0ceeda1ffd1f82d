"""Frame numbers: which are asked for, which are missing, and how they are told."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from collections.abc import Sequence as Many
from enum import StrEnum
from itertools import pairwise
from math import gcd
from pathlib import Path

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.files.names import renumbered

FrameRange = tuple[int, int]  # numbers of the first and the last frame, both included


class OnBreak(StrEnum):
    """What to do where a sequence breaks off: a frame is missing, or the size is another."""

    ERROR = "error"  # refuse the sequence
    RESET = "reset"  # begin a new history behind it


def on_break(mode: OnBreak | str) -> OnBreak:
    """The mode of that name; raises UsageError for a word that is none."""
    if mode not in [*OnBreak]:
        raise UsageError("no such way to go on behind a break", expected=", ".join(OnBreak), found=mode)
    return OnBreak(mode)


def chosen_numbers(numbers: Many[int], frames: FrameRange | None, folder: Path) -> list[int]:
    """Those of the sorted frame ``numbers`` that are asked for; raises UsageError unless both ends are there."""
    if frames is None:
        return list(numbers)
    first, last = frames
    for end in frames:
        if end not in numbers:
            raise no_such_frame(folder, end, numbers)
    if first > last:
        raise UsageError("the range of frames is empty", path=folder, found=f"{first}-{last}")
    return [number for number in numbers if first <= number <= last]


def check_steps(paths: Mapping[int, Path], frames: FrameRange, step: int, gaps: OnBreak) -> None:
    """Raise DataError for a number between two steps, InputMissing for one that is not there unless it may be.

    A step below 1 is a UsageError.
    """
    first, last = frames
    if step < 1:
        raise UsageError("the step between frames is wrong", expected="a whole number from 1 on", found=step)
    numbers = [number for number in sorted(paths) if first <= number <= last]
    for number in numbers:
        if (number - first) % step:
            expected, cure = f"every {step}. frame from {first} on", "leave --step out, or move the others elsewhere"
            raise DataError(
                "the frame lies between two steps", path=paths[number], frame=number, expected=expected, cure=cure
            )
    for number in range(first, last + 1, step) if gaps is OnBreak.ERROR else ():
        if number not in paths:
            apart = even_step(numbers)
            path = renumbered(next(iter(paths.values())), number)
            raise frame_missing(path, number, 1 if apart == step else apart)


def even_step(numbers: Many[int]) -> int:
    """How far three or more sorted numbers lie apart, most of them that far and others by multiples of it, else 1."""
    apart = [after - before for before, after in pairwise(numbers)]
    even = gcd(*apart)
    return even if len(apart) > 1 and 2 * apart.count(even) > len(apart) else 1


def missing_from(numbers: Many[int], step: int) -> list[int]:
    """Numbers between the first and the last of the sorted ``numbers``, ``step`` apart, that are none of them."""
    return sorted(set(range(numbers[0], numbers[-1] + 1, step)) - set(numbers))


def no_such_frame(folder: Path, number: int, numbers: Many[int]) -> UsageError:
    """The error for a frame that was asked for and is none of the sorted ``numbers``."""
    return UsageError("no such frame", path=folder, frame=number, expected=ranges(numbers))


def no_truth(path: Path, number: int, wanted: Iterable[int], there: Collection[int]) -> InputMissing:
    """The error for a frame without its truth, which has the numbers ``there``."""
    cure = "capture it again, or render it"
    if not set(wanted) & set(there):
        cure = "the two have no frame number in common: number them alike"
    what = "the reference of this frame is missing"
    return InputMissing(what, path=path, frame=number, found=ranges(there), cure=cure)


def frame_missing(path: Path, number: int, apart: int = 1) -> InputMissing:
    """The error for a frame that should be there; ``apart`` above 1 is the step that was meant, and was not given."""
    cure = "capture or render it again, or go on without it by cltaa resolve --gaps reset or cltaa compare --frames A-B"
    if apart > 1:
        cure = f"the frames are {apart} apart: --step {apart} takes each as the one after the last"
    return InputMissing("the frame is missing", path=path, frame=number, cure=cure)


def ranges(numbers: Iterable[int]) -> str:
    """Frame numbers for a reader: write 1, 2, 3, 7 as "1-3, 7"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(one_range(first, last) for first, last in runs)


def named_frames(numbers: Iterable[int]) -> str:
    """Frames for a reader: write "frame 5", or "frames 1-3, 7"."""
    several = list(numbers)
    return f"frame{'s' * (len(several) != 1)} {ranges(several)}"


def one_range(first: int, last: int) -> str:
    """Write ``first`` to ``last`` for a reader."""
    return str(first) if first == last else f"{first}-{last}"
