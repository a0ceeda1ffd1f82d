"""The layout of an EXR image: channels, windows, compression, and which window is the picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera

PIXEL_BYTES = {"uint": 4, "half": 2, "float": 4}
# Name and scan lines per chunk, in the order of their numbers in the file.
COMPRESSIONS = (
    ("none", 1),
    ("rle", 1),
    ("zips", 1),
    ("zip", 16),
    ("piz", 32),
    ("pxr24", 16),
    ("b44", 32),
    ("b44a", 32),
    ("dwaa", 32),
    ("dwab", 256),
    ("htj2k256", 256),
    ("htj2k32", 32),
    ("lj2k", 256),
    ("zstd", 1),
)
COMPRESSION_NUMBERS = {name: number for number, (name, _) in enumerate(COMPRESSIONS)}
LOSSLESS = frozenset({"none", "rle", "zips", "zip", "piz", "htj2k256", "htj2k32", "zstd"})

Window = tuple[int, int, int, int]  # x and y of the first pixel, x and y of the last
Part = tuple[slice, slice]  # rows and columns
# The option for files that cltaa did not write, whatever attributes they have kept.
OTHER_TOOLS = "another tool's files: cltaa resolve --profile parts, in Python cltaa.open(..., profile='parts')"
Windows = tuple[Window, Window]  # of the data, and of the display


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of an EXR image or a part of one: channel name -> "uint", "half" or "float", windows, compression.

    The picture is the data window, all that was drawn: a region of the display window, or more than it (overscan).
    """

    path: Path
    channels: dict[str, str]
    data_window: Window
    display_window: Window
    compression: str
    part: str | None = None  # name of the part, None in a file of one image
    windows: Mapping[str, Window] = field(default_factory=dict)  # data windows of channels, in a file of several parts
    tile: tuple[int, int] | None = None  # columns and rows of a tile, None for chunks of scan lines
    in_file: Window | None = field(default=None, compare=False)  # the file's data window, where another was chosen

    @property
    def width(self) -> int:
        """Columns of the picture, which is the data window."""
        return self.data_window[2] - self.data_window[0] + 1

    @property
    def height(self) -> int:
        """Rows of the picture, which is the data window."""
        return self.data_window[3] - self.data_window[1] + 1

    @property
    def display_size(self) -> tuple[int, int]:
        """Columns and rows of the display window, to which camera matrices and fractions of a picture refer."""
        return self.display_window[2] - self.display_window[0] + 1, self.display_window[3] - self.display_window[1] + 1

    @property
    def region(self) -> Window:
        """The window of the picture, with x and y counted from the first pixel of the display window."""
        left, top, right, bottom = self.data_window
        x, y, *_ = self.display_window
        return left - x, top - y, right - x, bottom - y

    def refuse_outside(self, frame: int | None = None) -> None:
        """Raise DataError where no part of the picture lies in the display window."""
        left, top, right, bottom = self.region
        if left >= self.display_size[0] or top >= self.display_size[1] or right < 0 or bottom < 0:
            what = "the data window lies outside of the display window"
            cure = "render a region of the picture, or the whole"
            expected, found = f"some of {self.display_window}", self.data_window
            raise DataError(what, path=self.path, frame=frame, expected=expected, found=found, cure=cure)

    def shown_by(self, channels: Iterable[str]) -> Layout:
        """Return the layout of the picture of some channels: their data window if they share one, or the display's."""
        windows = {self.windows.get(name, self.data_window) for name in channels}
        return self.showing(windows.pop() if len(windows) == 1 else self.display_window)

    def whole(self) -> Layout:
        """Return the layout of the whole display window."""
        return self.showing(self.display_window)

    def cropped(self, region: Window) -> Layout:
        """Return the layout of a region of the picture alone."""
        left, top, *_ = self.display_window
        data = region[0] + left, region[1] + top, region[2] + left, region[3] + top
        return self.showing(data)

    def showing(self, window: Window) -> Layout:
        """Return the layout of another picture of the same file."""
        return replace(self, data_window=window, in_file=self.file_window)

    @property
    def file_window(self) -> Window:
        """The data window of the file, whatever the picture is."""
        return self.in_file or self.data_window

    def check_unchanged(self, now: Layout) -> None:
        """Raise DataError where the file has other windows ``now``: it would be cropped or padded to this picture."""
        found, expected = (replace(each, data_window=each.file_window) for each in (now, self))
        if (found.data_window, found.display_window) != (expected.data_window, expected.display_window):
            what, cure = "the file changed after the sequence was opened", "run again"
            raise DataError(what, path=self.path, expected=expected.size, found=found.size, cure=cure)

    @property
    def size(self) -> str:
        """Columns and rows for a reader, and for a region or overscan its place in the display window."""
        size = f"{self.width} x {self.height}"
        if self.data_window == self.display_window:
            return size
        return f"{size} at ({self.region[0]}, {self.region[1]}) of {self.display_size[0]} x {self.display_size[1]}"

    @property
    def bytes_a_pixel(self) -> int:
        """Bytes of all channels of a pixel, as decoded."""
        return sum(PIXEL_BYTES[kind] for kind in self.channels.values())

    @property
    def decoded_bytes(self) -> int:
        """Bytes of all its pixels, as decoded."""
        return self.width * self.height * self.bytes_a_pixel

    @property
    def chunk_bytes(self) -> int:
        """Bytes of a chunk, as decoded; those at the right and at the bottom have fewer."""
        width, height = self.tile or (self.width, dict(COMPRESSIONS)[self.compression])
        return min(width, self.width) * min(height, self.height) * self.bytes_a_pixel


