"""Names of earlier versions that this one still accepts, and their current names. (words: frozen)

A name is looked up here only where it is not a current one. An old name prints a warning of one line, once; files are
read without one, because they outlive code.
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
    "gamma_still": "box_scale_static",
    "gamma_moving": "box_scale_moving",
    "thin_frames": "subpixel_frames",
    "fresh_blur": "disocclusion_blur",
}
# Values of a choice, by its current key.
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
    """Warn that ``old``, a ``what``, is now called ``new``."""
    warnings.warn(f"{what} {old} is called {new} now; the next version takes that alone", Renamed, stacklevel=4)


def current(name: str, table: Mapping[str, str], names: Mapping[str, object] | frozenset[str], what: str) -> str:
    """Return the current name of ``name``: its new one where ``names``, the current ones, hold that and not
    ``name``."""
    new = table.get(name)
    if new is None or name in names or new not in names:
        return name
    say(name, new, what)
    return new


@contextmanager
def one_line_each() -> Iterator[None]:
    """Print warnings on a command line as one line on standard error each, without a place in our code."""
    told: set[str] = set()
    with warnings.catch_warnings():
        shown = warnings.showwarning

        def show(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, Renamed | UserWarning):
                if str(message) not in told:  # Python counts by place, and a command may warn at several
                    print(f"cltaa: warning: {printable(str(message))}", file=sys.stderr)
                told.add(str(message))
            else:
                shown(message, category, *place, **more)

        warnings.showwarning = show
        if not sys.warnoptions:  # the user's own settings of Python take precedence
            for category in (Renamed, UserWarning):
                warnings.simplefilter("default", category)
        yield


class RenamedMembers(EnumType):
    """An enumeration that finds its members by the names of earlier versions too."""

    if not TYPE_CHECKING:  # hidden from type checkers, which reject old names

        def __getattr__(cls, name: str) -> Any:
            """Find the member that was called ``name``."""
            new = MEMBERS.get(cls.__name__, {}).get(name)
            if new is None or new not in cls.__members__:
                raise AttributeError(f"type object {cls.__name__!r} has no attribute {name!r}")
            say(f"{cls.__name__}.{name}", f"{cls.__name__}.{new}", "member")
            return cls.__members__[new]
