"""The resolver: frames in, anti-aliased images out; it never knows who drew the pixels."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.build import FRAME_DTYPE, Build, Record, Storage, settings_record
from cltaa.cameras import Displacement, closeness, displacement, sky_closeness
from cltaa.errors import DataError
from cltaa.frames import Camera, Frame, Image
from cltaa.launch import Buffer, Launcher, launcher_for, storage_dtype
from cltaa.layout import Layout
from cltaa.params import Preset
from cltaa.plan import Plan, plan_frame
from cltaa.presets import load_preset


class Times(NamedTuple):
    """Seconds that one frame spent in each step."""

    upload: float
    kernels: float
    read_back: float


@dataclass(frozen=True, slots=True)
class Past:
    """What the next frame needs to know of this one, without its pixels."""

    index: int
    camera: Camera
    exposure: float
    shape: tuple[int, ...]
    alpha: bool

    @classmethod
    def of(cls, frame: Frame) -> Past:
        """The past that ``frame`` becomes."""
        return cls(frame.index, frame.camera, frame.exposure, frame.colour.shape, frame.alpha is not None)


class Resolver:
    """Accumulates a sequence frame by frame.

    ``preset`` is a name or a Preset; ``device`` is None (first OpenCL device), a part of a device's name, its index, or
    ``numpy``; ``strict`` builds kernels that match the NumPy oracle bit for bit. A cut, a gap in the frame numbers or a
    change of size starts a new history.
    """

    def __init__(
        self,
        preset: str | Preset = "default",
        device: str | Launcher | None = None,
        *,
        strict: bool = False,
        storage: Storage = Storage.FLOAT,
        lanes: int = 0,
        rows: int = 0,
    ) -> None:
        self.preset = load_preset(preset) if isinstance(preset, str) else preset
        self.launcher = launcher_for(device) if device is None or isinstance(device, str) else device
        self._shape = Build(strict=strict, storage=storage, lanes=lanes, rows=rows)
        self._buffers: _Buffers | None = None
        self._previous: Past | None = None
        self.plan: Plan | None = None
        self.times = Times(0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Forget the history: the next frame starts a new one."""
        self._previous = None

    def resolve(self, frame: Frame) -> Image:
        """The resolved colour of ``frame``, [H, W, 3] float32, or [H, W, 4] where the frame has alpha.

        Raises DataError where colour, depth or another channel differ in size.
        """
        _check_shapes(frame)
        started = perf_counter()
        previous = self._predecessor(frame)
        self.plan = plan_frame(self.preset, frame, None if previous is None else previous.camera)
        build = self._build(self.plan)
        buffers = self._prepare(frame, build)
        self._upload(frame, buffers)
        uploaded = perf_counter()
        self._run(frame, previous, build, buffers)
        self.launcher.finish()
        resolved = perf_counter()
        image = buffers.read(frame.alpha is not None)
        self.times = Times(uploaded - started, resolved - uploaded, perf_counter() - resolved)
        buffers.swap()
        self._previous = Past.of(frame)
        return image

    def _predecessor(self, frame: Frame) -> Past | None:
        """The past whose history continues into this one."""
        previous = self._previous
        if previous is None or frame.cut or frame.index != previous.index + 1:
            return None
        same_planes = (frame.colour.shape, frame.alpha is not None) == (previous.shape, previous.alpha)
        same_kind = frame.camera.orthographic == previous.camera.orthographic
        return previous if same_planes and same_kind else None

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

    def _prepare(self, frame: Frame, build: Build) -> _Buffers:
        layout = Layout(frame.width, frame.height)
        if self._buffers is None or not self._buffers.fit(layout, build):
            self._buffers = None  # released before the new ones are allocated
            self._buffers = _Buffers(self.launcher, layout, build)
        return self._buffers

    def _upload(self, frame: Frame, buffers: _Buffers) -> None:
        layout = buffers.layout
        _fill(buffers.current, layout, np.moveaxis(frame.colour, -1, 0))
        with buffers.closeness.mapped(write=True) as planes:
            closeness(frame.depth, frame.camera, out=layout.inside(planes)[0])
            layout.extend_edges(planes)
        if frame.motion is not None:
            _fill(buffers.optional("motion", 2), layout, np.moveaxis(frame.motion, -1, 0))
        for name, channel in (("alpha", frame.alpha), ("reactive", frame.reactive)):
            if channel is not None:
                _fill(buffers.optional(name, 1), layout, channel[None])

    def _run(self, frame: Frame, previous: Past | None, build: Build, buffers: _Buffers) -> None:
        assert self.plan is not None
        layout, steps = buffers.layout, build.steps
        record = frame_record(frame, previous, layout)
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
        self.launcher.run("resolve", build, layout, arguments)
        float_build = build if build.storage is Storage.FLOAT else Build(lanes=build.lanes, rows=build.rows)
        self.launcher.run(
            "extend_edges", build, layout, {"image": buffers.output, "frame": record, "planes": 4 if steps.alpha else 3}
        )
        self.launcher.run(
            "extend_edges", float_build, layout, {"image": buffers.output_count, "frame": record, "planes": 1}
        )


