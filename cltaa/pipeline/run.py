"""One run of a resolve: the frames that are missing, in order, in parts side by side or on workers, and its report.

``cltaa.pipeline.part`` resolves each part.
"""

from __future__ import annotations

import json
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from numbers import Integral
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np

from cltaa.core.bands import BandedResolver
from cltaa.core.debug import View
from cltaa.core.parameters import HistoryKind
from cltaa.core.planes import BLOCK_POOL
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DeviceLost, UsageError, public
from cltaa.frame import Asked
from cltaa.inputs.found import Found
from cltaa.io.atomic import atomic_path, check_creatable, move_into, owned, temporary_folder
from cltaa.io.exr_layout import check_lossless
from cltaa.io.manifest import REFERENCE
from cltaa.io.names import SUFFIXES, Selection, has_suffix, real_path
from cltaa.io.numbered import OnBreak
from cltaa.io.pixel_statistics import Meaningless, Missing
from cltaa.io.sequence import FrameSequence, ImageSequence, open_images
from cltaa.io.video import check_film, rate_of, write_pairs, write_video
from cltaa.pipeline.checkpoint import CHECKPOINT_EVERY, Checkpoints
from cltaa.pipeline.debug import DebugViews
from cltaa.pipeline.denoise import denoiser
from cltaa.pipeline.follow import Arrivals
from cltaa.pipeline.lineage import Lineage
from cltaa.pipeline.output import OutputFolder, ResolvedFiles, Written, check_layers, sequence_settings
from cltaa.pipeline.part import How, Parts, from_ring_alone, gathered_from, in_parts, lineage_of
from cltaa.printable import bytes_of, counted, printable, shell_word
from cltaa.process import Stop
from cltaa.progress import shown_progress, track

CHECKED_AFTER = 2  # files; frames of one sequence differ little


class DiskSpace:
    """Checks once whether ``count`` results fit into ``folder``; an estimate, so it warns and refuses nothing."""

    def __init__(self, folder: Path, count: int) -> None:
        """Store the arguments; the check waits for results."""
        self._folder, self._count, self._looked = folder, count, False

    def look(self, sizes: Sequence[int]) -> None:
        """Warn on standard error if the remaining files, of the mean size of the finished ones, will not fit."""
        finished = len(sizes)
        if self._looked or finished < CHECKED_AFTER:
            return
        self._looked = True
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:  # the folder is gone: writing the next file reports that
            return
        left = self._count - finished
        wanted = left * sum(sizes) / finished
        if wanted > free:
            frames = f"{counted(left, 'frame')} left will take about {bytes_of(wanted)}, {bytes_of(free)} are free"
            cure = "free some space; a run that ends for want of it goes on by the same command"
            print(f"cltaa: warning: {printable(self._folder)}: {frames}: {cure}", file=sys.stderr)


class StageTimes(msgspec.Struct, kw_only=True):
    """Seconds per frame: the median of each stage, and ``whole``, the mean elapsed time.

    Stages overlap, so that the whole of many frames is less than their sum; it includes work outside the stages, such
    as building kernels and drawing debug views, which dominates where few frames are resolved.
    """

    read: float
    upload: float
    kernels: float
    read_back: float
    write: float
    whole: float


class ResolveReport(msgspec.Struct, kw_only=True):
    """What a run of ``resolve_sequence`` did: of ``frames``, it wrote ``resolved``, and earlier runs the others.

    ``repaired`` counts the pixels of those whose colour was no usable number (NaN, infinite, beyond 2^50), ``missing``
    says which frame lacks how many of them and where, ``meaningless`` which has depths or vectors that say nothing,
    ``opaque`` counts the frames whose alpha is 1 everywhere,
    ``saturated`` the pixels at the largest half, where halves are written or stored as history. ``cuts_found`` are
    frames that begin another shot, undeclared but found; ``found`` are the effects where none are declared, and why.
    """

    output: str
    frames: int
    resolved: int
    repaired: int
    missing: list[Missing]
    meaningless: list[Meaningless] = []
    opaque: int
    saturated: int
    cuts_found: list[int]
    found: Found | None = None
    width: int
    height: int
    device: str
    preset: str
    seconds: StageTimes


RECORD = "resolve.json"


def write_record(folder: Path, report: ResolveReport, preset: Preset) -> None:
    """Write ``resolve.json``, which says what made the images. Raises OutputError and StorageError."""
    record: dict[str, Any] = {"outcome": msgspec.to_builtins(report), "preset": msgspec.to_builtins(preset)}
    with atomic_path(folder / RECORD) as temporary:
        temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def stage_rows(seconds: StageTimes) -> Iterable[tuple[str, float]]:
    """Return name and milliseconds per frame of each stage, for a table."""
    return ((field.replace("_", " "), getattr(seconds, field) * 1e3) for field in StageTimes.__struct_fields__)


