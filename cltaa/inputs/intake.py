"""Decide from its headers how to read another tool's sequence: profile, channels, matrices, what is missing."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from collections.abc import Sequence as Many
from dataclasses import dataclass, field, fields
from operator import attrgetter
from os.path import relpath
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError, public, several
from cltaa.inputs.declared import Declared, Stated, declared_frames, stated_names
from cltaa.inputs.profile import Profile, channels_option, keys_of, load_profile, option_text, override, profile_names
from cltaa.inputs.roles import (
    ALPHA_NAME,
    DEPTH_NAME,
    KEYS,
    MOTION_NAME,
    NO_LIGHT,
    ONE_VIEW,
    Z_ALONE,
    Place,
    Roles,
    Views,
    assign,
    assign_view,
    describe,
    file_sets,
    guessed_profile,
    has_named_colour,
    ignored_files,
    incomplete,
    no_colour,
    shown_name,
    views_of,
    whole_numbers,
    with_usual_names,
    without_vectors,
)
from cltaa.inputs.side_file import Side, read_side_file
from cltaa.io.exr_frame import COLOUR, check_number
from cltaa.io.exr_layout import Layout
from cltaa.io.exr_read import ImageHeader, read_any_header
from cltaa.io.names import Named, Selection, pattern_of, renumbered, selection_of
from cltaa.io.numbered import (
    FrameRange,
    OnBreak,
    as_pictures,
    check_steps,
    checked_range,
    chosen_numbers,
    even_step,
    first_of,
    frame_missing,
    missing_from,
    named_frames,
    ranges,
)
from cltaa.printable import written


class Damaged(NamedTuple):
    """The error of a file, its frame number, and the label of its set of files."""

    label: str
    number: int
    error: CltaaError


def damaged_files(sets: Mapping[str, Mapping[int, Path]]) -> dict[Path, Damaged]:
    """Return the unreadable files among ``sets``, by label and frame number; reads no pixels."""
    damaged = {}
    for label, files in sets.items():
        for number, path in files.items():
            try:
                read_any_header(path)
            except CltaaError as error:
                damaged[path] = Damaged(label, number, error)
    return damaged


class ReadAgain(dict[int, dict[str, object]]):
    """Attributes of frames by number, read from the headers of ``files`` on access, for the part of a ``channel``."""

    def __init__(self, files: Mapping[int, Path], channel: str) -> None:
        super().__init__()
        self.files, self.channel = files, channel

    def __missing__(self, number: int) -> dict[str, object]:
        """Read the attributes of a frame; raises what reading raises."""
        return self.setdefault(number, read_any_header(self.files[number]).of_channel(self.channel))


@dataclass(slots=True)
class Intake:
    """All decisions about a folder, made before any pixel is read."""

    profile: Profile
    reason: str
    roles: Roles
    sets: dict[str, dict[int, Path]]
    attributes: dict[int, dict[str, object]]
    layouts: dict[int, Layout]
    declared: dict[int, Declared]
    first: dict[str, Layout]  # layout of the first file of each of ``sets``
    gaps: OnBreak = OnBreak.ERROR
    on_resize: OnBreak = OnBreak.ERROR
    step: int = 1  # difference of consecutive frame numbers
    # Profile and assignments as asked for, to read a truth beside the frames.
    asked: tuple[str | Path | Profile, Many[str]] = ("auto", ())
    damaged: Collection[int] = ()  # numbers of frames with a file left out because it cannot be read
    views: Views = ONE_VIEW
    notes: list[str] = field(default_factory=list)  # what is missing, and what the resolve does without it

    def __reduce__(self) -> tuple[type[Intake], tuple[Any, ...]]:
        """Pickle all but the attributes, because some are OpenEXR objects that cannot be pickled."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        colour = self.roles["colour"][0]
        values["attributes"] = ReadAgain(self.sets[colour.files], colour.channel)
        return Intake, tuple(values.values())

    @property
    def has_camera(self) -> bool:
        """True when every frame declares its matrices."""
        return all(known.camera is not None for known in self.declared.values())

    @property
    def missing(self) -> list[int]:
        """Numbers between the first and the last frame whose files are missing."""
        return [number for number in missing_from(sorted(self.declared), self.step) if number not in self.damaged]

    @property
    def missing_text(self) -> str:
        """The missing frames for a message; of those that only some channel sets lack, the sets."""
        missing = self.missing
        read = sorted({place.files for places in self.roles.values() for place in places})
        lacking = {label: {number for number in missing if number not in self.sets[label]} for label in read}
        partly = set[int].union(*lacking.values()) - set[int].intersection(*lacking.values())
        whole = [number for number in missing if number not in partly]
        of_sets = {label: ranges(sorted(numbers & partly)) for label, numbers in lacking.items()}
        return "; ".join([ranges(whole)] * bool(whole) + [f"{label} of {of}" for label, of in of_sets.items() if of])

    @property
    def unused(self) -> list[str]:
        """Display names of the channels without a role."""
        used = {place for places in self.roles.values() for place in places}
        there = [Place(label, channel) for label, layout in sorted(self.first.items()) for channel in layout.channels]
        return [shown_name(place, self.sets) for place in there if place not in used]

    @property
    def has_jitter(self) -> bool:
        """True when every frame declares its jitter."""
        return all(known.jitter_px is not None for known in self.declared.values())


