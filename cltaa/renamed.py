"""Names of earlier versions, which this one still takes, and what they are called now. (words: frozen)

A name is looked up here only where it is not one of today. Whoever uses an old one is told the new one in a line, once;
files are read without a word, for they live longer than code.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import EnumType
from typing import TYPE_CHECKING, Any

from cltaa.printable import printable

KEYS = {
    "history_of": "history",
    "frames_kept": "history_frames",
    "light_change": "illumination",
    "change_t": "illumination_t",
    "change_kept": "illumination_decay",
    "change_floor": "illumination_floor",
    "resample_cost": "resampling_penalty",
    "pull_cost": "clip_penalty",
    "gamma_still": "box_scale_static",
    "gamma_moving": "box_scale_moving",
    "thin_frames": "subpixel_frames",
    "fresh_blur": "disocclusion_blur",
}
# Words of a choice, by the key of today.
WORDS = {
    "history": {"result": "accumulated", "samples": "frames"},
    "history_filter": {"lanczos-3": "cross-20"},
    "illumination": {"ignore": "static", "spans": "window"},
}
PRESETS = {
    "t0": "accumulate",
    "t1": "basic",
    "t2": "fast",
    "t3": "default",
    "t4": "gather-8",
    "t5": "gather-48",
    "fsr3-native": "fsr3-like",
}
EFFECTS = {"uncover": "disocclusion", "shading": "illumination"}
PUBLIC = {"Sequence": "FrameSequence", "open_sequence": "open"}  # names of the package
MEMBERS = {"Effect": {"UNCOVER": "DISOCCLUSION", "SHADING": "ILLUMINATION"}}


class Renamed(FutureWarning):
    """A name of an earlier version was used."""


def say(old: str, new: str, what: str) -> None:
    """Tell that ``old``, a ``what``, is called ``new`` now."""
    warnings.warn(f"{what} {old} is called {new} now; the next version takes that alone", Renamed, stacklevel=4)


def current(name: str, table: Mapping[str, str], names: Mapping[str, object] | frozenset[str], what: str) -> str:
    """``name``, or what it is called now: where ``names``, those of today, lack it and hold the new one."""
    new = table.get(name)
    if new is None or name in names or new not in names:
        return name
    say(name, new, what)
    return new


@contextmanager
def one_line_each() -> Iterator[None]:
    """On a command line what a program is warned of is one line on standard error, not a place in our code."""
    told: set[str] = set()
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def show(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, Renamed | UserWarning):
                if str(message) not in told:  # Python counts by place, and a command may ask at several
                    print(f"cltaa: warning: {printable(str(message))}", file=sys.stderr)
                told.add(str(message))
            else:
                shown(message, category, *place, **more)

        warnings.showwarning = show
        if not sys.warnoptions:  # what the user has asked of Python holds
            for category in (Renamed, UserWarning):
                warnings.simplefilter("default", category)
        yield


class RenamedMembers(EnumType):
    """An enumeration whose members are found by the names of earlier versions too."""

    if not TYPE_CHECKING:  # to a type checker a name of an earlier version is none

        def __getattr__(cls, name: str) -> Any:
            """Find the member that was called ``name``."""
            new = MEMBERS.get(cls.__name__, {}).get(name)
            if new is None or new not in cls.__members__:
                raise AttributeError(f"type object {cls.__name__!r} has no attribute {name!r}")
            say(f"{cls.__name__}.{name}", f"{cls.__name__}.{new}", "member")
            return cls.__members__[new]