def check_jobs(jobs: int, preset: Preset, *, follow: bool, debug: bool, dask: bool) -> None:
    """Raise UsageError where so many parts of a sequence cannot be resolved at once, here or by workers of ``dask``."""
    if not isinstance(jobs, Integral) or jobs < 1:
        raise UsageError("invalid number of parts", expected="a whole number, 1 or more", found=repr(jobs))
    if jobs == 1 and not dask:
        return
    parted = "--dask" if dask else "--jobs"
    if preset.choices.history is not HistoryKind.FRAMES:
        cure = f"leave out {parted}, or take a preset that gathers, as gather-8"
        raise UsageError(f"{parted}: preset {preset.name} resolves each frame from the result before it", cure=cure)
    for given, option in ((follow, "--follow"), (debug, "--debug")):
        if given:
            what = f"{parted} does not resolve frames in order, which {option} needs"
            raise UsageError(what, cure="give one of the two")


class Order(NamedTuple):
    """What a worker elsewhere needs to resolve a part of a sequence, apart from what creates its resolver."""

    sequence: FrameSequence  # the wanted frames and those around them that they need
    wanted: list[int]
    how: How
    settings: dict[str, Any]  # required of its resolver
    output: Path
    place: Path  # a folder in it, for folders of results
    stale: dict[str, str]  # SHA-256 of results to replace, by their names


class Result(msgspec.Struct, frozen=True):
    """A result that a worker has written into a ``folder`` of the place, and the cuts that it has found so far."""

    folder: str
    written: Written
    cuts: list[int]


class Elsewhere(Protocol):
    """Workers in other processes that resolve up to ``parts`` parts at the same time."""

    parts: int

    def resolve(self, orders: list[Order], stop: Stop, seconds: dict[str, list[float]]) -> Iterator[Result]:
        """Yield each result as it is written, some perhaps twice; adds to ``seconds`` the time of each frame in each
        stage.

        Raises KeyboardInterrupt once ``stop`` is requested, and the errors of resolving.
        """


COMPARISONS = ("side", "wipe")  # of a film