class _Found(NamedTuple):
    """What the first headers of a place tell: its files, and which channels are read by which profile."""

    sets: dict[str, dict[int, Path]]
    first: dict[str, ImageHeader]
    profile: Profile
    reason: str
    views: Views
    roles: Roles

    @property
    def main(self) -> dict[int, Path]:
        """The files of the colour."""
        return self.sets[self.roles["colour"][0].files]

    @property
    def read(self) -> list[dict[int, Path]]:
        """The sets of files that a role is read from."""
        return [self.sets[label] for label in {place.files for all_of in self.roles.values() for place in all_of}]

    @property
    def complete(self) -> list[int]:
        """Numbers of the frames that have all of their files; raises InputMissing where none has."""
        there = sorted(number for number in self.main if all(number in files for files in self.read))
        if not there:
            path = next(iter(self.main.values()))
            raise InputMissing("no frame has all of its files", path=path, cure="render them again")
        return there


def _found_in(
    place: Selection,
    profile: str | Profile,
    assignments: Many[str],
    damaged: Mapping[Path, int],
    frames: FrameRange | None = None,
    gaps: OnBreak = OnBreak.ERROR,
) -> _Found:
    sets = file_sets(place, damaged, existing=gaps is OnBreak.RESET)
    low, high = frames or (-math.inf, math.inf)  # frames that are not asked for decide nothing
    begins = {label: min([n for n in files if low <= n <= high] or files) for label, files in sets.items()}
    first = {label: read_any_header(sets[label][number]) for label, number in begins.items()}
    channels = {label: tuple(header.layout.channels) for label, header in first.items()}
    attributes = {label: header.attributes for label, header in first.items()}
    views = views_of(attributes, channels, [header.views for header in first.values()])
    if profile == "auto":
        chosen, reason = guessed_profile(attributes, channels, views, assignments)
        chosen = with_usual_names(chosen, channels, views)
    else:
        chosen, reason = load_profile(profile), "as asked"
    chosen = override(chosen, assignments)
    faults = [fault for header in first.values() for fault in header.faults.values()]
    patterns = {label: pattern_of(sets[label][number], number) for label, number in begins.items()}
    roles = _assigned(place.folder, chosen, assignments, channels, views, faults, patterns)
    return _Found(sets, first, chosen, reason, views, roles)


def first_frames(
    named: Named, count: int, profile: str | Path | Profile = "auto", assignments: Many[str] = ()
) -> FrameRange:
    """Return the first and the last number of ``count`` frames that have all files that would be read; where opening
    them will raise, of those that have any. Raises InputMissing for no frames."""
    place, profile = selection_of(named), str(profile) if isinstance(profile, Path) else profile
    try:
        numbers = _found_in(place, profile, assignments, {}).complete
    except CltaaError:
        numbers = sorted({number for files in file_sets(place).values() for number in files})
    return first_of(numbers, count, place)


