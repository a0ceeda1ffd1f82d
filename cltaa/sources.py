"""Sequences on disk: folders of ``<name>.<frame:04d>.exr``, opened as a whole and read a frame at a time.

Opening reads every file's layout (not its pixels), so that a gap, another size or a truncated file is known before
the first frame is worked on. Only one frame is in memory at a time, unless the caller keeps more.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.exr import ImageHeader, read_colour, read_frame, read_header
from cltaa.exr_attributes import FrameHeader
from cltaa.exr_channels import check_float_channels
from cltaa.exr_layout import Layout, read_layout
from cltaa.frames import Effect, Frame, Image
from cltaa.manifest import read_capture_record, recorded_hashes

_NUMBERED = re.compile(r"(?P<name>.+)\.(?P<number>[0-9]{1,9})\.exr", re.DOTALL)  # nine digits fit cltaa:frame, an int


class NumberedFiles:
    """EXR files of one name and size, numbered without a gap; frame numbers are those in the file names.

    Each file that is read must have the SHA-256 that is recorded for it, if one is; ``verify`` False leaves that out.
    """

    def __init__(self, folder: Path, name: str, paths: dict[int, Path], *, verify: bool = True) -> None:
        """Read every layout; raises InputMissing for a gap and DataError for damaged files or sizes that differ."""
        self.folder, self.name, self.verify = folder, name, verify
        self._paths = dict(sorted(paths.items()))
        for number in range(self.first, self.last + 1):
            if number not in self._paths:
                missing = folder / f"{name}.{number:04d}.exr"
                cure = "capture it again, or move the frames of each unbroken run into a folder of their own"
                raise InputMissing("the frame is missing", path=missing, frame=number, cure=cure)
        self.layouts: dict[int, Layout] = {}
        for number, path in self._paths.items():
            self.layouts[number] = layout = read_layout(path)
            if (layout.width, layout.height) != (self.width, self.height):
                expected, found = f"{self.width} x {self.height}", f"{layout.width} x {layout.height}"
                cure = "all frames of a sequence have one size"
                raise DataError("size differs", path=path, frame=number, expected=expected, found=found, cure=cure)

    @property
    def paths(self) -> tuple[Path, ...]:
        """Files in frame order."""
        return tuple(self._paths.values())

    @property
    def numbers(self) -> range:
        """Frame numbers in order."""
        return range(self.first, self.last + 1)

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
        """Columns."""
        return self.layouts[self.first].width

    @property
    def height(self) -> int:
        """Rows."""
        return self.layouts[self.first].height

    def __len__(self) -> int:
        """Count of frames."""
        return len(self._paths)

    def path(self, number: int) -> Path:
        """Return the file of a frame number; raises UsageError for one outside the sequence."""
        if number not in self._paths:
            expected = f"{self.first} to {self.last}"
            raise UsageError("no such frame", path=self.folder, frame=number, expected=expected)
        return self._paths[number]

    def sha256(self, number: int) -> str | None:
        """Return the SHA-256 that a frame's file must have, or None where none is recorded or is to be verified."""
        return self._recorded.get(self.path(number).name) if self.verify else None

    @cached_property
    def _recorded(self) -> dict[str, str]:
        return recorded_hashes(self.folder)

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included; raises UsageError unless all are there."""
        self.path(first), self.path(last)
        if first > last:
            raise UsageError("the range of frames is empty", path=self.folder, found=f"{first}-{last}")
        paths = {number: self._paths[number] for number in range(first, last + 1)}
        return type(self)(self.folder, self.name, paths, verify=self.verify)


class ImageSequence(NumberedFiles):
    """Colour only: a reference, or resolved frames. Iteration yields ``[H, W, 3]`` linear float32 in frame order."""

    def image(self, number: int) -> Image:
        """Read the colour of one frame number, [H, W, 3] linear float32."""
        return read_colour(self.path(number), sha256=self.sha256(number))

    def __iter__(self) -> Iterator[Image]:
        """Read the frames one after another."""
        return (self.image(number) for number in self.numbers)


class Sequence(NumberedFiles):
    """A captured sequence. Iteration yields a ``Frame`` at a time, in frame order.

    ``effects`` is what the first header declares, or None where it declares nothing; ``reference`` is the truth that
    lies in ``reference/``, or None; ``sequence_json`` is what ``sequence.json`` says about the capture, or empty.
    """

    @cached_property
    def header(self) -> ImageHeader:
        """Layout and attributes of the first frame, read without its pixels."""
        return read_header(self.path(self.first))

    @cached_property
    def effects(self) -> frozenset[Effect] | None:
        """Effects that the first frame declares, or None."""
        return self.frame_header(self.first).effects

    @cached_property
    def reference(self) -> ImageSequence | None:
        """The truth of every frame, or None; raises InputMissing or DataError where it is there but does not fit."""
        folder = self.folder / "reference"
        if not folder.exists():
            return None
        reference = open_images(folder, verify=self.verify)
        for number in self.numbers:
            if number not in reference.layouts:
                missing = folder / self.path(number).name
                raise InputMissing("the reference of this frame is missing", path=missing, frame=number)
        check_same_size(self, reference)
        return reference.select(self.first, self.last)

    @cached_property
    def sequence_json(self) -> dict[str, Any]:
        """Content of ``sequence.json``, or an empty dict where there is none."""
        return read_capture_record(self.folder)

    def frame_header(self, number: int) -> FrameHeader:
        """Camera, jitter, cut and exposure of one frame number, checked, read without its pixels."""
        path = self.path(number)
        return FrameHeader(path, read_header(path).attributes)

    def frame(self, number: int) -> Frame:
        """Read one frame by its number; raises DataError where header and sequence disagree."""
        frame = read_frame(self.path(number), sha256=self.sha256(number))
        if frame.index != number:
            raise DataError(
                "the file name and attribute cltaa:frame disagree", path=frame.path,
                expected=number, found=frame.index, cure="give the file its own number again",
            )  # fmt: skip
        if frame.effects != self.effects:
            expected, found = _names(self.effects), _names(frame.effects)
            what = "declares other effects than the first frame"
            raise DataError(what, path=frame.path, frame=number, expected=expected, found=found)
        return frame

    def __iter__(self) -> Iterator[Frame]:
        """Read the frames one after another."""
        return (self.frame(number) for number in self.numbers)


def open_sequence(folder: str | Path, *, verify: bool = True) -> Sequence:
    """Open a folder of ``<name>.<frame:04d>.exr`` files, reading layouts but no pixels.

    With ``verify`` every file that is read later must have the SHA-256 that ``sequence.json`` records for it.
    Raises InputMissing where the folder, its frames or a frame in the middle is missing, DataError where files are
    damaged, differ in size or belong to several sequences.
    """
    return Sequence(*numbered_files(Path(folder)), verify=verify)


def open_images(path: str | Path, *, verify: bool = True) -> ImageSequence:
    """Open resolved or reference images: a folder as ``open_sequence`` takes it, or one EXR file.

    A single file without a number is frame 0. ``verify`` and errors are those of ``open_sequence``,
    and DataError is raised where R, G or B is missing.
    """
    path = Path(path)
    if path.is_dir():
        images = ImageSequence(*numbered_files(path), verify=verify)
    else:
        match = _NUMBERED.fullmatch(path.name)
        number = int(match["number"]) if match else 0
        name = match["name"] if match else path.stem
        images = ImageSequence(path.parent, name, {number: path}, verify=verify)
    for layout in images.layouts.values():
        check_float_channels(layout, ("R", "G", "B"))
    return images


def check_same_size(one: NumberedFiles, other: NumberedFiles) -> None:
    """Raise DataError unless both have the same width and height."""
    if (one.width, one.height) != (other.width, other.height):
        expected, found = f"{one.width} x {one.height}", f"{other.width} x {other.height}"
        path = other.path(other.first)
        raise DataError(f"size differs from {one.folder}", path=path, expected=expected, found=found)


def numbered_files(folder: Path) -> tuple[Path, str, dict[int, Path]]:
    """Find the frames of a folder: the folder, their name and the file of each number; errors as ``open_sequence``."""
    try:
        files = sorted(entry for entry in folder.iterdir() if entry.suffix == ".exr" and entry.name[0] != ".")
    except FileNotFoundError as error:
        raise InputMissing("the folder is missing", path=folder, cure="check the name") from error
    except OSError as error:
        raise InputMissing(f"the folder cannot be read: {error.strerror}", path=folder) from error
    matches = {path: _NUMBERED.fullmatch(path.name) for path in files}
    names = sorted({match["name"] if match else path.name for path, match in matches.items()})
    if not any(matches.values()):
        raise InputMissing(
            "no frames in the folder", path=folder, expected="<name>.<frame>.exr", found=names or "nothing"
        )
    if len(names) > 1:
        cure = "keep one sequence in a folder"
        raise DataError("several sequences in one folder", path=folder, found=", ".join(names), cure=cure)
    paths: dict[int, Path] = {}
    for path, match in matches.items():
        number = int(match["number"]) if match else 0
        if number in paths:
            raise DataError("two files have one frame number", path=path, frame=number, found=paths[number].name)
        paths[number] = path
    return folder, names[0], paths


def _names(effects: frozenset[Effect] | None) -> str:
    return "nothing declared" if effects is None else ",".join(sorted(effects)) or "no effect"
