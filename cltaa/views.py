"""Names of what ``cltaa resolve --debug`` can show of each pixel; ``cltaa.debug`` draws them."""

from __future__ import annotations

from enum import StrEnum

from cltaa.errors import UsageError


class View(StrEnum):
    """What can be looked at."""

    REJECT = "reject"  # why the history of each pixel was dropped
    COUNT = "count"  # samples that the result stands for
    MOTION = "motion"  # displacement that each pixel followed, pixels, x right, y down
    CLIP = "clip"  # how far rectification moved the history, length of the change of colour


def are_views(text: str) -> bool:
    """True for a comma-separated list of views and nothing else."""
    return bool(text) and all(name.strip() in [*View] for name in text.split(","))


def parse_views(text: str) -> tuple[View, ...]:
    """Views named in a comma-separated list, none for an empty text; raises UsageError for an unknown name."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in [*View]:
            raise UsageError("--debug: unknown view", expected=", ".join(View), found=name)
    return tuple(View(name) for name in dict.fromkeys(names))
