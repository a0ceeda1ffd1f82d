"""Debug views: the decisions of the resolve at each pixel, from stage kernels that run on the memory of the fused one.

The fused kernel outputs none of them; the stages are its own functions one at a time (docs/design.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cltaa.core.backend import Buffer, Launcher
from cltaa.core.buffers import LastRun
from cltaa.core.build import Build
from cltaa.core.parameters import Rectify, Reject
from cltaa.errors import UsageError, closest, known, several
from cltaa.frame import Image

Planes = NDArray[Any]  # [planes, H, W]
MOST_REACTIVE = 0.5  # reactivity from which the reason is REACTIVE


class View(StrEnum):
    """What a debug view shows."""

    REJECT = "reject"  # why the history of each pixel was dropped
    COUNT = "count"  # effective sample count of the result
    MOTION = "motion"  # displacement that each pixel followed, pixels, x right, y down
    CLIP = "clip"  # how far rectification moved the history, length of the change of colour


class Reason(IntEnum):
    """Why history was dropped: the first cause that applies."""

    KEPT = 0
    NO_HISTORY = 1  # first frame, cut, gap, other size
    OFF_SCREEN = 2  # outside the previous image, or behind the previous camera
    BAD_TEXEL = 3  # NaN, or beyond the domain
    DEPTH = 4  # another surface, by its depth
    REACTIVE = 5  # at least half of it dropped by the reactive mask


def are_views(text: str) -> bool:
    """True for a comma-separated list of views; misspelt names count unless a file has that name."""
    names = _split(text)
    if all(name in [*View] for name in names):
        return bool(names)
    return any(closest(name, View) for name in names) and (len(names) > 1 or not Path(text).exists())


def parse_views(given: str | Iterable[str], origin: str = "--debug") -> tuple[View, ...]:
    """Parse a comma-separated list of views, or several, none for an empty text; raises UsageError for an unknown
    name."""
    names = _split(",".join(several(given, origin)))
    for name in names:
        if name not in [*View]:
            raise UsageError(f"{origin}: unknown view {name}", cure=known(name, View, "views"))
    return tuple(View(name) for name in dict.fromkeys(names))


def _split(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def decided(launcher: Launcher, last: LastRun, views: Iterable[View]) -> dict[str, Image]:
    """Return each of ``views`` of the frame resolved ``last``, [H, W] float32, of motion [H, W, 2]."""
    stages = _Stages(launcher, last)
    gathers = "ring" in last.arguments
    drawn: dict[View, Callable[[], Image]] = {
        View.REJECT: lambda: (_reasons_gathered(stages) if gathers else _reasons(stages)).astype(np.float32),
        View.COUNT: lambda: stages.read(last.arguments["output_count"])[0],
        View.MOTION: lambda: np.moveaxis(stages.read(stages.motion)[:2], 0, -1),
        View.CLIP: lambda: _clip_gathered(stages) if gathers else _clip_distance(stages),
    }
    return {view.value: drawn[view]() for view in views}


class _Stages:
    """The chain of stage kernels on the arguments of the fused kernel."""

    def __init__(self, launcher: Launcher, last: LastRun) -> None:
        self._launcher, self._last = launcher, last
        self.shape = (last.layout.height, last.layout.width)
        self.motion = self.run("surface_motion", last.build, 10, "motion_out", "current alpha inverse_depth motion", {})

    def run(self, kernel: str, build: Build, planes: int, output: str, given: str, made: dict[str, Buffer]) -> Buffer:
        """Run one kernel into new memory, on the fused one's arguments in ``given`` and those ``made`` by others."""
        layout, arguments = self._last.layout, self._last.arguments
        written = self._launcher.allocate((planes, layout.rows, layout.stride))
        structs = "frame" if kernel == "neighbourhood_statistics" else "frame settings"
        known = {name: arguments[name] for name in f"{given} {structs}".split()}
        self._launcher.run(kernel, build, layout, {**known, **made, output: written})
        self._launcher.finish()
        return written

    def history(self, build: Build, **made: Buffer) -> Buffer:
        """Return the history at the motion: r, g, b, alpha, count, fx, fy, valid, illumination change."""
        given = " ".join({"current", "alpha", "history", "history_count", "previous_inverse_depth"} - made.keys())
        return self.run("sample_history", build, 9, "history_at", given, {"motion_in": self.motion, **made})

    def read(self, buffer: Buffer) -> Planes:
        """Return the planes of a buffer without their halo."""
        with buffer.mapped(write=False) as planes:
            inside: Planes = self._last.layout.inside(planes).astype(np.float32)
        return inside

    def valid(self, build: Build, **made: Buffer) -> NDArray[np.bool_]:
        """Return where that history can be used, [H, W]."""
        valid: NDArray[np.bool_] = self.read(self.history(build, **made))[7] > 0.5
        return valid

    def gather(self, build: Build) -> Planes:
        """Return the colour that another build gathers, [3, H, W]."""
        layout, arguments = self._last.layout, self._last.arguments
        made = {name: self.blank(name) for name in ("output", "output_count")}
        self._launcher.run("gather", build, layout, {**arguments, **made})
        self._launcher.finish()
        return self.read(made["output"])[:3]

    def given(self, name: str) -> Any:
        """Return an argument of the fused kernel."""
        return self._last.arguments[name]

    @property
    def build(self) -> Build:
        """The build of the fused kernel."""
        return self._last.build

    def blank(self, name: str) -> Buffer:
        """Allocate zeroed memory like that of an argument; as a history it is black, and so has no bad texel."""
        layout = self._last.layout
        with self._last.arguments[name].mapped(write=False) as planes:
            count, dtype = len(planes), planes.dtype
        return self._launcher.allocate((count, layout.rows, layout.stride), dtype)


