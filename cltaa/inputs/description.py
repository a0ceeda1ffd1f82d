"""How a folder of another tool's files would be read, and what their pixels then hold, for a reader."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from cltaa.errors import CltaaError
from cltaa.exr.channels import frame_planes
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import open_with_gaps
from cltaa.inputs.roles import shown_name
from cltaa.sequences.frame_numbers import ranges
from cltaa.sequences.pixel_statistics import ChannelStatistics, pixel_problems


class Description(msgspec.Struct, kw_only=True):
    """Profile and why, frames, the channels of each role, the channels of none, and what is missing."""

    folder: str
    profile: str
    reason: str
    first: int
    last: int
    frames: int
    width: int
    height: int
    size: str  # and of a region of the display window, which
    channels: dict[str, list[str]]
    unused: list[str]
    notes: list[str]
    statistics: dict[str, ChannelStatistics] = {}  # of what a resolve takes, by the channels of cltaa's own files
    problems: list[str] = []


def describe_input(
    folder: Path,
    *,
    profile: str,
    assignments: Sequence[str] = (),
    side_file: Path | None = None,
    step: int = 1,
    pixels: bool = False,
    advance: Callable[[int, int], None] | None = None,
) -> Description:
    """Decide how ``folder`` is read, and say so; raises what ``open_with_gaps`` raises.

    With ``pixels`` every frame is read and converted as for a resolve, and what is wrong with it is listed, not raised.
    ``advance(done, total)`` is called after every frame.
    """
    intake = open_with_gaps(folder, profile=profile, assignments=assignments, side_file=side_file, step=step)
    numbers = sorted(intake.declared)
    size = intake.layouts[numbers[0]]
    several = len(intake.sets) > 1
    found = Description(
        folder=str(folder), profile=intake.profile.name, reason=intake.reason, first=numbers[0], last=numbers[-1],
        frames=len(numbers), width=size.width, height=size.height, size=size.size,
        channels={role: [shown_name(place, several) for place in places] for role, places in intake.roles.items()},
        unused=intake.unused, notes=intake.notes,
        problems=[f"frames missing: {ranges(intake.missing)}"] if intake.missing else [],
    )  # fmt: skip
    if pixels:
        _look(found, ForeignSequence(folder, intake, numbers), advance)
    return found


def _look(found: Description, sequence: ForeignSequence, advance: Callable[[int, int], None] | None) -> None:
    for done, number in enumerate(sequence.numbers, start=1):
        try:
            planes = frame_planes(sequence.frame(number), sequence.path(number))
        except CltaaError as error:
            found.problems.append(str(error))
            planes = {}
        for channel, plane in planes.items():
            if channel != "Z" or "depth" in sequence.intake.roles:  # else it is filled in
                found.statistics.setdefault(channel, ChannelStatistics()).add(plane)
        if advance is not None:
            advance(done, found.frames)
    found.problems += pixel_problems(found.statistics)
