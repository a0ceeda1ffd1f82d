"""The resolver: frames in, anti-aliased images out; it never knows who drew the pixels."""

from __future__ import annotations

from time import perf_counter
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cltaa.buffers import Buffers, fill
from cltaa.build import Build, Real, Steps, Storage, settings_record
from cltaa.cameras import closeness, closeness_at
from cltaa.errors import DataError
from cltaa.frame_record import Past as Past
from cltaa.frame_record import frame_record as frame_record
from cltaa.frames import Frame, Image
from cltaa.kernel_files import code_sha256
from cltaa.launch import Buffer, Launcher, launcher_for, storage_dtype
from cltaa.layout import Layout
from cltaa.params import Preset
from cltaa.planning import Plan, plan_frame
from cltaa.presets import load_preset

# What a channel that a frame does not have would hold: no vector, all covered, nothing to distrust.
NOTHING = {"motion": np.nan, "alpha": 1.0, "reactive": 0.0}


class Times(NamedTuple):
    """Seconds that one frame spent in each step."""

    upload: float
    kernels: float
    read_back: float


class LastRun(NamedTuple):
    """What the fused kernel was given for the last frame; its memory holds that until the next one."""

    build: Build
    layout: Layout
    arguments: dict[str, Any]


class Resolver:
    """Accumulates a sequence frame by frame.

    ``preset`` is a name or a Preset; ``device`` is None (first OpenCL device), a part of a device's name, its index, or
    ``numpy``; ``strict`` builds kernels that match the NumPy oracle bit for bit; ``real`` and ``storage`` are the
    numbers that they compute with and keep the history in; ``every_step`` runs also the steps that no frame calls for.
    A cut, a gap in the frame numbers or a change of size starts a new history.
    """

    def __init__(
        self,
        preset: str | Preset = "default",
        device: str | Launcher | None = None,
        *,
        strict: bool = False,
        storage: Storage = Storage.FLOAT,
        real: Real = Real.FLOAT,
        lanes: int = 0,
        rows: int = 0,
        every_step: bool = False,
    ) -> None:
        self.every_step = every_step
        self.preset = load_preset(preset) if isinstance(preset, str) else preset
        self._device = device
        self.launcher = launcher_for(device) if device is None or isinstance(device, str) else device
        self._shape = Build(strict=strict, storage=storage, real=real, lanes=lanes, rows=rows)
        self._buffers: Buffers | None = None
        self._previous: Past | None = None
        self.plan: Plan | None = None
        self.last: LastRun | None = None
        self.times = Times(0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Forget the history: the next frame starts a new one."""
        self._previous = None

    def settings(self) -> dict[str, Any]:
        """Everything that decides the bits of a result, beside the frames."""
        return {
            "code_sha256": code_sha256(),
            "device": self.launcher.description,
            "preset": msgspec.to_builtins(self.preset),
            "build": msgspec.to_builtins(self._shape),
        }

    def reopen(self) -> None:
        """Open the device again after it was lost, without a history; raises what opening it raises."""
        self._buffers, self._previous = None, None
        if self._device is None or isinstance(self._device, str):
            self.launcher = launcher_for(self._device)

    def recurrent(self) -> tuple[Past, dict[str, Buffer]]:
        """What the next frame depends on: facts about the last one, and the memory that holds its result.

        Raises ValueError before the first frame and after ``reset``.
        """
        if self._previous is None or self._buffers is None:
            raise ValueError("there is no history")
        return self._previous, self._buffers.recurrent()

    def restore(self, past: Past) -> dict[str, Buffer]:
        """Go on after ``past``; returns the memory to fill with what ``recurrent`` gave then, by the same names."""
        layout = Layout(past.shape[1], past.shape[0])
        self._buffers = None  # released before the new ones are allocated
        self._buffers = Buffers(self.launcher, layout, past.alpha or self.every_step, storage_dtype(self._shape))
        self._previous = past
        return self._buffers.recurrent()

    def resolve(self, frame: Frame) -> Image:
        """The resolved colour of ``frame``, [H, W, 3] float32, or [H, W, 4] where the frame has alpha.

        Raises DataError where colour, depth or another channel differ in size.
        """
        _check_shapes(frame)
        started = perf_counter()
        previous = self._previous
        if previous is not None and not previous.continues_in(frame, self.preset.choices):
            previous = None
        camera = None if previous is None else previous.camera
        self.plan = plan_frame(self.preset, frame, camera, every=self.every_step)
        build = self._build(self.plan)
        buffers = self._prepare(frame, build)
        self._upload(frame, buffers, build.steps)
        uploaded = perf_counter()
        self._run(frame, previous, build, buffers)
        self.launcher.finish()
        resolved = perf_counter()
        image = buffers.read(frame.alpha is not None)
        self.times = Times(uploaded - started, resolved - uploaded, perf_counter() - resolved)
        buffers.swap()
        self._previous = Past.of(frame)
        return image

    def run_again(self, frame: Frame, previous: Frame) -> None:
        """Run the kernels of the last frame once more, to the same result, and wait for them: something to time.

        ``frame`` is what was resolved last and ``previous`` what was resolved before it.
        """
        assert self.plan is not None
        assert self._buffers is not None
        self._buffers.swap()
        self._run(frame, Past.of(previous), self._build(self.plan), self._buffers)
        self._buffers.swap()
        self.launcher.finish()

    def _build(self, plan: Plan) -> Build:
        shape = self._shape
        build = Build(
            choices=plan.choices,
            steps=plan.steps,
            real=shape.real,
            storage=shape.storage,
            lanes=shape.lanes,
            rows=shape.rows,
            strict=shape.strict,
        )
        return self.launcher.build(build)

    def _prepare(self, frame: Frame, build: Build) -> Buffers:
        layout = Layout(frame.width, frame.height)
        if self._buffers is None or not self._buffers.fit(layout, build.steps.alpha):
            self._buffers = None  # released before the new ones are allocated
            self._buffers = Buffers(self.launcher, layout, build.steps.alpha, storage_dtype(build))
        return self._buffers

    def _upload(self, frame: Frame, buffers: Buffers, steps: Steps) -> None:
        layout = buffers.layout
        fill(buffers.current, layout, np.moveaxis(frame.colour, -1, 0))
        with buffers.closeness.mapped(write=True) as planes:
            inside = layout.inside(planes)[0]
            closeness(frame.depth, frame.camera, out=inside)
            settings = self.preset.settings
            if settings.sky_at > 0.0 and not frame.camera.orthographic:
                sky = inside <= closeness_at(settings.sky_below, frame.camera)
                inside[sky] = closeness_at(settings.sky_at, frame.camera)
            layout.extend_edges(planes)
        planes_of = {"motion": 2, "alpha": 1, "reactive": 1}
        for name, wanted in (("motion", steps.own_motion), ("alpha", steps.alpha), ("reactive", steps.reactive)):
            channel = getattr(frame, name)
            if channel is not None:
                fill(buffers.optional(name, planes_of[name]), layout, np.atleast_3d(channel).transpose(2, 0, 1))
            elif wanted:
                nothing = np.full((planes_of[name], 1, 1), NOTHING[name], np.float32)
                fill(buffers.optional(name, planes_of[name]), layout, nothing)

    def _run(self, frame: Frame, previous: Past | None, build: Build, buffers: Buffers) -> None:
        assert self.plan is not None
        layout, steps = buffers.layout, build.steps
        record = frame_record(frame, previous, layout, self.plan)
        arguments = {
            "current": buffers.current,
            "closeness": buffers.closeness,
            "motion": buffers.optional("motion", 2) if steps.own_motion else None,
            "alpha": buffers.optional("alpha", 1) if steps.alpha else None,
            "reactive": buffers.optional("reactive", 1) if steps.reactive else None,
            "history": buffers.history,
            "history_count": buffers.history_count,
            "previous_closeness": buffers.previous_closeness,
            "output": buffers.output,
            "output_count": buffers.output_count,
            "frame": record,
            "settings": settings_record(self.plan.settings),
        }
        self.last = LastRun(build, layout, arguments)
        self.launcher.run("resolve", build, layout, arguments)
        float_build = build if build.storage is Storage.FLOAT else Build(lanes=build.lanes, rows=build.rows)
        self.launcher.run(
            "extend_edges", build, layout, {"image": buffers.output, "frame": record, "planes": 4 if steps.alpha else 3}
        )
        self.launcher.run(
            "extend_edges", float_build, layout, {"image": buffers.output_count, "frame": record, "planes": 1}
        )


def _check_shapes(frame: Frame) -> None:
    size = frame.colour.shape[:2]
    expected = {"colour": (*size, 3), "depth": size, "motion": (*size, 2), "alpha": size, "reactive": size}
    for name, shape in expected.items():
        array = getattr(frame, name)
        if array is not None and (array.shape != shape or 0 in shape):
            raise DataError(
                f"{name} has the wrong shape",
                path=frame.path,
                frame=frame.index,
                expected=shape if 0 not in shape else "at least one pixel",
                found=array.shape,
                cure="all channels of a frame share one size",
            )