class _Buffers:
    """Device memory of one image size; history and output, and closeness now and then, change places each frame."""

    def __init__(self, launcher: Launcher, layout: Layout, build: Build) -> None:
        self.layout, self._launcher = layout, launcher
        self._history_planes = 4 if build.steps.alpha else 3
        self._dtype = storage_dtype(build)
        self.current = self._planes(3)
        self.closeness, self.previous_closeness = self._planes(1), self._planes(1)
        self.history = self._planes(self._history_planes, self._dtype)
        self.output = self._planes(self._history_planes, self._dtype)
        self.history_count, self.output_count = self._planes(1), self._planes(1)
        self._optional: dict[str, Buffer] = {}

    def _planes(self, count: int, dtype: Any = np.float32) -> Buffer:
        return self._launcher.allocate((count, self.layout.rows, self.layout.stride), dtype)

    def fit(self, layout: Layout, build: Build) -> bool:
        """True when these buffers serve a frame of that size and build."""
        return layout == self.layout and (4 if build.steps.alpha else 3) == self._history_planes

    def optional(self, name: str, planes: int) -> Buffer:
        """A buffer that only some sequences need, allocated when first asked for."""
        if name not in self._optional:
            self._optional[name] = self._planes(planes)
        return self._optional[name]

    def read(self, alpha: bool) -> Image:
        """The output as [H, W, 3 or 4] float32, planar in memory."""
        with self.output.mapped(write=False) as planes:
            image: NDArray[np.float32] = self.layout.inside(planes)[: 4 if alpha else 3].astype(np.float32)
        return np.moveaxis(image, 0, -1)

    def swap(self) -> None:
        """What was written becomes what is read."""
        self.history, self.output = self.output, self.history
        self.history_count, self.output_count = self.output_count, self.history_count
        self.closeness, self.previous_closeness = self.previous_closeness, self.closeness


def frame_record(frame: Frame, previous: Past | None, layout: Layout) -> Record:
    """The per-frame struct of the kernels for ``frame``, whose history is that of ``previous`` (None: none)."""
    earlier: Camera = frame.camera if previous is None else previous.camera
    moved: Displacement = displacement(frame.camera, earlier, layout.width, layout.height)
    record = np.zeros((), FRAME_DTYPE)
    record["width"], record["height"], record["stride"] = layout.width, layout.height, layout.stride
    record["reset"] = int(previous is None)
    record["origin_x"] = 0.5 + frame.jitter_px[0] - layout.width / 2.0
    record["origin_y"] = 0.5 + frame.jitter_px[1] - layout.height / 2.0
    for row, letter in enumerate("xyw"):
        for column, by in enumerate("xyq1"):
            record[letter + by] = moved.rows[row, column]
    for column, by in enumerate("xyq1"):
        record["z" + by] = moved.closeness[column]
    record["sky_closeness"] = sky_closeness(frame.camera)
    record["exposure_ratio"] = 1.0 if previous is None else frame.exposure / previous.exposure
    return record


def _fill(buffer: Buffer, layout: Layout, planes: NDArray[np.float32]) -> None:
    with buffer.mapped(write=True) as target:
        layout.inside(target)[: len(planes)] = planes
        layout.extend_edges(target)


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
