"""Pictures of several views, such as left and right: one is chosen, and all channels of a frame are of it.

Names are those of OpenEXR's multi-view files (https://openexr.com/en/latest/TechnicalIntroduction.html, multi-view):
the view is a word of a channel's name, ``diffuse.right.R``, Blender's ``ViewLayer.Combined.left.R``, or of its part's;
channels of the first view may have none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from cltaa.errors import UsageError
from cltaa.inputs.profile import Profile
from cltaa.inputs.roles import Place, Roles, assign

USUAL = ("left", "right")  # what views are called where no attribute names them

Channels = Mapping[str, Iterable[str]]  # of each set of files


def views_of(attributes: Mapping[str, object], channels: Channels) -> list[str]:
    """The views of a picture, the first of them first; none where it has one."""
    named = attributes.get("multiView", USUAL)
    words = {word for names in channels.values() for name in names for word in name.split(".")[:-1]}
    if not isinstance(named, list | tuple):
        return []
    views = [view for view in named if isinstance(view, str)]
    # Those of the first view may go without its name.
    there = [view for view in views if view in words]
    return views if len(there) > (0 if "multiView" in attributes else 1) else []


def view_of(channels: Iterable[str], views: Sequence[str]) -> str:
    """The view that channels are of: the one in their names, else the first; empty where there are none."""
    return next((word for name in channels for word in name.split(".")[:-1] if word in views), [*views, ""][0])


def assign_view(profile: Profile, channels: Channels, views: Sequence[str]) -> Roles:
    """The channels of each role, all of one view: that of the profile, else that of the colour that is found.

    Raises UsageError for a view that there is not.
    """
    view = profile.colour.view
    if view and view not in views:
        what, expected = f"--input colour.view={view}: no such view", ", ".join(views)
        raise UsageError(what, expected=expected or "none: the picture has one view, or its names do not tell them")
    if not views:
        return assign(profile, channels)
    if not view:
        found = assign(profile, channels)
        if "colour" not in found and len(views) > 1:  # it is not for us to choose
            return found
        view = view_of((place.channel for place in found.get("colour", ())), views)
    asked = _asked_for(profile)
    own = {label: _of_view(names, view, views, asked) for label, names in channels.items()}
    roles = assign(profile, {label: tuple(named) for label, named in own.items()})
    return {
        role: tuple(Place(its.files, own[its.files][its.channel]) for its in places) for role, places in roles.items()
    }


def _asked_for(profile: Profile) -> set[str]:
    """Every name of a channel that the profile has."""
    colour = profile.colour
    every = (colour.channels, colour.alpha, colour.reactive, profile.depth.channels, profile.motion.channels)
    return {name for candidates in every for names in candidates for name in names.split()}


def _of_view(names: Iterable[str], view: str, views: Sequence[str], asked: set[str]) -> dict[str, str]:
    """The channels of one view and those of none, by their names without it, and any that is ``asked`` for in full."""
    named, others = dict[str, str](), dict[str, str]()
    for name in names:
        words = set(name.split(".")[:-1]) & set(views)
        if view in words:
            named[without_view(name, views)] = name
        if (not words and (view == views[0] or "." in name)) or (words and name in asked):
            others[name] = name
    return others | named


def without_view(name: str, views: Iterable[str]) -> str:
    """A channel's name without the words that say of which view it is."""
    *words, last = name.split(".")
    return ".".join([*(word for word in words if word not in views), last])