def placed(plane: NDArray[Any], window: Window, picture: Window, outside: float = 0.0) -> NDArray[Any]:
    """Return what lies in ``picture`` of a plane [H, W] with a data ``window``; beyond it floats are ``outside``."""
    if window == picture:
        return plane
    left, top, *_ = window
    if covers(window, picture):
        return plane[picture[1] - top : picture[3] - top + 1, picture[0] - left : picture[2] - left + 1]
    columns, rows = picture[2] - picture[0] + 1, picture[3] - picture[1] + 1
    made = np.full((rows, columns), outside if plane.dtype.kind == "f" else 0, plane.dtype)
    first, last = np.maximum(window[:2], picture[:2]), np.minimum(window[2:], picture[2:]) + 1
    if (first < last).all():
        there = plane[first[1] - top : last[1] - top, first[0] - left : last[0] - left]
        (x, y), (right, bottom) = first - picture[:2], last - picture[:2]
        made[y:bottom, x:right] = there
    return made


# Values outside of a frame's data window: no light, and no surface but the sky, which moves with the camera.
OUTSIDE = {"Z": np.inf, "backward.u": np.nan, "backward.v": np.nan}


def covers(window: Window, other: Window) -> bool:
    """True where all of ``other`` lies in ``window``."""
    left, top, right, bottom = window
    return left <= other[0] <= other[2] <= right and top <= other[1] <= other[3] <= bottom


def check_lossless(compression: str, path: Path | None = None) -> None:
    """Raise UsageError unless ``compression`` names a lossless one; ``path`` is the file to write."""
    if compression not in LOSSLESS:
        expected = ", ".join(sorted(LOSSLESS))
        raise UsageError("unknown or lossy compression", path=path, expected=expected, found=compression)


def shared_window(parts: Sequence[Layout]) -> Window:
    """Return the picture of all parts of a file: their data window if they share one, else the display window."""
    windows = {part.data_window for part in parts}
    return windows.pop() if len(windows) == 1 else parts[0].display_window


def of_region(camera: Camera, layout: Layout) -> Camera:
    """Return the camera of a file's picture from that of its display window: clip space moved and scaled."""
    if layout.data_window == layout.display_window:
        return camera
    (columns, rows), (left, top, *_) = layout.display_size, layout.region
    region = np.eye(4)
    region[0, 0], region[0, 3] = columns / layout.width, (columns - 2 * left) / layout.width - 1.0
    region[1, 1], region[1, 3] = rows / layout.height, 1.0 - (rows - 2 * top) / layout.height
    return Camera(camera.world_to_view, region @ camera.view_to_clip)
