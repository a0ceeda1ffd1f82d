"""What is in a captured sequence, and what is wrong with it, from the headers of its files alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

import msgspec
import numpy as np

from cltaa.errors import CltaaError
from cltaa.exr_attributes import FrameHeader
from cltaa.exr_channels import COLOUR, check_float_channels, frame_channels
from cltaa.exr_layout import LOSSLESS, Layout
from cltaa.exr_read import ImageHeader, read_header, read_image
from cltaa.frame_numbers import even_step, one_range, ranges
from cltaa.frames import Effect, Matrix
from cltaa.manifest import recorded_hashes
from cltaa.numbered import numbered_files
from cltaa.pixel_statistics import ChannelStatistics, needless_channels, pixel_problems
from cltaa.promises import Witness
from cltaa.sources import RESOLVED, open_images

LARGEST_MEAN_JITTER = 1e-3  # pixels; a mean that is not 0 shifts the whole image for good

Headers = Mapping[int, FrameHeader]


class Jitter(msgspec.Struct, kw_only=True):
    """Offsets of the samples: frames after which they repeat (None: not within the sequence), mean over a period."""

    period: int | None
    mean_px: tuple[float, float]
    largest_px: float


class Reference(msgspec.Struct, kw_only=True):
    """The truth beside a sequence; ``samples`` a pixel where its header tells."""

    frames: int
    samples: int | None


class Inspection(msgspec.Struct, kw_only=True):
    """Everything that ``cltaa inspect`` reports; frame lists hold frame numbers."""

    folder: str
    name: str
    scene: str = ""
    resolved_by: str = ""  # the preset, where these are results of a resolve
    first: int = 0
    last: int = 0
    frames: int = 0
    size: str = "unknown"  # and of a region of the display window, which
    width: int = 0
    height: int = 0
    compression: str = ""
    channels: dict[str, str] = {}
    effects: list[str] | None = None  # None: nothing is declared
    jitter: Jitter | None = None
    camera: str = ""  # still, moves, zooms, moves and zooms
    orthographic: bool = False
    cuts: list[int] = []
    exposures: tuple[float, float] = (1.0, 1.0)  # smallest and largest
    reference: Reference | None = None
    disk_bytes: int = 0
    statistics: dict[str, ChannelStatistics] = {}
    problems: list[str] = []
    idle: list[str] = []  # what is declared and never shows: it costs time and nothing else


def inspect_folder(
    folder: Path, *, pixels: bool = False, step: int = 1, advance: Callable[[int, int], None] | None = None
) -> Inspection:
    """Look at every file of a sequence. What is wrong is listed, not raised.

    With ``pixels`` the files are also decoded, and held against the SHA-256 that is recorded for them and against the
    effects that they declare.
    ``advance(done, total)`` is called after every file. Raises InputMissing or DataError only where there is no one
    sequence to look at.
    """
    _, name, paths = numbered_files(folder)
    result = Inspection(folder=str(folder), name=name, first=min(paths), last=max(paths), frames=len(paths))
    result.problems += _missing(sorted(paths), step)
    recorded = _recorded(folder, result.problems) if pixels else {}
    layouts: dict[int, Layout] = {}
    headers: dict[int, FrameHeader] = {}
    witness, wrong = Witness(), dict[object, tuple[str, list[int]]]()
    for done, (number, path) in enumerate(sorted(paths.items()), start=1):
        try:
            header = read_header(path)
            layouts[number] = header.layout
            result.resolved_by = str(header.attributes.get(RESOLVED, ""))
            _check_channels(header)
            headers[number] = FrameHeader(path, header.attributes, header.layout)
            if pixels:
                channels = read_image(path, sha256=recorded.get(path.name))[0]
                for channel, plane in channels.items():
                    result.statistics.setdefault(channel, ChannelStatistics()).add(plane)
                if not result.resolved_by:
                    witness.look(headers[number], channels)
        except CltaaError as error:
            wrong.setdefault(_kind(error), (str(error), []))[1].append(number)
        result.disk_bytes += _size(path)
        if advance is not None:
            advance(done, len(paths))
    result.problems += [_with_others(text, numbers[1:]) for text, numbers in wrong.values()]
    _describe_layouts(result, layouts)
    if headers:
        _describe_headers(result, headers)
    _describe_reference(result, folder, paths)
    result.problems += pixel_problems(result.statistics) + needless_channels(result.statistics)
    if pixels and headers:
        declared = next(iter(headers.values())).effects
        result.problems += witness.broken(declared)
        result.idle = witness.idle(declared)
    return result


def _missing(numbers: list[int], step: int) -> list[str]:
    """The problem of frames that are not there, if any."""
    gaps = [one_range(one + 1, other - 1) for one, other in pairwise(numbers) if other != one + step]
    if not gaps:
        return []
    apart, what = even_step(numbers), f"frames missing: {', '.join(gaps)}"
    return [what if apart == 1 else f"{what}; those there are {apart} apart: --step {apart}"]


def _recorded(folder: Path, problems: list[str]) -> dict[str, str]:
    """The hashes that files must have; a record that cannot be read is among the ``problems``."""
    try:
        return recorded_hashes(folder)
    except CltaaError as error:
        problems.append(str(error))
        return {}


def _check_channels(header: ImageHeader) -> None:
    """Refuse a frame without the channels that it needs: an image that a resolve wrote needs no depth."""
    if RESOLVED in header.attributes:
        check_float_channels(header.layout, COLOUR)
    else:
        frame_channels(header.layout)


def _kind(error: CltaaError) -> object:
    """The same for what is wrong in the same way with another frame."""
    return error.what, error.channel, str(error.expected), str(error.found)


def _with_others(problem: str, others: list[int]) -> str:
    return f"{problem}; the same in frame{'s' * (len(others) > 1)} {ranges(others)}" if others else problem


def _describe_layouts(result: Inspection, layouts: Mapping[int, Layout]) -> None:
    if not layouts:
        return
    number, first = next(iter(layouts.items()))
    result.width, result.height, result.size = first.width, first.height, first.size
    result.channels, result.compression = dict(sorted(first.channels.items())), first.compression
    for name, value in (
        ("size", attrgetter("size")),
        ("channels", attrgetter("channels")),
    ):
        others = [other for other, layout in layouts.items() if value(layout) != value(first)]
        if others:
            result.problems.append(f"{name} of frames {ranges(others)} differ from those of frame {number}")
    lossy = sorted({layout.compression for layout in layouts.values()} - LOSSLESS)
    if lossy:
        result.problems.append(f"compression {', '.join(lossy)} loses precision; depth and motion need all of it")
    for channel in ("backward.u", "backward.v"):
        if first.channels.get(channel) == "half":
            result.problems.append(f"channel {channel} is half precision: wrong by up to 1/2048 of its length")


def _describe_headers(result: Inspection, headers: Headers) -> None:
    first = next(iter(headers.values()))
    result.scene, result.orthographic = first.scene, first.camera.orthographic
    result.effects = None if first.effects is None else sorted(first.effects)
    result.cuts = [number for number, header in headers.items() if header.cut]
    exposures = [header.exposure for header in headers.values()]
    result.exposures = (min(exposures), max(exposures))
    moves = not _constant(header.camera.world_to_view for header in headers.values())
    zooms = not _constant(header.camera.view_to_clip for header in headers.values())
    result.camera = " and ".join(word for word, on in (("moves", moves), ("zooms", zooms)) if on) or "still"
    result.jitter = _jitter([header.jitter_px for header in headers.values()])
    mean = max(abs(component) for component in result.jitter.mean_px)
    if result.jitter.period is not None and mean > LARGEST_MEAN_JITTER:
        result.problems.append(f"jitter is not centred: its mean shifts the image by up to {mean:.3g} pixels")
    renamed = [number for number, header in headers.items() if header.index != number]
    if renamed:
        result.problems.append(f"cltaa:frame of frames {ranges(renamed)} is not the number in the file name")
    others = [number for number, header in headers.items() if header.effects != first.effects]
    if others:
        result.problems.append(f"frames {ranges(others)} declare other effects than the first")
    if first.effects is not None:
        result.problems += _broken_promises(result, first.effects)


def _broken_promises(result: Inspection, declared: frozenset[Effect]) -> list[str]:
    """Effects that the files show and the declaration leaves out; a resolve would trust the declaration."""
    shown = {
        Effect.CAMERA: result.camera != "still",
        Effect.MOTION: "backward.u" in result.channels,
        Effect.REACTIVE: "reactive" in result.channels,
        Effect.ALPHA: "A" in result.channels,
        Effect.CUT: any(number > result.first for number in result.cuts),
        Effect.EXPOSURE: result.exposures[0] != result.exposures[1],
    }
    return [f"effect {name} is there but not declared" for name, on in shown.items() if on and name not in declared]


def _describe_reference(result: Inspection, folder: Path, paths: Mapping[int, Path]) -> None:
    if not (folder / "reference").exists():
        return
    try:
        truth = open_images(folder / "reference")
        samples = read_header(truth.path(truth.first)).attributes.get("cltaa:samples")
    except CltaaError as error:
        result.problems.append(str(error))
        return
    result.reference = Reference(frames=len(truth), samples=samples if isinstance(samples, int) else None)
    result.disk_bytes += sum(map(_size, truth.paths))
    without = sorted(set(paths) - set(truth.numbers))
    if without:
        result.problems.append(f"reference missing for frames {ranges(without)}")
    if (truth.width, truth.height) != (result.width, result.height):
        result.problems.append(f"reference is {truth.layouts[truth.first].size}, frames {result.size}")


def _jitter(offsets: list[tuple[float, float]]) -> Jitter:
    count = len(offsets)
    periods = (p for p in range(1, count) if all(offsets[i] == offsets[i - p] for i in range(p, count)))
    period = next(periods, None)
    mean = np.mean(offsets[:period], axis=0)
    largest = float(np.abs(offsets).max())
    return Jitter(period=period, mean_px=(float(mean[0]), float(mean[1])), largest_px=largest)


def _constant(matrices: Iterable[Matrix]) -> bool:
    iterator = iter(matrices)
    first = next(iterator)
    return all(np.array_equal(matrix, first) for matrix in iterator)


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
