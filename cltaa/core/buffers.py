"""Device memory of a resolve: planes of the current frame, the history, the result, and the ring of past frames."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from cltaa.camera import inverse_depth_at, is_still
from cltaa.core.backend import Buffer, Launcher
from cltaa.core.build import (
    FRAME_DTYPE,
    Build,
    Record,
    Steps,
    edge_build,
    first_windows,
    ring_planes,
    ring_steps,
    window_count,
    window_planes,
)
from cltaa.core.constants import CENTRED_WINDOWS, HELD_SHARE
from cltaa.core.parameters import Choices, HistoryKind, Illumination, Settings
from cltaa.core.plan import Plan, reads_depth
from cltaa.core.planes import BlockPool, Kind, Layout, around, as_floats, flat, places
from cltaa.core.presets import Preset
from cltaa.core.record import Past, frame_record
from cltaa.errors import ResourceError
from cltaa.frame import Camera, Frame
from cltaa.printable import counted

KEPT_RESULTS = 2  # most released result arrays kept: a program looks at one while the next is filled


class LastRun(NamedTuple):
    """Build, layout and arguments of the last frame's fused kernel; its memory is valid until the next frame.

    For a resolve that gathers samples the arguments include ``ring``, its frames.
    """

    build: Build
    layout: Layout
    arguments: dict[str, Any]


class Buffers:
    """Device memory of one image size; history and output, and both inverse depths, swap each frame."""

    def __init__(
        self, launcher: Launcher, layout: Layout, alpha: bool, dtype: Any, whole: Layout | None = None
    ) -> None:
        """``alpha`` adds a plane to the history, ``dtype`` is the type of the history.

        ``whole`` is the layout of the recurrent planes, where ``layout`` is that of a band.
        """
        self.layout, self.whole, self._launcher = layout, whole or layout, launcher
        self.result_planes = 4 if alpha else 3
        self.inverse_depth = self._planes(1)
        self.output, self.output_count = self._planes(self.result_planes, dtype), self._planes(1)
        self.history = self._planes(self.result_planes, dtype, self.whole)
        self.history_count, self.previous_inverse_depth = self._planes(1, layout=whole), self._planes(1, layout=whole)
        self._beside: dict[str, Buffer] = {}  # a result that the next frame does not read
        self.channels: dict[str, Buffer] = {}  # of the frame: current, motion, alpha, reactive
        self._copies: dict[str, Buffer] = {}  # memory that copied channels reuse
        self._dtype = dtype
        self._exchange = launcher.exchange()
        self.results = BlockPool(KEPT_RESULTS)
        # The same division everywhere: all that follows from inverse depth depends on it.
        self._unpacking = launcher.build(Build(strict=True))
        self._counts = 1  # planes of the counts
        self.holds_changes = False  # whether those of the last frame hold illumination changes

    def _planes(self, count: int, dtype: Any = np.float32, layout: Layout | None = None) -> Buffer:
        layout = layout or self.layout
        return self._launcher.allocate((count, layout.rows, layout.stride), dtype)

    def fit(self, layout: Layout, alpha: bool) -> bool:
        """True when these buffers serve a frame of that size, with or without alpha."""
        return layout == self.whole and (4 if alpha else 3) == self.result_planes

    def bring(self, name: str, array: Any) -> None:
        """Upload an array [H, W] or [H, W, C] as the frame's channel ``name``.

        A device that shares memory uses planes in place where they have the kernels' layout; all else is unpacked.
        """
        if self._launcher.shares_memory and isinstance(array, np.ndarray):
            whole = around(np.atleast_3d(array).transpose(2, 0, 1), self.layout)
            if whole is not None:
                self.layout.extend_edges(whole)
                self.channels[name] = self._launcher.take(whole)
                return
        if name not in self._copies:
            self._copies[name] = self._planes(array.shape[2] if len(array.shape) > 2 else 1)
        self._unpack(name, array, self._copies[name])
        self.channels[name] = self._copies[name]

    def copied(self, name: str, planes: int) -> Buffer:
        """Return the device memory for the frame's channel ``name``, which the device itself copies there."""
        if name == "inverse_depth":
            return self.inverse_depth
        if name not in self._copies:
            self._copies[name] = self._planes(planes)
        self.channels[name] = self._copies[name]
        return self._copies[name]

    def bring_depth(self, depth: Any, kind: Kind, below: float, at: float) -> None:
        """Upload ``depth`` [H, W] as inverse depth; where that is ``below`` or less it becomes ``at``."""
        self._unpack("depth", depth, self.inverse_depth, kind, below, at)

    def _unpack(
        self, name: str, array: Any, target: Buffer, kind: Kind = Kind.AS_IT_IS, below: float = 0.0, at: float = 0.0
    ) -> None:
        if isinstance(array, np.ndarray) and flat(array) is None:
            half = array.dtype == np.float16
            array = np.array(array, order="C") if half else as_floats(array, copy=True)
        held = self.layout.held
        given = {
            "source": self._exchange.lend(name, array),
            "target": target,
            "planes": array.shape[2] if len(array.shape) > 2 else 1,
            "kind": int(kind),
            "below": np.float32(below),
            "at": np.float32(at),
            "stride": self.layout.stride,
            "rows": self.layout.rows,
            "width": self.layout.width,
            "height": held.stop - held.start,
            "top": held.start,
            **places(array),
        }
        self._launcher.run("unpack", self._unpacking, self.layout, given)

    def keep_own_motion(self, frame: Frame, previous: Past | None) -> None:
        """Drop motion vectors of ``frame`` that its camera's motion since the ``previous`` frame explains."""
        if "own motion" not in self._copies:  # with the first frame, so that a lack of memory shows there
            self._copies["own motion"] = self._planes(2)
        if previous is None:
            return
        own, record = self._copies["own motion"], {"frame": frame_record(frame, previous, self.layout)}
        moved = not is_still(frame.camera, previous.camera)
        build = replace(self._unpacking, steps=Steps(camera_motion=moved, orthographic=frame.camera.orthographic))
        given = {"inverse_depth": self.inverse_depth, "motion": self.channels["motion"], "own": own, **record}
        self._launcher.run("own_motion", build, self.layout, given)
        edges = {"image": own, "floats": None, "planes": 2, "more": 0, **record}
        self._launcher.run("extend_edges", edge_build(self._unpacking), self.layout, edges)
        self.channels["motion"] = own

    def read(self, image: Buffer, out: Any, build: Build) -> None:
        """Copy the result into ``out`` [H, W, 3 or 4]; for an array of a device in the order of its queue."""
        direct = not isinstance(out, np.ndarray) or flat(out, dense=True) is not None
        into = out if direct else np.empty(out.shape, out.dtype)
        target = self._exchange.receive(into)
        height, width, planes = out.shape
        given = {
            "image": image,
            "target": target,
            "width": width,
            "height": height,
            "planes": planes,
            "stride": self.layout.stride,
            "rows": self.layout.rows,
            **places(into),
        }
        done = self._launcher.run("pack", edge_build(build), self.layout, given)
        self._exchange.hand_over(into, target, done)
        if into is not out:
            out[...] = into

    def let_go(self) -> None:
        """Release the channels of the last frame."""
        self.channels.clear()

    def give_back(self) -> None:
        """Drop references to the host's arrays of the last frame, which nothing reads any more."""
        self._exchange.give_back()

    def close(self) -> None:
        """End the threads that copied arrays."""
        self._exchange.close()

    def written(self) -> dict[str, Any]:
        """Return the arguments of ``extend_edges`` for what the next frame reads of this one's result."""
        planes = {"planes": self.result_planes, "more": 1 + self.holds_changes}
        return {"image": self.output, "floats": self.output_count, **planes}

    def beside(self) -> dict[str, Buffer]:
        """Return memory for a result that is not the history of the next frame, allocated on first use."""
        if not self._beside:
            image = self._planes(self.result_planes, self._dtype)
            self._beside = {"output": image, "output_count": self._planes(1)}
        return self._beside

    def swap(self) -> None:
        """Swap what was written with what is read."""
        self.history, self.output = self.output, self.history
        self.history_count, self.output_count = self.output_count, self.history_count
        self.inverse_depth, self.previous_inverse_depth = self.previous_inverse_depth, self.inverse_depth

    def ready_counts(self, choices: Choices, *, read: bool) -> None:
        """Prepare the counts for a frame with those choices. With the illumination test they have a second plane, of
        the change, which is zeroed if the frame reads it and the previous one had no test."""
        tests = choices.history is HistoryKind.ACCUMULATED and choices.illumination is not Illumination.STATIC
        if tests:
            self.hold_changes()
        if tests and read:
            self.settle_counts()
        self.holds_changes = tests

    def settle_counts(self) -> None:
        """Zero the second plane of the counts where the last frame did not write it."""
        if self._counts == 1 or self.holds_changes:
            return
        with self.history_count.mapped(write=False) as counts:
            count = counts[0].copy()
        with self.history_count.mapped(write=True) as counts:  # both: a GPU's copy on the host is out of date
            counts[0], counts[1] = count, 0.0
        self.holds_changes = True

    def hold_changes(self) -> None:
        """Add a plane for illumination changes to the counts, unless they have one."""
        if self._counts == 2:
            return
        with self.history_count.mapped(write=False) as counts:
            count = counts[0].copy()
        self.output_count, self.history_count = self._planes(2), self._planes(2, layout=self.whole)
        with self.history_count.mapped(write=True) as counts:
            counts[0] = count
        self._counts = 2  # last: no memory may be left for them

    def arguments(self, frame: Record, settings: Record, steps: Steps) -> dict[str, Any]:
        """Return the arguments of every kernel that resolves, without the recurrent memory."""
        return {
            "current": self.channels["current"],
            "inverse_depth": self.inverse_depth,
            "motion": self.channels["motion"] if steps.own_motion else None,
            "alpha": self.channels["alpha"] if steps.alpha else None,
            "reactive": self.channels["reactive"] if steps.reactive else None,
            "output": self.output,
            "output_count": self.output_count,
            "frame": frame,
            "settings": settings,
        }

    def recurrent(self) -> dict[str, Buffer]:
        """Return the memory that the next frame reads besides its own input, by name; valid until the next ``swap``."""
        return {
            "history": self.history,
            "history_count": self.history_count,
            "previous_inverse_depth": self.previous_inverse_depth,
        }


