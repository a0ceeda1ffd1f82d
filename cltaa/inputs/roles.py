"""Which channel of which file plays which role: the profile's names against the names that are there."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import DataError
from cltaa.files.manifest import NAME as MANIFEST
from cltaa.files.names import NUMBERED, number_of
from cltaa.inputs.profile import Profile
from cltaa.sequences.below import captures_below, only_below
from cltaa.sequences.numbered import folder_missing, no_frames

REFERENCE = "reference"  # folders of this name, or that begin with it, hold truth and no input


# The key of a profile that names the channels of each role that a frame can do without.
KEYS = {
    "depth": "depth.channels", "motion": "motion.channels", "alpha": "colour.alpha", "reactive": "colour.reactive",
}  # fmt: skip


class Place(NamedTuple):
    """A channel: the set of files that it is in, and its full name there."""

    files: str
    channel: str


Roles = Mapping[str, tuple[Place, ...]]  # colour, alpha, reactive, depth, motion -> places; absent roles are left out


def unnumbered(folder: Path) -> list[str]:
    """Names of EXR files in a folder that are no frames, for they have no number."""
    return [path.name for path in sorted(folder.glob("*.exr")) if path.name[0] != "." and number_of(path) is None]


def file_sets(folder: Path, without: Container[Path] = ()) -> dict[str, dict[int, Path]]:
    """The numbered files of a folder and its subfolders by name: ``beauty.0001.exr`` or ``beauty/x.0001.exr``.

    Hidden subfolders are left out, those with truth, and those that a resolve wrote: what came of a sequence is no part
    of it. So are the files ``without``.
    Raises InputMissing where there is none, or none but captures in folders of their own.
    """
    if not folder.is_dir():
        raise folder_missing(folder)
    captures = captures_below(folder)
    if captures and not any(folder.glob("*.exr")):
        raise only_below(folder, captures)
    sets: dict[str, dict[int, Path]] = {}
    files = sorted([*folder.glob("*.exr"), *(path for path in folder.glob("*/*.exr") if _is_input(path.parent))])
    for path in files:
        match = NUMBERED.fullmatch(path.name)
        if match is None or path.name[0] == "." or path in without:
            continue
        label = f"{path.parent.name}/{match['name']}" if path.parent != folder else match["name"]
        numbers = sets.setdefault(label, {})
        if int(match["number"]) in numbers:
            number = int(match["number"])
            raise DataError("two files have one frame number", path=path, frame=number, found=numbers[number].name)
        numbers[int(match["number"])] = path
    if not sets:
        raise no_frames(folder, files)
    return sets


def _is_input(folder: Path) -> bool:
    return not folder.name.startswith((REFERENCE, ".")) and not (folder / MANIFEST).exists()


def assign(profile: Profile, channels: Mapping[str, Iterable[str]]) -> dict[str, tuple[Place, ...]]:
    """Find the channels of each role among those of each set of files; roles that nothing plays are left out.

    So is the colour where several sets of files could be it: which of two pictures is meant nobody can tell.
    """
    colours = equal_matches(profile.colour.channels, channels)
    colour = colours[0] if len(colours) == 1 else ()
    own = {label: names for label, names in channels.items() if colour and label == colour[0].files}
    named = [name for name in profile.colour.alpha if "." in name]  # in a layer, or in a set of files
    found = {
        "colour": colour,
        "alpha": _nearest(colour, profile.colour.alpha, own) or _nearest(colour, named, channels),
        "reactive": _nearest(colour, profile.colour.reactive, channels),
        "depth": _nearest(colour, profile.depth.channels, channels),
        "motion": _nearest(colour, profile.motion.channels, channels),
    }
    return {role: places for role, places in found.items() if places}


def _nearest(
    colour: tuple[Place, ...], candidates: Sequence[str], channels: Mapping[str, Iterable[str]]
) -> tuple[Place, ...]:
    """The channels of a candidate in the layer of the colour, else in what that layer is part of, else anywhere.

    So the depth of ``Trees.Combined.R`` is ``Trees.Depth.Z`` and not ``Rocks.Depth.Z``, and ``A`` its own alpha.
    """
    layers = colour[0].channel.split(".")[:-1] if colour else []
    for end in range(len(layers), -1, -1):
        inside = "".join(f"{layer}." for layer in layers[:end])
        within = [" ".join(inside + name for name in candidate.split()) for candidate in candidates]
        if found := equal_matches(within, channels):
            return next((places for places in found if colour and places[0].files == colour[0].files), found[0])
    return ()


def channel_missing(place: Place, role: str, count: int, path: Path, there: Iterable[str]) -> DataError:
    """The error where a frame's file has none of that name, which is one of ``count`` channels of a role."""
    found, none = " ".join(sorted(there)), " ".join(["none"] * count)
    without = f", or do without: --input {KEYS[role]}='{none}'" if role in KEYS else ""
    cure = f"render it again{without}"
    return DataError("channel is missing", path=path, channel=place.channel, found=found, cure=cure)


