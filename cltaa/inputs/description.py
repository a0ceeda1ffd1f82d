"""How a folder of another tool's files would be read, for a reader."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from cltaa.inputs.intake import open_intake
from cltaa.inputs.parts import read_any_header
from cltaa.inputs.roles import Place, shown_name


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
    channels: dict[str, list[str]]
    unused: list[str]
    notes: list[str]


def describe_input(
    folder: Path, *, profile: str, assignments: Sequence[str] = (), side_file: Path | None = None
) -> Description:
    """Decide how ``folder`` is read, and say so; raises what ``open_intake`` raises."""
    intake = open_intake(folder, profile=profile, assignments=assignments, side_file=side_file)
    numbers = sorted(intake.declared)
    size = intake.layouts[numbers[0]]
    used = {place for places in intake.roles.values() for place in places}
    several = len(intake.sets) > 1
    there = [
        Place(label, channel)
        for label, files in sorted(intake.sets.items())
        for channel in read_any_header(files[min(files)]).layout.channels
    ]
    return Description(
        folder=str(folder), profile=intake.profile.name, reason=intake.reason, first=numbers[0], last=numbers[-1],
        frames=len(numbers), width=size.width, height=size.height,
        channels={role: [shown_name(place, several) for place in places] for role, places in intake.roles.items()},
        unused=[shown_name(place, several) for place in there if place not in used], notes=intake.notes,
    )  # fmt: skip
