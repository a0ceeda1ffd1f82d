"""A sequence through the resolver to a folder: frames are read ahead and images written behind while kernels run."""

from __future__ import annotations

import json
import shutil
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import numpy as np

from cltaa.core.bands import BandedResolver
from cltaa.core.debug_views import View
from cltaa.core.parameters import HistoryKind
from cltaa.core.plan import estimate, with_effects
from cltaa.core.planes import pooled_memory
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver, Times
from cltaa.errors import DeviceLost, UsageError
from cltaa.frame import Asked, Effect, Frame, outline
from cltaa.inputs.found import Found
from cltaa.io.atomic import atomic_path, check_creatable, owned
from cltaa.io.exr_layout import check_lossless
from cltaa.io.manifest import REFERENCE
from cltaa.io.names import Selection
from cltaa.io.numbered import OnBreak
from cltaa.io.pixel_statistics import Missing
from cltaa.io.sequence import FrameSequence, ImageSequence, open_images
from cltaa.io.streams import InTurn, ReadAhead, Writer
from cltaa.io.video import check_film, rate_of, write_side_by_side, write_video, write_wipe
from cltaa.pipeline.checkpoint import CHECKPOINT_EVERY, Checkpoints
from cltaa.pipeline.debug import DebugViews
from cltaa.pipeline.denoise import Denoise, denoiser
from cltaa.pipeline.follow import Arrivals
from cltaa.pipeline.output import (
    OutputFolder,
    Read,
    ResolvedFiles,
    check_layers,
    reads,
    sequence_settings,
)
from cltaa.printable import bytes_of, counted, printable
from cltaa.process import Stop
from cltaa.progress import shown_progress, track

CHECKED_AFTER = 2  # files, of which frames of one sequence differ little


class DiskSpace:
    """Looks once whether ``count`` results fit into ``folder``; a guess, so that it warns and refuses nothing."""

    def __init__(self, folder: Path, count: int) -> None:
        """Nothing is looked at before results are there."""
        self._folder, self._count, self._looked = folder, count, False

    def look(self, sizes: Sequence[int]) -> None:
        """Warn on standard error if as many bytes a file as ``sizes``, of those that are finished, will not fit."""
        finished = len(sizes)
        if self._looked or finished < CHECKED_AFTER:
            return
        self._looked = True
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:  # a folder that is gone: the next file tells
            return
        left = self._count - finished
        wanted = left * sum(sizes) / finished
        if wanted > free:
            frames = f"{counted(left, 'frame')} left will take about {bytes_of(wanted)}, {bytes_of(free)} are free"
            cure = "free some space; a run that ends for want of it goes on by the same command"
            print(f"cltaa: warning: {printable(self._folder)}: {frames}: {cure}", file=sys.stderr)


class StageTimes(msgspec.Struct, kw_only=True):
    """Seconds a frame: the median of each stage, and ``whole``, the mean of a run by the clock.

    Stages overlap, so that the whole of many frames is less than their sum; it holds what no stage does too, such as
    building kernels and drawing debug views, which is most of it where few frames are resolved.
    """

    read: float
    upload: float
    kernels: float
    read_back: float
    write: float
    whole: float


class ResolveReport(msgspec.Struct, kw_only=True):
    """What a run of ``resolve_sequence`` did: of ``frames``, ``resolved`` were written now, the others before.

    ``repaired`` counts the pixels of those whose colour was no usable number (NaN, infinite, beyond 2^50), ``missing``
    says which frame lacks how many of them and where, ``opaque``
    the frames whose alpha is 1 everywhere, ``saturated`` the pixels as bright as the largest half, where halves are
    written or kept as history, ``cuts_found`` the frames that were found to begin another shot though nobody says so,
    ``found`` the effects where none are declared, and why.
    """

    output: str
    frames: int
    resolved: int
    repaired: int
    missing: list[Missing]
    opaque: int
    saturated: int
    cuts_found: list[int]
    found: Found | None = None
    width: int
    height: int
    device: str
    preset: str
    seconds: StageTimes


def write_record(folder: Path, report: ResolveReport, preset: Preset) -> None:
    """Write ``resolve.json``: beside the images, what made them. Raises OutputError and StorageError."""
    record: dict[str, Any] = {"outcome": msgspec.to_builtins(report), "preset": msgspec.to_builtins(preset)}
    with atomic_path(folder / "resolve.json") as temporary:
        temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def stage_rows(seconds: StageTimes) -> Iterable[tuple[str, float]]:
    """Name and milliseconds a frame of each stage, for a table."""
    return ((field.replace("_", " "), getattr(seconds, field) * 1e3) for field in StageTimes.__struct_fields__)


