"""Which profile reads files where nobody named one, from their headers, and what to say where none finds a colour."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Many
from pathlib import Path

from cltaa.errors import DataError
from cltaa.inputs.profile import Profile, load_profile, profile_names
from cltaa.inputs.profile_text import override
from cltaa.inputs.roles import assign, equal_matches, shown_name
from cltaa.inputs.views import ONE_VIEW, Views, assign_view
from cltaa.printable import counted

OF_NO_TOOL = {"parts": 1, "cltaa": 2}  # and which goes before which
LUMINANCE = "Y"  # of a picture in greys, as OpenEXR calls it


def no_colour(folder: Path, profile: Profile, channels: Mapping[str, Many[str]], views: Views = ONE_VIEW) -> DataError:
    """The error where nothing is the colour, or several sets of files or ``views`` could be."""
    if (
        views.names
        and not profile.colour.view
        and "colour" in assign_view(override(profile, [f"colour.view={views.names[0]}"]), channels, views)
    ):
        cure = f"choose one: --input colour.view={views.names[0]}"
        return DataError("the picture has several views", path=folder, found=", ".join(views.names), cure=cure)
    several = equal_matches(profile.colour.channels, channels)
    if several:
        names = " ".join(shown_name(place, several=True) for place in several[0])
        return DataError(
            "several sets of files may be the colour",
            path=folder,
            found=", ".join(places[0].files for places in several),
            cure=f"name the folder of one sequence, or the channels, as --input colour.channels='{names}'",
        )
    there = [name for names in channels.values() for name in names]
    found = " ".join(there)
    grey = LUMINANCE if LUMINANCE in there else there[0] if len(there) == 1 else None
    # Of a picture in greys one channel is all three.
    example = " ".join([grey] * 3) if grey else _like_colour(there) or "RED GREEN BLUE"
    cure = f"name them: --input colour.channels='{example}'"
    expected = " or ".join(profile.colour.channels)
    return DataError("no colour channels", path=folder, expected=expected, found=found, cure=cure)


def _like_colour(there: Many[str]) -> str | None:
    """Three of the channels ``there`` that are called red, green and blue in some way, the shortest of such names."""
    named = {name.lower(): name for name in there}
    for words in (("r", "g", "b"), ("red", "green", "blue")):
        for name in sorted(named, key=len):
            stem, dot, last = name.rpartition(".")
            three = [f"{stem}{dot}{word}" for word in words]
            if last == words[0] and named.keys() >= set(three):
                return " ".join(named[each] for each in three)
    return None


def guessed_profile(attributes: dict[str, object], channels: dict[str, tuple[str, ...]]) -> tuple[Profile, str]:
    """The profile whose header attribute is there, else the one that finds most roles; and why."""
    profiles = [load_profile(name) for name in profile_names()]
    for profile in profiles:
        for name, word in profile.recognise.items():
            if name in attributes and word in str(attributes[name]):
                shown = str(attributes[name])[:40] if word else "there"
                return profile, f"header attribute {name} is {shown}"
    scores = {profile.name: len(assign(profile, channels)) for profile in profiles}
    # Of profiles that fit alike those of no tool win: a tool names itself in the header, and its units are its own.
    best = max(profiles, key=lambda profile: (scores[profile.name], OF_NO_TOOL.get(profile.name, 0)))
    return best, f"no header names the writer; its channel names fit best ({counted(scores[best.name], 'role')})"
