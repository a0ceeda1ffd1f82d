"""Folders of numbered EXR files: which files there are, their numbers and sizes, and what vouches for them.

cltaa writes ``<name>.<frame:04d>.exr``. Others put ``_``, ``-`` or nothing before the number, or have no name at all:
Blender writes ``0001.exr`` unless it is told otherwise. The number is the last thing before the suffix.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Self

from cltaa.errors import DataError, InputMissing
from cltaa.exr.layout import Layout, Part, Window
from cltaa.exr.outline import read_layout
from cltaa.files.manifest import recorded_hashes
from cltaa.files.names import NUMBERED
from cltaa.printable import counted
from cltaa.sequences.below import only_below, sequences_below
from cltaa.sequences.frame_numbers import (
    FrameRange,
    OnBreak,
    check_steps,
    chosen_numbers,
    no_such_frame,
    on_break,
    one_range,
)

# What a folder without frames may hold in their place.
PICTURES = frozenset({".bmp", ".dpx", ".exr", ".hdr", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff"})
ONE_REGION = "render one region in all frames, or the whole picture: no autocrop"


class NumberedFiles:
    """EXR files of one name; frame numbers are those in the file names.

    Each file that is read must have the SHA-256 that is recorded for it, if one is; ``verify`` False leaves that out.
    ``gaps`` and ``on_resize`` say whether a number may be missing and whether sizes may differ. Where ``frames`` are
    given, the first and the last number, no file outside them counts, whatever is wrong with it. ``step`` is how far
    numbers lie apart.
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
    ) -> None:
        """Read every layout; raises InputMissing for a gap and DataError for damaged files or sizes that differ."""
        self.folder, self.name, self.verify = folder, name, verify
        self.gaps, self.on_resize = on_break(gaps), on_break(on_resize)
        self.step = step
        numbers = chosen_numbers(sorted(paths), frames, folder)
        check_steps(paths, (numbers[0], numbers[-1]), step, self.gaps)
        self._paths = {number: paths[number] for number in numbers}
        self.layouts: dict[int, Layout] = {}
        before: Layout | None = None
        for number, path in self._paths.items():
            self.layouts[number] = layout = self.layout_of(path)
            check_size(layout, before or layout, number, self.on_resize)
            before = layout

    @staticmethod
    def layout_of(path: Path) -> Layout:
        """What a file's header says of its picture; raises InputMissing and DataError."""
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

    def __len__(self) -> int:
        """Count of frames."""
        return len(self._paths)

    def __repr__(self) -> str:
        """The folder, the numbers and the size."""
        numbers = f"{one_range(self.first, self.last)}, {self.width} x {self.height}"
        return f"{type(self).__name__}({str(self.folder)!r}: {counted(len(self), 'frame')}, {numbers})"

    def path(self, number: int) -> Path:
        """Return the file of a frame number; raises UsageError for one outside the sequence."""
        if number not in self._paths:
            raise no_such_frame(self.folder, number, self.numbers)
        return self._paths[number]

    def shows(self, region: Window) -> Part:
        """Rows and columns of an image that lie in a region, which begins at the first pixel of the display window."""
        left, top, *_ = self.layouts[self.first].region
        return slice(region[1] - top, region[3] - top + 1), slice(region[0] - left, region[2] - left + 1)

    def sha256(self, number: int) -> str | None:
        """Return the SHA-256 that a frame's file must have, or None where none is recorded or is to be verified."""
        return self._recorded.get(self.path(number).name) if self.verify else None

    def beside_sha256(self, number: int) -> str | None:
        """Return what vouches for all that a frame is made from beside its file: None, for nothing is."""
        del number
        return None

    @cached_property
    def _recorded(self) -> dict[str, str]:
        return recorded_hashes(self.folder)

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included; raises UsageError unless these two are there."""
        return type(self)(
            self.folder, self.name, self._paths, verify=self.verify, gaps=self.gaps, on_resize=self.on_resize,
            frames=(first, last), step=self.step,
        )  # fmt: skip


def check_size(layout: Layout, before: Layout, number: int, on_resize: OnBreak) -> None:
    """Raise DataError unless frame ``number`` has the size of the one before, or may have another, and its region."""
    if (layout.width, layout.height) != (before.width, before.height):
        if on_resize is OnBreak.RESET:
            return
        cure = "all frames of a sequence have one size; cltaa resolve --on-resize reset begins anew at each change"
        if layout.display_size == before.display_size:
            cure = ONE_REGION
        raise DataError(
            "size differs", path=layout.path, frame=number, expected=before.size, found=layout.size, cure=cure
        )
    check_region(layout, before, f"the frame before, {before.path.name}", number)


def check_region(layout: Layout, other: Layout, named: str, number: int | None = None) -> None:
    """Raise DataError where two pictures of one size are other regions of their display windows."""
    if layout.region != other.region or layout.display_size != other.display_size:
        raise DataError(
            f"shows another region than {named}", path=layout.path, frame=number, expected=other.size,
            found=layout.size, cure=ONE_REGION,
        )  # fmt: skip


def shared_region(one: NumberedFiles, other: NumberedFiles) -> Window | None:
    """What both show, from the first pixel of their display window on; None where they show one picture.

    Raises DataError where their sizes differ without one display window, or where they show nothing in common.
    """
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


def numbered_files(folder: Path, suffix: str = ".exr") -> tuple[Path, str, dict[int, Path]]:
    """Find the frames of a folder: the folder, their name and the file of each number; errors as ``open_sequence``."""
    try:
        files = sorted(entry for entry in folder.iterdir() if entry.suffix == suffix and entry.name[0] != ".")
    except FileNotFoundError as error:
        raise folder_missing(folder) from error
    except OSError as error:
        cure = "name the folder that its frames are in" if folder.suffix == ".exr" else None
        raise InputMissing(f"the folder cannot be read: {error.strerror}", path=folder, cure=cure) from error
    matches = {path: NUMBERED.fullmatch(path.name) for path in files}
    names = sorted({match["name"] if match else path.name for path, match in matches.items()})
    if not any(matches.values()):
        raise no_frames(folder, files)
    if len(names) > 1:
        cure = "keep one sequence in a folder; another tool's: use --profile, in Python cltaa.inputs.opening.open_input"
        raise DataError("several sequences in one folder", path=folder, found=", ".join(names), cure=cure)
    paths: dict[int, Path] = {}
    for path, match in matches.items():
        number = int(match["number"]) if match else 0
        if number in paths:
            raise DataError("two files have one frame number", path=path, frame=number, found=paths[number].name)
        paths[number] = path
    return folder, names[0], paths


def folder_missing(folder: Path) -> InputMissing:
    """The error for a folder that is not there, or for a pattern of files where a folder is meant."""
    pattern = folder.suffix == ".exr" and folder.parent.is_dir()
    cure = f"name the folder that its frames are in: {folder.parent}" if pattern else "check the name"
    return InputMissing("the folder is missing", path=folder, cure=cure)


def no_frames(folder: Path, files: Iterable[Path]) -> InputMissing:
    """The error for a folder none of whose EXR ``files`` has a number."""
    names = [path.name for path in files]
    suffix = Path(names[0]).suffix if names else ".exr"
    cure = f"number the frames, as in {Path(names[0]).stem}.0001{suffix}" if names else None
    if any(re.search(r"(^|[._-])-[0-9]+\.exr$", name) for name in names):
        cure = "numbers below 0 are not read: number the frames from 0 or 1 on"
    elif any(re.search(r"[0-9]{10,}\.exr$", name) for name in names):
        cure = "numbers have nine digits at most: number the frames from 0 or 1 on"
    found = ", ".join(names)
    if not names:
        below = sequences_below(folder)
        if below:
            return only_below(folder, below)
        others = sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in PICTURES)
        found = f"no EXR, but {others[0]}" if others else "nothing"
        cure = "convert the frames to OpenEXR, linear and with .exr in small letters" if others else None
    return InputMissing(
        "no frames in the folder", path=folder, expected=f"<name>.<frame>{suffix}", found=found, cure=cure
    )