def check_jobs(jobs: int, preset: Preset, *, follow: bool, debug: bool) -> None:
    """Raise UsageError where so many parts of a sequence cannot be resolved at once."""
    if jobs < 1:
        raise UsageError("so many parts at once", expected="1 or more", found=jobs)
    if jobs == 1:
        return
    if preset.choices.history is not HistoryKind.FRAMES:
        cure = "leave out --jobs, or take a preset that gathers, as gather-8"
        raise UsageError(f"--jobs: preset {preset.name} resolves each frame from the result before it", cure=cure)
    for given, option in ((follow, "--follow"), (debug, "--debug")):
        if given:
            raise UsageError(f"--jobs resolves no frames in turn, as {option} wants", cure="give one of the two")


COMPARISONS = ("side", "wipe")  # of a film


def resolve_sequence(
    sequence: FrameSequence,
    output: str | Path,
    resolver: Resolver,
    *,
    effects: Asked = "auto",
    half: bool = False,
    compression: str = "zip",
    preview: str | Path | None = None,
    compare: str | None = None,
    restart: bool = False,
    checkpoint_every: int = CHECKPOINT_EVERY,
    debug: tuple[View, ...] = (),
    layers: tuple[str, ...] = (),
    denoise: str = "none",
    progress: bool = True,
    stopping: AbstractContextManager[Stop] | None = None,
    arrivals: Arrivals | None = None,
    others: Sequence[Resolver] = (),
    found: Found | None = None,
) -> ResolveReport:
    """Resolve every frame of ``sequence`` into ``output``, one EXR a frame under the same names.

    ``effects`` overrides what the sequence declares: ``auto`` keeps it, or what was found where it declares nothing,
    ``find`` takes that alone, ``all`` runs every step of the preset whatever the frames call for, and a set leaves out
    the steps and channels of all other effects. ``preview`` is an MP4 of the
    result, with ``compare`` of the input beside it (``side``) or under a line that sweeps over it (``wipe``). A run
    that was cut short goes on where it stopped, to the same bits. A device that is lost is opened once more. Views to
    ``debug`` become layers of the EXRs, and PNGs in a folder of that name. Channels of the input that match one of
    ``layers`` are kept beside the resolved ones, and its attributes and windows always. ``denoise`` is ``none``, or
    ``oidn`` for Intel's Open Image Denoise on each frame's colour before it is resolved. Without ``progress`` nothing
    is shown while it runs.

    ``stopping`` is entered for the run and tells when to stop: then the frame in work is finished, the state saved and
    KeyboardInterrupt raised. ``cltaa.process.stop_signals()`` does so for SIGINT and SIGTERM; signals are left alone
    without it. What follows among ``arrivals``, whose first frames are ``sequence``, is resolved as it comes. With
    ``others``, which are as ``resolver`` is and gather, each resolves a part of the sequence at the same time.
    ``found`` is what the effects that ``sequence`` was told rest on, for the report.

    Raises UsageError where ``output`` is the sequence's own folder or was begun with other settings (unless
    ``restart``, which begins it anew), OutputError where it cannot be created or another process writes there, and
    what reading, resolving and writing raise; finished frames stay complete.
    """
    check_jobs(1 + len(others), resolver.preset, follow=arrivals is not None, debug=bool(debug))
    output, preview = Path(output), None if preview is None else Path(preview)
    if compare not in (None, *COMPARISONS):
        raise UsageError("no such comparison", expected=", ".join(COMPARISONS), found=compare)
    if compare is not None and preview is None:
        raise UsageError(f"comparison {compare} is of a film", cure="name it: preview")
    if checkpoint_every < 1:
        raise UsageError("a checkpoint every so many frames", expected="1 or more", found=checkpoint_every)
    _refuse_place(output, sequence)
    check_lossless(compression)
    check_layers(sequence, layers)
    options: dict[str, Any] = {"effects": effects if isinstance(effects, str) else sorted(effects), "half": half}
    if debug:
        if isinstance(resolver, BandedResolver):
            raise UsageError("--debug shows whole images only", cure="use --band-rows 0 or smaller frames")
        options["debug"] = sorted(debug)
    if layers:
        options["layers"] = list(layers)
    cleans = denoiser(denoise)
    if cleans is not None:
        options["denoise"] = denoise
    if resolver.look_ahead:
        options["last_frame"] = sequence.last  # the frames before it would have more ahead in a longer sequence
    settings = {**resolver.settings(), **options, "compression": compression, **sequence_settings(sequence)}
    if preview is not None:
        check_film(preview, sequence, output)
        rate = rate_of(sequence.attributes, sequence.sequence_json, sequence.step)
    keeping = pooled_memory(images=not isinstance(resolver, BandedResolver))
    resolvers = [resolver, *others]
    every = _every_step(resolvers, resolver.every_step or effects == "all")
    with keeping, every, owned(output), stopping or nullcontext(Stop()) as stop:
        if preview is not None:
            check_creatable(preview)  # again, now that the output is there, which may be the film's folder
        folder = OutputFolder(output, settings, preset=resolver.preset.name, restart=restart)
        checkpoints = Checkpoints(output, folder.key)
        if restart:
            checkpoints.clear()
        views = DebugViews(resolver, debug, len(sequence))
        files = ResolvedFiles(folder, resolver, views, undeclared=sequence.undeclared)
        run = _Run(
            sequence, files, checkpoints, resolvers, effects, stop, layers, half=half, progress=progress, denoise=cleans
        )
        try:
            run.resolve(compression, checkpoint_every)
        except DeviceLost:
            for each in resolvers:
                each.reopen()
            run.resolve(compression, checkpoint_every)
        if arrivals is not None:
            run.follow(arrivals, compression, checkpoint_every)
        report = msgspec.structs.replace(run.report(), found=found)
        write_record(output, report, resolver.preset)
        if arrivals is None or arrivals.ended:
            checkpoints.clear()
    if preview is not None:
        _write_film(preview, sequence, open_images(_results(output, sequence), gaps=OnBreak.RESET), compare, rate)
    return report


