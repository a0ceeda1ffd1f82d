"""Effects that nobody declares, found in the headers of all frames and the pixels of a bounded number of them.

A step of the resolve is left out only where there is evidence against its effect; what cannot be told stays on. The
frames that are looked at are chosen by their numbers alone, so that a sequence has the same effects on every run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.camera import displacement, inverse_depth, is_still, reprojected
from cltaa.errors import CltaaError
from cltaa.frame import Camera, Effect, Frame, Image, format_effects, outline
from cltaa.io.display import LUMA
from cltaa.io.exr_frame import MATRICES
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import ReadAhead
from cltaa.printable import counted
from cltaa.progress import Advance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Two spans of frames a place, the second 2 * SPAN after the first: light that changes is not the same in both.
PLACES, SPAN = 3, 8
BLOCK = 8  # pixels of a block along each side; 3 x 3 blocks are a tile, of which so many are looked at in an image
TILE, TILES = 3 * BLOCK, 256
SEEN = 0.6  # share of a block's pixels, and of a tile's blocks, that must be seen in both spans
DEPTH_SLACK = 0.05  # of the inverse depth: as far as two samples of one surface may differ
# Share of tiles whose mean moves by more than a block's texture explains by chance: 0 in 22 scenes of standing light,
# under any camera, and beside two lamps that flash faintly; 0.25 behind panes of glass, 0.8 where shadows run.
SHIFTED_SHARE, LEAST_TILES, LEAST_SHARE = 0.01, 4, 0.2
# A pixel's light scatters in time by more than this much of it, and its square over that of what texture moves it by:
# the squared steps to its four neighbours in the mean over time, halved, of which jitter makes a twelfth and chance
# twice as much. Of the middle pixel: 0.48 at most without noise, 0.7 and more with four samples a pixel. In frames of
# fewer pixels than NOISE_PIXELS texture is often finer than a pixel and scatters as noise does, by up to 0.94.
NOISE_LEAST, NOISE_RATIO, NOISE_FRAMES, NOISE_PIXELS = 0.02, 0.6, 4, 12_000
# Of a tile's mean light over a span, and light: in single frames jitter moves it by a tenth, by more where it is dark.
FLASH, FLASH_LEAST = 0.25, 0.02
SHADE = 0.02  # of a block's mean: less is no change that anybody sees
# Pixels whose surface is in none of the 3 x 3 samples before, though nothing hides it: it is thinner than a pixel.
# Worst seen where nothing is: 2e-4; 4e-4 in hedges, 4e-3 along wires.
THIN_SHARE = 3e-4
# And pixels in whose place something nearer was sampled, as beside every edge of a thing: where that is so many, what
# lies between the edges is as narrow. 0.017 at most past walls, columns and posts; 0.027 and more behind a lattice,
# 0.05 in hedges. To find it where it is not costs 0.5 dB at most, to miss it behind a lattice 3.8 dB.
EDGES_SHARE = 0.022
MOVED_PX, MOVED_SHARE = 0.1, 1e-4  # vectors that are not the camera's, and share of pixels that have them
LOOKED_AT = 2**20  # pixels of a pair of frames at most, in whole rows
LEAP = 0.25  # of the picture, as far as what lies at infinity moves in a frame; shots that are cut lie farther apart
BRIGHT = 8.0  # radiance "far above 1"
LARGEST = 2.0**50  # light beyond it is missing

NO_FRAME = "no frame looked at: each place has a cut, or cannot be read"


class Evidence(msgspec.Struct, kw_only=True, frozen=True):
    """Whether a sequence has an effect, and what says so."""

    effect: Effect
    found: bool
    why: str


class Found(msgspec.Struct, kw_only=True, frozen=True):
    """The effects of a sequence that declares none; ``frames`` were decoded for it, which took ``seconds``."""

    evidence: tuple[Evidence, ...]
    frames: int
    seconds: float

    @property
    def effects(self) -> frozenset[Effect]:
        """Those that were found or cannot be told."""
        return frozenset(each.effect for each in self.evidence if each.found)

    def without(self, effect: Effect, why: str) -> Found:
        """The same, less one effect."""
        less = Evidence(effect=effect, found=False, why=why)
        evidence = tuple(less if each.effect is effect else each for each in self.evidence)
        return msgspec.structs.replace(self, evidence=evidence)

    @property
    def line(self) -> str:
        """What was found, in one line."""
        looked = f"{counted(self.frames, 'frame')} looked at, {self.seconds:.1f} s" if self.frames else NO_FRAME
        return f"effects found: {format_effects(self.effects)} ({looked})"


def find_effects(sequence: FrameSequence, advance: Advance | None = None) -> Found:
    """Find the effects of ``sequence`` as if it declared none; a frame that cannot be read tells nothing.

    ``advance(done, total)`` is called now and then. Raises what reading headers raises.
    """
    started = time.perf_counter()
    outlines = [sequence.outline(number) for number in sequence.numbers]
    cameras = _cameras(sequence, outlines)
    told = by_headers(sequence, outlines)
    witness = _Witness(cameras, moves=told[Effect.CAMERA][0])
    places = list(_places([each.cut for each in outlines]))
    every = {at for place in places for span in place for at in span}
    for place in places:
        early, late = ([sequence.numbers[at] for at in span] for span in place)
        with np.errstate(all="ignore"):  # of matrices that lead beyond numbers, which are then out of sight
            witness.look(_readable(sequence, [*early, *late]), set(late))
        if advance is not None:
            advance(len(witness.looked), len(every))
    said = told | {
        Effect.MOTION: witness.motion(sequence),
        Effect.DISOCCLUSION: (True, "nothing proves that all stays in view"),
        Effect.THIN: witness.thin(),
        Effect.ILLUMINATION: witness.illumination(),
        Effect.HDR: (not witness.brightest <= BRIGHT, f"values up to {witness.brightest:.4g}"),
        Effect.SKY: (witness.sky, "depth is infinite" if witness.sky else "depth is finite"),
        Effect.NOISE: witness.noise(),
    }
    if told[Effect.CUT][0] and not any(each.cut for each in outlines[1:]):
        said[Effect.ILLUMINATION] = (True, "light is compared in one shot only")
    if not witness.looked:
        for effect in (Effect.HDR, Effect.SKY):
            said[effect] = (True, NO_FRAME)
    evidence = tuple(Evidence(effect=effect, found=found, why=why) for effect, (found, why) in said.items())
    return Found(evidence=evidence, frames=len(witness.looked), seconds=time.perf_counter() - started)


def by_headers(sequence: FrameSequence, outlines: Sequence[Frame] | None = None) -> dict[Effect, tuple[bool, str]]:
    """Whether there is each effect that headers alone tell, and why; ``outlines`` are those of all frames."""
    outlines = [sequence.outline(number) for number in sequence.numbers] if outlines is None else outlines
    cameras, exposures = _cameras(sequence, outlines), {each.exposure for each in outlines}
    moves = cameras is not None and not all(is_still(*pair) for pair in pairwise(cameras.values()))
    camera = "the matrices change" if moves else "all matrices are the same"
    said = {
        Effect.CAMERA: (moves or cameras is None, camera if cameras is not None else "nothing tells a camera"),
        Effect.CUT: _cut(sequence, outlines, cameras),
        Effect.EXPOSURE: (len(exposures) > 1, "it changes" if len(exposures) > 1 else "it is the same in all headers"),
    }
    for effect, part in ((Effect.ALPHA, "alpha"), (Effect.REACTIVE, "reactive")):
        said[effect] = (part in sequence.holds, "there is a channel" if part in sequence.holds else "no channel")
    return said


def _cut(sequence: FrameSequence, outlines: Sequence[Frame], cameras: Mapping[int, Camera] | None) -> tuple[bool, str]:
    """Whether headers say that there is a cut, or a camera turns so far in a frame that it may be one."""
    if any(each.cut for each in outlines[1:]):
        return True, "headers say so"
    for before, now in pairwise(cameras.values() if cameras is not None else ()):
        if before.orthographic or now.orthographic or is_still(now, before):
            continue
        (_, _, _, u), (_, _, _, v), (_, _, _, w) = displacement(now, before, sequence.width, sequence.height).rows
        # Behind the camera 1 + w is negative, and any motion is more.
        if max(abs(u) / sequence.width, abs(v) / sequence.height) > LEAP * (1 + w):
            return True, "no header says so, but the camera leaps"
    return False, "no header says so, and the camera leaps nowhere"


def _cameras(sequence: FrameSequence, outlines: Sequence[Frame]) -> dict[int, Camera] | None:
    """The cameras of all frames by their numbers; None where nothing tells them."""
    told = sequence.undeclared.isdisjoint(MATRICES)
    return {each.index: each.camera for each in outlines} if told else None


def with_found(sequence: FrameSequence, found: Found | None) -> FrameSequence:
    """The same frames, which say what was found."""
    if found is None and sequence.found is None:
        return sequence
    copy = sequence.select(sequence.first, sequence.last)
    copy.found = None if found is None else found.effects
    return copy


def _places(cuts: Sequence[bool]) -> Iterator[tuple[range, range]]:
    """Two spans of frames to look at, by their order, in each of up to PLACES places, none with a cut in it."""
    count = len(cuts)
    whole = min(count, 3 * SPAN)
    few = min(max(count // (2 * SPAN), 1), PLACES)  # of a short sequence, so that no frame is read often
    places = {round(at * (count - whole) / max(few - 1, 1)) for at in range(few)}
    for first in sorted(places):
        span = max(whole // 3, 1)
        late = first + (span if count < 2 * whole else whole - span)  # a short sequence is looked at whole
        if not any(cuts[first + 1 : first + whole]):
            yield range(first, first + span), range(late, first + whole)


def _readable(sequence: FrameSequence, numbers: Sequence[int]) -> Iterator[Frame]:
    """Those of these frames that can be read; what is wrong with the others is told when they are resolved."""

    def read(number: int) -> Frame | None:
        try:
            return sequence.frame(number)
        except CltaaError:
            return None

    with ReadAhead(partial(read, number) for number in numbers) as frames:
        yield from (frame for frame in frames if frame is not None)


class _Witness:
    """Gathers what the frames of a sequence show."""

    def __init__(self, cameras: Mapping[int, Camera] | None, *, moves: bool) -> None:
        self._cameras = cameras
        self._shifted: list[float] = []  # share of tiles, of each place that tells
        self._thin: list[float] = []  # shares of pixels
        self._hidden: list[float] = []
        self._moving: list[float] = []
        self._flashed: list[float] = []  # share of tiles, of each span
        self._scatter: list[float] = []  # median of pixels, of each span
        self._moves, self._depth = moves, False
        self.looked: set[int] = set()
        self.brightest, self.sky = 0.0, False

    def look(self, frames: Iterable[Frame], late: set[int]) -> None:
        """Take in the frames of a place, a few in memory at a time; its second span are those numbered ``late``."""
        spans: tuple[_Span, _Span] | None = None
        before: _Look | None = None
        for frame in frames:
            look = _Look(frame)
            self.looked.add(frame.index)
            self.brightest = max(self.brightest, look.brightest)
            self.sky, self._depth = self.sky or look.sky, self._depth or look.depth
            self._motion(look, frame.motion)
            if spans is None:
                spans = _Span(look), _Span(look)
            if self._cameras is None or min(look.inverse.shape) < TILE or not spans[0].fits(look):
                continue
            span = spans[frame.index in late]
            span.add(look)
            # Of the frames next to the anchor, at whose pixels both spans look.
            if spans[0].moving is None and (apart := self._apart(look, frame.motion, *span.places)) is not None:
                spans[0].moving = spans[1].moving = apart > MOVED_PX
            # The first pair of each span is enough.
            if before is not None and frame.index == before.frame.index + frame.step:
                view = _View(look, before, *_places_of(look, LOOKED_AT))
                self._thin.append(view.vanished())
                self._hidden.append(view.hidden())
                before = None
            elif before is None and span.frames <= 1:
                before = look
        if spans is not None:
            share = _shifted(*spans)
            self._shifted += [] if share is None else [share]
            self._flashed += [share for span in spans if (share := span.flashed()) is not None]
            self._scatter += [ratio for span in spans if (ratio := span.scatter()) is not None]

    def _motion(self, look: _Look, motion: Image | None) -> None:
        """Compare vectors with those that the camera makes since the frame before, whether that is looked at or not."""
        apart = self._apart(look, motion, *_places_of(look, LOOKED_AT // 8))
        if apart is not None:
            self._moving.append(float((apart > MOVED_PX).mean()))  # NaN, which means the camera's, is not more

    def _apart(self, look: _Look, motion: Image | None, rows: Array, columns: Array) -> Array | None:
        """How many pixels vectors are from the camera's at these places; None: nothing tells."""
        before = None if self._cameras is None else self._cameras.get(look.frame.index - look.frame.step)
        if motion is None or (self._cameras is not None and before is None):
            return None
        u: Array | float = 0.0
        v: Array | float = 0.0
        if before is not None and not is_still(look.frame.camera, before):
            u, v, _, _ = _moved(look, before, rows, columns)
        at = rows.astype(np.intp), columns.astype(np.intp)
        return np.asarray(np.maximum(np.abs(motion[..., 0][at] - u), np.abs(motion[..., 1][at] - v)))

    def motion(self, sequence: FrameSequence) -> tuple[bool, str]:
        """Whether something moves on its own."""
        if "motion" not in sequence.holds:
            return False, "no channel"
        if not self._moving:
            return True, "no two frames tell"
        share = max(self._moving)
        return share > MOVED_SHARE, f"{share:.2%} of the pixels move otherwise than the camera makes them"

    def thin(self) -> tuple[bool, str]:
        """Whether something is thinner than a pixel."""
        if not self._depth:
            return True, "no depth"
        if not self._thin:
            return True, "no camera tells where a surface was" if self._cameras is None else "no two frames tell"
        missed, hidden = float(np.mean(self._thin)), float(np.mean(self._hidden))
        why = f"{missed:.2%} of the pixels show what the frame before misses, {hidden:.1%} what it hides"
        return missed > THIN_SHARE or hidden > EDGES_SHARE, why

    def illumination(self) -> tuple[bool, str]:
        """Whether light changes."""
        if self._moves and not self._depth:
            return True, "no depth tells what a moving camera sees"
        if not self._shifted:
            return True, "too little is seen in two spans of frames, or nothing tells a camera"
        share = max(self._shifted + self._flashed)
        return share > SHIFTED_SHARE, f"{share:.1%} of the image changes its light within {3 * SPAN} frames"

    def noise(self) -> tuple[bool, str]:
        """Whether the samples of one place scatter more than texture explains."""
        if not self._scatter:
            return False, f"frames are small, or too little of one place is seen in {NOISE_FRAMES} of them"
        ratio = float(np.mean(self._scatter))
        return ratio > NOISE_RATIO, f"light scatters in time by {ratio:.2f} of the steps of texture"