class FrameRing:
    """A ring of ``count`` frames of one size, the current one and ``ahead`` later ones; ``past``: the facts about each,
    the latest first."""

    def __init__(self, launcher: Launcher, layout: Layout, count: int, steps: Steps, ahead: int = 0) -> None:
        self.layout, self._launcher, self._count, self._ahead = layout, launcher, count, ahead
        self._planes, self._steps = ring_planes(steps), steps
        self._slots = count + 1 + ahead
        self.planes = _ring(launcher, (self._slots * self._planes, layout.rows, layout.stride), self._slots)
        self.records = launcher.allocate((count + ahead,), FRAME_DTYPE)
        self.past: tuple[Past, ...] = ()
        self._windows: Buffer | None = None
        self._window_planes = 0

    def fit(self, layout: Layout, count: int, steps: Steps, ahead: int) -> bool:
        """True when this ring holds ``count`` frames and ``ahead`` later ones of that size and with those channels."""
        wanted = layout, count, ahead, _channels(steps)
        return wanted == (self.layout, self._count, self._ahead, _channels(self._steps))

    def build(self, build: Build, frame: Frame) -> Build:
        """Return ``build`` with camera motion where the camera differs from that of any frame of the ring."""
        nearest = [past for past, _ in self._nearest(frame)] if self._ahead else self.past
        moved = any(not is_still(frame.camera, past.camera) for past in nearest)
        kind = ring_steps(self._count, self._ahead)
        centred = build.choices.illumination is Illumination.WINDOW and self._is_centred(frame)
        steps = replace(build.steps, camera_motion=build.steps.camera_motion or moved, centred=centred, **kind)
        return replace(build, steps=steps)

    def window_memory(self, build: Build) -> Buffer:
        """Return memory for the gathered temporal windows, allocated when first needed at that size."""
        planes = window_count(build.choices, build.steps) * window_planes(build.steps)
        if self._windows is None or self._window_planes < planes:
            self._windows = None  # freed before the next is allocated
            self._windows = self._launcher.allocate((planes, self.layout.rows, self.layout.stride), np.float32)
            self._window_planes = planes
        return self._windows

    def count(self, frame: Frame) -> int:
        """Return how many frames of the ring ``frame`` gathers from."""
        return len(self._nearest(frame))

    def holds_more(self, frame: Frame, held: int) -> bool:
        """Return whether samples of the ring are better than the mean of ``held`` frames that the camera of ``frame``
        saw: with frames ahead, which that lacks, until it holds HELD_SHARE as many, else until the ring is full."""
        count = self.count(frame)
        return held < HELD_SHARE * (1 + count) if self._ahead else count < self._count

    def static_frames(self, frame: Frame) -> int:
        """Return how many of the nearest frames in the ring were seen by the camera of ``frame``."""
        nearest = self._nearest(frame)
        moved = (place for place, (past, _) in enumerate(nearest) if not is_still(frame.camera, past.camera))
        return next(moved, len(nearest))

    def _is_centred(self, frame: Frame) -> bool:
        """Return whether as many frames of the shortest window are ahead as earlier: not at the ends of a shot."""
        nearest = self._nearest(frame)[: CENTRED_WINDOWS[0]]
        return self._ahead > 0 and 2 * sum(ahead > 0 for _, ahead in nearest) == CENTRED_WINDOWS[0]

    def lag_ratio(self, frame: Frame) -> float:
        """Return how far behind ``frame`` the shortest temporal window lies, over its distance in time from the second.

        At most 1. It is 0 where the second window is not whole, or frames ahead balance the earlier ones.
        """
        few, more = first_windows(centred=self._is_centred(frame))
        ages = [0, *(-ahead for _, ahead in self._nearest(frame)[:more])]
        shortest, second = (sum(part) / len(part) for part in (ages[: few + 1], ages))
        if len(ages) <= more or shortest * (second - shortest) <= 0.0:
            return 0.0
        return min(shortest / (second - shortest), 1.0)

    def describe(self, frame: Frame, plan: Plan) -> int:
        """Write a record for each frame of the ring, with the motion of ``frame`` to it; returns how many there are."""
        nearest = self._nearest(frame)
        with self.records.mapped(write=True) as records:
            for place, (past, ahead) in enumerate(nearest):
                record = frame_record(frame, past, self.layout, plan)
                record["jitter_x"], record["jitter_y"] = past.jitter_px
                record["slot"], record["ahead"] = past.slot, ahead
                records[place] = record
        return len(nearest)

    def _nearest(self, frame: Frame) -> list[tuple[Past, int]]:
        """Return the frames of the ring that ``frame`` gathers from, each with how many frames it is ahead: nearest
        first, earlier and later ones in turn."""
        before = [past for past in self.past if past.index < frame.index][: self._count]
        later = [past for past in reversed(self.past) if past.index > frame.index][: self._ahead]
        in_turn = zip_longest(
            ((past, -ago) for ago, past in enumerate(before, 1)), ((past, ahead) for ahead, past in enumerate(later, 1))
        )
        return [each for pair in in_turn for each in pair if each is not None]

    def keep(self, frame: Frame, buffers: Buffers, steps: Steps) -> None:
        """Copy the uploaded channels of ``frame`` into the ring, over the oldest frame."""
        slot = (self.past[0].slot + 1) % self._slots if self.past else 0
        for name, _, at in self._channels_of(slot, steps):
            source = buffers.inverse_depth if name == "inverse_depth" else buffers.channels[name]
            self._launcher.copy(source, self.planes, at)
        self.past = (replace(Past.of(frame), slot=slot), *self.past)[: self._slots]

    def bring(self, frame: Frame, buffers: Buffers, steps: Steps) -> None:
        """Copy a frame of the ring to the current frame's place in ``buffers``."""
        slot = next(past.slot for past in self.past if past.index == frame.index)
        for name, planes, at in self._channels_of(slot, steps):
            self._launcher.copy(self.planes, buffers.copied(name, planes), 0, at)

    def _channels_of(self, slot: int, steps: Steps) -> Iterator[tuple[str, int, int]]:
        """Yield name, planes and first element of each channel of the frame in that slot of the ring."""
        at = slot * self._planes * self.layout.plane
        kept = (steps.own_motion, "motion", 2), (steps.alpha, "alpha", 1), (steps.reactive, "reactive", 1)
        for held, name, planes in ((True, "current", 3), (True, "inverse_depth", 1), *kept):
            if held:
                yield name, planes, at
                at += planes * self.layout.plane

    def go_back(self, last: Past | None) -> None:
        """Drop frames later than ``last``, such as one that was interrupted; all where ``last`` is None."""
        self.past = tuple(past for past in self.past if last is not None and past.index <= last.index)

    def take_back(self) -> None:
        """Drop the latest frame; all earlier ones are still there."""
        self.past = self.past[1:]