@public("resolve")
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
    elsewhere: Elsewhere | None = None,
) -> ResolveReport:
    """Resolve every frame of ``sequence`` into ``output``, one EXR per frame under the same names.

    ``effects`` overrides what the sequence declares: ``auto`` keeps it, or what was found where it declares nothing,
    ``find`` takes only what was found, ``all`` assumes nothing, so that ``cltaa.resolve`` runs every step of the
    preset, and a set omits the steps and channels of all other effects. ``preview`` is an MP4 of the result;
    ``compare`` shows the input beside it (``side``) or under a line that sweeps over it (``wipe``). An interrupted run
    resumes where it stopped, to the same bits. A lost device is opened once more. ``debug`` views become layers of the
    EXRs, and PNGs in a folder of that name. Channels of the input that match one of ``layers`` are kept beside the
    resolved ones, and its attributes and windows always. ``denoise`` is ``none``, or ``oidn`` for Intel's Open Image
    Denoise on each frame's colour before the resolve. Without ``progress`` nothing is shown during the run.

    ``stopping`` is entered for the run and says when to stop: then the current frame is finished, the state saved and
    KeyboardInterrupt raised. ``cltaa.process.stop_signals()`` does so for SIGINT and SIGTERM; without it signals are
    left alone. Frames of ``arrivals``, whose first are ``sequence``, are resolved as they come. Each of ``others``,
    which equal ``resolver`` and gather, resolves a part of the sequence at the same time. With workers ``elsewhere``,
    ``resolver`` only describes theirs. ``found`` is the evidence for the effects of ``sequence``, for the report.

    Raises UsageError where ``output`` is a folder with files of the sequence or was begun with other settings (unless
    ``restart``, which begins it anew), OutputError where it cannot be created or another process writes there, and the
    errors of reading, resolving and writing; finished frames stay complete.
    """
    follows, dask = arrivals is not None, elsewhere is not None
    check_jobs(1 + len(others), resolver.preset, follow=follows, debug=bool(debug), dask=dask)
    if not isinstance(preview, str | Path | None):
        raise UsageError("a film must be an MP4", expected="its name", found=repr(preview))
    output, preview = Path(output), None if preview is None else Path(preview)
    if compare not in (None, *COMPARISONS):
        raise UsageError("no such comparison", expected=", ".join(COMPARISONS), found=compare)
    if compare is not None and preview is None:
        raise UsageError(f"comparison {compare} needs a film", cure="name it: preview")
    if not isinstance(checkpoint_every, Integral) or checkpoint_every < 1:
        raise UsageError("invalid checkpoint interval", expected="1 or more", found=repr(checkpoint_every))
    refuse_place(output, sequence)
    check_lossless(compression)
    check_layers(sequence, layers)
    options: dict[str, Any] = {"effects": effects if isinstance(effects, str) else sorted(effects), "half": half}
    if debug:
        if isinstance(resolver, BandedResolver):
            raise UsageError("--debug shows whole images only", cure="use --band-rows 0 or smaller frames")
        options["debug"] = sorted(debug)
    if layers:
        options["layers"] = list(layers)
    if denoiser(denoise) is not None:
        options["denoise"] = denoise
    how = How(effects=effects, half=half, compression=compression, layers=layers, denoise=denoise)
    if resolver.look_ahead:
        options["last_frame"] = sequence.last  # in a longer sequence, frames before it would have more ahead
    settings = {**resolver.settings(), **options, "compression": compression, **sequence_settings(sequence)}
    if preview is not None:
        check_film(preview, sequence, output, beside=compare == "side")
        rate = rate_of(sequence.attributes, sequence.sequence_json, sequence.step)
    pool = nullcontext() if isinstance(resolver, BandedResolver) else BLOCK_POOL
    resolvers = [resolver, *others]
    with pool, owned(output), stopping or nullcontext(Stop()) as stop:
        if preview is not None:
            check_creatable(preview)  # again: the output folder now exists, and may be the film's
        folder = OutputFolder(output, settings, preset=resolver.preset.name, restart=restart)
        checkpoints = Checkpoints(output, folder.key)
        if restart:
            checkpoints.clear()
        views = DebugViews(resolver, debug, len(sequence))
        files = ResolvedFiles(folder, resolver, views, undeclared=sequence.undeclared)
        run = _Run(sequence, folder, files, checkpoints, resolvers, how, stop, elsewhere, progress)
        run.once_more(lambda: run.resolve(checkpoint_every))
        if arrivals is not None:
            run.follow(arrivals, checkpoint_every)
        report = msgspec.structs.replace(run.report(), found=found)
        write_record(output, report, resolver.preset)
        if arrivals is None or arrivals.ended:
            checkpoints.clear()
    if preview is not None:
        of_results = {output / sequence.path(number).name: number for number in sequence.numbers}
        results = Selection(output, tuple(of_results), tuple(map(str, of_results)), of_results)
        _write_film(preview, sequence, open_images(results, gaps=OnBreak.RESET), compare, rate)
    return report


def _write_film(
    path: Path, sequence: FrameSequence, results: ImageSequence, compare: str | None, rate: Fraction
) -> None:
    """Write a film of the results alone, or beside their input."""
    if compare is None:
        write_video(path, results, rate=rate)
        return
    frames = (sequence.frame(number).colour for number in results.numbers)
    before = (np.nan_to_num(colour, posinf=0.0, neginf=0.0) for colour in frames)
    write_pairs(path, before, results, labels=("input", "resolved"), rate=rate, swept=compare == "wipe")


def refuse_place(output: str | Path, sequence: FrameSequence) -> None:
    """Raise UsageError for a folder with a file of the sequence or in the place of its reference, and for none."""
    if not isinstance(output, str | Path) or output == "":
        raise UsageError("no folder for the results is named", found=repr(output))
    output = Path(output)
    if has_suffix(output, *SUFFIXES) and not output.is_dir():
        what, cure = (
            "results go into a folder, under the names of their inputs",
            f"name it alone: {shell_word(output.parent)}",
        )
        raise UsageError(what, path=output, cure=cure)
    cure, place, folder = "name another folder with -o", real_path(output), real_path(sequence.folder)
    links = {path for path in sequence.files if path.is_symlink()}
    parents = {path.parent for path in sequence.files}
    if place in {folder, *map(real_path, parents), *(real_path(path).parent for path in links)}:
        raise UsageError("the output would overwrite the sequence", path=output, cure=cure)
    if place.parent == folder and REFERENCE.fullmatch(place.name):
        raise UsageError("the output would be taken for the truth of the sequence", path=output, cure=cure)


