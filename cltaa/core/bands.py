"""Images too large for several copies in memory: resolved in bands of rows, to the same bits as in one piece, but for
fills, which see only the rows that a band holds.

History, counts and inverse depth are held whole, once; of the current frame and its result the device holds one band at
a time, and the result overwrites the frame's own arrays band by band. A band includes rows above and below, so that
every pixel has the same neighbours as in one piece.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from numbers import Integral
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.core.backend import Buffer, storage_dtype
from cltaa.core.buffers import Buffers, upload
from cltaa.core.build import Build, edge_build
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.frame_checks import check_frame
from cltaa.core.parameters import HistoryKind
from cltaa.core.passes import Passes
from cltaa.core.planes import Layout, checked_out
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver, Times
from cltaa.errors import UsageError
from cltaa.frame import Frame, Image
from cltaa.process import one_thread

BAND_ROWS = 512  # a band of 16384 columns takes 400 MB


class Band(Layout):
    """Layout of planes that hold some rows of an image and, above and below, up to PAD_Y more of its rows."""

    first: int
    whole: int

    @classmethod
    def of(cls, image: Layout, first: int, rows: int) -> Band:
        """Return the band of ``rows`` rows from ``first`` on; the last band of an image may extend beyond it."""
        band = cls(image.width, rows)
        band.first, band.whole = first, image.height
        return band

    @property
    def taken(self) -> slice:
        """Rows of the image that the planes hold."""
        return slice(max(self.first - PAD_Y, 0), min(self.first + self.height + PAD_Y, self.whole))

    @property
    def own(self) -> slice:
        """Rows of the image that the band resolves."""
        return slice(self.first, min(self.first + self.height, self.whole))

    @property
    def held(self) -> slice:
        """Rows of a plane that hold rows of the image."""
        above = PAD_Y - self.first
        return slice(self.taken.start + above, self.taken.stop + above)

    def copied(self, buffer: Buffer) -> NDArray[np.float32]:
        """A copy of the band's own rows of a buffer, [C, own rows, W]."""
        rows = slice(PAD_Y, PAD_Y + self.own.stop - self.own.start)
        with buffer.mapped(write=False) as planes:
            return planes[:, rows, PAD_X : PAD_X + self.width].astype(np.float32)


class _Result(NamedTuple):
    """The result of a band; it is stored once no band below needs the rows of the frame that it overwrites."""

    band: Band
    output: NDArray[np.float32]
    counts: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]


class _Whole(NamedTuple):
    """Where the results of all bands of a frame are stored: mostly the frame's own arrays."""

    colour: Image  # [H, W, 3]
    alpha: Image | None
    counts: NDArray[np.float32]  # [1 or 2, H, W]: samples, and with the illumination test the change
    inverse_depth: Image | None  # where depth was given

    def store(self, result: _Result) -> None:
        rows = result.band.own
        self.colour[rows] = np.moveaxis(result.output[:3], 0, -1)
        if self.alpha is not None:
            self.alpha[rows] = result.output[3]
        self.counts[:, rows] = result.counts[: len(self.counts)]
        if self.inverse_depth is not None:
            self.inverse_depth[rows] = result.inverse_depth[0]