def _channels(steps: Steps) -> tuple[bool, ...]:
    """Return which channels are kept: others may take as many planes of the ring, but not of the windows."""
    return steps.own_motion, steps.alpha, steps.reactive


def _ring(launcher: Launcher, shape: tuple[int, int, int], frames: int) -> Buffer:
    try:
        return launcher.allocate(shape, np.float32)
    except ResourceError as error:
        raise ResourceError(
            f"{error.what} to keep {counted(frames, 'frame')}",
            expected=error.expected,
            found=error.found,
            cure="keep fewer with --set history_frames=N, or none with --preset default",
        ) from error


# Values of a channel that a frame lacks: no vector, full coverage, not reactive.
NOTHING = {"motion": np.nan, "alpha": 1.0, "reactive": 0.0}


def upload(frame: Frame, buffers: Buffers, steps: Steps, preset: Preset, previous: Past | None = None) -> None:
    """Upload what ``steps`` and ``preset`` read; channels that the frame lacks get the values of NOTHING. Where samples
    are gathered, vectors that the camera's motion since the ``previous`` frame explains are dropped.

    The frame must not change until the device has copied it, or, where the device reads it in place, until the next
    upload.
    """
    buffers.bring("current", frame.colour)
    if reads_depth(preset.choices):
        buffers.bring_depth(frame.depth, *_depth_rule(frame.camera, preset.settings))
    for name, wanted in (("motion", steps.own_motion), ("alpha", steps.alpha), ("reactive", steps.reactive)):
        channel = getattr(frame, name)
        if wanted and channel is None:
            size = (frame.height, frame.width, 2) if name == "motion" else (frame.height, frame.width)
            channel = np.broadcast_to(np.float32(NOTHING[name]), size)
        if wanted:
            buffers.bring(name, channel)
    gathers = preset.choices.history is HistoryKind.FRAMES and not preset.published
    if gathers and steps.own_motion and frame.has_camera and frame.has_depth:
        buffers.keep_own_motion(frame, previous)


def _depth_rule(camera: Camera, settings: Settings) -> tuple[Kind, float, float]:
    """Return how to convert depth, and the inverse depths up to which it is sky and at which sky is placed."""
    if camera.orthographic:
        return Kind.PARALLEL, -np.inf, 0.0
    if settings.sky_at > 0.0:
        below, at = (inverse_depth_at(depth, camera) for depth in (settings.sky_below, settings.sky_at))
        return Kind.PERSPECTIVE, below, at
    return Kind.PERSPECTIVE, -np.inf, 0.0
