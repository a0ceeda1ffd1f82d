"""Pictures of several views, such as left and right: one is chosen, and all channels of a frame are of it.

Names are those of OpenEXR's multi-view files (https://openexr.com/en/latest/TechnicalIntroduction.html, multi-view):
the view is a word of a channel's name, ``diffuse.right.R``, Blender's ``ViewLayer.Combined.left.R``, or of its part's;
channels of the first view may have none. Where no word tells, attribute ``view`` of the part does, ``rgba_right``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from cltaa.errors import UsageError
from cltaa.inputs.profile import Profile
from cltaa.inputs.roles import Place, Roles, assign

USUAL = ("left", "right")  # what views are called where no attribute names them

Channels = Mapping[str, Iterable[str]]  # of each set of files


class Views(NamedTuple):
    """The views of a picture, the first of them first, none where it has one that nothing names."""

    names: tuple[str, ...] = ()
    stated: Mapping[str, str] = MappingProxyType({})  # of channels, by attributes of their parts

    def within(self, name: str) -> set[str]:
        """The views that a channel is of: those in its name, else what is stated; empty where nothing tells."""
        words = set(name.split(".")[:-1]) & set(self.names)
        return words or ({self.stated[name]} if name in self.stated else set())

    def of(self, channels: Iterable[str]) -> str:
        """The view that channels are of: the one that is told, else the first; empty where there are none."""
        told = (view for name in channels for view in self.names if view in self.within(name))
        return next(told, [*self.names, ""][0])

    def without(self, name: str) -> str:
        """A channel's name without what says of which view it is."""
        *words, last = name.split(".")
        kept = [word for word in words if word not in self.names]
        if len(kept) == len(words) and name in self.stated:
            kept = [word.removesuffix(f"_{self.stated[name]}") for word in words]
        return ".".join([*kept, last])


ONE_VIEW = Views()


def views_of(attributes: Mapping[str, object], channels: Channels, stated: Iterable[Mapping[str, str]] = ()) -> Views:
    """The views of a picture; ``stated`` are those of channels by attribute ``view``, of each set of files."""
    named = attributes.get("multiView", USUAL)
    words = {word for names in channels.values() for name in names for word in name.split(".")[:-1]}
    if not isinstance(named, list | tuple):
        return ONE_VIEW
    views = [view for view in named if isinstance(view, str)]
    # Those of the first view may go without its name.
    there = [view for view in views if view in words]
    if "multiView" in attributes:
        return Views(tuple(views)) if there else ONE_VIEW
    pairs = list(dict.fromkeys(pair for its in stated for pair in its.items()))
    # Sets of files that are of one view each, with names alike, are told apart as sets.
    of_parts = dict(pairs) if len(dict(pairs)) == len(pairs) else {}
    names = [*(views if len(there) > 1 else ()), *of_parts.values()]
    return Views(tuple(dict.fromkeys([*(view for view in USUAL if view in names), *names])), of_parts)


def assign_view(profile: Profile, channels: Channels, views: Views) -> Roles:
    """The channels of each role, all of one view: that of the profile, else that of the colour that is found.

    Raises UsageError for a view that there is not.
    """
    view = profile.colour.view
    if view and view not in views.names:
        what, expected = f"--input colour.view={view}: no such view", ", ".join(views.names)
        raise UsageError(what, expected=expected or "none: the picture has one view, or its names do not tell them")
    if not views.names:
        return assign(profile, channels)
    if not view:
        found = assign(profile, channels)
        if "colour" not in found and len(views.names) > 1:  # it is not for us to choose
            return found
        view = views.of(place.channel for place in found.get("colour", ()))
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


def _of_view(names: Iterable[str], view: str, views: Views, asked: set[str]) -> dict[str, str]:
    """The channels of one view and those of none, by their names without it, and any that is ``asked`` for in full."""
    named, others = dict[str, str](), dict[str, str]()
    for name in names:
        told = views.within(name)
        if view in told:
            named[views.without(name)] = name
        by_part = view in told and name in views.stated  # whose own name may be asked for by a pattern
        if (not told and (view == views.names[0] or "." in name)) or by_part or (told and name in asked):
            others[name] = name
    return others | named