def _write_film(
    path: Path, sequence: FrameSequence, results: ImageSequence, compare: str | None, rate: Fraction
) -> None:
    """A film of the results alone, or beside what they were resolved from."""
    if compare is None:
        write_video(path, results, rate=rate)
        return
    frames = (sequence.frame(number).colour for number in results.numbers)
    before = (np.nan_to_num(colour, nan=0.0, posinf=0.0, neginf=0.0) for colour in frames)
    labels = "input", "resolved"
    if compare == "side":
        write_side_by_side(path, before, results, labels=labels, rate=rate)
    else:
        write_wipe(path, before, results, labels=labels, rate=rate)


def _results(output: Path, sequence: FrameSequence) -> Selection:
    """The results of a sequence among all that may be in its output folder."""
    numbers = {output / sequence.path(number).name: number for number in sequence.numbers}
    return Selection(output, tuple(numbers), tuple(map(str, numbers)), numbers)


@contextmanager
def _every_step(resolvers: Sequence[Resolver], every: bool) -> Iterator[None]:
    """Let resolvers run every step, or not, until the end of the block."""
    before = [resolver.every_step for resolver in resolvers]
    for resolver in resolvers:
        resolver.every_step = every
    try:
        yield
    finally:
        for resolver, ran in zip(resolvers, before, strict=True):
            resolver.every_step = ran


def _refuse_place(output: Path, sequence: FrameSequence) -> None:
    """Raise UsageError for the sequence's own folder, and for one in it in which its truth is looked for."""
    cure, place, folder = "name another folder with -o", output.resolve(), sequence.folder.resolve()
    if place == folder:
        raise UsageError("the output would overwrite the sequence", path=output, cure=cure)
    if place.parent == folder and REFERENCE.fullmatch(place.name):
        raise UsageError("the output would be taken for the truth of the sequence", path=output, cure=cure)


