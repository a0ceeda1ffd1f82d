"""The last frames as they were drawn, kept on the device for resolves that gather samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from cltaa.cameras import is_still
from cltaa.constants import MIDDLE_SPAN, SHORT_SPAN, SPANS
from cltaa.devices.launch import Buffer, Launcher
from cltaa.errors import ResourceError
from cltaa.frames import Frame
from cltaa.memory.layout import Layout
from cltaa.parameters.build import FRAME_DTYPE, Build, Steps, kept_planes, span_planes
from cltaa.planning.frame_plan import Plan
from cltaa.printable import counted
from cltaa.resolve.buffers import Buffers
from cltaa.resolve.frame_record import Past, frame_record


class KeptFrames:
    """A ring of ``count`` frames of one size and the one in work; ``past``: the facts about each, the latest first."""

    def __init__(self, launcher: Launcher, layout: Layout, count: int, steps: Steps) -> None:
        self.layout, self._launcher, self._count = layout, launcher, count
        self._planes, self._channels = kept_planes(steps), _channels(steps)
        self._slots = count + 1
        self.planes = _ring(launcher, (self._slots * self._planes, layout.rows, layout.stride), self._slots)
        self.records = launcher.allocate((count,), FRAME_DTYPE)
        self.past: tuple[Past, ...] = ()
        self._spans: dict[str, Buffer] = {}

    def fit(self, layout: Layout, count: int, steps: Steps) -> bool:
        """True when this ring holds ``count`` frames of that size and with those channels."""
        return (layout, count, _channels(steps)) == (self.layout, self._count, self._channels)

    def build(self, build: Build, frame: Frame) -> Build:
        """``build`` with camera motion where the camera differs from that of any kept frame."""
        moved = any(not is_still(frame.camera, past.camera) for past in self.past)
        return replace(build, steps=replace(build.steps, camera_motion=build.steps.camera_motion or moved))

    def span_memory(self, steps: Steps) -> dict[str, Buffer]:
        """Memory for what is gathered of the spans of the past, allocated when first asked for."""
        if not self._spans:
            for name, planes in (("spans", SPANS * span_planes(steps)), ("repeats", 1)):
                shape = (planes, self.layout.rows, self.layout.stride)
                self._spans[name] = self._launcher.allocate(shape, np.float32)
        return self._spans

    def standing(self, frame: Frame) -> int:
        """How many of the latest kept frames were seen by the camera of ``frame``."""
        told = self.past[: self._count]
        return next((place for place, past in enumerate(told) if not is_still(frame.camera, past.camera)), len(told))

    def describe(self, frame: Frame, plan: Plan) -> int:
        """Tell the device how ``frame`` looks from each kept frame; returns how many there are."""
        with self.records.mapped(write=True) as records:
            for place, past in enumerate(self.past[: self._count]):
                record = frame_record(frame, past, self.layout, plan)
                record["jitter_x"], record["jitter_y"] = past.jitter_px
                record["slot"] = past.index // frame.step % self._slots
                records[place] = record
            self._tell_repeats(frame, records)
        return min(len(self.past), self._count)

    def _tell_repeats(self, frame: Frame, records: NDArray[Any]) -> None:
        """Tell of each frame, that of now first, which other kept frame of one camera has its samples nearest to where
        they lie in their pixels, of the latest ones before them; of no more frames than the middle span has none."""
        standing, records["again"] = self.standing(frame), -1
        if standing <= MIDDLE_SPAN:
            return
        jitters = np.array([frame.jitter_px, *(past.jitter_px for past in self.past[:standing])])
        apart = np.square(jitters[:-1, None] - jitters[1:]).sum(-1)
        itself = np.arange(1, standing)
        apart[itself, itself - 1] = np.inf
        for place in range(1, SHORT_SPAN + 1):
            apart[place, :place] = np.inf
        records["again"][:standing] = apart.argmin(-1)

    def keep(self, frame: Frame, buffers: Buffers, steps: Steps) -> None:
        """Copy what was uploaded of ``frame`` into the ring, in the place of the oldest."""
        sources = [(buffers.channels["current"], 3), (buffers.closeness, 1)]
        if steps.own_motion:
            sources.append((buffers.channels["motion"], 2))
        if steps.alpha:
            sources.append((buffers.channels["alpha"], 1))
        if steps.reactive:
            sources.append((buffers.channels["reactive"], 1))
        at = (frame.index // frame.step % self._slots) * self._planes * self.layout.plane
        for source, planes in sources:
            self._launcher.copy(source, self.planes, at)
            at += planes * self.layout.plane
        self.past = (Past.of(frame), *self.past)[: self._slots]

    def go_back(self, last: Past | None) -> None:
        """Forget what was kept after ``last``, as of a frame that was interrupted; all where there is none."""
        self.past = tuple(past for past in self.past if last is not None and past.index <= last.index)

    def take_back(self) -> None:
        """Forget the frame that was kept last; those before it are all still there."""
        self.past = self.past[1:]


def _channels(steps: Steps) -> tuple[bool, ...]:
    """Which channels are kept: as many others take as much of the ring, but not of the memory for spans."""
    return steps.own_motion, steps.alpha, steps.reactive


def _ring(launcher: Launcher, shape: tuple[int, int, int], frames: int) -> Buffer:
    try:
        return launcher.allocate(shape, np.float32)
    except ResourceError as error:
        raise ResourceError(
            f"{error.what} to keep {counted(frames, 'frame')}", expected=error.expected, found=error.found,
            cure="keep fewer with --set frames_kept=N, or none with --preset default",
        ) from error  # fmt: skip