class _Look:
    """A frame, its inverse depth and its light x / (1 + x), [H, W], of which no highlight outweighs all else."""

    def __init__(self, frame: Frame) -> None:
        self.frame = outline(frame)
        depth = np.asarray(frame.depth, np.float32)
        self.inverse: NDArray[np.float32] = np.empty((frame.height, frame.width), np.float32)
        inverse_depth(depth, frame.camera, self.inverse)
        self.sky, self.depth = bool(np.isinf(depth).any()), bool(np.isfinite(depth).any())
        colour = np.where((frame.colour > 0) & (frame.colour < LARGEST), frame.colour, np.float32(0))
        self.brightest = float(colour.max(initial=0.0))
        light = colour @ (LUMA / np.float32(frame.exposure))
        self.light = light / (1 + light)


class _View:
    """Where pixels of ``now`` were in ``before`` by depth and cameras, and whether they were in sight."""

    def __init__(self, now: _Look, before: _Look, rows: Array, columns: Array) -> None:
        height, width = now.inverse.shape
        jitter = now.frame.jitter_px
        u, v, self.expected, visible = _moved(now, before.frame.camera, rows, columns)
        self.before = before
        at = columns + u + jitter[0] - before.frame.jitter_px[0]
        on = rows + v + jitter[1] - before.frame.jitter_px[1]
        self.inside = visible & (at >= 1) & (on >= 1) & (at < width - 2) & (on < height - 2)
        self.column, self.row = np.where(self.inside, at, 1.0), np.where(self.inside, on, 1.0)

    def vanished(self) -> float:
        """Share of pixels whose surface is in none of the 3 x 3 samples there, all of which lie behind it."""
        column, row = np.rint(self.column).astype(np.intp), np.rint(self.row).astype(np.intp)
        nearest = np.full(self.column.shape, -np.inf)
        for below in (-1, 0, 1):
            for beside in (-1, 0, 1):
                nearest = np.maximum(nearest, self.before.inverse[row + below, column + beside])
        return float((self.inside & (self.expected - nearest > DEPTH_SLACK * np.abs(self.expected))).mean())

    def hidden(self) -> float:
        """Share of pixels in whose place something nearer was sampled."""
        there = self.before.inverse[np.rint(self.row).astype(np.intp), np.rint(self.column).astype(np.intp)]
        return float((self.inside & (there - self.expected > DEPTH_SLACK * np.abs(there))).mean())

    def light(self) -> tuple[Array, Mask]:
        """The light between the samples there, and where all four are of the surface."""
        column, row = self.column.astype(np.intp), self.row.astype(np.intp)
        right, below = self.column - column, self.row - row
        result, same = np.zeros(column.shape), self.inside.copy()
        for down, by_row in ((0, 1 - below), (1, below)):
            for beside, by_column in ((0, 1 - right), (1, right)):
                place = row + down, column + beside
                result += self.before.light[place] * by_row * by_column
                there = self.before.inverse[place]
                same &= np.abs(there - self.expected) <= DEPTH_SLACK * np.maximum(np.abs(there), np.abs(self.expected))
        return result, same


