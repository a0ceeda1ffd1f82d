"""The resolver: frames in, anti-aliased images out; it never knows who drew the pixels."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import msgspec

from cltaa.buffers import Buffers, LastRun
from cltaa.build import HALVES, Build, Record, Steps, Storage, Terms, edge_build, settings_record, shared
from cltaa.frame_checks import check_frame
from cltaa.frame_record import Past, frame_record
from cltaa.frames import Frame, Image
from cltaa.kept_frames import KeptFrames, run_spans
from cltaa.kernel_files import code_sha256
from cltaa.launch import Buffer, Launcher, launcher_for, storage_dtype
from cltaa.layout import Layout
from cltaa.params import Choices, HistoryOf, LightChange, Settings
from cltaa.planning import Plan, plan_frame, recursive
from cltaa.presets import Preset, load_preset
from cltaa.upload import upload


class Times(NamedTuple):
    """Seconds that one frame spent in each step."""

    upload: float
    kernels: float
    read_back: float


class Resolver:
    """Accumulates a sequence frame by frame.

    ``preset`` is a name or a Preset; ``device`` is None (first OpenCL device), a part of a device's name, its index,
    ``numpy``, or a launcher to share; ``strict`` builds kernels that match the NumPy oracle bit for bit; ``storage`` is
    the numbers that the history is kept in; ``every_step`` runs steps too that no frame calls for. A measurement gives
    a whole ``build`` in place of ``strict`` and ``storage``; of it the plan decides choices, steps and terms.
    A cut, a gap in the frame numbers or a change of size starts a new history.
    """

    def __init__(
        self,
        preset: str | Preset = "default",
        device: str | int | Launcher | None = None,
        *,
        strict: bool = False,
        storage: Storage = Storage.FLOAT,
        every_step: bool = False,
        build: Build | None = None,
    ) -> None:
        self.every_step = every_step
        self.preset = load_preset(preset) if isinstance(preset, str) else preset
        self._device = device
        self.launcher = launcher_for(device)
        self._shape = build or Build(strict=strict, storage=storage)
        self._builds: dict[tuple[Choices, Settings, Steps], Build] = {}
        self._buffers: Buffers | None = None
        self._kept: KeptFrames | None = None
        self._previous: Past | None = None
        self.plan: Plan | None = None
        self.last: LastRun | None = None
        self.times = Times(0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Forget the history: the next frame starts a new one."""
        self._previous = None

    @property
    def keeps_halves(self) -> bool:
        """True where the history is kept in halves."""
        return self._shape.storage in HALVES

    def settings(self) -> dict[str, Any]:
        """Everything that decides the bits of a result, beside the frames."""
        return {
            "code_sha256": code_sha256(),
            "device": self.launcher.description,
            "preset": self.preset.deciding(),
            "build": msgspec.to_builtins(self._shape),
        }

    def reopen(self) -> None:
        """Open the device again after it was lost, without a history; raises what opening it raises."""
        self._buffers, self._kept, self._previous = None, None, None
        self.launcher, self._builds = launcher_for(self._device), {}

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
        steps = Steps(**{n: getattr(past, n) or self.every_step for n in ("own_motion", "alpha", "reactive")})
        self._kept = KeptFrames(self.launcher, layout, self.preset.settings.frames_kept, steps)
        self._kept.past = past.earlier
        return {**buffers.recurrent(), "kept": self._kept.planes}

    def reserve(self, width: int, height: int, *, alpha: bool) -> None:
        """Do what every frame of a size needs, with or without alpha, while the first of them is still being read."""
        self._fitting(Layout(width, height), alpha or self.every_step)
        self.launcher.prepare("extend_edges", edge_build(self.launcher.build(self._shape)))

    def resolve(self, frame: Frame) -> Image:
        """The resolved colour of ``frame``, [H, W, 3] float32, or [H, W, 4] where the frame has alpha.

        Raises DataError where ``cltaa.frame_checks`` finds a frame wrong: channels, camera, jitter, exposure, effects.
        """
        check_frame(frame)
        started = perf_counter()
        previous, build = self._begin(frame)
        buffers = self._fitting(Layout(frame.width, frame.height), build.steps.alpha)
        upload(frame, buffers, build.steps, self.preset.settings)
        uploaded = perf_counter()
        self._run(frame, previous, build, buffers)
        self.launcher.finish()
        resolved = perf_counter()
        assert self.last is not None
        image = buffers.read(self.last.arguments["output"], frame.alpha is not None)
        self.times = Times(uploaded - started, resolved - uploaded, perf_counter() - resolved)
        buffers.swap()
        self._previous = Past.of(frame)
        return image

    def release(self) -> None:
        """Let go of the channels of the last frame, which ``last`` and ``run_again`` need: the next may lie there."""
        self.last = None
        (self._buffers.channels if self._buffers else {}).clear()

    def run_again(self, frame: Frame, previous: Frame) -> None:
        """Run the kernels of the last frame once more, to the same result, and wait for them: something to time.

        ``frame`` is what was resolved last and ``previous`` what was resolved before it.
        """
        assert self.plan is not None
        assert self._buffers is not None
        self._buffers.swap()
        if self._kept is not None:
            self._kept.take_back()
        self._run(frame, Past.of(previous), self._build(self.plan), self._buffers)
        self._buffers.swap()
        self.launcher.finish()

    def keep_again(self, frame: Frame, times: int) -> None:
        """Keep ``frame``, which was resolved last, as the last ``times`` ones, if any are kept: something to time."""
        if self._kept is None or self._buffers is None or self.plan is None:
            return
        self._buffers.swap()  # back to where the frame was uploaded
        for ago in reversed(range(times)):
            self._kept.keep(replace(frame, index=frame.index - ago), self._buffers, self.plan.steps)
        self._buffers.swap()

    def _begin(self, frame: Frame) -> tuple[Past | None, Build]:
        """Make the plan of ``frame``; returns the past that it continues, and what its kernels are built from."""
        previous = self._previous
        if previous is not None and not previous.continues_in(frame, self.preset.choices):
            previous = None
        self.plan = plan_frame(self.preset, frame, previous.camera if previous else None, every=self.every_step)
        return previous, self._build(self.plan)

    def _build(self, plan: Plan) -> Build:
        decided_by = plan.choices, plan.settings, plan.steps
        if decided_by not in self._builds:
            decided = {"choices": plan.choices, "steps": plan.steps, "terms": Terms.of(plan.settings)}
            self._builds[decided_by] = self.launcher.build(shared(msgspec.structs.replace(self._shape, **decided)))
        return self._builds[decided_by]

    def _fitting(self, layout: Layout, alpha: bool) -> Buffers:
        return there if (there := self._buffers) and there.fit(layout, alpha) else self._allocate(layout, alpha)

    def _allocate(self, layout: Layout, alpha: bool) -> Buffers:
        self._buffers = None  # released before the new ones are allocated
        self._buffers = Buffers(self.launcher, layout, alpha, storage_dtype(self._shape))
        return self._buffers

    def _ring(self, previous: Past | None, layout: Layout, steps: Steps) -> KeptFrames:
        """The ring of kept frames for this frame; it holds none where there is no predecessor."""
        if self._kept is None or not self._kept.fit(layout, self.preset.settings.frames_kept, steps):
            self._kept = None  # released before the new one is allocated
            self._kept = KeptFrames(self.launcher, layout, self.preset.settings.frames_kept, steps)
        if previous is None:
            self._kept.past = ()
        return self._kept

    def _run(self, frame: Frame, previous: Past | None, build: Build, buffers: Buffers) -> None:
        assert self.plan is not None
        layout, steps = buffers.layout, build.steps
        record = frame_record(frame, previous, layout, self.plan)
        if self.plan.choices.history_of is HistoryOf.SAMPLES:
            kept = self._ring(previous, layout, steps)
            build = kept.build(build, frame)
            ring = {"kept": kept.planes, "past": kept.records, "frames": kept.describe(frame, self.plan)}
            arguments = buffers.arguments(record, settings_record(self.plan.settings), steps)
            self.last = LastRun(build, layout, arguments | ring)
            if self.plan.choices.light_change is LightChange.SPANS:
                self._run_spans(frame, previous, kept, buffers)
            else:
                buffers.ready_counts(self.plan.choices, read=previous is not None)
                self.launcher.run("gather", *self.last)
            kept.keep(frame, buffers, steps)
        else:
            buffers.ready_counts(self.plan.choices, read=previous is not None)
            self._resolve(record, build, buffers)
        buffers.doubled = self.plan.choices.history_of is HistoryOf.DOUBLED
        for written in buffers.written(buffers.doubled):
            self.launcher.run("extend_edges", edge_build(build), layout, {"frame": record, **written})

    def _run_spans(self, frame: Frame, previous: Past | None, kept: KeptFrames, buffers: Buffers) -> None:
        """Gather spans of the past beside a recursive resolve of the frame, which is all that the next frame reads."""
        assert self.last is not None
        build, layout, arguments = self.last
        plan = plan_frame(recursive(self.preset), frame, previous.camera if previous else None, every=self.every_step)
        buffers.ready_counts(plan.choices, read=previous is not None)
        given = buffers.arguments(arguments["frame"], settings_record(plan.settings), build.steps)
        self.launcher.run("resolve", self._build(plan), layout, given | buffers.recurrent())
        written = {"recursive": buffers.output, "recursive_count": buffers.output_count}
        self.last = LastRun(build, layout, arguments | buffers.shown())
        run_spans(self.launcher, *self.last, kept.spans(frame, build.steps), written)

    def _resolve(self, record: Record, build: Build, buffers: Buffers) -> None:
        """Start the kernel that resolves what ``buffers`` hold of a frame."""
        assert self.plan is not None
        arguments = buffers.arguments(record, settings_record(self.plan.settings), build.steps)
        if self.plan.choices.history_of is HistoryOf.DOUBLED:
            record["reset"] |= not buffers.doubled  # the last frame may have left no history at 200 %
            kernel, given = "resolve_doubled", arguments | buffers.doubling()
        else:
            kernel, given = "resolve", arguments | buffers.recurrent()
        self.last = LastRun(build, buffers.layout, arguments | buffers.recurrent())
        self.launcher.run(kernel, build, buffers.layout, given)