@public("open")
def open_intake(
    named: Named,
    *,
    profile: str | Path | Profile = "auto",
    assignments: Many[str] = (),
    side_file: str | Path | None = None,
    gaps: OnBreak = OnBreak.ERROR,
    on_resize: OnBreak = OnBreak.ERROR,
    frames: FrameRange | None = None,
    step: int = 1,
    damaged: Mapping[Path, int] = MappingProxyType({}),
) -> Intake:
    """Decide from its headers how to read a sequence; raises InputMissing, DataError or UsageError.

    ``gaps`` and ``on_resize`` say whether a frame may be missing (in any of the files that are read) and whether sizes
    may differ. ``frames`` are the first and the last number to read, both included. ``step`` is the difference of
    consecutive frame numbers. ``damaged`` maps files to leave out to their frame numbers.
    """
    place, gaps, on_resize = selection_of(named), OnBreak(gaps), OnBreak(on_resize)
    if not isinstance(side_file, str | Path | None):
        raise UsageError("this is no name of a side file", expected="a text or a path", found=repr(side_file))
    side_file, assignments = None if side_file is None else Path(side_file), several(assignments, "assignments")
    folder, profile = place.folder, str(profile) if isinstance(profile, Path) else profile
    frames = None if frames is None else checked_range(frames, folder)
    sets, first, chosen, reason, views, roles = found = _found_in(place, profile, assignments, damaged, frames, gaps)
    main, there = found.main, found.complete
    numbers = chosen_numbers(there, frames, folder)
    for files in found.read:
        check_steps(files, frames or (min(main), max(main)), step, gaps)
    # Delayed jitter or matrices are in frames just outside the requested range.
    late = step * max(abs(chosen.jitter.delay), abs(chosen.camera.delay))
    around = [number for number in there if numbers[0] - late <= number <= numbers[-1] + late]
    headers = {number: read_any_header(main[number]) for number in around}
    # The colour's windows define the picture, whatever windows other parts have.
    colour = [place.channel for place in roles["colour"]]
    pictures = {number: header.layout.shown_by(colour) for number, header in headers.items()}
    layouts = as_pictures({number: pictures[number] for number in numbers}, on_resize)
    _refuse_whole_numbers(first, roles)
    given = {number: header.of_channel(colour[0]) for number, header in headers.items()}
    if not place.alone:  # a picture that is named by itself may have any name
        for number in numbers:
            check_number(main[number], given[number], number)
    side = {} if side_file is None else _side_of(side_file, numbers)
    stated = {number: [Stated(main[number], given[number]), *_beside(found, number)] for number in around}
    if not side:
        _check_attributes(folder, chosen, assignments, stated.values())
    known = declared_frames(chosen, stated, side, side_file, pictures | layouts, step)
    declared = {number: known[number] for number in numbers}
    delays = {"matrices": step * chosen.camera.delay, "jitter": step * chosen.jitter.delay, "exposure": 0}
    _check_complete(folder, known, numbers, delays, side_file, side)
    intake = Intake(
        chosen,
        reason,
        roles,
        sets,
        given,
        layouts,
        declared,
        {label: header.layout for label, header in first.items()},
        gaps,
        on_resize,
        step,
        (profile, assignments),
        frozenset(damaged.values()),
        views,
    )
    intake.notes += notes_of(intake, place) + _of_layouts(first.values(), pictures, layouts)
    return intake


def _beside(found: _Found, number: int) -> Iterator[Stated]:
    """Yield what the headers of a frame's other files say, where they may declare what the colour's does not."""
    colour = found.roles["colour"][0]
    undeclared = stated_names(found.profile) - found.first[colour.files].of_channel(colour.channel).keys()
    for label, channel in {place.files: place.channel for its in found.roles.values() for place in its}.items():
        if label != colour.files and undeclared & found.first[label].of_channel(channel).keys():
            path = found.sets[label][number]
            yield Stated(path, read_any_header(path).of_channel(channel))


def _of_layouts(
    headers: Iterable[ImageHeader], pictures: Mapping[int, Layout], layouts: Mapping[int, Layout]
) -> list[str]:
    """Return one line for differing windows, and one for each part that is not read."""
    notes = [f"part {name}: left out, for {fault.what}" for header in headers for name, fault in header.faults.items()]
    if any(layout.data_window != pictures[number].data_window for number, layout in layouts.items()):
        rest = "frames are read as their display window, with nothing outside of each"
        notes.append(f"data windows differ: {rest}")
    return notes


def open_with_gaps(named: Named, **reading: Any) -> Intake:
    """Do as ``open_intake``, but allow missing frames; raises InputMissing if another ``step`` would explain them."""
    intake = open_intake(named, **reading, gaps=OnBreak.RESET)
    missing = intake.missing
    first, last = min(intake.declared), max(intake.declared)
    apart = even_step(sorted({*intake.declared, *(number for number in intake.damaged if first < number < last)}))
    if missing and apart != intake.step:
        path = intake.sets[intake.roles["colour"][0].files][first]
        raise frame_missing(renumbered(path, missing[0], first), missing[0], apart)
    return intake


