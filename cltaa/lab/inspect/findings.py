"""Contents and problems of a sequence, captured or another tool's.

A broken promise (an effect that is present but not declared) makes a resolve wrong, because the plan trusts the
declaration. An idle effect (declared but never present) only costs time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.core.plan import CHANGING, nothing_changes
from cltaa.errors import CltaaError, check_flags, public
from cltaa.frame import Effect, Frame, Matrix
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import OPAQUE, Intake, damaged_files, open_with_gaps
from cltaa.inputs.open import is_own
from cltaa.inputs.profile import Profile
from cltaa.inputs.roles import file_sets, shown_name
from cltaa.io.exr_frame import (
    COLOUR,
    MOTION,
    NO_PIXELS,
    Pixels,
    check_float_channels,
    check_frame_channels,
    frame_outline,
    frame_planes,
)
from cltaa.io.exr_header import read_layout
from cltaa.io.exr_layout import LOSSLESS, Layout
from cltaa.io.exr_read import read_header, read_image
from cltaa.io.manifest import recorded_hashes
from cltaa.io.names import Named, Selection, selection_of
from cltaa.io.numbered import (
    FrameRange,
    OnBreak,
    Problems,
    as_pictures,
    check_size,
    checked_step,
    chosen_numbers,
    even_step,
    named_frames,
    numbered_files,
    one_range,
)
from cltaa.io.pixel_statistics import (
    ChannelStatistics,
    Meaningless,
    Missing,
    meaningless,
    meaningless_lines,
    missing_lines,
    missing_samples,
    needless_channels,
    pixel_problems,
)
from cltaa.io.sequence import RESOLVED, open_images
from cltaa.lab.check.jitter import LARGEST_MEAN_PX
from cltaa.lab.inspect.changes import ColourChange, DepthChange, Uncovering

Headers = Mapping[int, Frame]


class Jitter(msgspec.Struct, kw_only=True):
    """Sample offsets: the period in frames (None: longer than the sequence), the mean over it, the largest."""

    period: int | None
    mean_px: tuple[float, float]
    largest_px: float


class Reference(msgspec.Struct, kw_only=True):
    """The truth beside a sequence; ``samples`` a pixel, None if its header does not say."""

    frames: int
    samples: int | None


class Inspection(msgspec.Struct, kw_only=True):
    """Everything that ``cltaa inspect`` reports; frame lists hold frame numbers."""

    folder: str
    name: str
    scene: str = ""
    resolved_by: str = ""  # the preset, if a resolve wrote the files
    first: int = 0
    last: int = 0
    frames: int = 0
    size: str = "unknown"  # includes the position of a region in the display window
    width: int = 0
    height: int = 0
    compression: str = ""
    channels: dict[str, str] = {}
    effects: list[str] | None = None  # None: nothing is declared
    jitter: Jitter | None = None
    camera: str = ""  # still, or moves, zooms, shifts (its centre moves, as by jitter left in it)
    orthographic: bool = False
    cuts: list[int] = []
    exposures: tuple[float, float] = (1.0, 1.0)  # smallest and largest
    reference: Reference | None = None
    disk_bytes: int = 0
    statistics: dict[str, ChannelStatistics] = {}
    problems: list[str] = []
    idle: list[str] = []  # declared effects that never occur; they only cost time


def describe_layouts(result: Inspection, layouts: Mapping[int, Layout]) -> None:
    """Fill ``result`` from the layouts by frame number, and compare all with the first."""
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
    """Fill ``result`` from cameras, jitter, exposure and declared effects of at least one frame."""
    first = next(iter(headers.values()))
    result.scene, result.orthographic = first.scene, first.camera.orthographic
    result.effects = None if first.effects is None else sorted(first.effects)
    result.cuts = [number for number, header in headers.items() if header.cut]
    exposures = [header.exposure for header in headers.values()]
    result.exposures = (min(exposures), max(exposures))
    moves = not _constant(header.camera.world_to_view for header in headers.values())
    zooms = not _constant(header.camera.view_to_clip[:2, :2] for header in headers.values())
    shifts = not zooms and not _constant(header.camera.view_to_clip for header in headers.values())
    does = {"moves": moves, "zooms": zooms, "shifts": shifts}
    result.camera = " and ".join(word for word, on in does.items() if on) or "still"
    result.jitter = _jitter([header.jitter_px for header in headers.values()])
    mean = max(abs(component) for component in result.jitter.mean_px)
    if result.jitter.period is not None and mean > LARGEST_MEAN_PX:
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
    """Return a problem for each effect that the headers show and the declaration lacks."""
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
    """Fill ``result`` with the truth in ``folder`` for the frames at ``paths``."""
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
    """Return the size of a file in bytes; 0 if it does not exist."""
    return path.stat().st_size if path.is_file() else 0


BRIGHT = 8.0  # "far above 1"
# Each of these changes which surface a pixel shows.
MOVING = frozenset({Effect.CAMERA, Effect.MOTION, Effect.DISOCCLUSION, Effect.CUT})


class Witness:
    """Examines the frames of a sequence in order for undeclared changes."""

    def __init__(self) -> None:
        self._depth, self._colour, self._disoccluded = DepthChange(), ColourChange(), Uncovering()

    def look(self, header: Frame, channels: Mapping[str, Pixels]) -> None:
        """Examine one frame."""
        declared = header.effects
        if declared is None:
            return
        if not declared & MOVING:
            self._depth.look(header, np.asarray(channels["Z"], np.float32))
        elif Effect.DISOCCLUSION not in declared:
            self._disoccluded.look(header, channels)
        if nothing_changes(declared):
            self._colour.look(header, np.stack([np.asarray(channels[name], np.float32) for name in "RGB"]))

    def broken(self, brightest: float, declared: frozenset[Effect]) -> list[str]:
        """Return a problem for each effect that the pixels, at most ``brightest``, show and ``declared`` lacks."""
        problems = []
        if brightest > BRIGHT and Effect.HDR not in declared:
            problems.append(f"effect hdr shows in the pixels (up to {brightest:.4g}) but is not declared")
        if self._depth.frame is not None:
            problems.append(_undeclared("depth changes", self._depth.frame, MOVING))
        elif self._colour.frame is not None:
            problems.append(_undeclared("colour changes", self._colour.frame, CHANGING))
        if self._disoccluded.frame is not None:
            problems.append(
                f"something comes into view at frame {self._disoccluded.frame}, but effect disocclusion is not declared"
            )
        return problems


def _undeclared(what: str, frame: int, effects: frozenset[Effect]) -> str:
    return f"{what} at frame {frame}, but no effect out of {', '.join(sorted(effects))} is declared"


def _idle(statistics: Mapping[str, ChannelStatistics], brightest: float, declared: frozenset[Effect]) -> list[str]:
    """Return a line for each declared effect that never occurs, with the evidence."""
    nothing = ChannelStatistics()
    vectors = [channel for name, channel in statistics.items() if name.startswith("backward.")]
    reactive, alpha = statistics.get("reactive", nothing), statistics.get("A", nothing)
    idle = {  # values between 1 and BRIGHT may count as HDR or not
        Effect.MOTION: (
            "the motion channel is zero or NaN everywhere",
            all(v.zero + v.nan == v.count for v in vectors),
        ),
        Effect.REACTIVE: ("channel reactive is 0 everywhere", reactive.zero == reactive.count),
        Effect.ALPHA: ("channel A is 1 everywhere", alpha.is_one or not alpha.count),
        Effect.HDR: ("no value is above 1", brightest <= 1.0),
        Effect.SKY: ("depth is finite everywhere", statistics["Z"].infinite == 0),
    }
    return [
        f"effect {effect} is declared, but {says}: leave it out and save its step"
        for effect, (says, sure) in idle.items()
        if sure and effect in declared
    ]


def inspect_folder(
    named: Named,
    *,
    pixels: bool = False,
    step: int = 1,
    frames: FrameRange | None = None,
    advance: Callable[[int, int], None] | None = None,
) -> Inspection:
    """Inspect every file of a sequence, or those of ``frames``, both included; lists problems and does not raise them.

    ``pixels`` also decodes the files, and checks them against their recorded SHA-256 and their declared effects. Calls
    ``advance(done, total)`` after every file. Raises InputMissing or DataError only if ``named`` is not one sequence,
    and UsageError if it lacks an end of ``frames``.
    """
    place = selection_of(named)
    folder, name, paths = numbered_files(place)
    paths = {number: paths[number] for number in chosen_numbers(sorted(paths), frames, folder)}
    result = Inspection(folder=str(place), name=name, first=min(paths), last=max(paths), frames=len(paths))
    result.problems += _missing(sorted(paths), step)
    recorded: dict[Path, dict[str, str]] = {}
    for parent in sorted({path.parent for path in paths.values()} if pixels else ()):
        try:
            recorded[parent] = recorded_hashes(parent)
        except CltaaError as error:
            recorded[parent] = {}
            result.problems.append(str(error))
    layouts: dict[int, Layout] = {}
    headers: dict[int, Frame] = {}
    witness, wrong, pictures, lost = Witness(), Problems(), _pictures(paths), Lost()
    for done, (number, path) in enumerate(sorted(paths.items()), start=1):
        try:
            header = read_header(path)
            layouts[number] = layout = pictures.get(number, header.layout)
            result.resolved_by = str(header.attributes.get(RESOLVED, ""))
            if RESOLVED in header.attributes:  # an image that a resolve wrote needs no depth
                check_float_channels(header.layout, COLOUR)
            else:
                check_frame_channels(header.layout)
            # Results from other tools' files may have no jitter.
            if not result.resolved_by or "cltaa:jitterPx" in header.attributes:
                headers[number] = frame_outline(path, header.attributes, layout)
            if pixels:
                channels = read_image(path, sha256=recorded[path.parent].get(path.name), picture=layout)[0]
                for channel, plane in channels.items():
                    result.statistics.setdefault(channel, ChannelStatistics()).add(plane)
                lost.look(_with_pixels(headers.get(number), number, channels), first=number == result.first)
                if not result.resolved_by:
                    witness.look(headers[number], channels)
        except CltaaError as error:
            wrong.add(number, error)
        result.disk_bytes += size_of(path)
        if advance is not None:
            advance(done, len(paths))
    result.problems += wrong.lines
    describe_layouts(result, layouts)
    if headers:
        describe_headers(result, headers)
    describe_reference(result, folder, paths)
    result.problems += lost.lines + pixel_problems(result.statistics, orthographic=result.orthographic)
    result.problems += needless_channels(result.statistics)
    if pixels and headers and not result.resolved_by:
        declared, shown = next(iter(headers.values())).effects, result.statistics
        if declared is not None and shown:
            brightest = max(0.0, *(shown[name].highest for name in COLOUR))
            result.problems += witness.broken(brightest, declared)
            result.idle = _idle(shown, brightest, declared)
    return result


class Lost:
    """The samples, depths and vectors that frames lack."""

    def __init__(self) -> None:
        self._missing, self._meaningless = list[Missing](), list[Meaningless]()

    def look(self, frame: Frame, *, first: bool) -> None:
        """Count those of a frame, as ``meaningless`` does."""
        self._missing += [lost] if (lost := missing_samples(frame.colour, frame.alpha, frame.index)) else []
        self._meaningless += meaningless(frame, first=first)

    @property
    def lines(self) -> list[str]:
        """What was counted, in sentences."""
        return missing_lines(self._missing) + meaningless_lines(self._meaningless)


def _with_pixels(header: Frame | None, number: int, channels: Mapping[str, Pixels]) -> Frame:
    """Return the frame of a header with the pixels of its file; a result has no depth, and perhaps no header."""

    planes = {name: np.asarray(plane, np.float32) for name, plane in channels.items()}
    motion = np.stack([planes[name] for name in MOTION], axis=-1) if MOTION[0] in planes else None
    given: dict[str, Any] = {"depth": planes.get("Z"), "motion": motion}
    given |= {"alpha": planes.get("A"), "reactive": planes.get("reactive")}
    colour = np.stack([planes[name] for name in COLOUR], axis=-1)
    return replace(header or Frame(number, NO_PIXELS), colour=colour, **given)


def _pictures(paths: Mapping[int, Path]) -> dict[int, Layout]:
    """Return the layouts of the readable files, as the sequence shows them."""
    layouts: dict[int, Layout] = {}
    for number, path in sorted(paths.items()):
        with suppress(CltaaError):
            layouts[number] = read_layout(path)
    with suppress(CltaaError):  # the loop over the files reports it
        return as_pictures(layouts, OnBreak.RESET)
    return layouts


def _missing(numbers: list[int], step: int) -> list[str]:
    """Return the problem of missing frames, if any."""
    gaps = [one_range(one + 1, other - 1) for one, other in pairwise(numbers) if other != one + step]
    if not gaps:
        return []
    apart, what = even_step(numbers), f"frames missing: {', '.join(gaps)}"
    return [what if apart == 1 else f"{what}; those there are {apart} apart: --step {apart}"]


class Description(msgspec.Struct, kw_only=True):
    """How another tool's sequence is read: profile with reason, frames, channels of each role, unused, missing.

    Only ``folder`` and ``problems`` are filled if the readable files form no sequence.
    """

    folder: str
    profile: str = ""
    reason: str = ""
    first: int = 0
    last: int = 0
    frames: int = 0
    width: int = 0
    height: int = 0
    size: str = "unknown"  # includes the position of a region in the display window
    channels: dict[str, list[str]] = {}
    unused: list[str] = []
    notes: list[str] = []
    exposures: tuple[float, float] = (1.0, 1.0)  # smallest and largest
    cuts: list[int] = []
    statistics: dict[str, ChannelStatistics] = {}  # of the converted values, by cltaa's channel names
    problems: list[str] = []


def describe_input(
    named: Named, *, pixels: bool = False, advance: Callable[[int, int], None] | None = None, **reading: Any
) -> Description:
    """Describe how a sequence would be read; leaves out damaged files and lists them.

    ``pixels`` also reads and converts every frame as for a resolve; lists problems and does not raise them. Calls
    ``advance(done, total)`` after each frame. ``reading`` goes to ``open_with_gaps``, whose errors are raised if no
    file that is asked for is damaged.
    """
    place = selection_of(named)
    wrong, sets = Problems(), file_sets(place)
    damaged = damaged_files(sets)
    first, last = reading.get("frames") or (-math.inf, math.inf)
    for file in damaged.values():
        if first <= file.number <= last:
            wrong.add(file.number, file.error)
    if len(damaged) == sum(map(len, sets.values())):
        return Description(folder=str(place), problems=wrong.lines)
    try:
        without = {path: file.number for path, file in damaged.items()}
        intake = open_with_gaps(place, damaged=without, on_resize=OnBreak.RESET, **reading)
    except CltaaError as error:
        if not wrong.lines:
            raise
        return Description(folder=str(place), problems=[*wrong.lines, str(error)])
    found, sequence = _described(place, intake), ForeignSequence(place.folder, intake, sorted(intake.declared))
    _check_sizes(intake, wrong)
    for number, fault in sequence.unreadable():
        wrong.add(number, fault)
    lost = Lost()
    if pixels:
        _look(found, sequence, wrong, lost, advance)
        if found.statistics.get("A", ChannelStatistics()).is_one:
            found.notes = [*found.notes, OPAQUE]
    missing = [f"frames missing: {intake.missing_text}"] if intake.missing else []
    orthographic = any(known.camera is not None and known.camera.orthographic for known in intake.declared.values())
    of_pixels = pixel_problems(found.statistics, orthographic=orthographic)
    found.problems = [*missing, *wrong.lines, *lost.lines, *of_pixels]
    return found


@public("inspect")
def inspect_input(
    named: Named,
    *,
    profile: str | Path | Profile = "auto",
    assignments: Sequence[str] = (),
    side_file: str | Path | None = None,
    step: int = 1,
    frames: FrameRange | None = None,
    pixels: bool = False,
    advance: Callable[[int, int], None] | None = None,
) -> Inspection | Description:
    """Inspect cltaa's own sequence with ``inspect_folder``, another tool's with ``describe_input``.

    Raises UsageError for no such profile, InputMissing where no frames are, DataError for files that no profile reads.
    """
    check_flags(pixels=pixels)
    checked_step(step)
    place, asked = selection_of(named), bool(assignments) or side_file is not None
    if not asked and (profile == "cltaa" or (profile == "auto" and is_own(place))):
        return inspect_folder(place, pixels=pixels, step=step, frames=frames, advance=advance)
    reading: Any = {"profile": profile, "assignments": assignments, "side_file": side_file, "step": step}
    reading["frames"] = frames
    return describe_input(place, pixels=pixels, advance=advance, **reading)


def _described(place: Selection, intake: Intake) -> Description:
    numbers = sorted(intake.declared)
    size = intake.layouts[numbers[0]]
    exposures = [1.0 if known.exposure is None else known.exposure for known in intake.declared.values()]
    return Description(
        folder=str(place),
        profile=intake.profile.name,
        reason=intake.reason,
        first=numbers[0],
        last=numbers[-1],
        frames=len(numbers),
        width=size.width,
        height=size.height,
        size=size.size,
        channels={role: [shown_name(place, intake.sets) for place in places] for role, places in intake.roles.items()},
        unused=intake.unused,
        notes=intake.notes,
        exposures=(min(exposures), max(exposures)),
        cuts=[number for number in numbers if intake.declared[number].cut],
    )


def _check_sizes(intake: Intake, wrong: Problems) -> None:
    """Add frames whose size differs from the first to ``wrong``."""
    first = intake.layouts[min(intake.layouts)]
    for number, layout in intake.layouts.items():
        try:
            check_size(layout, first, number, OnBreak.ERROR)
        except CltaaError as error:
            wrong.add(number, error)


def _look(
    found: Description,
    sequence: ForeignSequence,
    wrong: Problems,
    lost: Lost,
    advance: Callable[[int, int], None] | None,
) -> None:
    for done, number in enumerate(sequence.numbers, start=1):
        try:
            frame = sequence.frame(number)
            planes = frame_planes(frame, sequence.path(number))
            lost.look(frame, first=number == found.first)
        except CltaaError as error:
            wrong.add(number, error)
            planes = {}
        for channel, plane in planes.items():
            if channel != "Z" or "depth" in sequence.intake.roles:  # else the reader fills in depth
                found.statistics.setdefault(channel, ChannelStatistics()).add(plane)
        if advance is not None:
            advance(done, found.frames)
