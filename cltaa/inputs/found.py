"""Find undeclared effects, in the headers of all frames and in the pixels of a bounded number of frames.

The resolve leaves out a step only where there is evidence against its effect; in doubt the step stays on. Frame numbers
alone decide which frames are decoded, so that a sequence has the same effects on every run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.camera import displacement, inverse_depth, is_still, reprojected
from cltaa.errors import CltaaError, UsageError
from cltaa.frame import Camera, Effect, Frame, Image, format_effects, outline
from cltaa.io.display import LUMA
from cltaa.io.exr_frame import MATRICES
from cltaa.io.manifest import RESTART_CURE
from cltaa.io.pixel_statistics import is_missing
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import ReadAhead
from cltaa.printable import counted
from cltaa.progress import Advance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Each place has two spans of frames, the second 2 * SPAN after the first; changing light differs between them. In a
# shot of under 6 * SPAN frames the second follows the first, with twice its frames, so that all are examined.
PLACES, SPAN = 3, 8
LEAST_SPAN = 4  # fewer frames tell nothing of light. On 33 scenes, 12 frames show every change that 24 show
BLOCK = 8  # side of a block in pixels; a tile has 3 x 3 blocks, and about TILES tiles of an image are examined
TILE, TILES = 3 * BLOCK, 256
SEEN = 0.6  # share of a block's pixels, and of a tile's blocks, that must be visible in both spans
DEPTH_SLACK = 0.05  # two samples of one surface may differ by this share of the inverse depth
# Share of tiles whose mean changes by more than a block's texture explains by chance: 0.25 behind panes of glass, 0.8
# with moving shadows; bodies that move or are uncovered there change up to 0.05 (one that deforms 0.1).
SHIFTED_SHARE, LEAST_TILES, LEAST_SHARE = 0.05, 4, 0.2
FLASHED_SHARE = 0.01  # share of tiles that flash; none do in 22 scenes of constant light
# A noisy pixel's light deviates in time by more than NOISE_LEAST of its mean. NOISE_RATIO divides its variance by the
# variation of the texture: half the squared steps to its four neighbours in the mean over time, of which jitter makes a
# twelfth and chance twice as much. The median pixel has 0.48 at most without noise, 0.7 and more with four samples a
# pixel. In frames below NOISE_PIXELS texture is often finer than a pixel and varies like noise, by up to 0.94.
NOISE_LEAST, NOISE_RATIO, NOISE_FRAMES, NOISE_PIXELS = 0.02, 0.6, 4, 12_000
# A flash changes a tile by FLASH of its mean over the span plus FLASH_LEAST; jitter by a tenth, by more in the dark.
FLASH, FLASH_LEAST = 0.25, 0.02
SHADE = 0.02  # share of a block's mean; a smaller change is invisible
# Light that moves over a surface, as shadows do, and reflections under a moving camera: the mean of the first span
# predicts a block's frames in the second with over OLDER times the squared error of the mean of their last two. Jitter
# gives about 0.65, since that is a mean of more frames. Share of such blocks at 320 x 180: 0.035 and more beside balls
# that roll or fly, 0.06 on floors that reflect half of the light, 0.8 where a shadow sweeps; in constant light 0.02,
# but 0.046 where the camera zooms and 0.1 in a corridor that it walks along.
OLDER, OLDER_SHARE, CELL = 2.0, 0.03, 4
# Share of pixels whose surface is in none of the previous 3 x 3 samples, though nothing occludes it: it is thinner than
# a pixel. Worst value without thin surfaces: 2e-4; 4e-4 in hedges, 4e-3 along wires.
THIN_SHARE = 3e-4
# Share of pixels at whose previous position an occluder was sampled, as beside every silhouette: so many silhouettes
# leave only narrow gaps between them. 0.017 at most past walls, columns and posts; 0.027 and more behind a lattice,
# 0.05 in hedges. A false positive costs 0.5 dB at most, a miss behind a lattice 3.8 dB.
EDGES_SHARE = 0.022
MOVED_PX, MOVED_SHARE = 0.1, 1e-4  # least difference from the camera's motion, and share of pixels that have it
LOOKED_AT = 2**20  # most pixels examined in a pair of frames, in whole rows
LEAP = 0.25  # share of the picture that points at infinity may move in a frame; a cut moves them farther
BRIGHT = 8.0  # radiance "far above 1"
GROUND = 0.5  # light beneath transparent texels, where a black shadow changes nothing but alpha

NO_FRAME = "no frame can be read"


class Evidence(msgspec.Struct, kw_only=True, frozen=True):
    """Whether a sequence has an effect, and why."""

    effect: Effect
    found: bool
    why: str


class Found(msgspec.Struct, kw_only=True, frozen=True):
    """The effects found in a sequence, from ``frames`` decoded frames, in ``seconds``."""

    evidence: tuple[Evidence, ...]
    frames: int
    seconds: float

    @property
    def effects(self) -> frozenset[Effect]:
        """Effects that were found or cannot be excluded."""
        return frozenset(each.effect for each in self.evidence if each.found)

    def without(self, effect: Effect, why: str) -> Found:
        """Return a copy without one effect."""
        less = Evidence(effect=effect, found=False, why=why)
        evidence = tuple(less if each.effect is effect else each for each in self.evidence)
        return msgspec.structs.replace(self, evidence=evidence)

    @property
    def line(self) -> str:
        """The found effects in one line."""
        looked = f"{counted(self.frames, 'frame')} looked at, {self.seconds:.1f} s" if self.frames else NO_FRAME
        return f"effects found: {format_effects(self.effects)} ({looked})"


def find_effects(sequence: FrameSequence, advance: Advance | None = None) -> Found:
    """Find the effects of ``sequence`` as if it declared none; skips frames that cannot be read."""
    started = time.perf_counter()
    outlines = [sequence.outline(number) for number in sequence.numbers]
    cameras = _cameras(sequence, outlines)
    told = by_headers(sequence, outlines)
    witness = _Witness(cameras, moves=told[Effect.CAMERA][0])
    places = _places([each.cut for each in outlines])
    every = {at for place in places for span in place for at in span}
    for place in places:
        early, late = ([sequence.numbers[at] for at in span] for span in place)
        with np.errstate(all="ignore"):  # extreme matrices overflow; such pixels count as out of sight
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
    """Return for each effect that headers alone decide whether it is present, and why; ``outlines`` of all frames."""
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


def check_headers(sequence: FrameSequence, begun: frozenset[Effect], *, path: Path) -> None:
    """Raise UsageError, about ``path``, where headers show effects beyond those that a run was ``begun`` with."""
    shown = {effect for effect, (there, _) in by_headers(sequence).items() if there}
    if new := shown - begun - {Effect.CUT}:  # a cut starts a new history, whatever the plan
        what, expected = "headers show effects that the run was not begun with", format_effects(begun)
        raise UsageError(what, path=path, expected=expected, found=format_effects(new), cure=RESTART_CURE)


def _cut(sequence: FrameSequence, outlines: Sequence[Frame], cameras: Mapping[int, Camera] | None) -> tuple[bool, str]:
    """Return whether headers declare a cut, or the camera turns so far in one frame that it may be one; and why."""
    if any(each.cut for each in outlines[1:]):
        return True, "headers say so"
    for before, now in pairwise(cameras.values() if cameras is not None else ()):
        if before.orthographic or now.orthographic or is_still(now, before):
            continue
        (_, _, _, u), (_, _, _, v), (_, _, _, w) = displacement(now, before, sequence.width, sequence.height).rows
        # Behind the camera 1 + w is negative, so any motion exceeds it.
        if max(abs(u) / sequence.width, abs(v) / sequence.height) > LEAP * (1 + w):
            return True, "no header says so, but the camera leaps"
    return False, "no header says so, and the camera leaps nowhere"


def _cameras(sequence: FrameSequence, outlines: Sequence[Frame]) -> dict[int, Camera] | None:
    """Return the cameras of all frames by number, or None if they are undeclared."""
    told = sequence.undeclared.isdisjoint(MATRICES)
    return {each.index: each.camera for each in outlines} if told else None


def with_found(sequence: FrameSequence, found: Found | None) -> FrameSequence:
    """Return the same frames with the found effects."""
    if found is None and sequence.found is None:
        return sequence
    copy = sequence.select(sequence.first, sequence.last)
    copy.found = None if found is None else found.effects
    return copy


def _places(cuts: Sequence[bool]) -> list[tuple[range, range]]:
    """Return two spans of frame positions for each of up to PLACES places, each within one shot."""
    count, places = len(cuts), list[tuple[range, range]]()
    whole = min(count, 3 * SPAN)
    few = min(max(count // (2 * SPAN), 1), PLACES)  # fewer in a short sequence, so that no frame is read often
    begins = [0, *(at for at in range(1, count) if cuts[at])]
    shots = [range(*each) for each in pairwise([*begins, count])]
    for at in range(few):
        first = round(at * (count - whole) / max(few - 1, 1))
        shot = max(shots, key=lambda its: min(its.stop, first + whole) - max(its.start, first))
        frames = min(whole, len(shot))
        first = min(max(first, shot.start), shot.stop - frames)
        span = max(frames // 3, 1)
        late = first + (span if len(shot) < 2 * frames else frames - span)  # examines every frame of a short shot
        place = range(first, first + span), range(late, first + frames)
        places += [] if place in places else [place]
    return places


def _readable(sequence: FrameSequence, numbers: Sequence[int]) -> Iterator[Frame]:
    """Yield the readable frames; the resolve reports the errors of the others."""

    def read(number: int) -> Frame | None:
        try:
            return sequence.frame(number)
        except CltaaError:
            return None

    with ReadAhead(partial(read, number) for number in numbers) as frames:
        yield from (frame for frame in frames if frame is not None)


class _Witness:
    """Collects evidence from the frames of a sequence."""

    def __init__(self, cameras: Mapping[int, Camera] | None, *, moves: bool) -> None:
        self._cameras = cameras
        self._shifted: list[float] = []  # share of tiles, for each conclusive place
        self._thin: list[float] = []  # share of pixels, for each pair of frames
        self._hidden: list[float] = []
        self._moving: list[float] = []
        self._flashed: list[float] = []  # share of tiles, for each span
        self._older: list[float] = []  # share of blocks, for each conclusive place
        self._scatter: list[float] = []  # median over the pixels, for each span
        self._moves, self._depth = moves, False
        self.looked: set[int] = set()
        self.brightest, self.sky = 0.0, False

    def look(self, frames: Iterable[Frame], late: set[int]) -> None:
        """Examine the frames of a place, few in memory at a time; frame numbers in ``late`` are its second span."""
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
            # From the first frames, next to the anchor, whose pixels both spans use.
            if spans[0].moving is None and (apart := self._apart(look, frame.motion, *span.places)) is not None:
                spans[0].moving = spans[1].moving = apart > MOVED_PX
            # One pair of frames for each span is enough.
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
            older = _older(*spans)
            self._older += [] if older is None else [older]
            self._flashed += [share for span in spans if (share := span.flashed()) is not None]
            self._scatter += [ratio for span in spans if (ratio := span.scatter()) is not None]

    def _motion(self, look: _Look, motion: Image | None) -> None:
        """Compare motion vectors with the camera's motion since the previous frame, decoded or not."""
        apart = self._apart(look, motion, *_places_of(look, LOOKED_AT // 8))
        if apart is not None:
            self._moving.append(float((apart > MOVED_PX).mean()))  # False for NaN, which means the camera's motion

    def _apart(self, look: _Look, motion: Image | None, rows: Array, columns: Array) -> Array | None:
        """Return the distance in pixels of vectors from the camera's motion at these places; None if unknown."""
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
        """Return whether something has own motion, and why."""
        if "motion" not in sequence.holds:
            return False, "no channel"
        if not self._moving:
            return True, "no two frames tell"
        share = max(self._moving)
        return share > MOVED_SHARE, f"{share:.2%} of the pixels move otherwise than the camera makes them"

    def thin(self) -> tuple[bool, str]:
        """Return whether something is thinner than a pixel, and why."""
        if not self._depth:
            return True, "no depth"
        if not self._thin:
            return True, "no camera tells where a surface was" if self._cameras is None else "no two frames tell"
        missed, hidden = float(np.mean(self._thin)), float(np.mean(self._hidden))
        why = f"{missed:.2%} of the pixels show what the frame before misses, {hidden:.1%} what it hides"
        return missed > THIN_SHARE or hidden > EDGES_SHARE, why

    def illumination(self) -> tuple[bool, str]:
        """Return whether the illumination changes, and why."""
        if self._moves and not self._depth:
            return True, "no depth tells what a moving camera sees"
        if not self._shifted:
            return True, "too little is seen in two spans of frames, or nothing tells a camera"
        shares = self._shifted, self._flashed, self._older
        shifted, flashed, older = (max(each, default=0.0) for each in shares)
        if older > OLDER_SHARE:
            return True, f"light moves over the surfaces of {older:.1%} of the image"
        found = shifted > SHIFTED_SHARE or flashed > FLASHED_SHARE
        return found, f"the light of {max(shifted, flashed):.1%} of the image changes from span to span"

    def noise(self) -> tuple[bool, str]:
        """Return whether the samples of one place vary more than texture explains, and why."""
        if not self._scatter:
            return False, f"frames are small, or too little of one place is seen in {NOISE_FRAMES} of them"
        ratio = float(np.mean(self._scatter))
        return ratio > NOISE_RATIO, f"light scatters in time by {ratio:.2f} of the steps of texture"


class _Look:
    """A frame, its inverse depth and its light x / (1 + x) over a grey ground, [H, W], tonemapped so that no highlight
    dominates. Both are NaN where they are missing, which is evidence of nothing."""

    def __init__(self, frame: Frame) -> None:
        self.frame = outline(frame)
        depth = np.asarray(frame.depth, np.float32)
        self.inverse: NDArray[np.float32] = np.empty((frame.height, frame.width), np.float32)
        inverse_depth(depth, self.inverse, parallel=frame.camera.orthographic)
        self.inverse[np.isnan(depth)] = np.nan
        self.sky, self.depth = bool(np.isinf(depth).any()), bool(np.isfinite(depth).any())
        missing = is_missing(frame.colour, frame.alpha)
        colour = np.where(missing[..., None], np.float32(0), np.maximum(frame.colour, 0))
        self.brightest = float(colour.max(initial=0.0))
        light = colour @ (LUMA / np.float32(frame.exposure))
        if frame.alpha is not None:
            light += np.float32(GROUND) * (1 - np.clip(frame.alpha, 0, 1))
        self.light = np.where(missing, np.float32(np.nan), light / (1 + light))


class _View:
    """Pixels of ``now`` reprojected into ``before`` by depth and cameras, and whether they were visible there."""

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
        """Return the share of pixels whose surface is nearer than all 3 x 3 samples there, so none of them hit it."""
        column, row = np.rint(self.column).astype(np.intp), np.rint(self.row).astype(np.intp)
        nearest = np.full(self.column.shape, -np.inf)
        for below in (-1, 0, 1):
            for beside in (-1, 0, 1):
                nearest = np.maximum(nearest, self.before.inverse[row + below, column + beside])
        return float((self.inside & (self.expected - nearest > DEPTH_SLACK * np.abs(self.expected))).mean())

    def hidden(self) -> float:
        """Return the share of pixels where something nearer was sampled."""
        there = self.before.inverse[np.rint(self.row).astype(np.intp), np.rint(self.column).astype(np.intp)]
        return float((self.inside & (there - self.expected > DEPTH_SLACK * np.abs(there))).mean())

    def light(self) -> tuple[Array, Mask]:
        """Return the bilinear light there, and True where all four samples are on the surface and none is missing."""
        column, row = self.column.astype(np.intp), self.row.astype(np.intp)
        right, below = self.column - column, self.row - row
        result, same = np.zeros(column.shape), self.inside.copy()
        for down, by_row in ((0, 1 - below), (1, below)):
            for beside, by_column in ((0, 1 - right), (1, right)):
                place = row + down, column + beside
                result += self.before.light[place] * by_row * by_column
                there = self.before.inverse[place]
                same &= np.abs(there - self.expected) <= DEPTH_SLACK * np.maximum(np.abs(there), np.abs(self.expected))
        return result, same & np.isfinite(result)


def _moved(now: _Look, before: Camera, rows: Array, columns: Array) -> tuple[Array, Array, Array, Mask]:
    """Return the motion u, v in pixels into ``before``, the inverse depth there, and what was in front of it."""
    height, width = now.inverse.shape
    camera, jitter = now.frame.camera, now.frame.jitter_px
    depth = now.inverse[rows.astype(np.intp), columns.astype(np.intp)].astype(np.float64)
    moved = displacement(camera, before, width, height)
    x, y = columns + (0.5 + jitter[0] - width / 2), rows + (0.5 + jitter[1] - height / 2)
    return reprojected(x, y, depth, moved, parallel=camera.orthographic)


def _places_of(look: _Look, most: int) -> tuple[Array, Array]:
    """Return rows and columns of up to about ``most`` pixels, in evenly spread whole rows."""
    height, width = look.inverse.shape
    rows = np.arange(0, height, math.ceil(height * width / most), dtype=np.float64)
    down, across = np.meshgrid(rows, np.arange(width, dtype=np.float64), indexing="ij")
    return down, across


class _Span:
    """The light of some frames, reprojected to the surfaces in the tiles of an ``anchor``."""

    def __init__(self, anchor: _Look) -> None:
        self._anchor = anchor
        height, width = anchor.inverse.shape
        self._rows, self._columns = _tiles(height, width)
        self._total, self._count = np.zeros(self._rows.shape), np.zeros(self._rows.shape)
        self._tiles: list[Array] = []  # mean light of each frame's tiles, NaN where little of a tile is visible
        self._ripple, self._ripples = np.zeros(self._rows.shape), np.zeros(self._rows.shape)
        self._cells: list[Array] = []  # mean light of each frame's cells, [tiles, blocks, cells]; NaN where not seen
        self.moving: Mask | None = None  # pixels with own motion; None: unknown
        self.frames = 0

    @property
    def places(self) -> tuple[Array, Array]:
        """Rows and columns of the pixels of the tiles."""
        return self._rows, self._columns

    def fits(self, look: _Look) -> bool:
        """Return whether a frame has the size and the kind of projection of the anchor."""
        one, other = self._anchor.frame.camera, look.frame.camera
        return self._anchor.inverse.shape == look.inverse.shape and one.orthographic == other.orthographic

    def add(self, look: _Look) -> None:
        """Add a frame."""
        light, same = _View(self._anchor, look, self._rows, self._columns).light()
        self._total += np.where(same, light, 0.0)
        self._count += same
        self.frames += 1
        seen = same.sum((1, 2))
        tiles = np.where(same, light, 0.0).sum((1, 2)) / np.maximum(seen, 1)
        self._tiles.append(np.where(seen >= SEEN * light[0].size, tiles, np.nan))
        # A change of a whole block is not noise.
        mean = np.where(same, light, 0.0).sum(2, keepdims=True) / np.maximum(same.sum(2, keepdims=True), 1)
        ripple = np.where(same, light - mean, 0.0)
        self._ripple += ripple
        self._ripples += ripple**2
        self._cells.append(_in_cells(np.where(same, light, np.nan)).mean(-1))

    def scatter(self) -> float | None:
        """Return the median over the pixels of their variation in time (``NOISE_RATIO``); None if too few count.

        Only still pixels with depth count: the sky has no noise, and a moving texture would look like noise.
        """
        most = self._count.max(initial=0)
        # One may be missing.
        seen = (self._count >= most - 1) & self._near & (True if self.moving is None else ~self.moving)
        square = (*seen.shape[:2], BLOCK, BLOCK)
        count = np.maximum(self._count, 2)
        mean, seen = (self._total / count).reshape(square), seen.reshape(square)
        tells = seen[:, :, 1:-1, 1:-1]
        steps = np.zeros(tells.shape)
        for axis in (2, 3):
            for there in (slice(2, None), slice(None, -2)):
                beside = tuple(there if at == axis else slice(1, -1) for at in (2, 3))
                tells = tells & seen[:, :, *beside]
                steps += (mean[:, :, *beside] - mean[:, :, 1:-1, 1:-1]) ** 2 / 2
        small = self._anchor.light.size < NOISE_PIXELS
        if small or most < NOISE_FRAMES or tells.sum() < LEAST_SHARE * max(tells.size, 1):
            return None
        scatter = ((self._ripples - self._ripple**2 / count) / (count - 1)).reshape(square)[:, :, 1:-1, 1:-1]
        ratio = scatter / np.maximum(steps, np.finfo(np.float64).tiny)
        return float(np.median(np.where(scatter > (NOISE_LEAST * mean[:, :, 1:-1, 1:-1]) ** 2, ratio, 0.0)[tells]))

    def flashed(self) -> float | None:
        """Return the share of tiles whose light differs in some frame by more than jitter does; None: too few count."""
        if self.frames < LEAST_SPAN or self._rows.size == 0:
            return None
        tiles = np.array(self._tiles)
        tiles = tiles[np.isfinite(tiles).any(1)]  # a frame may lack all its samples
        tells = np.isfinite(tiles).all(0)
        if not len(tiles) or not _enough(tells):
            return None
        mean = tiles[:, tells].mean(0)
        return float((np.abs(tiles[:, tells] - mean).max(0) > FLASH * mean + FLASH_LEAST).mean())

    def cells(self) -> Array:
        """Return the mean light of cells in each frame, [frames, tiles, blocks, cells]; NaN for sky and own motion."""
        cells, left_out = np.array(self._cells), ~self._near
        if self.moving is not None:
            left_out = left_out | self.moving
        cells[:, _in_cells(left_out).any(-1)] = np.nan
        return cells

    @property
    def _near(self) -> Mask:
        """Pixels with a surface."""
        if self._anchor.frame.camera.orthographic:
            return np.ones(self._rows.shape, np.bool_)
        return np.asarray(self._anchor.inverse[self._rows.astype(np.intp), self._columns.astype(np.intp)] > 0)

    def blocks(self) -> tuple[Array, Array, Mask]:
        """Return mean and deviation of each block's light, [tiles, blocks], and whether enough of it was visible."""
        seen = self._count > SEEN * self.frames
        values, pixels = np.where(seen, self._total / np.maximum(self._count, 1), 0.0), seen.sum(2)
        mean = values.sum(2) / np.maximum(pixels, 1)
        variance = (values**2).sum(2) / np.maximum(pixels, 1) - mean**2
        return mean, np.sqrt(np.maximum(variance, 0.0)), pixels >= SEEN * self._rows.shape[2]


def _shifted(early: _Span, late: _Span) -> float | None:
    """Return the share of tiles whose light differs in the ``late`` span; None if too little is visible in both.

    The change of each block's mean is divided by the error that its texture explains: a block of deviation s, sampled
    at 64 places, has a mean that is wrong by s / 8. Jitter changes neighbouring blocks by chance, light changes them
    together, so the mean of the signed differences of 3 x 3 blocks decides.
    """
    if min(early.frames, late.frames) < LEAST_SPAN:
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


def _older(early: _Span, late: _Span) -> float | None:
    """Return the share of blocks whose light an older mean predicts worse (``OLDER``); None if too few are seen."""
    if min(early.frames, late.frames) < LEAST_SPAN:
        return None
    old, later = early.cells().mean(0), late.cells()
    sums, count = np.zeros((3, *old.shape[:2])), np.zeros(old.shape[:2])
    for two_before, before, now in zip(later, later[1:], later[2:], strict=False):
        errors = np.stack([now - old, now - (before + two_before) / 2, SHADE * old]) ** 2
        seen = np.isfinite(errors).all(0)
        sums += np.where(seen, errors, 0.0).sum(-1)
        count += seen.sum(-1)
    tells = count >= max(SEEN * old.shape[2] * (len(later) - 2), 1)
    by_old, by_recent, least = sums
    return float((by_old > OLDER * (by_recent + least))[tells].mean()) if _enough(tells) else None


def _in_cells(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return the pixels of blocks [tiles, blocks, pixels] by cells, [tiles, blocks, cells, pixels of a cell]."""
    tiles, blocks, _ = pixels.shape
    side = BLOCK // CELL
    split = pixels.reshape(tiles, blocks, side, CELL, side, CELL).swapaxes(3, 4)
    return split.reshape(tiles, blocks, side * side, CELL * CELL)


def _enough(tells: Any) -> bool:
    """Return whether enough tiles count to represent the image."""
    return bool(tells.sum() >= max(LEAST_TILES, LEAST_SHARE * tells.size))


def _tiles(height: int, width: int) -> tuple[Array, Array]:
    """Return rows and columns [tiles, blocks, pixels] of tiles spread evenly over an image."""
    down, across = height // TILE, width // TILE
    step = max(1, math.ceil(math.sqrt(down * across / TILES)))
    corners = [(TILE * row, TILE * column) for row in range(0, down, step) for column in range(0, across, step)]
    tops, lefts = np.array(corners, np.float64).reshape(-1, 2).T
    block = BLOCK * np.indices((3, 3)).reshape(2, -1, 1)
    pixel = np.indices((BLOCK, BLOCK)).reshape(2, 1, -1)
    rows, columns = block + pixel
    return tops[:, None, None] + rows, lefts[:, None, None] + columns
