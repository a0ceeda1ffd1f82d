"""The resolver: frames in, anti-aliased images out; it never knows who drew the pixels."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, Literal, NamedTuple, NoReturn, SupportsIndex, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.devices.kernel_files import code_sha256
from cltaa.devices.launch import Launcher, launcher_for
from cltaa.devices.one_process import OneProcess, no_copy
from cltaa.errors import UsageError
from cltaa.frame_checks import check_frame
from cltaa.frames import Frame
from cltaa.memory.layout import Layout
from cltaa.parameters.build import HALVES, Build, Steps, Storage, Terms, edge_build, shared, storage_of
from cltaa.parameters.choices import Choices, HistoryOf, LightChange, Settings
from cltaa.parameters.presets import Preset, load_preset
from cltaa.planning.frame_plan import Plan, plan_frame, recursive
from cltaa.resolve.buffers import Buffers, LastRun
from cltaa.resolve.frame_record import Past, frame_record
from cltaa.resolve.one_thread import one_thread
from cltaa.resolve.passes import Passes
from cltaa.resolve.recurrent import Recurrent
from cltaa.resolve.upload import upload


class Times(NamedTuple):
    """Seconds that one frame spent in each step."""

    upload: float
    kernels: float
    read_back: float


class Resolver(Recurrent):
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
        super().__init__()
        self.every_step = every_step
        if not isinstance(preset, str | Preset):
            raise UsageError("no preset", expected="a name or a cltaa.Preset", found=repr(preset))
        self.preset = load_preset(preset) if isinstance(preset, str) else preset
        self._device = device
        self.launcher = launcher_for(device)
        self._shape = build or Build(strict=strict, storage=storage_of(storage))
        self._builds: dict[tuple[Choices, Settings, Steps], Build] = {}
        self.plan: Plan | None = None
        self.last: LastRun | None = None
        self.times = Times(0.0, 0.0, 0.0)

    def __copy__(self) -> NoReturn:
        """Refuse: the copy's results would go where the history of this one is."""
        raise UsageError(
            "a copy of a resolver would write to the same memory",
            cure="make another one, or take copy.deepcopy on NumPy",
        )

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """What ``pickle`` and ``copy.deepcopy`` ask for; raises UsageError where a device is held."""
        if isinstance(self.launcher, OneProcess):
            raise no_copy(self)
        return super().__reduce_ex__(protocol)

    @property
    def storage(self) -> Storage:
        """The numbers that the history is kept in."""
        return self._shape.storage

    @property
    def keeps_halves(self) -> bool:
        """True where the history is kept in halves."""
        return self.storage in HALVES

    def settings(self) -> dict[str, Any]:
        """Everything that decides the bits of a result, beside the frames."""
        return {
            "code_sha256": code_sha256(),
            "device": self.launcher.description,
            "preset": self.preset.deciding(),
            "build": msgspec.to_builtins(self._shape),
        }

    @one_thread
    def reopen(self) -> None:
        """Open the device again after it was lost, without a history; raises what opening it raises."""
        self._buffers, self._kept, self._previous = None, None, None
        self.launcher, self._builds = launcher_for(self._device), {}

    @one_thread
    def reserve(self, width: int, height: int, *, alpha: bool, half: bool = False) -> None:
        """Do what every frame of a size needs, with or without alpha, while the first of them is still being read."""
        self._fitting(Layout(width, height), alpha or self.every_step)
        build = edge_build(self.launcher.build(self._shape))
        for kernel in (*([] if build.extends else ["extend_edges"]), *(["to_halves"] if half else [])):
            self.launcher.prepare(kernel, build)

    @overload
    def resolve(self, frame: Frame, *, half: Literal[False] = False) -> NDArray[np.float32]: ...

    @overload
    def resolve(self, frame: Frame, *, half: Literal[True]) -> NDArray[np.float16]: ...

    @overload
    def resolve(self, frame: Frame, *, half: bool) -> NDArray[np.float32] | NDArray[np.float16]: ...

    @one_thread
    def resolve(self, frame: Frame, *, half: bool = False) -> NDArray[Any]:
        """The resolved colour of ``frame``, [H, W, 3] float32, or [H, W, 4] where the frame has alpha.

        With ``half`` float16, infinite where it is 65504 or beyond; ``halves.limit_halves`` limits that.
        Raises DataError where ``cltaa.frame_checks`` finds a frame wrong, and UsageError where another thread is in it.
        """
        check_frame(frame)
        started = perf_counter()
        previous, build = self._begin(frame)
        buffers = self._fitting(Layout(frame.width, frame.height), build.steps.alpha)
        upload(frame, buffers, build.steps, self.preset.settings)
        uploaded = perf_counter()
        passes = self._run(frame, previous, build, buffers)
        assert self.last is not None
        output = self.last.arguments["output"]
        result = passes.to_halves(output) if half else output
        self.launcher.finish()
        resolved = perf_counter()
        image = buffers.read(result, frame.alpha is not None, np.float16 if half else np.float32)
        self.times = Times(uploaded - started, resolved - uploaded, perf_counter() - resolved)
        self._previous = None  # an interrupt from here on leaves no history, rather than a half of one
        buffers.swap()
        self._previous = Past.of(frame)
        return image

    @one_thread
    def release(self) -> None:
        """Let go of the channels of the last frame, which ``last`` and ``run_again`` need: the next may lie there."""
        self.last = None
        if self._buffers is not None:
            self._buffers.channels.clear()

    @one_thread
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

    @one_thread
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
        self.plan = self._plan(self.preset, frame, previous)
        return previous, self._build(self.plan)

    def _build(self, plan: Plan) -> Build:
        decided_by = plan.choices, plan.settings, plan.steps
        if decided_by not in self._builds:
            decided = {"choices": plan.choices, "steps": plan.steps, "terms": Terms.of(plan.settings)}
            self._builds[decided_by] = self.launcher.build(shared(msgspec.structs.replace(self._shape, **decided)))
        return self._builds[decided_by]

    def _run(self, frame: Frame, previous: Past | None, build: Build, buffers: Buffers) -> Passes:
        """Start the kernels of ``frame``, which ``buffers`` hold; returns what started them."""
        assert self.plan is not None
        choices, record = self.plan.choices, frame_record(frame, previous, buffers.layout, self.plan)
        passes = Passes(self.launcher, self.plan, build, buffers, record)
        if choices.history_of is HistoryOf.SAMPLES:
            kept = self._ring(previous, buffers.layout, build.steps)
            if choices.light_change is LightChange.SPANS:
                self.last = passes.gather_spans(frame, kept, self._beside(passes, frame, previous))
            else:
                self.last = passes.gather(frame, kept)
            kept.keep(frame, buffers, build.steps)
        else:
            self.last = passes.resolve()
        buffers.doubled = choices.history_of is HistoryOf.DOUBLED
        passes.extend_edges()
        return passes

    def _beside(self, passes: Passes, frame: Frame, previous: Past | None) -> Passes:
        """Those of the recursive resolve that runs beside the spans of the past."""
        plan = self._plan(recursive(self.preset), frame, previous)
        return replace(passes, plan=plan, build=self._build(plan))

    def _plan(self, preset: Preset, frame: Frame, previous: Past | None) -> Plan:
        return plan_frame(preset, frame, previous.camera if previous else None, every=self.every_step)
