"""The kernels of one frame, in the order in which they run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.buffers import Buffers, FrameRing, LastRun
from cltaa.core.build import Build, Record, edge_build, mix_build, settings_record, window_count, window_planes
from cltaa.core.constants import BALANCED_DRIFT
from cltaa.core.plan import Plan
from cltaa.frame import Frame

WRITTEN = ("output", "output_count")


@dataclass(slots=True)
class Passes:
    """Enqueues the kernels that resolve the frame in ``buffers``, and waits for none.

    ``record`` is the kernels' struct of the frame. Each way to resolve returns the arguments of its kernel. Raises
    DeviceLost.
    """

    launcher: Launcher
    plan: Plan
    build: Build
    recursive: Build | None  # of the recursive resolve beside the gathered samples, where the plan has one
    buffers: Buffers
    record: Record

    def resolve(self) -> LastRun:
        """Resolve from the accumulated history."""
        buffers, build = self.buffers, self.recursive or self.build
        buffers.ready_counts(build.choices, read=not self.record["reset"])
        last = LastRun(build, buffers.layout, self._arguments() | buffers.recurrent())
        self.launcher.run("resolve", *last)
        return last

    def gather(self, frame: Frame, frame_ring: FrameRing) -> LastRun:
        """Resolve from the samples in ``frame_ring``."""
        last = self._gathering(frame, frame_ring)
        self._ready_counts()
        self.launcher.run("gather", *last)
        return last

    def gather_or_resolve(self, frame: Frame, frame_ring: FrameRing, held: int) -> LastRun:
        """Resolve a still scene from the accumulated history, ``held`` frames of which its camera saw, and if
        ``frame_ring`` holds more, from its samples."""
        last = self.resolve()
        if frame_ring.holds_more(frame, held):
            last = self._gathering(frame, frame_ring)
            self.launcher.run("gather", *last)
        return last

    def gather_windows(self, frame: Frame, frame_ring: FrameRing) -> LastRun:
        """Resolve from temporal windows in ``frame_ring``, where the plan says so also from an accumulated history."""
        if self.recursive is None:
            self._ready_counts()
        else:
            self.resolve()
        build, layout, arguments = last = self._gathering(frame, frame_ring)
        windows = {"windows": frame_ring.window_memory(build)}
        inputs = {name: value for name, value in arguments.items() if name not in WRITTEN}
        recursive = {"recursive": self.buffers.output, "recursive_count": self.buffers.output_count}
        unmoved = {"static_frames": frame_ring.static_frames(frame), **recursive}
        self.launcher.run("gather_windows", build, layout, inputs | windows | unmoved)
        if not build.extends:
            gathered = {"image": windows["windows"], "floats": None, "frame": self.record}
            floats = Build(lanes=build.lanes, rows=build.rows)  # windows are floats, whatever the history's storage
            planes = {"planes": window_count(build.choices, build.steps) * window_planes(build.steps), "more": 0}
            self.launcher.run("extend_edges", floats, layout, gathered | planes)
        mixed = {name: arguments[name] for name in ("current", "alpha", *WRITTEN, "frames", "frame", "settings")}
        mixed |= {"static_frames": unmoved["static_frames"]}
        # What a reactive mask marks, such as smoke, has no trend of light. Windows that frames ahead balance lag less.
        ratio = 0.0 if build.steps.reactive else frame_ring.lag_ratio(frame)
        share = 0.0 if build.steps.reactive else 1.0 if ratio > 0.0 else BALANCED_DRIFT
        mixed |= {"lag_ratio": np.float32(ratio), "drift_share": np.float32(share)}
        self.launcher.run("mix_windows", mix_build(build), layout, windows | mixed)
        if build.extends and self.recursive is None:
            self._extend()
        return last

    def extend_edges(self) -> None:
        """Repeat the edges of what the next frame reads, where the kernels have not done so."""
        if not self.build.extends:
            self._extend()

    def _extend(self) -> None:
        given = {"frame": self.record, **self.buffers.written()}
        self.launcher.run("extend_edges", edge_build(self.build), self.buffers.layout, given)

    def _ready_counts(self) -> None:
        self.buffers.ready_counts(self.plan.choices, read=not self.record["reset"])

    def _arguments(self) -> dict[str, Any]:
        return self.buffers.arguments(self.record, settings_record(self.plan.settings), self.build.steps)

    def _gathering(self, frame: Frame, frame_ring: FrameRing) -> LastRun:
        """Return the build, layout and arguments of a kernel that gathers."""
        count = frame_ring.describe(frame, self.plan)
        ring = {"ring": frame_ring.planes, "past": frame_ring.records, "frames": count}
        beside = {} if self.recursive is None else self.buffers.beside()
        return LastRun(frame_ring.build(self.build, frame), self.buffers.layout, self._arguments() | ring | beside)
