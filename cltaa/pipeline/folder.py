"""``cltaa resolve``, from a folder of frames to a folder of results: the resolver, the channels, the jobs."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from inspect import signature
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec

from cltaa.core.backend import DEVICE_VARIABLE, Launcher
from cltaa.core.bands import BAND_ROWS, BandedResolver
from cltaa.core.build import Steps, Storage
from cltaa.core.debug import parse_views
from cltaa.core.parameters import HistoryKind, Illumination, Rectify
from cltaa.core.presets import Preset, Published, override
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError, UsageError, check_flags, known, public
from cltaa.frame import Asked, Effect, format_effects
from cltaa.inputs.fitted_camera import fit_cameras, lacks_camera, with_cameras
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.found import Evidence, Found, check_headers, find_effects, with_found
from cltaa.inputs.open import ARGUMENTS, check_declared, looked_for, open_input
from cltaa.io.atomic import check_ownable
from cltaa.io.content import memory_limit
from cltaa.io.exr_frame import MATRICES
from cltaa.io.manifest import Manifest
from cltaa.io.names import Named
from cltaa.io.preset_file import read_preset
from cltaa.io.sequence import FrameSequence
from cltaa.pipeline.denoise import denoiser, denoises, guide_line
from cltaa.pipeline.follow import Arrivals
from cltaa.pipeline.memory import NO_LAYERS, DevicePlanes, Memory, of_sequence
from cltaa.pipeline.output import carried_compression, carried_kinds, chosen_layers
from cltaa.pipeline.run import RECORD, ResolveReport, check_jobs, refuse_place, resolve_sequence
from cltaa.printable import printable
from cltaa.process import give_heap_back
from cltaa.progress import Advance, shown_progress


def band_rows_for(whole: Memory) -> int:
    """Return the rows of a band for a run that takes ``whole`` in whole images; 0 where memory suffices."""
    return BAND_ROWS if whole.whole > memory_limit() else 0


def of_whole(
    sequence: FrameSequence, resolver: Resolver, *, half: bool, layers: Mapping[str, str], jobs: int = 1
) -> Memory:
    """Return the memory of a resolve of ``sequence`` in whole images, with each step that its channels allow."""
    holds, shared = sequence.holds, resolver.launcher.shares_memory
    held = DevicePlanes(
        Steps(own_motion="motion" in holds, alpha="alpha" in holds, reactive="reactive" in holds),
        resolver.storage,
        look_ahead=resolver.look_ahead,
        changes=resolver.preset.choices.illumination is not Illumination.STATIC,
        shared=shared,
        half=half,
        staged=not shared,
    )
    return msgspec.structs.replace(of_sequence(sequence, held, layers), jobs=jobs)


def has_bands(resolver: Resolver) -> bool:
    """True where the device and the preset of ``resolver`` support bands."""
    return resolver.launcher.takes_bands and resolver.preset.choices.history is HistoryKind.ACCUMULATED


def resolver_for(
    preset: Preset,
    device: str | int | Launcher | None,
    sequence: FrameSequence,
    band_rows: int | None = None,
    *,
    storage: Storage = Storage.FLOAT,
    half: bool = False,
    layers: Mapping[str, str] = NO_LAYERS,
    jobs: int = 1,
    **options: Any,
) -> Resolver:
    """Return a resolver for ``sequence``: in bands where whole images take more memory than this machine has.

    ``half`` says that halves will be written, ``layers`` are as for ``of_sequence``, and ``jobs`` resolvers run at the
    same time. ``band_rows`` overrides the choice; 0 means whole images. Raises ResourceError where bands are needed and
    the preset keeps frames, which requires whole images.
    """
    resolver = Resolver(preset, device, storage=storage, **options)  # first: one that shares memory takes less of it
    if band_rows is None:
        whole = of_whole(sequence, resolver, half=half, layers=layers, jobs=jobs)
        band_rows = band_rows_for(whole)
        if band_rows and preset.choices.history is not HistoryKind.ACCUMULATED:
            size = f"{sequence.width} x {sequence.height} pixels are too many for preset {preset.name}"
            what = f"{size}, which keeps frames, so it resolves whole images only"
            expected = f"{whole.whole / 1e6:.0f} MB beside what it keeps"
            found = f"{memory_limit() / 1e6:.0f} MB of memory"
            cure = "take --preset default, which resolves them in bands, or --band-rows 0 to try all the same"
            raise ResourceError(what, expected=expected, found=found, cure="take fewer --jobs" if jobs > 1 else cure)
        if not has_bands(resolver):
            band_rows = 0
    if not band_rows:
        return resolver
    give_heap_back()  # nothing is kept from frame to frame, as ``memory`` counts
    return BandedResolver.beside(resolver, band_rows, storage=storage, **options)


def with_fireflies(preset: Preset, sequence: FrameSequence, asked: str | None) -> Preset:
    """Return ``preset`` with the fireflies ``asked`` for, else those of a profile unless it gathers or transcribes;
    raises UsageError where one that gathers is asked to clamp."""
    gathers = preset.choices.history is not HistoryKind.ACCUMULATED
    if asked is None:
        profile = sequence.intake.profile.colour.fireflies if isinstance(sequence, ForeignSequence) else "keep"
        asked = "keep" if gathers or preset.published is not Published.NO else profile
        return preset if asked == "keep" else override(preset, {"fireflies": asked})
    if gathers and asked == "clamp":
        cure = "take --preset default"
        raise UsageError(f"--fireflies clamp: preset {preset.name} gathers and keeps its fireflies", cure=cure)
    return override(preset, {"fireflies": asked}, "resolve")


# A denoiser leaves fewer aliases and less noise, so less evidence proves a change of light. A running mean of what it
# has filtered needs no filter; gathering has less error with its own. A box keeps light that has changed, so it takes
# the test too (docs/lab-notes/illumination.md, Noise).
DENOISED = {"current_filter": "none", "illumination_t": 1.7, "illumination_decay": 0.55, "falling_t": 1.4}
DENOISED_BOX = {**DENOISED, "illumination": "test"}
DENOISED_RING = {"drift_t": 1.0}


def for_denoised(preset: Preset) -> Preset:
    """Return ``preset`` for frames that a denoiser has filtered already: a transcription as it is."""
    if preset.published is not Published.NO:
        return preset
    if preset.choices.history is HistoryKind.FRAMES:
        return override(preset, DENOISED_RING)
    return override(preset, DENOISED if preset.choices.rectify is Rectify.NONE else DENOISED_BOX)


def find_for(sequence: FrameSequence, *, denoised: bool, advance: Advance | None = None) -> Found:
    """Find the effects of ``sequence``; frames that are denoised first have no noise."""
    found = find_effects(sequence, advance)
    return found.without(Effect.NOISE, "each frame is denoised first") if denoised else found


def guided(sequence: FrameSequence, *, told: bool) -> FrameSequence:
    """Return ``sequence`` with a denoiser's guides among the channels to read; ``told`` prints a line about them."""
    sequence, faults = sequence.with_guides()
    if told:
        print(guide_line(sequence.guides, faults), file=sys.stderr)
    return sequence