def _moved(now: _Look, before: Camera, rows: Array, columns: Array) -> tuple[Array, Array, Array, Mask]:
    """Motion u, v in pixels that ``before`` makes of these pixels, the inverse depth to expect there, and whether it
    could see them."""
    height, width = now.inverse.shape
    camera, jitter = now.frame.camera, now.frame.jitter_px
    depth = now.inverse[rows.astype(np.intp), columns.astype(np.intp)].astype(np.float64)
    moved = displacement(camera, before, width, height)
    x, y = columns + (0.5 + jitter[0] - width / 2), rows + (0.5 + jitter[1] - height / 2)
    return reprojected(x, y, depth, moved, parallel=camera.orthographic)


def _places_of(look: _Look, most: int) -> tuple[Array, Array]:
    """Rows and columns of up to about ``most`` pixels, in whole rows that are spread evenly."""
    height, width = look.inverse.shape
    rows = np.arange(0, height, math.ceil(height * width / most), dtype=np.float64)
    down, across = np.meshgrid(rows, np.arange(width, dtype=np.float64), indexing="ij")
    return down, across


class _Span:
    """The light of some frames in the tiles of an ``anchor``, as its surfaces have it."""

    def __init__(self, anchor: _Look) -> None:
        self._anchor = anchor
        height, width = anchor.inverse.shape
        self._rows, self._columns = _tiles(height, width)
        self._total, self._count = np.zeros(self._rows.shape), np.zeros(self._rows.shape)
        self._tiles: list[Array] = []  # mean light of each frame's tiles, NaN where little of one is seen
        self._ripple, self._ripples = np.zeros(self._rows.shape), np.zeros(self._rows.shape)
        self.moving: Mask | None = None  # pixels that move on their own; None: nothing tells
        self.frames = 0

    @property
    def places(self) -> tuple[Array, Array]:
        """Rows and columns of the pixels of the tiles."""
        return self._rows, self._columns

    def fits(self, look: _Look) -> bool:
        """Whether a frame is as large as the anchor, and seen through as parallel a lens."""
        one, other = self._anchor.frame.camera, look.frame.camera
        return self._anchor.inverse.shape == look.inverse.shape and one.orthographic == other.orthographic

    def add(self, look: _Look) -> None:
        """Take in a frame."""
        light, same = _View(self._anchor, look, self._rows, self._columns).light()
        self._total += np.where(same, light, 0.0)
        self._count += same
        self.frames += 1
        seen = same.sum((1, 2))
        tiles = np.where(same, light, 0.0).sum((1, 2)) / np.maximum(seen, 1)
        self._tiles.append(np.where(seen >= SEEN * light[0].size, tiles, np.nan))
        # What changes a whole block is not noise.
        mean = np.where(same, light, 0.0).sum(2, keepdims=True) / np.maximum(same.sum(2, keepdims=True), 1)
        ripple = np.where(same, light - mean, 0.0)
        self._ripple += ripple
        self._ripples += ripple**2

    def scatter(self) -> float | None:
        """The median over the pixels of how much their light scatters in time (``NOISE_RATIO``); None: too few tell.

        They have depth and stand in the world: the sky has no noise, and a texture that moves on its own is none.
        """
        place = self._rows.astype(np.intp), self._columns.astype(np.intp)
        near = self._anchor.inverse[place] > 0 if not self._anchor.frame.camera.orthographic else True
        seen = (self._count == self.frames) & near & (True if self.moving is None else ~self.moving)
        square = (*seen.shape[:2], BLOCK, BLOCK)
        mean, seen = (self._total / max(self.frames, 1)).reshape(square), seen.reshape(square)
        tells = seen[:, :, 1:-1, 1:-1]
        steps = np.zeros(tells.shape)
        for axis in (2, 3):
            for there in (slice(2, None), slice(None, -2)):
                beside = tuple(there if at == axis else slice(1, -1) for at in (2, 3))
                tells = tells & seen[:, :, *beside]
                steps += (mean[:, :, *beside] - mean[:, :, 1:-1, 1:-1]) ** 2 / 2
        small = self._anchor.light.size < NOISE_PIXELS
        if small or self.frames < NOISE_FRAMES or tells.sum() < LEAST_SHARE * max(tells.size, 1):
            return None
        scatter = (self._ripples - self._ripple**2 / self.frames).reshape(square)[:, :, 1:-1, 1:-1] / (self.frames - 1)
        ratio = scatter / np.maximum(steps, np.finfo(np.float64).tiny)
        return float(np.median(np.where(scatter > (NOISE_LEAST * mean[:, :, 1:-1, 1:-1]) ** 2, ratio, 0.0)[tells]))

    def flashed(self) -> float | None:
        """Share of tiles whose light leaves its mean over the span in a frame by more than jitter moves it; None: none
        tells."""
        if self.frames < SPAN or self._rows.size == 0:
            return None
        tiles = np.array(self._tiles)
        tells = np.isfinite(tiles).all(0)
        if not _enough(tells):
            return None
        mean = tiles[:, tells].mean(0)
        return float((np.abs(tiles[:, tells] - mean).max(0) > FLASH * mean + FLASH_LEAST).mean())

    def blocks(self) -> tuple[Array, Array, Mask]:
        """Mean and deviation of each block's light, [tiles, blocks], and whether enough of it was seen."""
        seen = self._count > SEEN * self.frames
        values, pixels = np.where(seen, self._total / np.maximum(self._count, 1), 0.0), seen.sum(2)
        mean = values.sum(2) / np.maximum(pixels, 1)
        variance = (values**2).sum(2) / np.maximum(pixels, 1) - mean**2
        return mean, np.sqrt(np.maximum(variance, 0.0)), pixels >= SEEN * self._rows.shape[2]


