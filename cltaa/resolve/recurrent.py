"""What a resolver keeps from one frame to the next, on its device."""

from __future__ import annotations

from dataclasses import replace

from cltaa.devices.launch import Buffer, Launcher, storage_dtype
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build, Steps
from cltaa.parameters.presets import Preset
from cltaa.planning.frame_plan import channel_steps
from cltaa.resolve.buffers import Buffers
from cltaa.resolve.frame_record import Past
from cltaa.resolve.kept_frames import KeptFrames
from cltaa.resolve.one_thread import one_thread


class Recurrent:
    """Facts about the last frame, memory for images of its size, and the ring of kept frames where there is one."""

    launcher: Launcher
    preset: Preset
    every_step: bool
    _shape: Build

    def __init__(self) -> None:
        """Nothing is kept yet; the rest is the resolver's own to say."""
        self._buffers: Buffers | None = None
        self._kept: KeptFrames | None = None
        self._previous: Past | None = None

    @one_thread
    def reset(self) -> None:
        """Forget the history: the next frame starts a new one."""
        self._previous = None

    @one_thread
    def recurrent(self) -> tuple[Past, dict[str, Buffer]]:
        """What the next frame depends on: facts about the last one, and the memory that holds its result.

        Raises ValueError before the first frame and after ``reset``.
        """
        if self._previous is None or self._buffers is None:
            raise ValueError("there is no history")
        memory, past = self._buffers.recurrent(), replace(self._previous, marked=self._buffers.marked)
        if self._buffers.doubled:
            return replace(past, doubled=True), {**memory, "texels": self._buffers.texels()[0]}
        if self._kept is None:
            return past, memory
        return replace(past, earlier=self._kept.past), {**memory, "kept": self._kept.planes}

    @one_thread
    def restore(self, past: Past) -> dict[str, Buffer]:
        """Go on after ``past``; returns the memory to fill with what ``recurrent`` gave then, by the same names."""
        layout = Layout(past.shape[1], past.shape[0])
        buffers = self._allocate(layout, past.alpha or self.every_step)
        self._previous, self._kept = past, None
        buffers.doubled, buffers.marked = past.doubled, past.marked
        if past.doubled:
            return {**buffers.recurrent(), "texels": buffers.texels()[0]}
        if not past.earlier:
            return buffers.recurrent()
        steps = channel_steps(
            self.preset, motion=past.own_motion, alpha=past.alpha, reactive=past.reactive, every=self.every_step
        )
        kept = self._ring(past, layout, steps)
        kept.past = past.earlier
        return {**buffers.recurrent(), "kept": kept.planes}

    def _fitting(self, layout: Layout, alpha: bool) -> Buffers:
        """Memory for images of a size: what there is, where that fits."""
        if self._buffers is None or not self._buffers.fit(layout, alpha):
            return self._allocate(layout, alpha)
        return self._buffers

    def _allocate(self, layout: Layout, alpha: bool) -> Buffers:
        self._buffers = None  # released before the new ones are allocated
        self._buffers = self._new_buffers(layout, alpha)
        return self._buffers

    def _new_buffers(self, layout: Layout, alpha: bool) -> Buffers:
        return Buffers(self.launcher, layout, alpha, storage_dtype(self._shape))

    def _ring(self, previous: Past | None, layout: Layout, steps: Steps) -> KeptFrames:
        """The ring of kept frames for this frame; it holds none where there is no predecessor."""
        count = self.preset.settings.frames_kept
        if self._kept is None or not self._kept.fit(layout, count, steps):
            self._kept = None  # released before the new one is allocated
            self._kept = KeptFrames(self.launcher, layout, count, steps)
        self._kept.go_back(previous)
        return self._kept