def whole_numbers(place: Place, path: Path) -> DataError:
    """The error where what is to be read as light, depth or motion holds whole numbers."""
    return DataError(
        "wrong channel type", path=path, channel=place.channel, expected="half or float", found="uint",
        cure="write it as 32-bit float",
    )  # fmt: skip


def describe(roles: Roles, several: bool = False) -> str:
    """One line: every role and its channels, with the names of their files where there are ``several`` sets."""
    return "; ".join(
        f"{role} {' '.join(shown_name(place, several) for place in places)}" for role, places in roles.items()
    )


def shown_name(place: Place, several: bool) -> str:
    """A channel as a reader is told of it."""
    return f"{_short(place.files)}.{place.channel}" if several else place.channel


def equal_matches(candidates: Sequence[str], channels: Mapping[str, Iterable[str]]) -> list[tuple[Place, ...]]:
    """The channels that the first candidate with any names; several where sets of files have them alike.

    Files in the folder itself come before those of its subfolders.
    """
    for candidate in candidates:
        # With several sets of files, ``depth.Z`` also means channel Z of the set named depth; that is tried first.
        for by_set in (True, False):
            # All channels of a role are in one set: R of a depth and G of a picture make no colour.
            found = [_in_set(candidate.split(), label, names, by_set) for label, names in channels.items()]
            whole = [places for places in found if places]
            if whole:  # the shortest names are the least qualified: no view, no light group
                shortest = min(map(_length, whole))
                alike = [places for places in whole if _length(places) == shortest]
                return [places for places in alike if "/" not in places[0].files] or alike
    return []


def _length(places: tuple[Place, ...]) -> int:
    return sum(len(place.channel) for place in places)


def _in_set(patterns: Sequence[str], label: str, names: Iterable[str], by_set: bool) -> tuple[Place, ...]:
    """The channel of each pattern within one set of files; empty unless all are there.

    Where the patterns have ``*`` alike it stands for the same in each: R of one layer and G of another make no colour.
    """
    names, before = sorted(names, key=len), f"{_short(label)}." if by_set else ""
    alike = len({pattern.count("*") for pattern in patterns}) == 1
    by_layer: list[dict[tuple[str, ...], str]] = []
    for pattern in patterns:
        stars = re.compile(re.escape(pattern).replace(r"\*", "(.*)"))
        found = [(match.groups(), name) for name in names if (match := stars.fullmatch(before + name))]
        by_layer.append({layer if alike else (): name for layer, name in reversed(found)})
    layers = [layer for layer in reversed(by_layer[0]) if all(layer in named for named in by_layer)]
    return tuple(Place(label, named[layers[0]]) for named in by_layer) if layers else ()


def _short(label: str) -> str:
    """The name of a set of files for a reader: that of its folder, if it has one of its own."""
    return label.split("/")[0]