def _shifted(early: _Span, late: _Span) -> float | None:
    """Share of tiles whose light is another in the ``late`` span; None where too little is seen in both.

    The mean of each block over a span is compared with what its texture explains: a block of deviation s, sampled at
    64 places, has a mean that is wrong by s / 8. Jitter moves neighbouring blocks apart by chance, light together, so
    that the mean of the signed differences of 3 x 3 blocks counts.
    """
    if min(early.frames, late.frames) < SPAN:
        return None
    (before, rough, seen), (now, rougher, still_seen) = early.blocks(), late.blocks()
    both = seen & still_seen
    texture = np.maximum(rough, rougher) / BLOCK + SHADE * np.maximum(before, now) + SHADE / 8
    change = np.where(both, (now - before) / texture, 0.0)
    blocks = both.sum(1)
    tells: Mask = np.asarray(blocks >= SEEN * both.shape[1])
    if not _enough(tells):
        return None
    return float((np.abs(change.sum(1)[tells]) > blocks[tells]).mean())


def _enough(tells: Any) -> bool:
    """Whether so many tiles tell that they stand for the image."""
    return bool(tells.sum() >= max(LEAST_TILES, LEAST_SHARE * tells.size))


def _tiles(height: int, width: int) -> tuple[Array, Array]:
    """Rows and columns [tiles, blocks, pixels] of tiles that are spread evenly over an image."""
    down, across = height // TILE, width // TILE
    step = max(1, math.ceil(math.sqrt(down * across / TILES)))
    corners = [(TILE * row, TILE * column) for row in range(0, down, step) for column in range(0, across, step)]
    tops, lefts = np.array(corners, np.float64).reshape(-1, 2).T
    block = BLOCK * np.indices((3, 3)).reshape(2, -1, 1)
    pixel = np.indices((BLOCK, BLOCK)).reshape(2, 1, -1)
    rows, columns = block + pixel
    return tops[:, None, None] + rows, lefts[:, None, None] + columns