@dataclass(eq=False)
class _Run:
    """One run over a sequence; ``resolve`` may be called again after the device was lost."""

    sequence: FrameSequence
    folder: OutputFolder
    files: ResolvedFiles
    checkpoints: Checkpoints
    resolvers: Sequence[Resolver]
    how: How
    stop: Stop
    elsewhere: Elsewhere | None
    progress: bool

    def __post_init__(self) -> None:
        """Begin without frames."""
        self.parts, self.frames, self.cuts = Parts(self.files, self.how, self.stop), len(self.sequence), set[int]()
        self.resolver = self.resolvers[0]
        self.reopened = False  # after a loss of the device
        self.lineage = self._lineage()  # of the frames that the resolver holds

    def resolve(self, checkpoint_every: int) -> None:
        """Resolve the frames that are missing, after those that their history needs."""
        missing = self.folder.missing(self.sequence, self._lineage(), shown=self.progress)
        if not missing:
            return
        self.parts.look = DiskSpace(self.folder.folder, len(self.files.sizes) + len(missing)).look
        if (len(self.resolvers) > 1 or self.elsewhere) and not self._splits and self.progress:
            what = f"each result of preset {self.resolver.preset.name} holds all frames before it here"
            print(f"cltaa: resolved in one part: {what}; plan: cltaa inspect --plan", file=sys.stderr)
        if self.elsewhere is not None:
            self._by_workers(self.elsewhere, missing)
            return
        if len(self.resolvers) > 1 and self._splits:
            self._beside(missing)
            return
        if self.resolver.look_ahead:
            checkpoint_every = 0
        after, part, self.lineage = self._given(missing)
        shown = (lambda numbers: track(numbers, len(numbers), "resolving", shown=True)) if self.progress else iter
        slots, every = self.checkpoints, checkpoint_every
        self.parts.resolve(self.resolver, part, after, self.lineage, missing, shown, slots, every)

    def once_more(self, work: Callable[[], None]) -> None:
        """Do ``work``, and again where that loses the device, which is opened again once in a run."""
        try:
            work()
        except DeviceLost:
            if self.reopened:
                raise
            self.reopened = True
            for each in self.resolvers:
                each.reopen()
            work()

    def _beside(self, missing: list[int]) -> None:
        """Resolve the ``missing`` frames in as many runs of them as there are resolvers, at the same time.

        After a failure or an interrupt all end with their current frame, and the first failure is raised.
        """
        runs = in_parts(missing, len(self.resolvers))
        started, done, lock = time.perf_counter(), 0, threading.Lock()
        failures: list[BaseException] = []
        self.parts.halted.clear()

        def shown(numbers: list[int]) -> Iterator[int]:
            nonlocal done
            for number in numbers:
                yield number
                with lock:
                    done += number in among
                    advance(done, len(missing))

        def resolve(resolver: Resolver, wanted: list[int]) -> None:
            try:
                part = gathered_from(self.sequence, wanted, resolver.preset, self.how)
                self.parts.resolve(resolver, part, None, self._lineage(), wanted, shown)
            except BaseException as failure:
                failures.append(failure)
                self.parts.halted.set()

        among = frozenset(missing)
        showing = shown_progress("resolving", shown=self.progress)
        with showing as advance, ThreadPoolExecutor(len(runs), "cltaa job") as pool:
            left = {pool.submit(resolve, *each) for each in zip(self.resolvers, runs, strict=False)}
            while left:  # the folder is owned until no job writes into it
                try:
                    left = wait(left).not_done
                except KeyboardInterrupt as interrupt:
                    failures.append(interrupt)
                    self.parts.halted.set()
        if failures:
            raise failures[0]
        self.parts.seconds["whole"] = [(time.perf_counter() - started) / len(missing)]

    def _by_workers(self, elsewhere: Elsewhere, missing: list[int]) -> None:
        """Let workers elsewhere resolve the ``missing`` frames, and move each result into the folder as it comes."""
        entries, started, taken = self.folder.manifest.entries, time.perf_counter(), set[int]()
        names = {number: self.sequence.path(number).name for number in missing}
        showing = shown_progress("resolving", shown=self.progress)
        with showing as advance, temporary_folder(self.folder.folder) as place:
            orders = [
                Order(
                    sequence=gathered_from(self.sequence, wanted, self.resolver.preset, self.how),
                    wanted=wanted,
                    how=self.how,
                    settings=self.resolver.settings(),
                    output=self.folder.folder,
                    place=place,
                    stale={name: entries[name].sha256 for n in wanted if (name := names[n]) in entries},
                )
                for wanted in in_parts(missing, elsewhere.parts if self._splits else 1)
            ]
            advance(0, len(missing))
            for result in elsewhere.resolve(orders, self.stop, self.parts.seconds):
                self.cuts.update(result.cuts)
                number = result.written.number
                if number in taken:  # from a part that two workers began
                    continue
                move_into(place / result.folder / result.written.name, self.folder.folder)
                self.files.take(result.written)
                taken.add(number)
                self.parts.look(self.files.sizes)
                advance(len(taken), len(missing))
        self.parts.seconds["whole"] = [(time.perf_counter() - started) / len(missing)]

    def follow(self, arrivals: Arrivals, checkpoint_every: int) -> None:
        """Resolve what arrives after the sequence, and save the state where more may come."""
        shown = shown_progress("following", shown=self.progress and not arrivals.ended)
        self.progress = False  # none for each part
        with shown as advance:
            advance(self.frames, arrivals.count or self.frames + 1)
            for part in arrivals.behind(self.stop):
                before, self.frames = self.sequence.last, self.frames + len(part)
                self.once_more(partial(self._go_on, part, before, arrivals, checkpoint_every))
                advance(self.frames, arrivals.count or self.frames)
        if not arrivals.ended and self._stands_behind(self.sequence.last):
            self.checkpoints.save(self.resolver, self.lineage.digest())
        if self.stop.requested:
            raise KeyboardInterrupt

    def _go_on(self, part: FrameSequence, before: int, arrivals: Arrivals, every: int) -> None:
        """Resolve the next ``part`` of the ``arrivals``, which comes after frame ``before``."""
        if self._stands_behind(before):
            slots, lineage = self.checkpoints, self.lineage
            self.parts.resolve(self.resolver, part, before, lineage, part.numbers, iter, slots, every)
            self.sequence = part
        else:  # no frame was missing, or the device was lost, so the resolver has no history
            self.sequence = arrivals.whole()
            self.resolve(every)

    def _stands_behind(self, number: int) -> bool:
        """True where the resolver holds the history after frame ``number``."""
        try:
            return self.resolver.recurrent()[0].index == number
        except ValueError:
            return False

    def _given(self, missing: list[int]) -> tuple[int | None, FrameSequence, Lineage]:
        """Return the frame after which the resolver continues, the frames that it needs for the ``missing``, and the
        lineage of those before."""
        preset, digests = self.resolver.preset, dict[int, str]()
        before = self.sequence.numbers[: self.sequence.numbers.index(missing[0])]
        for number, lineage in self._lineages(before):
            digests[number] = lineage.digest()
        after = None if preset.settings.look_ahead else self.checkpoints.restore(self.resolver, digests)
        if after is None:
            return None, gathered_from(self.sequence, missing, preset, self.how), self._lineage()
        *_, (_, lineage) = self._lineages([number for number in before if number <= after])
        given = [number for number in self.sequence.numbers if after < number <= missing[-1]]
        return after, self.sequence.select(given[0], given[-1]), lineage

    def _lineages(self, numbers: Iterable[int]) -> Iterator[tuple[int, Lineage]]:
        """Yield each of the first ``numbers`` of the sequence, and the lineage of results up to it."""
        lineage = self._lineage()
        for number in numbers:
            lineage.add(self.folder.inputs[number], self.sequence.outline(number))
            yield number, lineage

    def _lineage(self) -> Lineage:
        """Return a lineage without frames."""
        return lineage_of(self.resolver.preset, self.sequence, self.how)

    @property
    def _splits(self) -> bool:
        return from_ring_alone(self.resolver.preset, self.sequence, self.how)

    def report(self) -> ResolveReport:
        """Return what was done; stages without work took no time."""
        finished = self.files.finished
        missing = [each.missing for each in finished if each.missing]
        cuts = self.cuts.union(*(each.cuts_found for each in self.resolvers))
        seconds = {name: median(self.parts.seconds[name] or [0.0]) for name in StageTimes.__struct_fields__}
        return ResolveReport(
            output=str(self.folder.folder),
            frames=self.frames,
            resolved=len(finished),
            repaired=sum(each.pixels for each in missing),
            missing=missing,
            meaningless=[one for each in finished for one in each.meaningless],
            opaque=sum(each.opaque for each in finished),
            saturated=sum(each.saturated for each in finished),
            cuts_found=sorted(cuts),
            width=self.sequence.width,
            height=self.sequence.height,
            device=self.resolver.launcher.description,
            preset=self.resolver.preset.name,
            seconds=StageTimes(**seconds),
        )
