"""The resolver: frames in, anti-aliased images out, whatever drew the pixels."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from time import perf_counter
from typing import Any, Literal, NamedTuple, NoReturn, Self, SupportsIndex, TypeVar, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.backend import Buffer, Launcher, Queue, launcher_for, storage_dtype
from cltaa.core.buffers import Buffers, FrameRing, LastRun, upload
from cltaa.core.build import HALVES, Build, Steps, Storage, build_of, code_sha256, edge_build, storage_of
from cltaa.core.cuts import Coarse, coarse_colours, looks_cut
from cltaa.core.debug import View, decided, parse_views
from cltaa.core.frame_checks import check_frame, each_frame
from cltaa.core.parameters import Choices, HistoryKind, Illumination, Settings
from cltaa.core.passes import Passes
from cltaa.core.plan import JittersBefore, Plan, channel_steps, from_ring_alone, plan_frame, recursive_choices
from cltaa.core.planes import Layout, checked_layout, checked_out, empty_result, may_overlap, result_shape
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.record import Past, frame_record, frames_held
from cltaa.errors import ResourceError, UsageError, check_flags, public
from cltaa.frame import Array, Frame, on_device, outline
from cltaa.printable import counted
from cltaa.process import OneProcess, no_copy, one_thread

Out = TypeVar("Out", bound=Array)
CUTS_KEPT = 1024  # most found cuts that a resolver remembers


class Times(NamedTuple):
    """Seconds that one frame took in each step."""

    upload: float
    kernels: float
    read_back: float


class Resolver:
    """Accumulates a sequence frame by frame.

    ``preset`` is a name or a Preset; ``device`` is None (first OpenCL device), a part of a device's name, its index,
    ``numpy``, a launcher to share, or a ``pyopencl.CommandQueue``, for arrays on its device; ``strict`` builds kernels
    that match the NumPy oracle bit for bit; ``storage`` is the type in which the history is stored; ``every_step`` also
    runs steps that no frame needs. A measurement gives a whole ``build`` in place of ``strict`` and ``storage``; the
    plan decides choices, steps and terms of it. A cut, a gap in the frame numbers or a change of size starts a new
    history.

    ``look_ahead`` overrides the preset's: with N of it ``feed`` replaces ``resolve``, and the image of a frame is ready
    when N more have come. Raises UsageError where the preset keeps no frames.
    """

    @public("Resolver")
    def __init__(
        self,
        preset: str | Preset = "default",
        device: str | int | Launcher | Queue | None = None,
        *,
        strict: bool = False,
        storage: Storage = Storage.FLOAT,
        every_step: bool = False,
        build: Build | None = None,
        look_ahead: int | None = None,
    ) -> None:
        check_flags(strict=strict, every_step=every_step)
        if isinstance(look_ahead, str):
            raise UsageError("look_ahead is wrong", expected="a whole number", found=repr(look_ahead))
        if not isinstance(build, Build | None):
            raise UsageError("no build", expected="None, or that of a measurement", found=repr(build))
        self.every_step = every_step
        if not isinstance(preset, str | Preset):
            raise UsageError("no preset", expected="a name or a cltaa.Preset", found=repr(preset))
        over = {} if look_ahead is None else {"look_ahead": look_ahead}
        self.preset = override(load_preset(preset) if isinstance(preset, str) else preset, over, "Resolver")
        if self.look_ahead and self.preset.choices.history is not HistoryKind.FRAMES:
            raise UsageError(
                f"preset {self.preset.name} keeps no frames, so it cannot look ahead",
                cure="take one that gathers, as gather-8+8",
            )
        self._device, self.launcher = device, launcher_for(device)
        self._asked = build or Build(strict=strict, storage=storage_of(storage))
        self._builds: dict[tuple[Choices, Settings, Steps], Build] = {}
        # State for the next frame: facts about the last one, memory of its size, and a frame ring.
        self._buffers: Buffers | None = None
        self._frame_ring: FrameRing | None = None
        self._previous: Past | None = None
        self._jitters = JittersBefore()
        # With look-ahead: the frame that came last, and outlines of those that wait for later ones.
        self._latest: Past | None = None
        self._waiting: deque[Frame] = deque()
        self._coarse: Coarse = ()  # of the current frame
        self.cuts_found: deque[int] = deque(maxlen=CUTS_KEPT)  # frame numbers, the latest last
        self._lends = False  # whether an unfinished frame may still use arrays of the host
        self._closed = self._told = False  # told: of a frame without samples
        self.plan: Plan | None = None
        self.last: LastRun | None = None
        self.times = Times(0.0, 0.0, 0.0)

    @one_thread
    def __enter__(self) -> Self:
        """Return the resolver itself; the block's end closes it."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close it; an exception is not followed by the warning about frames that wait."""
        self._end(tells=kind is None)

    def __repr__(self) -> str:
        """The preset and the device."""
        return f"{type(self).__name__}({self.preset.name!r} on {self.launcher.description})"

    def __copy__(self) -> NoReturn:
        """Refuse to copy: the copy would write to the history of this one."""
        raise UsageError(
            "a copy of a resolver would write to the same memory",
            cure="make another one, or take copy.deepcopy on NumPy",
        )

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """Support ``pickle`` and ``copy.deepcopy``; raises UsageError where a device is held."""
        if isinstance(self.launcher, OneProcess):
            raise no_copy(self)
        return super().__reduce_ex__(protocol)

    @property
    def storage(self) -> Storage:
        """The type in which the history is stored."""
        return self._asked.storage

    @property
    def keeps_halves(self) -> bool:
        """True where the history is stored in halves."""
        return self.storage in HALVES

    @property
    def look_ahead(self) -> int:
        """How many later frames an image waits for."""
        return self.preset.settings.look_ahead

    @one_thread
    def settings(self) -> dict[str, Any]:
        """Return everything that decides the bits of a result, besides the frames."""
        return {
            "code_sha256": code_sha256(),
            "device": self.launcher.description,
            "preset": self.preset.deciding(),
            "build": msgspec.to_builtins(self._asked),
        }

    @one_thread
    def reset(self) -> None:
        """Forget the history, and the waiting frames: the next frame starts a new one."""
        self._forget()

    def close(self) -> None:
        """Free the device memory; all other methods then raise UsageError. Warns where frames wait for later ones."""
        self._end(tells=True)

    @one_thread
    def _end(self, *, tells: bool) -> None:
        self._closed, waiting = True, len(self._waiting)
        self._free()
        if waiting and tells:
            what = f"the resolver closed while {counted(waiting, 'frame')} waited for later ones"
            warnings.warn(f"{what}: call flush() before, for their images", stacklevel=4)  # of close, or of the block

    @one_thread
    def reopen(self) -> None:
        """Open the device again after it was lost, without a history; raises the errors of opening it."""
        self._free()
        self.launcher, self._builds = launcher_for(self._device), {}

    @one_thread
    def reserve(self, width: int, height: int, *, alpha: bool, half: bool = False) -> None:
        """Prepare for frames of a size, with or without alpha, while the first of them is still being read."""
        self._fitting(checked_layout(width, height), alpha or self.every_step)
        build = edge_build(self.launcher.build(self._asked))
        for kernel in (*([] if build.extends else ["extend_edges"]), "pack"):
            self.launcher.prepare(kernel, build)
        self.launcher.prepare("unpack", self.launcher.build(Build(strict=True)))

    @one_thread
    def empty(self, shape: tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
        """Allocate an array, not filled, for frames or for ``out``: in pinned memory, which a GPU reads and writes at
        the speed of its bus; elsewhere as ``np.empty`` does.

        Of float32 or float16. Pinned memory is scarce and slow to allocate: allocate as many arrays as are in use,
        once. Raises UsageError for other types, and ResourceError.
        """
        try:
            if np.dtype(dtype) not in (np.float32, np.float16):
                raise UsageError("unsupported type of numbers", expected="float32 or float16", found=np.dtype(dtype))
            wanted = np.empty(shape, dtype)  # takes no memory until it is touched
        except (TypeError, ValueError):
            expected = "whole numbers from 0 on that memory can hold"
            raise UsageError("empty: unusable shape or type", expected=expected, found=repr((shape, dtype))) from None
        except MemoryError as error:
            raise ResourceError(f"not enough memory for an array: {error}") from None
        return self.launcher.pinned(wanted.nbytes).view(wanted.dtype).reshape(wanted.shape)

    @overload
    def resolve(self, frame: Frame, *, half: Literal[False] = False) -> NDArray[np.float32]: ...

    @overload
    def resolve(self, frame: Frame, *, half: Literal[True]) -> NDArray[np.float16]: ...

    @overload
    def resolve(self, frame: Frame, *, half: bool) -> NDArray[np.float32] | NDArray[np.float16]: ...

    @overload
    def resolve(self, frame: Frame, *, out: Out) -> Out: ...  # an array of the host or of the device

    @one_thread
    def resolve(self, frame: Frame, *, half: bool = False, out: Any = None) -> Any:
        """Return the resolved colour of ``frame``, [H, W, 3] float32, or [H, W, 4] where the frame has alpha;
        contiguous.

        With ``half`` float16, infinite where it is 65504 or beyond. With ``out`` it writes there and returns that, in
        its own type: float32 or float16, its axes in any order in memory, of any library that has ``__dlpack__`` on a
        CPU. Arrays of a device (``pyopencl.array.Array``) stay on it, and where all are such nothing waits: later
        commands of their queue see the result. Raises DataError for a wrong frame, and UsageError for a wrong ``out``
        or while another thread is in it.
        """
        if self.look_ahead:
            raise UsageError(
                f"preset {self.preset.name} looks ahead, and its image of a frame comes later",
                cure="take one that does not; in Python call feed() and flush()",
            )
        self._told = check_frame(frame, self._told)
        check_flags(half=half)
        into = None if out is None else checked_out(out, frame, half=half)
        started = perf_counter()
        previous, build = self._begin(frame)
        buffers = self._fitting(Layout(frame.width, frame.height), build.steps.alpha)
        self._lends = True
        upload(frame, buffers, build.steps, self.preset, previous)
        into = self._place(frame, half, buffers) if out is None else into
        waits = not (on_device(into) and all(map(on_device, frame.arrays)))
        if waits:
            self.launcher.finish()
        self._resolved(frame, previous, build, buffers, into, started, waits=waits)
        if out is not None and any(may_overlap(into, array) for array in frame.arrays):
            self.last = None  # it may read the frame in place, where the result is now
        return into if out is None else out

    def _resolved(
        self,
        frame: Frame,
        previous: Past | None,
        build: Build,
        buffers: Buffers,
        out: Any,
        started: float,
        *,
        waits: bool = True,
    ) -> None:
        """Resolve the frame in ``buffers``, whose upload began at ``started``, into ``out``."""
        uploaded = perf_counter()
        output = self._run(frame, previous, build, buffers)
        if waits:
            self.launcher.finish()
        resolved = perf_counter()
        buffers.read(output, out, build)
        if waits:
            self.launcher.finish()
            buffers.give_back()
        self.times = Times(uploaded - started, resolved - uploaded, perf_counter() - resolved)
        self._lends = False
        self._previous = None  # an interrupt from here on leaves no history, rather than a half of one
        buffers.swap()
        self._previous = Past.of(frame, self._coarse, previous)

    @public("Resolver.images")
    def images(self, frames: Iterable[Frame], *, half: bool = False, planar: bool = False) -> Iterator[NDArray[Any]]:
        """Yield the image of each of ``frames``, in their order, as ``resolve`` returns it; with look-ahead they come
        later.

        ``planar`` stores each channel of an image by itself.
        """
        check_flags(planar=planar)
        for frame in each_frame(frames):
            if self.look_ahead:
                yield from self._one_by_one(self._fed(frame, half=half, planar=planar))
            elif planar:
                kind = np.float16 if half else np.float32
                yield self.resolve(frame, out=empty_result(frame, kind, planar=True))
            else:
                yield self.resolve(frame, half=half)
            del frame  # before the wait for the next
        yield from self._one_by_one(self._flushed(half=half, planar=planar))

    def _one_by_one(self, images: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
        """Yield ``images`` of this resolver; between two of them another thread may use it."""
        while (image := self._following(images)) is not None:
            yield image

    @one_thread
    def _following(self, images: Iterator[NDArray[Any]]) -> NDArray[Any] | None:
        return next(images, None)

    @one_thread
    def feed(self, frame: Frame, *, half: bool = False) -> list[NDArray[Any]]:
        """Take the next frame; returns the images that are now ready, in the order of their frames.

        An image is ready when ``look_ahead`` more frames have come, or one that starts a new history; without
        ``look_ahead`` at once. Raises the errors of ``resolve``: a frame that is wrong leaves the waiting ones, and
        other errors forget them.
        """
        return list(self._fed(frame, half=half)) if self.look_ahead else [self.resolve(frame, half=half)]

    @one_thread
    def flush(self, *, half: bool = False) -> list[NDArray[Any]]:
        """Return the images of the frames that wait for later ones, from those that there are."""
        check_flags(half=half)
        return list(self._flushed(half=half))

    @one_thread
    def keep(self, frame: Frame) -> None:
        """Take ``frame`` as the last one before the next, without its image: later images gather its samples.

        Raises the errors of ``resolve``, and UsageError where frames wait for later ones, or where the preset needs the
        result before.
        """
        self._told = check_frame(frame, self._told)
        if self._waiting:
            raise UsageError("frames are still waiting for later ones", cure="call flush()")
        self._previous = self._latest if self.look_ahead else self._previous
        started, (previous, build) = perf_counter(), self._begin(frame)
        assert self.plan is not None
        if not from_ring_alone(self.preset, frame):
            what = f"preset {self.preset.name} resolves this frame from the result before it, so none is only kept"
            raise UsageError(what, cure="call resolve() or feed()")
        steps = self._channel_steps(frame) if self.look_ahead else build.steps
        buffers, coarse = self._fitting(Layout(frame.width, frame.height), steps.alpha), self._coarse
        self._forget()  # an interrupt from here on leaves no history, rather than a half of one
        self._copy_into_ring(frame, previous, buffers, steps)
        self._previous = self._latest = Past.of(frame, coarse, previous, only_kept=True)
        self.times = Times(perf_counter() - started, 0.0, 0.0)

    def _fed(self, frame: Frame, *, half: bool, planar: bool = False) -> Iterator[NDArray[Any]]:
        self._told = check_frame(frame, self._told)
        check_flags(half=half)
        if self._latest is not None:
            self._latest.refuse_again(frame)
        coarse = coarse_colours(frame)
        if self._latest is not None and self._goes_on(frame) and self._is_cut(self._latest, frame, coarse):
            frame = replace(frame, cut=True)
        if not self._goes_on(frame):
            yield from self._flushed(half=half, planar=planar)
        self._take(frame, coarse)
        if len(self._waiting) > self.look_ahead:
            yield self._next(half=half, planar=planar)

    def _flushed(self, *, half: bool, planar: bool = False) -> Iterator[NDArray[Any]]:
        while self._waiting:
            yield self._next(half=half, planar=planar)

    def _goes_on(self, frame: Frame) -> bool:
        """True where ``frame`` comes next after those that wait, and fits the same ring."""
        if self._latest is None or self._frame_ring is None:
            return False
        settings, layout = self.preset.settings, Layout(frame.width, frame.height)
        fits = self._frame_ring.fit(layout, settings.history_frames, self._channel_steps(frame), self.look_ahead)
        return fits and self._latest.continues_in(frame, self.preset.choices)

    def _take(self, frame: Frame, coarse: Coarse) -> None:
        """Copy a frame into the ring, ahead of those that wait."""
        started, goes_on, steps = perf_counter(), self._goes_on(frame), self._channel_steps(frame)
        latest, waiting, self.last = self._latest, self._waiting, None
        self._forget_ahead()  # an interrupt from here on leaves no waiting frames, rather than some of them
        buffers = self._fitting(Layout(frame.width, frame.height), steps.alpha)
        self._copy_into_ring(frame, latest if goes_on else None, buffers, steps)
        self._latest, self._waiting = Past.of(frame, coarse), waiting
        waiting.append(outline(frame))
        self.times = Times(perf_counter() - started, 0.0, 0.0)

    def _copy_into_ring(self, frame: Frame, previous: Past | None, buffers: Buffers, steps: Steps) -> None:
        """Upload a frame and copy its channels into the ring, after ``previous``; waits until its arrays are free."""
        self._lends = True
        upload(frame, buffers, steps, self.preset, previous)
        self._ring(previous, buffers.layout, steps).keep(frame, buffers, steps)
        self.launcher.finish()
        buffers.let_go()
        buffers.give_back()
        self._lends = False

    def _next(self, *, half: bool, planar: bool) -> NDArray[Any]:
        """Resolve the first of the waiting frames."""
        assert self._buffers is not None
        assert self._frame_ring is not None
        started = perf_counter() - self.times.upload
        latest, waiting = self._latest, self._waiting
        self._forget_ahead()
        frame = waiting.popleft()
        previous, build = self._begin(frame)
        self._frame_ring.bring(frame, self._buffers, build.steps)
        image = empty_result(frame, np.float16 if half else np.float32, planar=planar)
        self._resolved(frame, previous, build, self._buffers, image, started)
        self._latest, self._waiting = latest, waiting
        return image

    def _place(self, frame: Frame, half: bool, buffers: Buffers) -> Any:
        """Allocate the result of ``frame``, on the device if its colour is there."""
        kind = np.float16 if half else np.float32
        if on_device(frame.colour):
            return self.launcher.empty(frame.colour, result_shape(frame), kind)
        return empty_result(frame, kind, pool=buffers.results)

    def _is_cut(self, past: Past, frame: Frame, coarse: Coarse) -> bool:
        """True where ``frame``, which otherwise continues ``past``, looks like a cut; published resolves search for
        none."""
        if self.preset.published or not looks_cut(past.coarse, coarse):
            return False
        self.cuts_found.append(frame.index)
        return True

    @one_thread
    def debug(self, *views: str) -> dict[str, NDArray[np.float32]]:
        """Return what was decided at each pixel of the frame resolved last: these ``views``, or all.

        Of docs/debug-views.md: ``reject`` and ``count`` [H, W], ``motion`` [H, W, 2] in pixels, ``clip`` [H, W]. Raises
        UsageError for other names, before the first image, after ``reset()``, with look-ahead where another frame came
        after the image, and where ``out`` overwrote the frame.
        """
        if self.last is None:
            raise UsageError("nothing was resolved yet", cure="call resolve() first")
        return decided(self.launcher, self.last, parse_views(views[0] if len(views) == 1 else views or View, "debug"))

    @one_thread
    def release(self) -> None:
        """Release the channels of the last frame, which ``last`` and ``run_again`` need, for the next to reuse."""
        self.last = None
        if self._buffers is not None:
            self._buffers.let_go()

    @one_thread
    def run_again(self, frame: Frame, previous: Frame) -> None:
        """Run the kernels of the last frame once more, to the same result, and wait for them, for timing.

        ``frame`` is the one resolved last and ``previous`` the one before it.
        """
        assert self.plan is not None
        assert self._buffers is not None
        assert self._previous is not None
        self._buffers.swap()
        if self._frame_ring is not None and not self.look_ahead:
            self._frame_ring.take_back()
        past = msgspec.structs.replace(Past.of(previous), held=self._previous.held - 1)
        self._run(frame, past, self._build(self.plan), self._buffers)
        self._buffers.swap()
        self.launcher.finish()

    @one_thread
    def keep_again(self, frame: Frame, times: int) -> None:
        """Keep ``frame``, which was resolved last, as the last ``times`` ones, if any are kept, for timing."""
        if self._frame_ring is None or self._buffers is None or self.plan is None:
            return
        self._buffers.swap()  # back to the planes to which it was uploaded
        for ago in reversed(range(times)):
            self._frame_ring.keep(replace(frame, index=frame.index - ago), self._buffers, self.plan.steps)
        self._buffers.swap()

    @one_thread
    def recurrent(self) -> tuple[Past, dict[str, Buffer]]:
        """Return what the next frame depends on: facts about the last one, and the memory of it that the next one
        reads.

        Raises ValueError before the first frame and after ``reset``.
        """
        if self._previous is None or self._buffers is None:
            raise ValueError("there is no history")
        self._buffers.settle_counts()
        memory = self._buffers.recurrent()
        holds_changes, jitters = self._buffers.holds_changes, self._jitters.kept()
        past = msgspec.structs.replace(self._previous, holds_changes=holds_changes, jitters=jitters)
        if self._frame_ring is None:
            return past, memory
        past = msgspec.structs.replace(past, earlier=self._frame_ring.past)
        return past, {**memory, "ring": self._frame_ring.planes}

    @one_thread
    def restore(self, past: Past) -> dict[str, Buffer]:
        """Continue after ``past``; returns the memory to fill with that of ``recurrent``, by the same names."""
        layout = Layout(past.shape[1], past.shape[0])
        buffers = self._allocate(layout, past.alpha or self.every_step)
        self._previous = past
        self._jitters.restore(past.jitters)
        buffers.holds_changes = past.holds_changes
        if past.holds_changes:
            buffers.hold_changes()
        if not past.earlier:
            return buffers.recurrent()
        steps = channel_steps(
            self.preset, motion=past.own_motion, alpha=past.alpha, reactive=past.reactive, every=self.every_step
        )
        frame_ring = self._ring(past, layout, steps)
        frame_ring.past = past.earlier
        return {**buffers.recurrent(), "ring": frame_ring.planes}

    def _begin(self, frame: Frame) -> tuple[Past | None, Build]:
        """Plan ``frame``; returns the past that it continues, and the build of its kernels."""
        previous = self._previous
        if previous is not None:
            previous.refuse_again(frame)
        self._coarse, self.last = coarse_colours(frame), None  # the frame's channels overwrite those of the last one
        if previous is not None:
            goes_on = previous.continues_in(frame, self.preset.choices)
            alone = not previous.only_kept or from_ring_alone(self.preset, frame)
            if not (goes_on and alone) or self._is_cut(previous, frame, self._coarse):
                previous = None
        camera, kept = (previous.camera, previous.only_kept) if previous else (None, False)
        jitters = self._jitters.of(frame, camera)
        self.plan = plan_frame(self.preset, frame, camera, every=self.every_step, jitters=jitters, only_kept=kept)
        return previous, self._build(self.plan)

    def _build(self, plan: Plan) -> Build:
        decided_by = plan.choices, plan.settings, plan.steps
        if decided_by not in self._builds:
            self._builds[decided_by] = self.launcher.build(build_of(self._asked, *decided_by))
        return self._builds[decided_by]

    def _recursive(self) -> Build | None:
        """Return the build of the recursive resolve beside the gathered samples, where the plan has one."""
        assert self.plan is not None
        choices = recursive_choices(self.plan.choices)
        return None if choices is None else self._build(self.plan._replace(choices=choices))

    def _run(self, frame: Frame, previous: Past | None, build: Build, buffers: Buffers) -> Buffer:
        """Start the kernels of ``frame``, which is in ``buffers``; returns the memory of the result."""
        assert self.plan is not None
        choices, record = self.plan.choices, frame_record(frame, previous, buffers.layout, self.plan)
        passes = Passes(self.launcher, self.plan, build, self._recursive(), buffers, record)
        if choices.history is HistoryKind.FRAMES:
            # With look-ahead, the current frame is already in the ring.
            ahead = self._frame_ring if self.look_ahead else None
            frame_ring = ahead or self._ring(previous, buffers.layout, build.steps)
            if choices.illumination is Illumination.WINDOW:
                self.last = passes.gather_windows(frame, frame_ring)
            elif passes.recursive is not None:
                self.last = passes.gather_or_resolve(frame, frame_ring, frames_held(frame, previous))
            else:
                self.last = passes.gather(frame, frame_ring)
            if not ahead:
                frame_ring.keep(frame, buffers, build.steps)
        else:
            self.last = passes.resolve()
            if self._frame_ring is not None and not self.look_ahead:
                self._frame_ring.go_back(None)  # it lacks this frame, so none before may be gathered later
        passes.extend_edges()
        output: Buffer = self.last.arguments["output"]
        return output

    def _fitting(self, layout: Layout, alpha: bool) -> Buffers:
        """Return memory for images of a size: the present one, if it fits."""
        if self._lends:  # an interrupted frame may still read or write arrays of the host
            self.launcher.finish()
        if self._buffers is None or not self._buffers.fit(layout, alpha):
            return self._allocate(layout, alpha)
        return self._buffers

    def _allocate(self, layout: Layout, alpha: bool) -> Buffers:
        self._free()  # before the new ones are allocated
        self._buffers = self._new_buffers(layout, alpha)
        return self._buffers

    def _free(self) -> None:
        """Free the planes on the device with what they hold, and end the threads that copy to them."""
        if self._buffers is not None:
            self._buffers.close()
        self._buffers = self._frame_ring = self.last = None
        self._forget()

    def _new_buffers(self, layout: Layout, alpha: bool) -> Buffers:
        return Buffers(self.launcher, layout, alpha, storage_dtype(self._asked))

    def _ring(self, previous: Past | None, layout: Layout, steps: Steps) -> FrameRing:
        """Return the frame ring for this frame; it is empty where there is no predecessor."""
        count, ahead = self.preset.settings.history_frames, self.look_ahead
        if self._frame_ring is None or not self._frame_ring.fit(layout, count, steps, ahead):
            self._frame_ring = None  # freed before the new one is allocated
            self._frame_ring = FrameRing(self.launcher, layout, count, steps, ahead)
        self._frame_ring.go_back(previous)
        return self._frame_ring

    def _channel_steps(self, frame: Frame) -> Steps:
        has = {name: getattr(frame, name) is not None for name in ("motion", "alpha", "reactive")}
        return channel_steps(self.preset, **has, every=self.every_step)

    def _forget(self) -> None:
        self._previous = self.last = None
        self._forget_ahead()

    def _forget_ahead(self) -> None:
        self._latest, self._waiting = None, deque()
