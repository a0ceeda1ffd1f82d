"""Parts of a sequence, each through one resolver: frames are read ahead and images written behind while kernels run."""

from __future__ import annotations

import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import msgspec

from cltaa.core import plan
from cltaa.core.bands import BandedResolver
from cltaa.core.plan import is_hold, with_effects
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.frame import Asked, Effect, Frame, outline
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import AHEAD, BEHIND, ReadAhead, Writer
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.denoise import denoiser
from cltaa.pipeline.lineage import Lineage, frames_behind
from cltaa.pipeline.output import Read, ResolvedFiles, reads
from cltaa.process import Stop

Shown = Callable[[list[int]], Iterator[int]]


class How(msgspec.Struct, frozen=True, kw_only=True):
    """How to read, resolve and write frames, apart from the resolver; as ``resolve_sequence`` takes it."""

    effects: Asked
    half: bool
    compression: str
    layers: tuple[str, ...]
    denoise: str


def from_ring_alone(preset: Preset, sequence: FrameSequence, how: How) -> bool:
    """True where frames are gathered, and no known effect needs more than the ring holds."""
    return plan.from_ring_alone(preset, with_effects(sequence.outline(sequence.first), how.effects))


def gathered_from(sequence: FrameSequence, wanted: Sequence[int], preset: Preset, how: How) -> FrameSequence:
    """Return the frames from which the ``wanted`` are made without a checkpoint: those of a ring, of a hold, or all
    before."""
    numbers, (begin, _) = sequence.numbers, _begins(sequence, wanted[0], preset, how)
    last = numbers.index(wanted[-1]) + preset.settings.look_ahead
    return sequence.select(numbers[begin], numbers[min(last, len(numbers) - 1)])


def _begins(sequence: FrameSequence, wanted: int, preset: Preset, how: How) -> tuple[int, int]:
    """Return the places of the first frame that the ``wanted`` one is made from, and of the first to resolve."""
    if not from_ring_alone(preset, sequence, how):
        return 0, 0
    numbers = sequence.numbers
    begun, frame = numbers.index(wanted), with_effects(sequence.outline(wanted), how.effects)
    while begun:
        before = with_effects(sequence.outline(numbers[begun - 1]), how.effects)
        if not is_hold(preset, frame, before.camera):
            break
        frame, begun = before, begun - 1
    return max(0, begun - frames_behind(preset)), begun


def lineage_of(preset: Preset, sequence: FrameSequence, how: How) -> Lineage:
    """Return a lineage of results of ``sequence``, without frames."""
    return Lineage(preset, how.effects, ring=from_ring_alone(preset, sequence, how))


def in_parts(wanted: list[int], count: int) -> list[list[int]]:
    """Split the ``wanted`` frames into up to ``count`` runs of about equal length."""
    begins = [len(wanted) * at // count for at in range(count + 1)]
    return [wanted[begin:end] for begin, end in pairwise(begins) if begin < end]


class Parts:
    """Resolves parts of a sequence, and writes the wanted frames by ``files``; several threads may use it.

    ``seconds`` holds the time of each frame in each stage. Once ``stop`` is requested KeyboardInterrupt is raised after
    the current frame; where ``halted`` is set all threads end after theirs. ``look`` receives the bytes of each
    finished file.
    """

    def __init__(self, files: ResolvedFiles, how: How, stop: Stop) -> None:
        self._files, self._how, self._stop = files, how, stop
        self._denoise = denoiser(how.denoise)
        self.seconds: defaultdict[str, list[float]] = defaultdict(list)
        self.halted = threading.Event()
        self.look: Callable[[Sequence[int]], None] = lambda _sizes: None

    def resolve(
        self,
        resolver: Resolver,
        part: FrameSequence,
        after: int | None,
        lineage: Lineage,
        wanted: Sequence[int],
        shown: Shown = iter,
        checkpoints: Checkpoints | None = None,
        every: int = 0,
    ) -> None:
        """Resolve ``part``, whose history continues after frame ``after``, and write the ``wanted`` frames.

        ``lineage`` holds the inputs of the frames before, and takes those of ``part``.

        Frames before those are only kept, where the wanted ones are gathered from them. ``shown`` passes numbers of
        frames on as they are resolved. The state is saved in ``checkpoints`` after ``every`` frames; 0 is never.
        """
        numbers = [number for number in part.numbers if number <= wanted[-1]]
        lead = _begins(part, wanted[0], resolver.preset, self._how)[1]
        asked, effects, started = frozenset(wanted), self._how.effects, time.perf_counter()
        in_turn = isinstance(resolver, BandedResolver)  # so large that no second image fits beside it
        reading = ReadAhead(reads(part, after, self._how.layers, self._denoise), 0 if in_turn else AHEAD)
        with Writer(compression=self._how.compression) as writer, reading as frames:
            if after is None:
                resolver.reset()
                # Allocates what the first frame needs, while that is decoded.
                alpha = "alpha" in part.holds and (isinstance(effects, str) or Effect.ALPHA in effects)
                resolver.reserve(part.width, part.height, alpha=alpha, half=self._how.half)
            waiting = deque[Read]()
            given = self._given(frames, len(part), waiting, outlines=resolver.look_ahead > 0)
            self._keep(resolver, numbers[:lead], given, waiting, lineage)
            images = resolver.images(given, half=self._how.half, planar=not in_turn)
            going = self._going(shown(numbers[lead:]))
            for done, (number, image) in enumerate(zip(going, images, strict=False), start=1):
                read = waiting.popleft()
                lineage.add(read.input, read.frame)
                if number in asked:
                    read = read.made_from(lineage, waiting)
                    self._files.write(writer, read, image)
                    self.look(self._files.sizes)
                resolver.release()
                for stage, seconds in resolver.times._asdict().items():
                    self.seconds[stage].append(seconds)
                if checkpoints and every and (self._stop.requested or done % every == 0):
                    if self._stop.requested or every <= BEHIND:  # else both slots may lie behind an unwritten frame
                        writer.flush()
                    checkpoints.save(resolver, lineage.digest())
                if self._stop.requested:
                    raise KeyboardInterrupt
                if in_turn:
                    writer.flush()
                del read, image
            writer.close()
            self.seconds["read"] += frames.seconds
            self.seconds["write"] += writer.seconds
        self.seconds["whole"].append((time.perf_counter() - started) / len(numbers))

    def _keep(
        self, resolver: Resolver, numbers: list[int], given: Iterator[Frame], waiting: deque[Read], lineage: Lineage
    ) -> None:
        """Let ``resolver`` keep the next of the ``given`` frames, those of ``numbers``."""
        for _, frame in zip(self._going(iter(numbers)), given, strict=False):
            resolver.keep(frame)
            read = waiting.popleft()
            lineage.add(read.input, read.frame)
            if self._stop.requested:
                raise KeyboardInterrupt

    def _going(self, numbers: Iterator[int]) -> Iterator[int]:
        """Yield ``numbers`` until all are halted."""
        for number in numbers:
            if self.halted.is_set():
                return
            yield number

    def _given(self, frames: Iterator[Read], count: int, waiting: deque[Read], *, outlines: bool) -> Iterator[Frame]:
        """Yield the next ``count`` of ``frames``, which stay in ``waiting``, whole or as ``outlines``."""
        for _ in range(count):
            read = next(frames)
            frame = with_effects(read.frame, self._how.effects)
            waiting.append(read._replace(frame=outline(read.frame)) if outlines else read)
            yield frame
            del read, frame
