"""Assign channels of files and views to roles: match the names in the profile with the names in the files.

View names follow OpenEXR's multi-view files (https://openexr.com/en/latest/TechnicalIntroduction.html, multi-view):
the view is a word in the name of the channel, ``diffuse.right.R``, Blender's ``ViewLayer.Combined.left.R``, or of its
part; channels of the first view may omit it. Without such a word the part's attribute ``view`` decides, as in
``rgba_right``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from collections.abc import Sequence as Many
from os.path import relpath
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from cltaa.errors import DataError, UsageError
from cltaa.inputs.profile import Names, Profile, channels_option, load_profile, option_text, override, profile_names
from cltaa.io.denoiser_guides import guided_role, guides_of
from cltaa.io.manifest import NAME as MANIFEST
from cltaa.io.names import Named, leads_nowhere, selection_of
from cltaa.io.numbered import captures_below, files_in, no_frames, only_below
from cltaa.printable import counted, shell_word, written

WORD = r"[^/._ -]+"  # of a file's name
TRUTH = "reference", "truth"  # folders whose names begin with one of these hold truth and no input


# The profile key with the channels of each optional role.
KEYS = {"depth": "depth.channels", "motion": "motion.channels", "alpha": "colour.alpha", "reactive": "colour.reactive"}


class Place(NamedTuple):
    """A channel: its set of files, and its full name there."""

    files: str
    channel: str


Roles = Mapping[str, tuple[Place, ...]]  # colour, alpha, reactive, depth, motion -> places; only roles that are filled


def ignored_files(named: Named) -> list[str]:
    """Return names of EXR files of a place whose numbering differs from that of its frames."""
    place = selection_of(named)
    files = [] if place.alone else files_in(place)
    sets = (numbers for its in _by_folder(files).values() for numbers in place.by_name(its).values())
    frames = {path for numbers in sets for path in numbers.values()}
    return [path.name for path in files if path not in frames]


def _by_folder(files: Iterable[Path]) -> dict[Path, list[Path]]:
    folders: dict[Path, list[Path]] = {}
    for path in files:
        folders.setdefault(path.parent, []).append(path)
    return folders


def file_sets(named: Named, without: Container[Path] = (), *, existing: bool = False) -> dict[str, dict[int, Path]]:
    """Return the numbered files of a folder and its subfolders by name: ``beauty.0001.exr`` or ``beauty/x.0001.exr``.

    Leaves out the files ``without``, with ``existing`` links to missing ones, and subfolders that are hidden, hold
    truth, or hold the output of a resolve. Files that ``named`` lists itself are all kept. Raises InputMissing if there
    are none, or only captures in subfolders.
    """
    place = selection_of(named)
    files = files_in(place, below=True)
    if place.files is None:
        captures = captures_below(place.folder)
        if captures and not any(path.parent == place.folder for path in files):
            raise only_below(place.folder, captures)
        files = [path for path in files if path.parent == place.folder or _is_input(path.parent)]
    sets: dict[str, dict[int, Path]] = {}
    for folder, its in _by_folder(files).items():
        for name, numbers in place.by_name(its).items():
            within = relpath(folder, place.folder).replace("/", ".").lstrip(".")
            label = f"{within}/{name}" if within else name
            there = {n: path for n, path in numbers.items() if path not in without}
            if left := {n: path for n, path in there.items() if not (existing and leads_nowhere(path))}:
                sets[label] = left
    if not sets:
        raise no_frames(place, files)
    return sets


def _is_input(folder: Path) -> bool:
    return not folder.name.startswith((*TRUTH, ".")) and not (folder / MANIFEST).exists()


def assign(
    profile: Profile, channels: Mapping[str, Iterable[str]], *, any_depth: bool = False
) -> dict[str, tuple[Place, ...]]:
    """Find the channels of each role in each set of files; the result holds only filled roles.

    With ``any_depth`` the third component of a vector may be the depth, as a last choice.
    It lacks the colour if several sets match and none of the profile's other names matches just one: the user chooses.
    """
    colour = _only_match(profile, _in_folder_itself(channels))
    if not colour or _is_auxiliary(shown_name(colour[0], channels)):
        colour = _only_match(profile, channels)
    if colour:
        channels = _without_pictures(colour, channels, _asked_for(profile))
    own = {label: names for label, names in channels.items() if colour and label == colour[0].files}
    alpha = [(name,) for name in profile.colour.alpha]
    named = [names for names in alpha if "." in names[0]]  # names with a layer or a set of files
    depth = [(name,) for name in profile.depth.channels]
    found = {
        "colour": colour,
        "alpha": _nearest(colour, alpha, own) or _nearest(colour, named, channels),
        "reactive": _nearest(colour, [(name,) for name in profile.colour.reactive], channels),
        "depth": _nearest(colour, depth, without_vectors(channels))
        or (_nearest(colour, depth, channels) if any_depth else ()),
        "motion": _nearest(colour, profile.motion.channels, channels),
    }
    return {role: places for role, places in found.items() if places}


def _in_folder_itself(channels: Channels) -> dict[str, Iterable[str]]:
    return {label: names for label, names in channels.items() if "/" not in label}


def _only_match(profile: Profile, channels: Channels) -> tuple[Place, ...]:
    """Return the channels of the first of the profile's names of a colour that match in one set of files alone."""
    found = (equal_matches([names], channels) for names in profile.colour.channels)
    return next((places[0] for places in found if len(places) == 1), ())