def _assigned(
    folder: Path,
    profile: Profile,
    assignments: Many[str],
    channels: Mapping[str, Many[str]],
    views: Views,
    faults: Many[DataError],
    patterns: Mapping[str, Path],
) -> Roles:
    """Return the channels of each role; UsageError where those asked for by name are missing."""
    asked = keys_of(assignments)
    # By an option, or by a profile of the user's own.
    names_depth = "depth.channels" in asked or profile.depth.channels not in [
        load_profile(name).depth.channels for name in profile_names()
    ]
    roles = assign_view(profile, channels, views, any_depth=names_depth)
    if "colour" not in roles:
        raise faults[0] if faults else no_colour(folder, profile, channels, views, patterns)
    for role, key in KEYS.items():
        wanted = attrgetter(key)(profile) if key in asked and role not in roles else ()
        lists = [[one] if isinstance(one, str) else one for one in wanted]
        if lists and not any("none" in names for names in lists):
            there = [shown_name(Place(label, name), channels) for label in channels for name in channels[label]]
            raise UsageError(
                f"--input {key}={', '.join(map(written, lists))}: no such channels",
                path=folder,
                found=written(there),
                cure=f"do without by --input {key}='{' '.join(['none'] * (1 + (role == 'motion')))}'",
            )
    return roles


def _check_attributes(folder: Path, profile: Profile, assignments: Many[str], stated: Iterable[Many[Stated]]) -> None:
    """Raise UsageError where no file has an attribute that an option names."""
    there = {name for files in stated for file in files for name in file.attributes}
    asked = keys_of(assignments)
    for key in ("camera.view", "camera.projection", "jitter.attribute"):
        name, source = attrgetter(key)(profile), f"{key.partition('.')[0]}.source"
        if key in asked and name and name not in there and attrgetter(source)(profile) == "declared":
            what, found = f"--input {key}={name}: no such attribute", written(sorted(there))
            cure = f"give it with --camera FILE, or do without by --input {source}=none"
            raise UsageError(what, path=folder, found=found, cure=cure)


def _refuse_whole_numbers(headers: Mapping[str, ImageHeader], roles: Roles) -> None:
    """Raise DataError if a channel of light, depth or motion holds integers."""
    for role, place in ((role, place) for role, places in roles.items() for place in places):
        layout = headers[place.files].layout
        if layout.channels[place.channel] == "uint":
            raise whole_numbers(place, role, len(roles[role]), layout.path)


def _side_of(path: Path, numbers: Many[int]) -> dict[int, Side]:
    """Read the side file; raises DataError if it describes none of the frames."""
    side = read_side_file(path)
    if not side.keys() & set(numbers):
        what, cure = "none of the frames is in the side file", "number its frames as the files are"
        raise DataError(what, path=path, expected=named_frames(numbers), found=ranges(sorted(side)), cure=cure)
    return side


def _check_complete(
    folder: Path,
    known: Mapping[int, Declared],
    numbers: Many[int],
    delays: Mapping[str, int],
    side_file: Path | None,
    side: Mapping[int, Side],
) -> None:
    """Raise DataError if some frames have matrices, jitter or exposure and others have none: that makes a jump."""
    for what, otherwise, told, given in (
        ("matrices", "with --input camera.source=none", "camera", "world_to_view"),
        ("jitter", "with --input jitter.source=none", "jitter_px", "jitter_px"),
        ("exposure", "of them", "exposure", "exposure"),
    ):
        late, beside = delays[what], {number for number, one in side.items() if getattr(one, given) is not None}
        source = {number: number + late if number + late in known else number for number in numbers}
        missing = {number for number in numbers if getattr(known[number], told) is None}
        # Not the headers' for some frames and the side file's for others: the two may differ by a convention.
        without = missing | ({number for number in numbers if source[number] not in beside} if beside else set())
        if 0 < len(without) < len(numbers):
            lacking = sorted({source[number] for number in without})
            where = "there" if beside else "with --camera FILE"
            none = f"to none {otherwise}" if missing else "to none, and those of the headers count"
            cure = f"give {what} to every frame {where}, or {none}"
            raise DataError(f"no {what} for {named_frames(lacking)}", path=side_file if beside else folder, cure=cure)