class _Run:
    """One run over a sequence; ``resolve`` may be called again after the device was lost."""

    def __init__(
        self,
        sequence: FrameSequence,
        files: ResolvedFiles,
        checkpoints: Checkpoints,
        resolvers: Sequence[Resolver],
        effects: Asked,
        stop: Stop,
        layers: tuple[str, ...],
        *,
        half: bool,
        progress: bool,
        denoise: Denoise | None,
    ) -> None:
        self._sequence, self._files, self._checkpoints = sequence, files, checkpoints
        self._resolver, self._resolvers = resolvers[0], resolvers
        self._effects, self._stop, self._layers = effects, stop, layers
        self._half, self._progress, self._denoise = half, progress, denoise
        self._frames = len(sequence)
        self._seconds: dict[str, list[float]] = {name: [] for name in StageTimes.__struct_fields__}

    def resolve(self, compression: str, checkpoint_every: int) -> None:
        """Resolve the frames that are missing, after those that their history needs."""
        missing = self._files.folder.missing(self._sequence, self._resolver.look_ahead)
        if not missing:
            return
        if len(self._resolvers) > 1 and self._gathers:
            self._beside(missing, compression)
            return
        if self._resolver.look_ahead:
            checkpoint_every = 0
        after, given = self._given(missing)
        part = self._sequence.select(given[0], given[-1])
        shown = (lambda numbers: track(numbers, len(numbers), "resolving")) if self._progress else iter
        self._through(self._resolver, part, after, missing, compression, checkpoint_every, shown)

    def _beside(self, missing: list[int], compression: str) -> None:
        """Resolve the ``missing`` frames in as many runs of them as there are resolvers, at the same time.

        Where one fails or the process is interrupted, all end with the frame in work, and the first failure is raised.
        """
        begins = [len(missing) * at // len(self._resolvers) for at in range(len(self._resolvers) + 1)]
        runs = [missing[begin:end] for begin, end in pairwise(begins) if begin < end]
        disk_space = self._disk_space(missing)
        started, done, lock = time.perf_counter(), 0, threading.Lock()
        failures: list[BaseException] = []

        def resolve(resolver: Resolver, wanted: list[int]) -> None:
            own = frozenset(wanted)

            def shown(numbers: list[int]) -> Iterator[int]:
                nonlocal done
                for number in numbers:
                    if failures:
                        return
                    yield number
                    with lock:
                        done += number in own
                        advance(done, len(missing))

            try:
                after, given = self._gathered_from(resolver, wanted)
                part = self._sequence.select(given[0], given[-1])
                self._through(resolver, part, after, wanted, compression, 0, shown, disk_space)
            except BaseException as failure:
                failures.append(failure)

        showing = shown_progress("resolving") if self._progress else nullcontext(lambda _done, _total: None)
        with showing as advance, ThreadPoolExecutor(len(runs), "cltaa job") as pool:
            left = {pool.submit(resolve, *each) for each in zip(self._resolvers, runs, strict=False)}
            while left:  # the folder is owned until no job writes into it
                try:
                    left = wait(left).not_done
                except KeyboardInterrupt as interrupt:
                    failures.append(interrupt)
        if failures:
            raise failures[0]
        self._seconds["whole"] = [(time.perf_counter() - started) / len(missing)]

    def follow(self, arrivals: Arrivals, compression: str, checkpoint_every: int) -> None:
        """Go on with what arrives behind the sequence, and save the state where more may come."""
        shows = self._progress and not arrivals.ended
        shown = shown_progress("following") if shows else nullcontext(lambda _done, _total: None)
        self._progress = False  # of each part
        with shown as advance:
            advance(self._frames, arrivals.count or self._frames + 1)
            for part in arrivals.behind(self._stop):
                before, self._frames = self._sequence.last, self._frames + len(part)
                if self._stands_behind(before):
                    self._through(self._resolver, part, before, [*part.numbers], compression, checkpoint_every, iter)
                    self._sequence = part
                else:  # nothing was missing before
                    self._sequence = arrivals.whole()
                    self.resolve(compression, checkpoint_every)
                advance(self._frames, arrivals.count or self._frames)
        if not arrivals.ended and self._stands_behind(self._sequence.last):
            self._checkpoints.save(self._resolver)
        if self._stop.requested:
            raise KeyboardInterrupt

    def _stands_behind(self, number: int) -> bool:
        """Whether the resolver holds the history that frame ``number`` left."""
        try:
            return self._resolver.recurrent()[0].index == number
        except ValueError:
            return False

    def _through(
        self,
        resolver: Resolver,
        part: FrameSequence,
        after: int | None,
        missing: list[int],
        compression: str,
        checkpoint_every: int,
        shown: Callable[[list[int]], Iterator[int]],
        disk_space: DiskSpace | None = None,
    ) -> None:
        """Resolve ``part``, whose history goes on behind frame ``after``, and write the ``missing`` frames.

        ``shown`` passes numbers of frames on as they are resolved; ``checkpoint_every`` of 0 saves no state.
        """
        numbers, wanted = [n for n in part.numbers if n <= missing[-1]], frozenset(missing)
        disk_space = disk_space or self._disk_space(missing)
        started = time.perf_counter()
        in_turn = isinstance(resolver, BandedResolver)  # so large that no second image waits beside it
        tasks = reads(part, after, self._layers, self._denoise)
        reading = InTurn(tasks) if in_turn else ReadAhead(tasks)
        with Writer(compression=compression) as writer, reading as frames:
            if after is None:
                self._reserve(resolver, part)
            waiting = deque[Read]()
            images = resolver.images(self._read(frames, len(part), waiting), half=self._half, planar=not in_turn)
            for done, (number, image) in enumerate(zip(shown(numbers), images, strict=False), start=1):
                read = waiting.popleft()
                if number in wanted:
                    self._files.write(writer, read, image)
                    disk_space.look(self._files.sizes)
                resolver.release()
                self._note(resolver.times)
                if checkpoint_every and (self._stop.requested or done % checkpoint_every == 0):
                    self._checkpoints.save(resolver)
                if self._stop.requested:
                    raise KeyboardInterrupt
                if in_turn:
                    writer.flush()
                del read, image
            writer.close()
            self._seconds["read"] += frames.seconds
            self._seconds["write"] += writer.seconds
        self._seconds["whole"].append((time.perf_counter() - started) / len(numbers))

    def _given(self, missing: list[int]) -> tuple[int | None, list[int]]:
        """The frame that the resolver goes on after, and those that it has to be given for the ``missing`` ones."""
        if self._resolver.look_ahead:
            return self._gathered_from(self._resolver, missing)
        after = self._checkpoints.restore(self._resolver, before=missing[0])
        if after is None and self._gathers:
            return self._gathered_from(self._resolver, missing)
        return after, [n for n in self._sequence.numbers if n <= missing[-1] and (after is None or n > after)]

    @property
    def _gathers(self) -> bool:
        """True where frames are gathered, and what is declared does not ask for the mean of all before."""
        declared = self._sequence.effects if self._effects == "auto" else None
        declared = self._effects if isinstance(self._effects, frozenset) else declared
        preset = self._resolver.preset
        choices, *_ = estimate(preset, preset.settings, declared)
        return choices.history is HistoryKind.FRAMES

    def _gathered_from(self, resolver: Resolver, missing: list[int]) -> tuple[int | None, list[int]]:
        """The same where no checkpoint is needed: what is gathered are so many frames before and behind each."""
        numbers, ahead = list(self._sequence.numbers), resolver.look_ahead
        first, last = numbers.index(missing[0]), numbers.index(missing[-1])
        resolver.reset()
        begin = max(0, first - resolver.preset.settings.history_frames) if self._gathers else 0
        return numbers[begin - 1] if begin else None, numbers[begin : last + 1 + ahead]

    def _disk_space(self, missing: list[int]) -> DiskSpace:
        return DiskSpace(self._files.folder.folder, len(self._files.sizes) + len(missing))

    def _read(self, frames: Iterator[Read], count: int, waiting: deque[Read]) -> Iterator[Frame]:
        """The next ``count`` of ``frames``, whose results wait in ``waiting``, without pixels where that takes long."""
        for _ in range(count):
            read = next(frames)
            frame = with_effects(read.frame, self._effects)
            waiting.append(read._replace(frame=outline(read.frame)) if self._resolver.look_ahead else read)
            yield frame
            del read, frame

    def _reserve(self, resolver: Resolver, part: FrameSequence) -> None:
        """Let a resolver allocate what the first frame will need, while that is decoded."""
        wanted = isinstance(self._effects, str) or Effect.ALPHA in self._effects
        alpha = wanted and "alpha" in part.holds
        resolver.reserve(part.width, part.height, alpha=alpha, half=self._half)

    def _note(self, times: Times) -> None:
        for name, seconds in times._asdict().items():
            self._seconds[name].append(seconds)

    def report(self) -> ResolveReport:
        """What was done; stages that nothing had to be done in took no time."""
        return ResolveReport(
            output=str(self._files.folder.folder),
            frames=self._frames,
            resolved=self._files.count,
            repaired=sum(each.pixels for each in self._files.missing),
            missing=sorted(self._files.missing, key=lambda each: each.frame),
            opaque=self._files.opaque,
            saturated=self._files.saturated,
            cuts_found=sorted({number for each in self._resolvers for number in each.cuts_found}),
            width=self._sequence.width,
            height=self._sequence.height,
            device=self._resolver.launcher.description,
            preset=self._resolver.preset.name,
            seconds=StageTimes(**{name: median(seconds or [0.0]) for name, seconds in self._seconds.items()}),
        )