def _without_pictures(colour: tuple[Place, ...], channels: Channels, asked: set[str]) -> dict[str, list[str]]:
    """Return ``channels`` without the ``colour`` and those of layers that have such a picture of their own.

    For Rocks.Depth.Z is no depth of Trees.Combined.R beside Rocks.Combined.R; but names ``asked`` for in full stay,
    and Blender's Composite is made of all layers.
    """
    first = colour[0].channel
    last = ".".join(first.split(".")[-2:])
    pictures = [name for names in channels.values() for name in names if name.endswith(f".{last}")]
    own = first.removesuffix(last)
    layers = {own} if own == "Composite." else {own, *(n.removesuffix(last) for n in pictures if not _is_auxiliary(n))}

    def is_own(place: Place) -> bool:
        layer = max((layer for layer in layers if place.channel.startswith(layer)), key=len, default="")
        return place not in colour and (layer in ("", own) or _is_asked(place, asked))

    return {label: [name for name in names if is_own(Place(label, name))] for label, names in channels.items()}


def _is_asked(place: Place, asked: Container[str]) -> bool:
    """Return True if a channel is asked for in full, perhaps with the name of its set of files."""
    return place.channel in asked or any(f"{word}.{place.channel}" in asked for word in _words(place.files))


def _words(label: str) -> list[str]:
    """Return what may stand for a set of files before the name of a channel: its folder, its name, or both."""
    return [*dict.fromkeys([*label.split("/"), label.replace("/", ".")])]


