"""Opening a sequence that anybody wrote: choose the profile, find the channels, say what is missing, read frames."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from collections.abc import Sequence as Many
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.exr.layout import Layout
from cltaa.exr.read import ImageHeader
from cltaa.files.names import renumbered
from cltaa.inputs.declared import Declared, declared_frames
from cltaa.inputs.guess import guessed_profile, no_colour
from cltaa.inputs.notes import notes_of
from cltaa.inputs.parts import read_any_header
from cltaa.inputs.profile import Profile, load_profile
from cltaa.inputs.profile_text import override
from cltaa.inputs.roles import KEYS, Place, Roles, describe, file_sets, shown_name, whole_numbers
from cltaa.inputs.side_file import Side, read_side_file
from cltaa.inputs.views import ONE_VIEW, Views, assign_view, views_of
from cltaa.sequences.frame_numbers import (
    FrameRange,
    OnBreak,
    check_steps,
    chosen_numbers,
    even_step,
    frame_missing,
    missing_from,
    named_frames,
    on_break,
    ranges,
)
from cltaa.sequences.numbered import check_size


@dataclass(slots=True)
class Intake:
    """What was decided about a folder before a pixel was read."""

    profile: Profile
    reason: str
    roles: Roles
    sets: dict[str, dict[int, Path]]
    attributes: dict[int, dict[str, object]]
    layouts: dict[int, Layout]
    declared: dict[int, Declared]
    first: dict[str, Layout]  # of each of ``sets``, that of its first file
    gaps: OnBreak = OnBreak.ERROR
    on_resize: OnBreak = OnBreak.ERROR
    step: int = 1  # how far frame numbers lie apart
    asked: tuple[str, Many[str]] = ("auto", ())  # profile and assignments, for a truth beside the frames
    damaged: Collection[int] = ()  # frames of which a file was left out, for it cannot be read
    views: Views = ONE_VIEW
    notes: list[str] = field(default_factory=list)  # what is missing, and what is done without it

    @property
    def has_camera(self) -> bool:
        """True when every frame declares its matrices."""
        return all(known.camera is not None for known in self.declared.values())

    @property
    def missing(self) -> list[int]:
        """Numbers of frames that are not there, with all of their files, between the first and the last."""
        return [number for number in missing_from(sorted(self.declared), self.step) if number not in self.damaged]

    @property
    def unused(self) -> list[str]:
        """The channels that play no role, as a reader is told of them."""
        used = {place for places in self.roles.values() for place in places}
        there = [Place(label, channel) for label, layout in sorted(self.first.items()) for channel in layout.channels]
        return [shown_name(place, len(self.sets) > 1) for place in there if place not in used]

    @property
    def has_jitter(self) -> bool:
        """True when every frame declares its jitter."""
        return all(known.jitter_px is not None for known in self.declared.values())


def open_intake(
    folder: Path,
    *,
    profile: str = "auto",
    assignments: Many[str] = (),
    side_file: Path | None = None,
    gaps: OnBreak = OnBreak.ERROR,
    on_resize: OnBreak = OnBreak.ERROR,
    frames: FrameRange | None = None,
    step: int = 1,
    damaged: Mapping[Path, int] = MappingProxyType({}),
) -> Intake:
    """Decide how ``folder`` is read, from its headers; raises InputMissing, DataError or UsageError.

    ``gaps`` and ``on_resize`` say whether a frame may be missing (in any of the files that are read) and whether sizes
    may differ; ``frames`` are the numbers of the first and the last one to take, both included, and no other counts.
    ``step`` is how far numbers lie apart. Files that are ``damaged``, and of which frame, are left out.
    """
    gaps, on_resize, sets = on_break(gaps), on_break(on_resize), file_sets(folder, damaged)
    first = {label: read_any_header(files[min(files)]) for label, files in sets.items()}
    channels = {label: tuple(header.layout.channels) for label, header in first.items()}
    attributes: dict[str, object] = {}
    for header in first.values():
        attributes = header.attributes | attributes
    chosen, reason = (load_profile(profile), "as asked") if profile != "auto" else guessed_profile(attributes, channels)
    chosen = override(chosen, assignments)
    views = views_of(attributes, channels, [header.views for header in first.values()])
    roles = _assigned(folder, chosen, assignments, channels, views)
    main = sets[roles["colour"][0].files]
    read = [sets[label] for label in {place.files for all_of in roles.values() for place in all_of}]
    there = sorted(number for number in main if all(number in files for files in read))
    if not there:
        raise InputMissing("no frame has all of its files", path=next(iter(main.values())), cure="render them again")
    numbers = chosen_numbers(there, frames, folder)
    for files in read:
        check_steps(files, frames or (min(main), max(main)), step, gaps)
    # What a profile says is late stands in files beside those that are asked for.
    late = step * max(abs(chosen.jitter.delay), abs(chosen.camera.delay))
    around = [number for number in there if numbers[0] - late <= number <= numbers[-1] + late]
    headers = {number: read_any_header(main[number]) for number in around}
    pictures = {number: header.layout for number, header in headers.items()}
    layouts = {number: pictures[number] for number in numbers}
    _refuse_whole_numbers(first, roles)
    for before, number in pairwise(numbers):
        check_size(layouts[number], layouts[before], number, on_resize)
    given = {number: header.attributes for number, header in headers.items()}
    side = {} if side_file is None else _side_of(side_file, numbers)
    known = declared_frames(chosen, given, side, pictures, step)
    declared = {number: known[number] for number in numbers}
    delays = {"matrices": step * chosen.camera.delay, "jitter": step * chosen.jitter.delay, "exposure": 0}
    _check_complete(folder, known, numbers, delays, side_file, side)
    intake = Intake(
        chosen, reason, roles, sets, given, layouts, declared,
        {label: header.layout for label, header in first.items()}, gaps, on_resize, step, (profile, assignments),
        frozenset(damaged.values()), views,
    )  # fmt: skip
    intake.notes += notes_of(intake, folder)
    return intake


def open_with_gaps(folder: Path, **reading: Any) -> Intake:
    """As ``open_intake``, to look at a sequence in which frames may be missing, unless it is for want of a step."""
    intake = open_intake(folder, **reading, gaps=OnBreak.RESET)
    missing = intake.missing
    first, last = min(intake.declared), max(intake.declared)
    apart = even_step(sorted({*intake.declared, *(number for number in intake.damaged if first < number < last)}))
    if missing and apart != intake.step:
        path = intake.sets[intake.roles["colour"][0].files][first]
        raise frame_missing(renumbered(path, missing[0]), missing[0], apart)
    return intake


def _assigned(
    folder: Path, profile: Profile, assignments: Many[str], channels: Mapping[str, Many[str]], views: Views
) -> Roles:
    """The channels of each role.

    Raises DataError where there is no colour, and UsageError where channels that were asked for by name are not there,
    other than ``none``, which leaves them out.
    """
    roles = assign_view(profile, channels, views)
    if "colour" not in roles:
        raise no_colour(folder, profile, channels, views)
    asked = dict(assignment.split("=", 1) for assignment in assignments)
    for role, key in KEYS.items():
        names = asked.get(key, "none").strip("[]' ")
        if role not in roles and names and "none" not in names.split():
            there = [
                shown_name(Place(label, name), len(channels) > 1) for label in channels for name in channels[label]
            ]
            raise UsageError(
                f"--input {key}={names}: no such channels", path=folder, found=" ".join(there),
                cure=f"do without by --input {key}='{' '.join(['none'] * (1 + (role == 'motion')))}'",
            )  # fmt: skip
    return roles


def _refuse_whole_numbers(headers: Mapping[str, ImageHeader], roles: Roles) -> None:
    """Raise DataError where a channel that is to be read as light, depth or motion holds whole numbers."""
    for place in (place for places in roles.values() for place in places):
        layout = headers[place.files].layout
        if layout.channels[place.channel] == "uint":
            raise whole_numbers(place, layout.path)


def _side_of(path: Path, numbers: Many[int]) -> dict[int, Side]:
    """What the side file says; raises DataError where it speaks of none of the frames."""
    side = read_side_file(path)
    if not side.keys() & set(numbers):
        raise DataError(
            "none of the frames is in the side file", path=path, expected=named_frames(numbers),
            found=ranges(sorted(side)), cure="number its frames as the files are",
        )  # fmt: skip
    return side


def _check_complete(
    folder: Path,
    known: Mapping[int, Declared],
    numbers: Many[int],
    delays: Mapping[str, int],
    side_file: Path | None,
    side: Mapping[int, Side],
) -> None:
    """Raise DataError where some frames have matrices, jitter or exposure and others have none: it would jump.

    The error names the frames that lack it, which lie by ``delays`` behind those that are read by it, and the side file
    where that has it for others.
    """
    for what, otherwise, told, given in (
        ("matrices", "with --input camera.source=none", "camera", "world_to_view"),
        ("jitter", "with --input jitter.source=none", "jitter_px", "jitter_px"),
        ("exposure", "of them", "exposure", "exposure"),
    ):
        without = [number for number in numbers if getattr(known[number], told) is None]
        if 0 < len(without) < len(numbers):
            late = delays[what]
            lacking = sorted({number + late if number + late in known else number for number in without})
            beside = any(getattr(one, given) is not None for one in side.values())
            where = "there" if beside else "with --camera FILE"
            raise DataError(
                f"no {what} for {named_frames(lacking)}", path=side_file if beside else folder,
                cure=f"give it to every frame {where}, or to none {otherwise}",
            )  # fmt: skip


def intake_lines(intake: Intake) -> Iterator[str]:
    """What was decided, for a reader: profile and reason, channels, what is missing."""
    yield f"profile {intake.profile.name}: {intake.reason}"
    yield f"channels: {describe(intake.roles, len(intake.sets) > 1)}"
    yield from intake.notes
