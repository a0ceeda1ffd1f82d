"""Names of what ``cltaa resolve --debug`` can show of each pixel; ``cltaa.core.debug`` finds it out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

from cltaa.errors import UsageError, closest, known


class View(StrEnum):
    """What can be looked at."""

    REJECT = "reject"  # why the history of each pixel was dropped
    COUNT = "count"  # samples that the result stands for
    MOTION = "motion"  # displacement that each pixel followed, pixels, x right, y down
    CLIP = "clip"  # how far rectification moved the history, length of the change of colour


def are_views(text: str) -> bool:
    """True for a comma-separated list of views, misspelt ones too unless something of that name is there."""
    names = _split(text)
    if all(name in [*View] for name in names):
        return bool(names)
    return any(closest(name, View) for name in names) and (len(names) > 1 or not Path(text).exists())


def parse_views(text: str, origin: str = "--debug") -> tuple[View, ...]:
    """Views named in a comma-separated list, none for an empty text; raises UsageError for an unknown name."""
    names = _split(text)
    for name in names:
        if name not in [*View]:
            raise UsageError(f"{origin}: unknown view {name}", cure=known(name, View, "views"))
    return tuple(View(name) for name in dict.fromkeys(names))


def _split(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