def _reasons(stages: _Stages) -> NDArray[np.int64]:
    """Return a Reason per pixel, by running the history stage with one cause of rejection after another removed."""
    if stages.given("frame")["reset"]:
        return np.full(stages.shape, Reason.NO_HISTORY.value)
    without_depth = replace(stages.build, choices=replace(stages.build.choices, reject=Reject.NONE))
    kept = stages.valid(stages.build)
    sound = stages.valid(without_depth)
    seen = stages.valid(without_depth, history=stages.blank("history"))
    reasons = np.select([kept, ~seen, ~sound], [Reason.KEPT, Reason.OFF_SCREEN, Reason.BAD_TEXEL], Reason.DEPTH)
    return _with_reactive(reasons, stages)


def _reasons_gathered(stages: _Stages) -> NDArray[np.int64]:
    """Return a Reason per pixel of a gathering resolve: why the latest frame had no sample, where none had one."""
    if stages.given("frames") == 0:
        return np.full(stages.shape, Reason.NO_HISTORY.value)
    count = stages.read(stages.given("output_count"))[0]
    u, v = stages.read(stages.motion)[:2]
    y, x = np.mgrid[: stages.shape[0], : stages.shape[1]] + 0.5
    inside = (x + u >= 0) & (y + v >= 0) & (x + u < stages.shape[1]) & (y + v < stages.shape[0])
    return _with_reactive(np.select([count > 1, ~inside], [Reason.KEPT, Reason.OFF_SCREEN], Reason.DEPTH), stages)


def _with_reactive(reasons: NDArray[np.int64], stages: _Stages) -> NDArray[np.int64]:
    reactive = stages.given("reactive")
    if reactive is not None:
        reasons[(reasons == Reason.KEPT) & (stages.read(reactive)[0] >= MOST_REACTIVE)] = Reason.REACTIVE
    return reasons


def _clip_gathered(stages: _Stages) -> Image:
    """Return the length of the change by rectification, in linear colour; gathers twice where there is any."""
    if stages.build.choices.rectify is Rectify.NONE:
        return np.zeros(stages.shape, np.float32)
    free = replace(stages.build, choices=replace(stages.build.choices, rectify=Rectify.NONE))
    change = stages.gather(stages.build) - stages.gather(free)
    distance: Image = np.sqrt((change**2).sum(0))
    return distance


def _clip_distance(stages: _Stages) -> Image:
    """Return the length of the change by rectification, in the range of the preset's blend; 0 without history."""
    statistics = stages.run(
        "neighbourhood_statistics", stages.build, 15, "statistics_out", "current alpha inverse_depth motion", {}
    )
    history = stages.history(stages.build)
    made = {"statistics_in": statistics, "motion_in": stages.motion, "history_at": history}
    change = stages.read(stages.run("rectify_history", stages.build, 5, "change_out", "", made))[:3]
    distance: Image = np.sqrt((change**2).sum(0))
    return np.where(stages.read(history)[7] > 0.5, distance, np.float32(0))
