"""What a sequence declares held against what its pixels show.

A broken promise (an effect that is there and not declared) makes a resolve wrong, because the plan trusts the list; an
idle one (declared, and never there) only costs time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cltaa.exr.attributes import FrameHeader
from cltaa.exr.channels import Pixels
from cltaa.frames import Effect
from cltaa.inspection.changes import ColourChange, DepthChange, Uncovering
from cltaa.planning.estimates import CHANGING, nothing_changes

BRIGHT = 8.0  # "far above 1"
# Any of these moves what a pixel shows.
MOVING = frozenset({Effect.CAMERA, Effect.MOTION, Effect.UNCOVER, Effect.CUT})


class Witness:
    """Looks at the frames of a sequence in order; ``broken`` and ``idle`` say what it saw."""

    def __init__(self) -> None:
        self._seen: set[Effect] = set()
        self._brightest = 0.0
        self._depth, self._colour, self._uncovering = DepthChange(), ColourChange(), Uncovering()

    def look(self, header: FrameHeader, channels: Mapping[str, Pixels]) -> None:
        """Take in one frame."""
        self._seen |= set(_shown(channels))
        self._brightest = max(self._brightest, *(_highest(channels[name]) for name in "RGB"))
        declared = header.effects
        if declared is None:
            return
        if not declared & MOVING:
            self._depth.look(header, np.asarray(channels["Z"], np.float32))
        elif Effect.UNCOVER not in declared:
            self._uncovering.look(header, channels)
        if nothing_changes(declared):
            self._colour.look(header, np.stack([np.asarray(channels[name], np.float32) for name in "RGB"]))

    def broken(self, declared: frozenset[Effect] | None) -> list[str]:
        """Effects that the pixels show and the declaration leaves out."""
        if declared is None:
            return []
        problems = []
        if self._brightest > BRIGHT and Effect.HDR not in declared:
            problems.append(f"effect hdr shows in the pixels (up to {self._brightest:.4g}) but is not declared")
        if self._depth.frame is not None:
            problems.append(_undeclared("depth changes", self._depth.frame, MOVING))
        elif self._colour.frame is not None:
            problems.append(_undeclared("colour changes", self._colour.frame, CHANGING))
        if self._uncovering.frame is not None:
            problems.append(
                f"something comes into view at frame {self._uncovering.frame}, but effect uncover is not declared"
            )
        return problems

    def idle(self, declared: frozenset[Effect] | None) -> list[str]:
        """Effects that are declared and never show, with what makes that sure."""
        return [
            f"effect {effect} is declared, but {says}: leave it out and save its step"
            for effect, says in _IDLE.items() if effect in (declared or ()) and effect not in self._seen
        ]  # fmt: skip


def _undeclared(what: str, frame: int, effects: frozenset[Effect]) -> str:
    return f"{what} at frame {frame}, but no effect out of {', '.join(sorted(effects))} is declared"


_IDLE = {
    Effect.MOTION: "the motion channel is zero or NaN everywhere",
    Effect.REACTIVE: "channel reactive is 0 everywhere",
    Effect.ALPHA: "channel A is 1 everywhere",
    Effect.HDR: "no value is above 1",
    Effect.SKY: "depth is finite everywhere",
}


def _shown(channels: Mapping[str, Pixels]) -> Iterable[Effect]:
    """Effects that one frame's pixels show; what lies between 1 and BRIGHT may be called HDR or not."""
    motion = [channels[name] for name in ("backward.u", "backward.v") if name in channels]
    if any((np.nan_to_num(plane) != 0).any() for plane in motion):
        yield Effect.MOTION
    if "reactive" in channels and (channels["reactive"] != 0).any():
        yield Effect.REACTIVE
    if "A" in channels and (channels["A"] != 1).any():
        yield Effect.ALPHA
    if any(_highest(channels[name]) > 1.0 for name in "RGB"):
        yield Effect.HDR
    if np.isinf(channels["Z"]).any():
        yield Effect.SKY


def _highest(plane: Pixels) -> float:
    return float(np.max(np.asarray(plane, np.float32), where=np.isfinite(plane), initial=0.0))
