"""MP4 films of a sequence, H.264 for any player, encoded a frame at a time in constant memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from cltaa.errors import DataError, StorageError, UsageError, import_extra
from cltaa.frame import Image
from cltaa.io.atomic import atomic_path, check_creatable
from cltaa.io.display import GAP, Picture, side_by_side, to_picture, wipe
from cltaa.io.names import real_path
from cltaa.io.numbered import NumberedFiles

QUALITY = 16  # x264's constant rate factor: finer than its default of 23, whose blocks would hide the differences
SUFFIXES = (".mp4", ".m4v")  # players rely on them
USUAL_RATE = Fraction(24)  # frames a second, by default
LARGEST_SIDE = 16384  # pixels; x264 takes no more
RATES = (1, 240)  # frames a second that players support
BT709 = 1  # number of ITU-R BT.709 in the tables of H.264, for primaries, curve and matrix


class Video:
    """An MP4 file in the making; every picture has the size of the first."""

    def __init__(self, container: Any, rate: Fraction, path: Path) -> None:
        self._container, self._rate, self._path = container, rate, path
        self._stream: Any = None
        self._size: tuple[int, ...] = ()
        self.count = 0

    def add(self, picture: Picture) -> None:
        """Encode one 8-bit picture [H, W, 3]; an odd side is made even by repeating its last row or column."""
        if self._stream is None:
            self._start(picture)
        elif picture.shape != self._size:
            expected, found = list(self._size), list(picture.shape)
            raise DataError("picture size differs", path=self._path, frame=self.count, expected=expected, found=found)
        odd = [(0, side % 2) for side in picture.shape[:2]]
        padded = np.ascontiguousarray(np.pad(picture, [*odd, (0, 0)], mode="edge"))
        av = import_av()
        frame = av.VideoFrame.from_ndarray(padded, format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
        frame.pts = self.count
        frame.time_base = 1 / self._rate
        self._container.mux(self._stream.encode(frame))
        self.count += 1

    def finish(self) -> None:
        """Flush the encoder; raises DataError where no picture was added."""
        if self._stream is None:
            raise DataError("no frames to film", path=self._path)
        self._container.mux(self._stream.encode(None))

    def _start(self, picture: Picture) -> None:
        self._size = picture.shape
        self._stream = self._container.add_stream("libx264", rate=self._rate, options={"crf": str(QUALITY)})
        self._stream.height, self._stream.width = (side + side % 2 for side in picture.shape[:2])
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = BT709


def import_av() -> Any:
    """Import PyAV; raises UsageError that says what to install."""
    return import_extra("av", package="PyAV", extra="video", purpose="writing MP4")


@contextmanager
def open_video(path: Path, rate: Fraction | int = USUAL_RATE) -> Iterator[Video]:
    """Open an MP4 file for pictures at ``rate`` frames a second; it gets its name when the block ends without an error.

    Its index lies at the front, so that it plays while it loads. Raises UsageError without PyAV, OutputError where the
    file cannot be created and StorageError where writing fails.
    """
    av = import_av()
    with atomic_path(path) as temporary:
        try:
            # "file:", because a folder called http: would be taken for an address.
            with av.open(f"file:{temporary}", "w", format="mp4", options={"movflags": "faststart"}) as container:
                video = Video(container, Fraction(rate), path)
                yield video
                video.finish()
        except av.FFmpegError as error:
            raise StorageError(f"encoding failed: {error}", path=path, cure="check the free space") from error


def check_film(path: Path, sequence: NumberedFiles, output: Path, *, beside: bool) -> None:
    """Raise UsageError or OutputError before the work for what would stop a film of ``sequence`` after it; ``beside``
    doubles its width.

    A film in a folder that is created with ``output``, or with its parents, is not tried here.
    """
    import_av()
    folder, made = real_path(path.parent), [real_path(output), *real_path(output).parents]
    if real_path(path) in made:
        raise UsageError("the film would overwrite the output", path=path, cure="name another file or folder")
    if folder.is_dir() or folder not in made:
        check_creatable(path)
    if path.suffix.lower() not in SUFFIXES:
        expected, found = " or ".join(SUFFIXES), path.suffix or "no suffix"
        raise UsageError("a film must be an MP4", path=path, expected=expected, found=found)
    if len({(layout.width, layout.height) for layout in sequence.layouts.values()}) > 1:
        raise UsageError("a film of frames of several sizes", path=path, cure="leave --preview out")
    first = sequence.layouts[sequence.first]
    width = 2 * first.width + GAP if beside else first.width
    if max(width, first.height) > LARGEST_SIDE:
        expected, found = f"at most {LARGEST_SIDE} pixels a side", f"{width} x {first.height}"
        cure = "take --compare wipe" if beside else "leave --preview out"
        raise UsageError("the film would be too large", path=path, expected=expected, found=found, cure=cure)


def rate_of(attributes: Mapping[str, object], record: Mapping[str, Any], step: int = 1) -> Fraction:
    """Return the frames a second of a sequence: attribute ``framesPerSecond``, else ``fps`` of its ``record``, else 24.

    A rate that players do not support is ignored. Numbers ``step`` apart lower it, so that motion keeps its speed.
    """
    settings = record.get("settings")
    told: Any = attributes.get("framesPerSecond", settings.get("fps") if isinstance(settings, dict) else None)
    try:
        rate = Fraction(told).limit_denominator(1001)
    except (TypeError, ValueError, ArithmeticError):
        rate = USUAL_RATE
    return max(Fraction(RATES[0]), (rate if RATES[0] <= rate <= RATES[1] else USUAL_RATE) / step)


def write_video(path: Path, images: Iterable[Image], *, rate: Fraction | int = USUAL_RATE) -> None:
    """Write linear images [H, W, 3] as an MP4 through the display transform; errors as above."""
    with open_video(path, rate) as video:
        for image in images:
            video.add(to_picture(image))


WIPE_SECONDS = 4.0  # for the line to cross the picture and return


def write_pairs(
    path: Path,
    before: Iterable[Image],
    after: Iterable[Image],
    *,
    labels: tuple[str, str] = ("before", "after"),
    rate: Fraction | int = USUAL_RATE,
    swept: bool = False,
) -> None:
    """Write two sequences of one size side by side, labelled, or with ``swept`` on both sides of a moving line; errors
    as above."""
    with open_video(path, rate) as video:
        for left, right in zip(before, after, strict=True):
            if swept:
                turn = 2.0 * np.pi * video.count / (WIPE_SECONDS * float(rate))
                video.add(wipe(left, right, 0.5 - 0.5 * float(np.cos(turn)), labels))
            else:
                video.add(side_by_side(left, right, labels))
