"""A sequence through the resolver, streaming: frames are read ahead and images written behind while kernels run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from statistics import median
from typing import Any, Literal

from cltaa.errors import DeviceLost, UsageError
from cltaa.exr.layout import check_lossless
from cltaa.files.atomic import check_creatable, owned
from cltaa.files.manifest import REFERENCE
from cltaa.frames import Effect
from cltaa.interrupt import Stop
from cltaa.memory.allocator import kept_memory
from cltaa.pictures.video import check_film, rate_of, write_video
from cltaa.planning.frame_plan import with_effects
from cltaa.progress import track
from cltaa.resolve.bands import BandedResolver
from cltaa.resolve.carried_over import check_layers
from cltaa.resolve.checkpoint import CHECKPOINT_EVERY, Checkpoints
from cltaa.resolve.debug import DebugViews
from cltaa.resolve.outcome import Outcome, StageTimes, write_record
from cltaa.resolve.output import OutputFolder, sequence_settings
from cltaa.resolve.reading import reads
from cltaa.resolve.resolved_files import ResolvedFiles
from cltaa.resolve.resolver import Resolver, Times
from cltaa.resolve.room import Room
from cltaa.resolve.views import View
from cltaa.sequences.frame_numbers import OnBreak
from cltaa.sequences.sources import Sequence, open_images
from cltaa.sequences.streams import InTurn, ReadAhead, Writer


def resolve_sequence(
    sequence: Sequence,
    output: str | Path,
    resolver: Resolver,
    *,
    effects: frozenset[Effect] | Literal["auto", "all"] = "auto",
    half: bool = False,
    compression: str = "zip",
    preview: Path | None = None,
    restart: bool = False,
    checkpoint_every: int = CHECKPOINT_EVERY,
    debug: tuple[View, ...] = (),
    layers: tuple[str, ...] = (),
    progress: bool = True,
    stopping: AbstractContextManager[Stop] | None = None,
) -> Outcome:
    """Resolve every frame of ``sequence`` into ``output``, one EXR a frame under the same names.

    ``effects`` overrides what the sequence declares: ``auto`` keeps it, ``all`` runs every step of the preset whatever
    the frames call for, and a set leaves out the steps and channels of all other effects. ``preview`` is an MP4 of the
    result. A run that was cut short goes on where it stopped, to the same bits. A device that is lost is opened once
    more. Views to ``debug`` become layers of the EXRs, and PNGs in a folder of that name. Channels of the input that
    match one of ``layers`` are kept beside the resolved ones, and its attributes and windows always. Without
    ``progress`` nothing is shown while it runs.

    ``stopping`` is entered for the run and tells when to stop: then the frame in work is finished, the state saved and
    KeyboardInterrupt raised. ``cltaa.interrupt.stop_signals()`` does so for SIGINT and SIGTERM; signals are left alone
    without it.

    Raises UsageError where ``output`` is the sequence's own folder or was begun with other settings (unless
    ``restart``, which begins it anew), OutputError where it cannot be created or another process writes there, and
    what reading, resolving and writing raise; finished frames stay complete.
    """
    output = Path(output)
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
    settings = {**resolver.settings(), **options, "compression": compression, **sequence_settings(sequence)}
    if preview is not None:
        check_film(preview, sequence, output)
        rate = rate_of(sequence.attributes, sequence.sequence_json, sequence.step)
    keeping = kept_memory(images=not isinstance(resolver, BandedResolver))
    every = _every_step(resolver, resolver.every_step or effects == "all")
    with keeping, every, owned(output), stopping or nullcontext(Stop()) as stop:
        if preview is not None:
            check_creatable(preview)  # again, now that the output is there, which may be the film's folder
        folder = OutputFolder(output, settings, preset=resolver.preset.name, restart=restart)
        checkpoints = Checkpoints(output, folder.key)
        if restart:
            checkpoints.clear()
        views = DebugViews(resolver, debug)
        files = ResolvedFiles(folder, resolver, views, undeclared=sequence.undeclared)
        run = _Run(sequence, files, checkpoints, resolver, effects, stop, layers, half=half, progress=progress)
        try:
            run.resolve(compression, checkpoint_every)
        except DeviceLost:
            resolver.reopen()
            run.resolve(compression, checkpoint_every)
        outcome = run.outcome()
        write_record(output, outcome, resolver.preset)
        checkpoints.clear()
    if preview is not None:
        write_video(preview, open_images(output, gaps=OnBreak.RESET).select(sequence.first, sequence.last), rate=rate)
    return outcome


@contextmanager
def _every_step(resolver: Resolver, every: bool) -> Iterator[None]:
    """Let a resolver run every step, or not, until the end of the block."""
    before, resolver.every_step = resolver.every_step, every
    try:
        yield
    finally:
        resolver.every_step = before


def _refuse_place(output: Path, sequence: Sequence) -> None:
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
        sequence: Sequence,
        files: ResolvedFiles,
        checkpoints: Checkpoints,
        resolver: Resolver,
        effects: frozenset[Effect] | Literal["auto", "all"],
        stop: Stop,
        layers: tuple[str, ...],
        *,
        half: bool,
        progress: bool,
    ) -> None:
        self._sequence, self._files, self._checkpoints = sequence, files, checkpoints
        self._resolver, self._effects, self._stop, self._layers = resolver, effects, stop, layers
        self._half, self._progress = half, progress
        self._seconds: dict[str, list[float]] = {name: [] for name in StageTimes.__struct_fields__}

    def resolve(self, compression: str, checkpoint_every: int) -> None:
        """Resolve the frames that are missing, after those that their history needs."""
        missing = self._files.folder.missing(self._sequence)
        if not missing:
            return
        after = self._checkpoints.restore(self._resolver, before=missing[0])
        numbers = [n for n in self._sequence.numbers if (after is None or n > after) and n <= missing[-1]]
        wanted = frozenset(missing)
        part = self._sequence.select(numbers[0], numbers[-1])
        room = Room(self._files.folder.folder, len(self._files.sizes) + len(missing))
        started = time.perf_counter()
        in_turn = isinstance(self._resolver, BandedResolver)  # so large that no second image waits beside it
        tasks = reads(part, after, self._layers)
        reading = InTurn(tasks) if in_turn else ReadAhead(tasks)
        with Writer(compression=compression) as writer, reading as frames:
            if after is None:
                self._reserve(part)
            shown = track(numbers, len(numbers), "resolving") if self._progress else numbers
            for done, number in enumerate(shown, start=1):
                read = next(frames)
                image = self._resolver.resolve(with_effects(read.frame, self._effects), half=self._half)
                if number in wanted:
                    self._files.write(writer, read, image)
                    room.look(self._files.sizes)
                self._resolver.release()
                self._note(self._resolver.times)
                if self._stop.requested or done % checkpoint_every == 0:
                    self._checkpoints.save(self._resolver)
                if self._stop.requested:
                    raise KeyboardInterrupt
                if in_turn:
                    writer.flush()
                del read, image
            writer.close()
            self._seconds["read"] += frames.seconds
            self._seconds["write"] += writer.seconds
        self._seconds["whole"].append((time.perf_counter() - started) / len(numbers))

    def _reserve(self, part: Sequence) -> None:
        """Let the resolver allocate what the first frame will need, while that is decoded."""
        wanted = isinstance(self._effects, str) or Effect.ALPHA in self._effects
        alpha = wanted and "alpha" in part.holds
        self._resolver.reserve(part.width, part.height, alpha=alpha, half=self._half)

    def _note(self, times: Times) -> None:
        for name, seconds in times._asdict().items():
            self._seconds[name].append(seconds)

    def outcome(self) -> Outcome:
        """What was done; stages that nothing had to be done in took no time."""
        return Outcome(
            output=str(self._files.folder.folder),
            frames=len(self._sequence),
            resolved=self._files.count,
            repaired=self._files.repaired,
            opaque=self._files.opaque,
            saturated=self._files.saturated,
            width=self._sequence.width,
            height=self._sequence.height,
            device=self._resolver.launcher.description,
            preset=self._resolver.preset.name,
            seconds=StageTimes(**{name: median(seconds or [0.0]) for name, seconds in self._seconds.items()}),
        )
