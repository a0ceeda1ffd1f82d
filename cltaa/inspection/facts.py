"""What the headers of a sequence say together, and what is wrong with that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
import numpy as np

from cltaa.errors import CltaaError
from cltaa.exr.attributes import FrameHeader
from cltaa.exr.layout import LOSSLESS, Layout
from cltaa.exr.read import read_header
from cltaa.frames import Effect, Matrix
from cltaa.sequences.frame_numbers import named_frames
from cltaa.sequences.pixel_statistics import ChannelStatistics
from cltaa.sequences.sources import open_images

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


def describe_layouts(result: Inspection, layouts: Mapping[int, Layout]) -> None:
    """Say in ``result`` what files of these layouts, by frame number, hold; the others are held against the first."""
    if not layouts:
        return
    number, first = next(iter(layouts.items()))
    result.width, result.height, result.size = first.width, first.height, first.size
    result.channels, result.compression = dict(sorted(first.channels.items())), first.compression
    for name, differ in (("size", "differs from that"), ("channels", "differ from those")):
        others = [other for other, layout in layouts.items() if getattr(layout, name) != getattr(first, name)]
        if others:
            result.problems.append(f"{name} of {named_frames(others)} {differ} of frame {number}")
    lossy = sorted({layout.compression for layout in layouts.values()} - LOSSLESS)
    if lossy:
        result.problems.append(f"compression {', '.join(lossy)} loses precision; depth and motion need all of it")
    for channel in ("backward.u", "backward.v"):
        if first.channels.get(channel) == "half":
            result.problems.append(f"channel {channel} is half precision: wrong by up to 1/2048 of its length")


def describe_headers(result: Inspection, headers: Headers) -> None:
    """Say in ``result`` what cameras, jitter, exposure and declared effects do over the frames; at least one."""
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
        result.problems.append(f"cltaa:frame of {named_frames(renamed)} is not the number in the file name")
    others = [number for number, header in headers.items() if header.effects != first.effects]
    if others:
        result.problems.append(f"other effects than the first are declared by {named_frames(others)}")
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


def describe_reference(result: Inspection, folder: Path, paths: Mapping[int, Path]) -> None:
    """Say in ``result`` what truth there is in ``folder`` for the frames at ``paths``."""
    if not (folder / "reference").exists():
        return
    try:
        truth = open_images(folder / "reference")
        samples = read_header(truth.path(truth.first)).attributes.get("cltaa:samples")
    except CltaaError as error:
        result.problems.append(str(error))
        return
    result.reference = Reference(frames=len(truth), samples=samples if isinstance(samples, int) else None)
    result.disk_bytes += sum(map(size_of, truth.paths))
    without = sorted(set(paths) - set(truth.numbers))
    if without:
        result.problems.append(f"reference missing for {named_frames(without)}")
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


def size_of(path: Path) -> int:
    """Bytes of a file; 0 where it is none."""
    return path.stat().st_size if path.is_file() else 0