def without_vectors(channels: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    """Return ``channels`` without third components of vectors, such as ``z`` beside ``x`` and ``y``: no depth."""

    def is_third(name: str, beside: set[str]) -> bool:
        others = {"z": ("x", "y"), "Z": ("X", "Y")}.get(name[-1:])
        return others is not None and {name[:-1] + other for other in others} <= beside

    return {label: [name for name in names if not is_third(name, {*names})] for label, names in channels.items()}


def _nearest(
    colour: tuple[Place, ...], candidates: Sequence[Names], channels: Mapping[str, Iterable[str]]
) -> tuple[Place, ...]:
    """Return the channels of a candidate in the colour's layer, else in its parent layers, else anywhere; beside a
    colour of the folder itself those there come first.

    So the depth of ``Trees.Combined.R`` is ``Trees.Depth.Z`` and not ``Rocks.Depth.Z``, and its alpha is its own ``A``.
    """
    above = _in_folder_itself(channels)
    beside = colour and colour[0].files in above and len(above) < len(channels)
    if beside and (there := _nearest(colour, candidates, above)):
        return there
    layers = colour[0].channel.split(".")[:-1] if colour else []
    for end in range(len(layers), -1, -1):
        inside = "".join(f"{layer}." for layer in layers[:end])
        within = [tuple(inside + name for name in candidate) for candidate in candidates]
        if found := equal_matches(within, channels):
            return min(found, key=lambda places: _farness(places[0].files, colour))
    return ()


def _farness(files: str, colour: tuple[Place, ...]) -> tuple[bool, bool, int]:
    """Return a sort key: first the ``colour``'s set of files, then sets in its folder, then those of more of its words:
    so ``depth.right`` is of ``beauty.right``."""
    own = colour[0].files if colour else ""
    shared = {*re.findall(WORD, own)} & {*re.findall(WORD, files)}
    return files != own, files.rpartition("/")[0] != own.rpartition("/")[0], -len(shared)


def channel_missing(place: Place, role: str, count: int, path: Path, there: Iterable[str]) -> DataError:
    """Return the error for a file that lacks a channel, one of the ``count`` channels of ``role``."""
    found, cure = written(sorted(there)), f"render it again{_or_without(role, count)}"
    return DataError("channel is missing", path=path, channel=place.channel, found=found, cure=cure)


def whole_numbers(place: Place, role: str, count: int, path: Path) -> DataError:
    """Return the error for a channel that holds integers, one of the ``count`` channels of ``role``."""
    what, expected, cure = "wrong channel type", "half or float", f"write it as 32-bit float{_or_without(role, count)}"
    return DataError(what, path=path, channel=place.channel, expected=expected, found="uint", cure=cure)


def _or_without(role: str, count: int) -> str:
    return f", or do without: --input {KEYS[role]}='{' '.join(['none'] * count)}'" if role in KEYS else ""


def describe(roles: Roles, sets: Collection[str]) -> str:
    """Return one line with every role and its channels, with the names of their files if there are several ``sets``."""
    return "; ".join(f"{role} {written(shown_name(place, sets) for place in places)}" for role, places in roles.items())


def shown_name(place: Place, sets: Collection[str]) -> str:
    """Return a channel's display name: with several ``sets``, prefixed by the folder if that holds only this set, else
    by the set's name, or by both if another set has that name."""
    if len(sets) == 1:
        return place.channel
    folder, _, name = place.files.partition("/")
    alone = sum(label.startswith(f"{folder}/") for label in sets) < 2
    alike = sum(label.rpartition("/")[2] == name for label in sets)
    qualifier = folder if alone or not name else name if alike < 2 else f"{folder}.{name}"
    return f"{qualifier}.{place.channel}"


def guide_places(channels: Mapping[str, Iterable[str]], colour: tuple[Place, ...]) -> dict[str, tuple[Place, ...]]:
    """Return the channels that guide a denoiser of the ``colour``, in any set of files, such as ``albedo.0001.exr``.

    The name of such a set is treated as an inner layer of its channels' own layer: of a view, or of none.
    """
    places = dict[str, Place]()
    for label in sorted(channels, key=lambda label: (*_farness(label, colour), label)):
        own = label == colour[0].files
        for name in channels[label]:
            layer, _, last = name.rpartition(".")
            words = [] if own else [word for word in label.split("/") if guided_role(word)]
            called = [".".join(filter(None, (layer, word, last))) for word in words]
            for each in [*([name] if own or layer else []), *called]:
                places.setdefault(each, Place(label, name))
    found = guides_of(places, [place.channel for place in colour])
    return {role: tuple(places[name] for name in names) for role, names in found.items()}


def equal_matches(candidates: Sequence[Names], channels: Mapping[str, Iterable[str]]) -> list[tuple[Place, ...]]:
    """Return the channels of the first candidate that matches; several if several sets of files match equally.

    Files in the folder itself take precedence over files in its subfolders.
    """
    for candidate in candidates:
        # With several sets of files, try ``depth.Z`` first as channel Z of the set named depth.
        for by_set in (True, False):
            # All channels of a role must be in one set: R of a depth and G of a picture make no colour.
            found = [_in_set(candidate, label, names, by_set) for label, names in channels.items()]
            whole = [places for places in found if places]
            if whole:  # prefer the shortest, least qualified names: no view, no light group
                shortest = min(map(_length, whole))
                alike = [places for places in whole if _length(places) == shortest]
                return [places for places in alike if "/" not in places[0].files] or alike
    return []


def has_named_colour(profile: Profile, channels: Channels) -> bool:
    """Return True if the profile names a colour that is there by more than the ends of names, ``*.R *.G *.B``."""
    named = [names for names in profile.colour.channels if not all(name.startswith("*.") for name in names)]
    return bool(equal_matches(named, channels))


def _length(places: tuple[Place, ...]) -> int:
    return sum(len(place.channel) for place in places)


def _in_set(patterns: Sequence[str], label: str, names: Iterable[str], by_set: bool) -> tuple[Place, ...]:
    """Return the channel of each pattern within one set of files; empty unless all match.

    If all patterns have as many ``*``, these match the same text in each: R of one layer and G of another make no
    colour. ``by_set`` prefixes channel names with the folder or the name of their set of files, or both.
    """
    names, qualifiers = sorted(names, key=len), [f"{word}." for word in _words(label)] if by_set else [""]
    if not by_set and set(patterns) <= set(names):  # a channel name may contain a literal star
        return tuple(Place(label, pattern) for pattern in patterns)
    alike = len({pattern.count("*") for pattern in patterns}) == 1
    for before in qualifiers:
        by_layer: list[dict[tuple[str, ...], str]] = []
        for pattern in patterns:
            stars = re.compile(re.escape(pattern).replace(r"\*", "(.*)"))
            found = [(match.groups(), name) for name in names if (match := stars.fullmatch(before + name))]
            by_layer.append({layer if alike else (): name for layer, name in reversed(found)})
        layers = [layer for layer in reversed(by_layer[0]) if all(layer in named for named in by_layer)]
        if layers:
            return tuple(Place(label, named[layers[0]]) for named in by_layer)
    return ()


USUAL = ("left", "right")  # view names without an attribute

Channels = Mapping[str, Iterable[str]]  # set of files -> its channels


class Views(NamedTuple):
    """The views of a picture, the first view first; empty if it has only one, unnamed."""

    names: tuple[str, ...]
    stated: Mapping[str, str]  # channel -> view, from attributes of parts
    firsts: Mapping[str, str]  # set of files -> the view of its channels that name none, where its files list views

    def within(self, name: str) -> set[str]:
        """Return the views of a channel: those in its name, else the stated one; empty if unknown."""
        words = {view for view in self.names if _has_word(name, view)}
        return words or ({self.stated[name]} if name in self.stated else set())

    def first_of(self, files: str) -> str:
        """Return the view of the channels of a set of files that name none; empty without views."""
        return self.firsts.get(files, [*self.names, ""][0])

    def of(self, channels: Iterable[str], files: str) -> str:
        """Return the view of channels of a set of files: the named or stated one, else the first of the set."""
        told = (view for name in channels for view in self.names if view in self.within(name))
        return next(told, self.first_of(files))

    def without(self, name: str) -> str:
        """Return a channel's name without its view."""
        layer, dot, last = name.rpartition(".")
        kept = f".{layer}."
        for view in self.names:
            kept = kept.replace(f".{view}.", ".")
        if kept == f".{layer}." and name in self.stated:
            kept = kept.replace(f"_{self.stated[name]}.", ".")
        return f"{kept[1:]}{last}" if dot else name


def _has_word(name: str, view: str) -> bool:
    """Return True if a view is a word of a channel's layer; like layer names it may contain dots."""
    return f".{view}." in f".{name.rpartition('.')[0]}."


ONE_VIEW = Views((), {}, {})
Attributes = Mapping[str, Mapping[str, object]]  # set of files -> attributes of its header


def views_of(attributes: Attributes, channels: Channels, stated: Iterable[Mapping[str, str]]) -> Views:
    """Return the views of a picture; ``stated`` maps channels to views by attribute ``view``, for each set of files."""
    lists: dict[str, Any] = {label: its["multiView"] for label, its in attributes.items() if "multiView" in its}
    listed = {label: [view for view in its if isinstance(view, str)] for label, its in lists.items() if _is_list(its)}
    named = [*dict.fromkeys(view for its in listed.values() for view in its)] if listed else [*USUAL]
    every = [name for names in channels.values() for name in names]
    # Channels of the first view may omit its name; each file has a first view of its own.
    there = [view for view in named if any(_has_word(name, view) for name in every)]
    firsts = {label: its[0] for label, its in listed.items() if its}
    if lists:
        return Views(tuple(named), {}, firsts) if there or len({*firsts.values()}) > 1 else ONE_VIEW
    pairs = list(dict.fromkeys(pair for its in stated for pair in its.items()))
    # If each set of files holds one view and the channel names are equal, the sets distinguish the views.
    of_parts = dict(pairs) if len(dict(pairs)) == len(pairs) else {}
    names = [*(named if len(there) > 1 else ()), *of_parts.values()]
    views = Views(tuple(dict.fromkeys([*(view for view in USUAL if view in names), *names])), of_parts, {})
    # Beside rgba.right, rgba is a view without a name.
    nameless = (label for label, its in channels.items() if {*map(views.without, of_parts)} & {*its} - of_parts.keys())
    return views._replace(firsts=dict.fromkeys(nameless, ""))


def _is_list(value: object) -> bool:
    return isinstance(value, list | tuple)


def assign_view(profile: Profile, channels: Channels, views: Views, *, any_depth: bool = False) -> Roles:
    """Return the channels of each role, all of one view: the profile's (UsageError where it is missing), else that of
    the found colour. ``any_depth`` is that of ``assign``."""
    view = profile.colour.view
    if view and view not in views.names:
        what, expected = f"--input colour.view={view}: no such view", ", ".join(views.names)
        raise UsageError(what, expected=expected or "none: the picture has one view, or its names do not tell them")
    if not views.names:
        return assign(profile, channels, any_depth=any_depth)
    if not view:
        found = assign(profile, channels)
        if "colour" not in found and len(views.names) > 1:  # the user must choose
            return found
        colour = found.get("colour", ())
        view = views.of((place.channel for place in colour), colour[0].files if colour else "")
    asked = _asked_for(profile)
    own = {label: _of_view(label, names, view, views, asked) for label, names in channels.items()}
    roles = assign(profile, {label: tuple(named) for label, named in own.items()}, any_depth=any_depth)
    return {
        role: tuple(Place(its.files, own[its.files][its.channel]) for its in places) for role, places in roles.items()
    }


def _asked_for(profile: Profile) -> set[str]:
    """Return every channel name in the profile."""
    colour, alone = profile.colour, profile.depth.channels
    lists = (*colour.channels, *profile.motion.channels, colour.alpha, colour.reactive, alone)
    return {name for names in lists for name in names}


def _of_view(label: str, names: Iterable[str], view: str, views: Views, asked: set[str]) -> dict[str, str]:
    """Map names without the view to channels of ``view`` or of no view; also keep names ``asked`` for in full."""
    named, others = dict[str, str](), dict[str, str]()
    for name in names:
        told = views.within(name)
        if view in told:
            named[views.without(name)] = name
        by_part = view in told and name in views.stated  # a pattern may ask for its full name
        in_full = told and _is_asked(Place(label, name), asked)
        if (not told and (view == views.first_of(label) or "." in name)) or by_part or in_full:
            others[name] = name
    return others | named


def _may_be_colour(profile: Profile, channels: Channels, views: Views) -> bool:
    """Return True if channels of some view, or of several sets of files, match the profile's colour names."""
    of_views = [override(profile, [f"colour.view={view}"]) for view in views.names]
    found = any("colour" in assign_view(its, channels, views) for its in (profile, *of_views))
    return found or bool(equal_matches(profile.colour.channels, channels))


def with_usual_names(profile: Profile, channels: Channels, views: Views) -> Profile:
    """Extend a tool's profile that finds no colour with the common names of colour, depth and motion that match."""

    def extended(sections: Iterable[str]) -> Profile:
        made = dict[str, Any]()
        for section in sections:
            own, other = getattr(profile, section), getattr(common, section)
            made[section] = msgspec.structs.replace(own, channels=(*own.channels, *other.channels))
        return msgspec.structs.replace(profile, **made)

    if _may_be_colour(profile, channels, views):
        return profile
    common, sections = load_profile("parts"), ("colour", "depth", "motion")
    found = assign_view(extended(sections), channels, views)
    return extended(section for section in sections if section in found)


# Names that tools give to vectors and depth, in a channel or its file.
MOTION_NAME = re.compile(r"mot(ion|vec)|veloc|vector|flow|(^|[._])mv(s|ecs?)?($|[._])", re.IGNORECASE)
DEPTH_NAME = re.compile(r"depth|(^|[._])(dist(ance)?|pz)($|[._])|(linear|view|eye|scene)_?z($|[._])", re.IGNORECASE)
Z_ALONE = re.compile(r"\.z$", re.IGNORECASE)  # depth where no x and y lie beside
ALPHA_NAME = re.compile(r"alpha|opacity|coverage|\.a$", re.IGNORECASE)
# Auxiliary layers that are not a picture.
NO_LIGHT = re.compile(
    r"albedo|base_?colou?r|diff(use)?_?col|matte|mask|crypto|normal|position|(^|[._])(uv|id|n|p)[._]", re.I
)
ONE_LETTER = re.compile(r"(^|[._])(z|zback|a|u|v|n|p|uv|id|object_?id)$", re.IGNORECASE)


def _is_auxiliary(name: str) -> bool:
    return any(pattern.search(name) for pattern in (DEPTH_NAME, MOTION_NAME, NO_LIGHT))


def _is_no_light(name: str) -> bool:
    """Return True for a name of depth, vectors, alpha, an id or another auxiliary channel."""
    return _is_auxiliary(name) or ALPHA_NAME.search(name) is not None or ONE_LETTER.search(name) is not None


# Components that mean something together alone, by the last words of their names.
IN_VECTORS = ("x", "y"), ("u", "v"), ("r", "g"), ("red", "green")
IN_COLOURS = ("r", "g", "b"), ("red", "green", "blue")


def incomplete(names: Iterable[str], *, vectors: bool) -> str:
    """Return which components of a layer, of ``vectors`` or of a colour, lack others; empty where none do."""
    every = {*names}
    for name in sorted(every):
        stem = re.sub(r"[^._]*\Z", "", name)
        last = name[len(stem) :]
        like = str.upper if last.isupper() else str.title if last.istitle() else str
        for words in IN_VECTORS if vectors else IN_COLOURS:
            whole = [stem + like(word) for word in words]
            if last.lower() in words and _is_vector(name) is vectors and not every.issuperset(whole):
                lacking, there = (written(one for one in whole if (one in every) is has) for has in (False, True))
                return f"beside {there} is no {lacking}"
    return ""


def _is_vector(name: str) -> bool:
    return MOTION_NAME.search(name) is not None or name.startswith("backward.")


OF_NO_TOOL = {"parts": 1, "cltaa": 2}  # profiles of no tool; the greater number wins
LUMINANCE, CHROMA = "Y", {"RY", "BY"}  # OpenEXR's names; a grey picture has only the first


def no_colour(
    folder: Path, profile: Profile, channels: Mapping[str, Many[str]], views: Views, patterns: Mapping[str, Path]
) -> DataError:
    """Return the error for a missing colour, or for one that several sets of files, of these ``patterns``, or ``views``
    could be."""
    if (
        views.names
        and not profile.colour.view
        and "colour" in assign_view(override(profile, [f"colour.view={views.names[0]}"]), channels, views)
    ):
        cure = f"choose one: {option_text({'colour': {'view': views.names[0]}})}"
        return DataError("the picture has several views", path=folder, found=", ".join(views.names), cure=cure)
    several = equal_matches(profile.colour.channels, channels)
    if len(several) > 1:
        several.sort(key=lambda places: _is_auxiliary(shown_name(places[0], channels)))
        option = channels_option("colour.channels", [shown_name(place, channels) for place in several[0]])
        what, found = "several sets of files may be the colour", ", ".join(places[0].files for places in several)
        one = shell_word(patterns[several[0][0].files])
        cure = f"name the files of one, such as {one}, or the channels, as {option}"
        return DataError(what, path=folder, found=found, cure=cure)
    there = [name for names in channels.values() for name in names]
    if {*there} >= CHROMA:
        what, cure = "the picture is in luminance and chroma", "convert it to R G B"
        return DataError(what, path=folder, expected="R G B", found=written(there), cure=cure)
    shown = [shown_name(Place(label, name), channels) for label, names in channels.items() for name in names]
    found, grey = written(there), there[0] if len(there) == 1 and not _is_no_light(there[0]) else None
    if LUMINANCE in there and not {*there} >= {*"XYZ"}:
        grey = LUMINANCE
    # In a grey picture one channel serves as all three.
    alike = ((label, _like_colour([n for n in names if not _is_no_light(n)])) for label, names in channels.items())
    three = next(([shown_name(Place(label, name), channels) for name in its] for label, its in alike if its), None)
    example = [grey] * 3 if grey else three or ["RED", "GREEN", "BLUE"]
    cure = f"name them: {channels_option('colour.channels', example)}"
    if not grey and not three:
        halves = [half for kind in (False, True) if (half := incomplete(shown, vectors=kind))]
        none = ["none of them is a picture: write R G B beside"] if all(map(_is_no_light, shown)) else []
        cure = f"{'; '.join(none + halves)}: write all" if halves else none[0] if none else cure
    expected = " or ".join(map(written, profile.colour.channels))
    what = f"no colour channels of view {profile.colour.view}" if profile.colour.view else "no colour channels"
    return DataError(what, path=folder, expected=expected, found=found, cure=cure)


def _like_colour(there: Many[str]) -> list[str]:
    """Return the three channels with the shortest names that end in r, g, b or red, green, blue; or none."""
    named = {name.lower(): name for name in there}
    for words in (("r", "g", "b"), ("red", "green", "blue")):
        for name in sorted(named, key=len):
            stem, dot, last = name.rpartition(".")
            three = [f"{stem}{dot}{word}" for word in words]
            if last == words[0] and named.keys() >= set(three):
                return [named[each] for each in three]
    return []


def guessed_profile(
    attributes: Attributes, channels: Channels, views: Views, assignments: Many[str]
) -> tuple[Profile, str]:
    """Return the profile whose attribute is in a header of the files that it reads, changed by ``assignments``, else
    the one that fills most roles; and the reason."""
    profiles = [load_profile(name) for name in profile_names()]
    for profile in profiles:
        for name, word in profile.recognise.items():
            saying = {label: str(its[name]) for label, its in attributes.items() if name in its}
            saying = {label: text for label, text in saying.items() if word in text}
            read = _sets_read(override(profile, assignments), channels, views) if saying else ()
            if text := next((text for label, text in saying.items() if label in read), None):
                return profile, f"header attribute {name} is {text[:40] if word else 'there'}"
    told = {
        profile.name: not profile.telling or bool(equal_matches([(name,) for name in profile.telling], channels))
        for profile in profiles
    }
    roles = {profile.name: assign(profile, channels) if told[profile.name] else {} for profile in profiles}

    # Among equal fits one that names the colour wins, as Combined beside Diffuse; then a profile of no tool: a tool
    # would name itself in the header, and has units of its own.
    def fit(profile: Profile) -> tuple[int, int, bool, int]:
        files = [places[0].files for places in roles[profile.name].values()]
        named = bool(files) and has_named_colour(profile, channels)
        return len(files), sum("/" not in label for label in files), named, OF_NO_TOOL.get(profile.name, 0)

    best = max(profiles, key=fit)
    return best, f"no header names the writer; its channel names fit best ({counted(len(roles[best.name]), 'role')})"


def _sets_read(profile: Profile, channels: Channels, views: Views) -> set[str]:
    """Return the sets of files that a profile would read; all where it finds no colour, which an error will tell."""
    roles = assign_view(with_usual_names(profile, channels, views), channels, views)
    return {place.files for places in roles.values() for place in places} if "colour" in roles else {*channels}