READING = ARGUMENTS - {"effects"}  # those of open_input, of which one is also the resolve's
# Arguments of resolve_sequence that a program may give.
OWN = {"sequence", "output", "resolver", "arrivals", "others", "found", "elsewhere"}
RESOLVING = frozenset(signature(resolve_sequence).parameters) - OWN


def how_read(
    source: object, reading: Mapping[str, Any], options: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arguments of opening ``source``, and among the others those of ``resolve_sequence``; raises UsageError
    for a name that neither takes, and for any of the former where ``source`` is open."""
    if not isinstance(reading, Mapping):
        raise UsageError("reading holds arguments of cltaa.open", expected="a dict of them", found=repr(reading))
    told = {**reading, **{name: options[name] for name in READING & options.keys()}}
    rest = {name: value for name, value in options.items() if name not in READING}
    for name in told.keys() - READING:
        raise UsageError(f"reading takes no {name}", cure=known(name, sorted(READING), "arguments"))
    for name in rest.keys() - RESOLVING:
        there = {*READING, *RESOLVING, *signature(resolve_folder).parameters} - {"options"}
        raise UsageError(f"resolve takes no {name}", cure=known(name, sorted(there), "arguments"))
    if told and isinstance(source, FrameSequence):
        raise UsageError("the sequence is open", found=", ".join(told), cure="give those to cltaa.open")
    return told, rest


@public("resolve")
def resolve_folder(
    source: Named | FrameSequence,
    output: str | Path,
    preset: str | Preset = "default",
    device: str | Launcher | None = None,
    *,
    effects: Asked = "auto",
    half: bool = False,
    storage: Storage = Storage.FLOAT,
    strict: bool = False,
    band_rows: int | None = None,
    compression: str | None = None,
    layers: tuple[str, ...] | None = None,
    debug: Iterable[str] = (),
    progress: bool = False,
    follow: bool = False,
    idle: float | None = None,
    fireflies: str | None = None,
    jobs: int | None = None,
    dask: str | None = None,
    reading: Mapping[str, Any] = MappingProxyType({}),
    **options: Any,
) -> ResolveReport:
    """Resolve a folder of frames into ``output``, with the options of ``cltaa resolve``.

    ``follow`` takes a folder that is still being written: each frame as it appears, until the last one of ``frames``,
    until none came for ``idle`` seconds, or until interrupted.

    If the preset gathers, ``jobs`` parts of the sequence are resolved at once, in turn on all devices like the one that
    ``device`` names. With ``dask``, the address of a scheduler, its workers resolve them, as many parts as they have
    threads unless ``jobs`` gives another number; they need the folders under the same paths, and devices that are
    alike. ``profile``, ``side_file``, ``frames`` and the other arguments of ``cltaa.open``, here or in ``reading``, say
    how a ``source`` that is not open yet is read. ``fireflies`` is ``keep`` or ``clamp``; by default the preset or else
    the profile decides. A preset given by name is adapted to what ``denoise`` in ``options`` has filtered;
    a ``Preset`` is not changed. Undeclared effects are found first (``cltaa.inputs.found``),
    except with ``follow``, and for a transcription. ``compression`` and ``layers`` default to those that the command
    keeps. ``options`` are other arguments of ``resolve_sequence``. Raises the errors of that and of opening.
    """
    if idle is not None and not follow:
        raise UsageError("--idle needs --follow", cure="give both, or neither")
    check_flags(half=half, strict=strict, progress=progress, follow=follow, restart=options.get("restart"))
    reading, options = how_read(source, reading, options)
    denoised = denoiser(options.get("denoise", "none")) is not None
    if not isinstance(preset, Preset):
        preset = read_preset(preset, for_denoised if denoised else None)
    views = parse_views(debug, "debug")
    check_jobs(1 if jobs is None else jobs, preset, follow=follow, debug=bool(views), dask=dask is not None)
    arrivals = arrivals_of(source, preset, idle, reading, options) if follow else None
    if arrivals is not None:
        sequence = arrivals.first()
        if progress and sequence.notes:
            print("\n".join(map(printable, sequence.notes)), file=sys.stderr)
    else:
        sequence = source if isinstance(source, FrameSequence) else open_input(source, **reading)
    check_declared(sequence, effects)
    refuse_place(output, sequence)
    if denoised:
        sequence = guided(sequence, told=progress)
    carried = chosen_layers(layers, sequence)
    preset = with_fireflies(preset, sequence, fireflies)
    made: dict[str, Any] = {"strict": strict, "storage": storage, "every_step": effects == "all"}
    how: dict[str, Any] = {
        **options,
        "effects": effects,
        "half": half,
        "compression": carried_compression(sequence) if compression is None else compression,
        "debug": views,
        "layers": carried,
        "progress": progress,
        "arrivals": arrivals,
    }
    with ExitStack() as stack:
        if dask is not None:
            from cltaa.pipeline.cluster import Cluster, Tool, connected  # here: an extra, which imports this module

            if not isinstance(device, str | None):
                raise UsageError("--dask: workers open devices by name", expected="a name", found=repr(device))
            tool = Tool(preset, device, band_rows=band_rows, **made)
            how["elsewhere"] = cluster = Cluster(stack.enter_context(connected(dask)), tool, jobs)
            resolver = tool.elsewhere(cluster.description())
        else:
            jobs = jobs or 1
            kept: dict[str, Any] = {"half": half, "layers": carried_kinds(sequence, carried), "jobs": jobs}
            resolver, *how["others"] = (
                resolver_for(preset, each, sequence, band_rows, **made, **kept) for each in devices_of(device, jobs)
            )
        # Effects are not searched for when following, nor for a transcription, which is the same on every scene; else
        # last, after all other checks: it takes a while.
        adapts, anew = arrivals is None and preset.published is Published.NO, options.get("restart", False)
        if adapts and lacks_camera(sequence, effects):
            sequence = with_known_camera(sequence, Path(output), anew=anew, progress=progress)
        looks = adapts and looked_for(sequence, effects)
        sequence, found = with_known_effects(
            sequence, Path(output), looks=looks, anew=anew, progress=progress, denoised=denoised
        )
        if arrivals is not None:
            arrivals.found = sequence.found
        return resolve_sequence(sequence, output, resolver, found=found, **how)


def with_known_camera(sequence: ForeignSequence, output: Path, *, anew: bool, progress: bool) -> FrameSequence:
    """Return ``sequence`` with a camera fitted to it, for a resolve into ``output``, if it fits most frames.

    A resumed run, which makes the same bits, has a camera if it began with one. Raises DataError for a damaged
    manifest.
    """
    begun = None if anew else Manifest(output)
    settings = begun.settings if begun is not None and begun.entries else None
    if settings is not None and not MATRICES.isdisjoint(settings.get("undeclared", ())):
        return sequence
    check_ownable(output)  # before a user without access waits for an error
    with shown_progress("fitting the camera", shown=progress) as advance:
        fitted = fit_cameras(sequence, advance)
    if progress:
        print(printable(fitted.line), file=sys.stderr)
    return with_cameras(sequence, fitted.cameras) if fitted.fits or settings is not None else sequence


def with_known_effects(
    sequence: FrameSequence, output: Path, *, looks: bool, anew: bool, progress: bool, denoised: bool
) -> tuple[FrameSequence, Found | None]:
    """Return ``sequence`` for a resolve into ``output``, with the effects found in its frames where it ``looks`` for
    them.

    A resumed run takes those that it began with, so that it makes the same bits, even where an unreadable frame was
    mended, or more frames are there now. Raises UsageError where headers show effects that it did not begin with,
    DataError for a damaged manifest, and the errors of finding.
    """
    found, line = None, ""
    begun = None if anew else Manifest(output)
    if begun is not None and begun.settings is not None and begun.entries:
        names = begun.settings.get("found")
        if names is not None:
            found = found_before(output, frozenset(map(Effect, names)))
            if begun.settings.get("sequence") == sequence.name:  # else ``OutputFolder`` refuses another sequence
                check_headers(sequence, found.effects, path=output)
            line = f"effects found: {format_effects(found.effects)} (as the run began)"
    elif looks:
        check_ownable(output)  # before a user without access waits for an error
        with shown_progress("finding effects", shown=progress) as advance:
            found = find_for(sequence, denoised=denoised, advance=advance)
        line = found.line
    if progress and line:
        print(line, file=sys.stderr)
    return with_found(sequence, found), found


def found_before(output: Path, effects: frozenset[Effect]) -> Found:
    """Return the evidence for ``effects`` that the last run into ``output`` recorded; without one, that it had them."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        recorded = msgspec.json.decode((output / RECORD).read_bytes())["outcome"]["found"]
        found = msgspec.convert(recorded, Found)
        if found.effects == effects:
            return found
    why = "the run that is gone on with says so"
    evidence = (Evidence(effect=each, found=each in effects, why=why) for each in Effect)
    return Found(evidence=tuple(evidence), frames=0, seconds=0.0)


def devices_of(device: str | int | Launcher | None, jobs: int) -> list[str | int | Launcher | None]:
    """Return what each of ``jobs`` resolvers opens: in turn all devices like the one that ``device`` names."""
    wish = os.environ.get(DEVICE_VARIABLE, "") if device is None else device
    if jobs == 1 or not isinstance(wish, str) or wish.isdigit() or wish == "numpy":
        return [device] * jobs
    from cltaa.opencl.device import alike

    indices = alike(wish)
    return [indices[at % len(indices)] for at in range(jobs)]


def arrivals_of(
    source: object, preset: Preset, idle: float | None, reading: Mapping[str, Any], options: Mapping[str, Any]
) -> Arrivals:
    """Return the arrivals to follow; raises UsageError for options that need a finished sequence."""
    if not isinstance(source, str | Path):
        raise UsageError("only a folder or a pattern of files can be followed", found=type(source).__name__)
    if idle is not None and not (isinstance(idle, int | float) and idle >= 0):
        raise UsageError("idle is no time to wait", expected="seconds, 0 or more", found=repr(idle))
    if preset.settings.look_ahead:
        cure = "take one that does not, or resolve the finished folder without --follow"
        raise UsageError(f"preset {preset.name} looks ahead, so it cannot follow", cure=cure)
    if options.get("preview") is not None:
        cure = "give the same command with --preview and without --follow when all is there"
        raise UsageError("--preview needs a finished sequence", cure=cure)
    others = dict(reading)
    guided = denoises(options.get("denoise", "none"))
    return Arrivals(source, others.pop("frames", None), idle, others, guided=guided)