def intake_lines(intake: Intake) -> Iterator[str]:
    """Yield the decisions as lines: profile and reason, channels, what is missing."""
    yield f"profile {intake.profile.name}: {intake.reason}"
    yield f"channels: {describe(intake.roles, intake.sets)}"
    yield from intake.notes


SHOWN = "; if the pixels are jittered, cltaa check shows by how much"
# A resolve spends time on an opaque alpha for nothing (docs/decisions/11-conventions-from-pixels.md).
OPAQUE = "alpha is 1 everywhere: --input colour.alpha=none gives the same colours, a tenth to a fifth faster"


STANDARD = {"standard": True, "view": "worldToCamera", "projection": "worldToNDC"}
STANDARD_NAMES = {"worldToCamera", "worldToNDC"}
STANDARD_THERE = f", or take those of the EXR standard, which cltaa check judges: {option_text({'camera': STANDARD})}"


def notes_of(intake: Intake, place: Selection) -> list[str]:
    """Return one line for each missing input: what the resolve does without it, and how to supply it."""
    notes = []
    if not intake.has_camera:
        rule = intake.profile.camera
        kept = "the camera is taken to stand still"
        if "motion" in intake.roles:
            fits = "depth" in intake.roles and rule.source != "none"
            kept = "vectors and depth may tell the camera" if fits else "motion vectors alone tell what moves"
        there = intake.attributes[min(intake.attributes)].keys()
        like = STANDARD_THERE if rule.source == "declared" and there >= STANDARD_NAMES else ""
        if len(lacking := [name for name in (rule.view, rule.projection) if name not in there]) == 1:
            (half,) = {rule.view, rule.projection} - {*lacking}
            like = f"; beside attribute {half} is no {lacking[0]}: write both"
        notes.append(f"no matrices: {kept}; give them with --camera FILE{like}")
    if "depth" not in intake.roles:
        rest = "nothing is told apart by distance, and moving edges are less exact"
        alone = without_vectors({"": intake.unused})[""]
        like = _may_be("depth.channels", DEPTH_NAME, intake.unused) or _may_be("depth.channels", Z_ALONE, alone)
        notes.append(f"no depth: {rest}{like}")
    if "alpha" not in intake.roles and (like := _may_be("colour.alpha", ALPHA_NAME, intake.unused)):
        notes.append(f"no alpha: the picture is taken as opaque{like}")
    if "motion" not in intake.roles:
        rest = (
            "the camera's motion comes from depth and matrices" if intake.has_camera and "depth" in intake.roles else ""
        )
        like = _may_be("motion.channels", MOTION_NAME, intake.unused)
        if not like and (half := incomplete(intake.unused, vectors=True)):
            like = f"; {half}: write both"
        notes.append(f"no motion vectors: {rest or 'whatever moves is rectified only'}{like}")
    elif intake.step > 1:
        notes.append(
            f"frames {intake.step} apart: vectors are taken to lead as far back; where they lead one back, "
            "--input motion.channels='none none' leaves them out"
        )
    if not intake.has_jitter:
        notes.append(f"no jitter: taken as none{SHOWN}")
    return notes + _from_beside(intake, place) + _left_out(intake, place)


def _from_beside(intake: Intake, place: Selection) -> list[str]:
    """Return one line if matrices or jitter are those of other files than the colour's."""
    first, (colour, *_) = intake.declared[min(intake.declared)], intake.roles["colour"]
    others = {path for label, files in intake.sets.items() if label != colour.files for path in files.values()}
    given = {"matrices": (first.camera, first.matrices_from), "jitter": (first.jitter_px, first.jitter_from)}
    taken = {what: source.path for what, (value, source) in given.items() if value and source.path in others}
    paths = sorted({relpath(path, place.folder) for path in taken.values()})
    rest = "and those after it, for the colour's files have none"
    return [f"{' and '.join(taken)}: from {' and '.join(paths)} {rest}"] if taken else []