class BandedResolver(Resolver):
    """A resolver that works in bands of ``band_rows`` rows, for images that do not fit into memory several times.

    It overwrites the arrays of a frame: the image that ``resolve`` returns lies in them, with no other copy in memory;
    with alpha, ``half`` or ``out`` it has memory of its own.
    """

    def __init__(self, *arguments: Any, band_rows: int = BAND_ROWS, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if not self.launcher.takes_bands:
            raise UsageError("NumPy resolves whole images only", cure="leave --band-rows out, or name a device")
        if self.preset.choices.history is not HistoryKind.ACCUMULATED:
            what = f"preset {self.preset.name} keeps frames, so it resolves whole images only"
            raise UsageError(what, cure="leave --band-rows out, or take --preset default")
        if not isinstance(band_rows, Integral) or band_rows < 1:
            raise UsageError("invalid number of rows in a band", expected="1 or more", found=repr(band_rows))
        self._rows: int = band_rows

    @classmethod
    def beside(cls, whole: Resolver, band_rows: int, **options: Any) -> BandedResolver:
        """Make one on the device that ``whole`` has opened; ``options`` are those of ``whole``."""
        banded = cls(whole.preset, whole.launcher, band_rows=band_rows, **options)
        banded._device = whole._device  # for ``reopen``
        return banded

    @one_thread
    def resolve(self, frame: Frame, *, half: bool = False, out: Any = None) -> Any:
        """Return the colour of ``frame`` as ``Resolver.resolve`` does, but in the arrays of the frame."""
        self._told = check_frame(frame, self._told)
        into = None if out is None else checked_out(out, frame)
        half = half if into is None else into.dtype == np.float16
        started = perf_counter()
        previous, build = self._begin(frame)
        buffers = self._fitting(Layout(frame.width, frame.height), build.steps.alpha)
        assert self.plan is not None
        record = frame_record(frame, previous, buffers.whole, self.plan)
        passes = Passes(self.launcher, self.plan, build, None, buffers, record)
        buffers.ready_counts(self.plan.choices, read=not record["reset"])
        whole = _whole(frame, build.steps.alpha, 1 + buffers.holds_changes)
        planes = 3 if frame.alpha is None else 4
        halves = np.empty((frame.height, frame.width, planes if half else 0), np.float16)
        waiting: deque[_Result] = deque()  # their rows of the frame are still input of the bands below
        for first in range(0, frame.height, self._rows):
            band = buffers.layout = Band.of(buffers.whole, first, self._rows)
            upload(_rows(frame, band.taken), buffers, build.steps, self.preset)
            self.launcher.finish()  # before the next upload overwrites its source
            while waiting and waiting[0].band.own.stop <= band.own.stop - PAD_Y:
                whole.store(waiting.popleft())
            record["first_row"], record["band_rows"] = first, self._rows
            passes.resolve()
            self.launcher.finish()
            if half:
                buffers.read(buffers.output, halves[band.own], build)
            written = (buffers.output, buffers.output_count, buffers.inverse_depth)
            waiting.append(_Result(band, *(band.copied(buffer) for buffer in written)))
        for result in waiting:
            whole.store(result)
        self._previous = None  # an interrupt from here on leaves no history, rather than a half of one
        _keep(whole, buffers)
        self._previous = Past.of(frame, self._coarse)
        self.times = Times(0.0, perf_counter() - started, 0.0)
        image = halves if half else whole.colour
        if frame.alpha is not None and not half:
            image = np.concatenate([whole.colour, frame.alpha[..., None]], axis=-1)
        if into is None:
            return image
        into[...] = image
        return out

    @one_thread
    def reserve(self, width: int, height: int, *, alpha: bool, half: bool = False) -> None:
        """Allocate memory for frames of a size, with or without alpha; the host repeats the edges of bands."""
        self._fitting(Layout(width, height), alpha or self.every_step)
        if half:
            self.launcher.prepare("pack", edge_build(self.launcher.build(self._asked)))
        self.launcher.prepare("unpack", self.launcher.build(Build(strict=True)))

    def _new_buffers(self, layout: Layout, alpha: bool) -> Buffers:
        band = Band.of(layout, 0, self._rows)
        return Buffers(self.launcher, band, alpha, storage_dtype(self._asked), layout)


def _whole(frame: Frame, alpha: bool, counts: int) -> _Whole:
    size = (frame.height, frame.width)
    return _Whole(
        frame.colour,
        np.empty(size, np.float32) if alpha and frame.alpha is None else frame.alpha,
        np.empty((counts, *size), np.float32),
        frame.depth if frame.has_depth else None,
    )


def _rows(frame: Frame, rows: slice) -> Frame:
    """Return those rows of a frame, without channels that no step reads."""
    planes: dict[str, Any] = {
        name: None if getattr(frame, name) is None else getattr(frame, name)[rows]
        for name in ("colour", "depth", "motion", "alpha", "reactive")
    }
    return replace(frame, **planes, object_id=None, normal=None)


def _keep(whole: _Whole, buffers: Buffers) -> None:
    """Store the result as the history of the next frame."""
    colour = np.moveaxis(whole.colour, -1, 0)
    for buffer, planes in (
        (buffers.history, [*colour, *([] if whole.alpha is None else [whole.alpha])]),
        (buffers.history_count, [*whole.counts]),
        (buffers.previous_inverse_depth, [] if whole.inverse_depth is None else [whole.inverse_depth]),
    ):
        with buffer.mapped(write=True) as target:
            for place, plane in zip(buffers.whole.inside(target)[: len(planes)], planes, strict=True):
                place[...] = plane
            buffers.whole.extend_edges(target)
