"""How a folder of another tool's files would be read, and what their pixels then hold, for a reader."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from cltaa.errors import CltaaError
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import OPAQUE, Intake, damaged_files, open_with_gaps
from cltaa.inputs.roles import file_sets, shown_name
from cltaa.io.exr_frame import frame_planes
from cltaa.io.names import Named, Selection, selection_of
from cltaa.io.numbered import OnBreak, Problems, check_size, ranges
from cltaa.io.pixel_statistics import ChannelStatistics, Missing, missing_lines, missing_samples, pixel_problems


class Description(msgspec.Struct, kw_only=True):
    """Profile and why, frames, the channels of each role, the channels of none, and what is missing.

    All but ``folder`` and ``problems`` is empty where the files that can be read make no sequence.
    """

    folder: str
    profile: str = ""
    reason: str = ""
    first: int = 0
    last: int = 0
    frames: int = 0
    width: int = 0
    height: int = 0
    size: str = "unknown"  # and of a region of the display window, which
    channels: dict[str, list[str]] = {}
    unused: list[str] = []
    notes: list[str] = []
    exposures: tuple[float, float] = (1.0, 1.0)  # smallest and largest
    cuts: list[int] = []
    statistics: dict[str, ChannelStatistics] = {}  # of what a resolve takes, by the channels of cltaa's own files
    problems: list[str] = []


def describe_input(
    named: Named,
    *,
    profile: str,
    assignments: Sequence[str] = (),
    side_file: Path | None = None,
    step: int = 1,
    pixels: bool = False,
    advance: Callable[[int, int], None] | None = None,
) -> Description:
    """Decide how a sequence is read, and say so; damaged files are left out of that, and listed.

    With ``pixels`` every frame is read and converted as for a resolve, and what is wrong with it is listed, not raised.
    ``advance(done, total)`` is called after each frame. Raises as ``open_with_gaps``, where no file is damaged.
    """
    place = selection_of(named)
    wrong, sets = Problems(), file_sets(place)
    damaged = damaged_files(sets)
    for file in damaged.values():
        wrong.add(file.number, file.error)
    if len(damaged) == sum(map(len, sets.values())):
        return Description(folder=str(place), problems=wrong.lines)
    try:
        intake = open_with_gaps(
            place,
            profile=profile,
            assignments=assignments,
            side_file=side_file,
            step=step,
            damaged={path: file.number for path, file in damaged.items()},
            on_resize=OnBreak.RESET,
        )
    except CltaaError as error:
        if not damaged:
            raise
        return Description(folder=str(place), problems=[*wrong.lines, str(error)])
    found = _described(place, intake)
    _check_sizes(intake, wrong)
    lost = list[Missing]()
    if pixels:
        lost = _look(found, ForeignSequence(place.folder, intake, sorted(intake.declared)), wrong, advance)
        alpha = found.statistics.get("A", ChannelStatistics())
        if alpha.lowest == alpha.highest == 1.0 and not alpha.nan + alpha.infinite:
            found.notes = [*found.notes, OPAQUE]
    missing = [f"frames missing: {ranges(intake.missing)}"] if intake.missing else []
    found.problems = [*missing, *wrong.lines, *missing_lines(lost), *pixel_problems(found.statistics)]
    return found


def _described(place: Selection, intake: Intake) -> Description:
    numbers = sorted(intake.declared)
    size = intake.layouts[numbers[0]]
    exposures = [1.0 if known.exposure is None else known.exposure for known in intake.declared.values()]
    several = len(intake.sets) > 1
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
        channels={role: [shown_name(place, several) for place in places] for role, places in intake.roles.items()},
        unused=intake.unused,
        notes=intake.notes,
        exposures=(min(exposures), max(exposures)),
        cuts=[number for number in numbers if intake.declared[number].cut],
    )


def _check_sizes(intake: Intake, wrong: Problems) -> None:
    """Add to what is ``wrong`` the frames of another size than the first."""
    first = intake.layouts[min(intake.layouts)]
    for number, layout in intake.layouts.items():
        try:
            check_size(layout, first, number, OnBreak.ERROR)
        except CltaaError as error:
            wrong.add(number, error)


def _look(
    found: Description, sequence: ForeignSequence, wrong: Problems, advance: Callable[[int, int], None] | None
) -> list[Missing]:
    lost = list[Missing]()
    for done, number in enumerate(sequence.numbers, start=1):
        try:
            frame = sequence.frame(number)
            planes = frame_planes(frame, sequence.path(number))
            lost += [missing] if (missing := missing_samples(frame.colour, number)) else []
        except CltaaError as error:
            wrong.add(number, error)
            planes = {}
        for channel, plane in planes.items():
            if channel != "Z" or "depth" in sequence.intake.roles:  # else it is filled in
                found.statistics.setdefault(channel, ChannelStatistics()).add(plane)
        if advance is not None:
            advance(done, found.frames)
    return lost