def _left_out(intake: Intake, place: Selection) -> list[str]:
    """Return one line for each input that is present but not read, or that is read for want of a better one."""
    views, notes = intake.views, list[str]()
    colour = [shown_name(place, intake.sets) for place in intake.roles["colour"]]
    if NO_LIGHT.search(colour[0]):
        notes.append(f"colour: {written(colour)} is by its name no picture; name another by --input colour.channels")
    files = intake.roles["colour"][0].files
    taken = views.of((place.channel for place in intake.roles["colour"]), files)
    if other := next((view for view in views.names if view != taken and _shows(intake, view)), None):
        option = option_text({"colour": {"view": other}})
        told = f"{taken} of {', '.join(views.names)}" if taken else "the one without a name"
        notes.append(f"several views: {told} is taken; to take {other}: {option}")
    if "." in intake.roles["colour"][0].channel and {*COLOUR} <= intake.first[files].channels.keys():
        names = [shown_name(Place(files, channel), intake.sets) for channel in COLOUR]
        option = channels_option("colour.channels", names)
        notes.append(f"another picture: R G B left out of results, which have these names; to take it: {option}")
    if others := _like_the_colour(intake, views) or _as_nameless(intake):
        names = [f"{others[0]}.{place.channel.rpartition('.')[2]}" for place in intake.roles["colour"]]
        option = channels_option("colour.channels", names)
        notes.append(f"another layer: {', '.join(others)} not resolved; to take {others[0]}: {option}")
    if late := _late(intake):
        notes.append(
            f"not in the first frame: {', '.join(late)}; left out of all, for a channel is read of every frame"
        )
    if left := ignored_files(place):
        notes.append(f"ignored, for they are not numbered as the frames are: {', '.join(left)}")
    return notes


def _shows(intake: Intake, view: str) -> bool:
    """Return True if a view has a picture that may be taken instead."""
    channels = {label: layout.channels for label, layout in intake.first.items()}
    return "colour" in assign_view(override(intake.profile, [f"colour.view={view}"]), channels, intake.views)


def _late(intake: Intake) -> list[str]:
    """Return channels for unfilled roles that only later frames have, in the colour's files."""
    files = intake.roles["colour"][0].files
    every = {name for layout in intake.layouts.values() for name in layout.channels}
    could = assign(intake.profile, {files: sorted(every)})
    places = [place for role, its in could.items() if role not in intake.roles for place in its]
    return [place.channel for place in places if place.channel not in intake.first[files].channels]


def _like_the_colour(intake: Intake, views: Views) -> list[str]:
    """Return other layers with the colour layer's name, such as the beauty of another view layer; of its view."""
    three = [place.channel for place in intake.roles["colour"]]
    files = intake.roles["colour"][0].files
    tails, view = [views.without(name).split(".")[-2:] for name in three], views.of(three, files)
    found: dict[str, list[list[str]]] = {}
    for name in intake.unused:
        if views.of([name], files) == view:
            found.setdefault(name.rpartition(".")[0], []).append(views.without(name).split(".")[-2:])
    return [layer for layer, its in found.items() if len(tails[0]) > 1 and all(tail in its for tail in tails)]


def _as_nameless(intake: Intake) -> list[str]:
    """Return other layers that could be the picture, if the colour is only the first layer with its three channels."""
    first = {label: tuple(layout.channels) for label, layout in intake.first.items()}
    if intake.views.names or has_named_colour(intake.profile, first):  # another note covers several views
        return []
    layers: dict[str, set[str]] = {}
    for name in intake.unused:
        layer, _, last = name.rpartition(".")
        layers.setdefault(layer, set()).add(last)
    three = {place.channel.rpartition(".")[2] for place in intake.roles["colour"]}
    return [layer for layer, its in layers.items() if layer and three <= its and not NO_LIGHT.search(f"{layer}.")]


def _may_be(key: str, pattern: re.Pattern[str], names: Sequence[str]) -> str:
    """Return a hint to give a profile's ``key`` channels named like it; ``cltaa check`` judges what they mean."""
    count = 2 if key == "motion.channels" else 1
    layers: dict[str, list[str]] = {}
    for name in filter(pattern.search, names):
        layers.setdefault(name.rpartition(".")[0], []).append(name)
    like = [name for its in layers.values() if len(its) >= count for name in its]
    if not like:
        return ""
    letters = "ruxhgvy"  # red, u, x or h is horizontal; a third and a fourth channel are something else
    across_first = sorted(like, key=lambda name: (len(name), f"{letters}{name[-1]}".lower().index(name[-1].lower())))
    layer = across_first[0].rpartition(".")[0]
    taken = [name for name in across_first if name.rpartition(".")[0] == layer][:count]
    option = channels_option(key, taken)
    judged = "" if key == "colour.alpha" else ", which cltaa check judges"
    return f"; to take {'those' if count > 1 else 'that'} in {written(taken)}: {option}{judged}"
