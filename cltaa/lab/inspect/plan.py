"""The plan of a whole sequence: which steps run on which frames, why, and the cost of each on this device.

Also measures what the plan saves, and proves that it changes time and not the picture (docs/effects.md), by three
resolves: as planned; with every step running, which must give the same bits; and as if nothing were declared (``all``),
with the preset's own means and weights in place of plain ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import msgspec
import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.build import Steps, Storage, ring_steps, window_count
from cltaa.core.parameters import HistoryKind, Illumination
from cltaa.core.plan import JittersBefore, Plan, from_ring_alone, plan_frame, recursive_choices, toggled, with_effects
from cltaa.core.presets import Preset, Published
from cltaa.core.record import Past
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError, check_flags, public
from cltaa.frame import Asked
from cltaa.inputs.fitted_camera import with_fitted_cameras
from cltaa.inputs.found import Found, with_found
from cltaa.inputs.open import check_declared, looked_for, open_input
from cltaa.io.names import Named
from cltaa.io.preset_file import read_preset
from cltaa.io.sequence import FrameSequence
from cltaa.lab.timing import Clock, Samples, measure
from cltaa.pipeline.denoise import denoises, without_noise
from cltaa.pipeline.folder import band_rows_for, find_for, for_denoised, has_bands, of_whole, with_fireflies
from cltaa.pipeline.memory import NO_LAYERS, DevicePlanes, Memory, of_sequence, program_bytes
from cltaa.pipeline.output import carried_kinds, check_layers, chosen_layers
from cltaa.pipeline.run import check_jobs

ROUNDS = 9  # timing rounds, each with one run of every variant
PLANNED, EVERY = "as planned", "every step"
CHANNELS = ("own_motion", "alpha", "reactive")  # steps that read a channel


class Step(msgspec.Struct, kw_only=True):
    """One step on some frames. ``milliseconds`` is the time that it takes, or would take, a frame; None: unknown."""

    name: str
    on: bool
    why: str
    milliseconds: float | None = None


class Section(msgspec.Struct, kw_only=True):
    """Consecutive frames with one plan; ``starts`` if they begin a new history. Times are of one frame's kernels."""

    first: int
    last: int
    starts: bool
    steps: list[Step]
    milliseconds: float | None = None
    every_milliseconds: float | None = None  # with every step of the preset on


class SequencePlan(msgspec.Struct, kw_only=True):
    """The report of ``cltaa inspect --plan``."""

    folder: str
    preset: str
    device: str
    kernels: int  # number of builds of the resolve that the sequence needs
    sections: list[Section]
    memory: Memory
    found: Found | None = None  # the effects, if none are declared


@public("plan")
def plan(
    sequence: FrameSequence | Named,
    preset: str | Preset = "default",
    device: str | int | Launcher | None = None,
    *,
    effects: Asked = "auto",
    rounds: int = ROUNDS,
    storage: Storage = Storage.FLOAT,
    half: bool = False,
    layers: tuple[str, ...] | None = None,
    band_rows: int | None = None,
    denoise: str = "none",
    jobs: int = 1,
) -> SequencePlan:
    """Return which steps of ``preset`` run on which frames of ``sequence``, opened or named, and why.

    Finds undeclared effects in its pixels first, like ``cltaa resolve``. With ``rounds`` it also times each step on
    ``device``, on and off in turn, on two frames of the sequence, unless the preset looks ahead. ``storage``, ``half``,
    ``layers``, ``band_rows``, ``denoise`` and ``jobs`` are those of ``cltaa resolve``; memory depends on them. The time
    and memory of the denoiser itself, and those of films and debug views, are not included. Raises what opening the
    device and reading raise, and UsageError for an unknown layer, and for jobs of a preset that does not gather.
    """
    check_flags(half=half)
    if not isinstance(rounds, int) or rounds < 0:
        raise UsageError("invalid number of rounds", expected="a whole number, 0 for no times", found=repr(rounds))
    denoised = denoises(denoise)
    if not isinstance(preset, Preset):
        preset = read_preset(preset, for_denoised if denoised else None)
    check_jobs(jobs, preset, follow=False, debug=False, dask=False)
    if not isinstance(sequence, FrameSequence):
        sequence = open_input(sequence)
    check_declared(sequence, effects)
    layers = chosen_layers(layers, sequence)
    check_layers(sequence, layers)
    preset = with_fireflies(preset, sequence, None)
    resolver = Resolver(preset, device, storage=storage, every_step=True)
    free = resolver.preset.published is Published.NO  # a transcription runs the same steps on every scene
    if free:
        sequence = with_fitted_cameras(sequence, effects)
    found = find_for(sequence, denoised=denoised) if free and looked_for(sequence, effects) else None
    sequence = with_found(sequence, found)
    program = program_bytes()  # measured before a kernel is built
    sections: list[Section] = []
    plans: list[Plan] = []
    for number, starts, planned in _plans(sequence, resolver.preset, effects, denoised=denoised):
        steps = [Step(name=reason.step, on=reason.on, why=reason.why) for reason in planned.reasons]
        second = bool(plans) and not starts and sections[-1].starts and sections[-1].first == sections[-1].last
        if second and [reason.on for reason in planned.reasons] == [reason.on for reason in plans[-1].reasons]:
            # Same steps as the first frame, with better reasons: whether the camera moved is unknown in a first frame.
            plans[-1], sections[-1].steps = plans[-1]._replace(reasons=planned.reasons), steps
        if plans and planned.reasons == plans[-1].reasons and not starts:
            sections[-1].last = number
            continue
        sections.append(Section(first=number, last=number, starts=starts, steps=steps))
        plans.append(planned)
    if rounds and not resolver.look_ahead:  # steps are timed one frame after another
        timed: dict[tuple[object, ...], Section] = {}
        for section, planned in zip(sections, plans, strict=True):
            key = tuple((step.name, step.on) for step in section.steps)
            if key not in timed and section.last > sequence.first:
                _time(section, planned, sequence, resolver, effects, rounds)
                timed[key] = section
            elif source := timed.get(key):
                section.milliseconds, section.every_milliseconds = source.milliseconds, source.every_milliseconds
                for step, other in zip(section.steps, source.steps, strict=True):
                    step.milliseconds = other.milliseconds
    run = [(choices, each.steps) for each in plans for choices in (each.choices, recursive_choices(each.choices))]
    kernels = len({(choices, steps) for choices, steps in run if choices is not None})
    needed = memory(sequence, resolver, plans, half=half, layers=carried_kinds(sequence, layers), rows=band_rows)
    first = sequence.outline(sequence.first)
    jobs = min(jobs, len(sequence)) if from_ring_alone(preset, with_effects(first, effects)) else 1
    return SequencePlan(
        folder=str(sequence.folder),
        preset=resolver.preset.name,
        device=resolver.launcher.description,
        kernels=kernels,
        sections=sections,
        memory=msgspec.structs.replace(needed, program=program, jobs=jobs),
        found=found,
    )


def memory(
    sequence: FrameSequence,
    resolver: Resolver,
    plans: list[Plan],
    *,
    half: bool = False,
    layers: Mapping[str, str] = NO_LAYERS,
    rows: int | None = None,
) -> Memory:
    """Return the peak memory of a resolve of ``sequence``; ``half`` if it writes halves.

    ``layers`` are as ``of_resolve`` takes them, ``rows`` those of a band (0: whole images; None: as the resolve
    chooses).
    """
    preset, shared = resolver.preset, resolver.launcher.shares_memory
    used = {name: any(getattr(each.steps, name) for each in plans) for name in Steps.__struct_fields__}
    histories = {each.choices.history for each in plans}
    if rows is None:
        whole = of_whole(sequence, resolver, half=half, layers=layers)
        rows = band_rows_for(whole) if has_bands(resolver) else 0
    kept = HistoryKind.FRAMES in histories
    history_frames = preset.settings.history_frames if kept else 0
    windowed = [each.choices for each in plans if kept and each.choices.illumination is Illumination.WINDOW]
    recursion = any(recursive_choices(each.choices) is not None for each in plans)
    changes = recursion or any(
        each.choices.history is HistoryKind.ACCUMULATED and each.choices.illumination is not Illumination.STATIC
        for each in plans
    )
    steps = Steps(**used | ring_steps(history_frames, preset.settings.look_ahead))
    held = DevicePlanes(
        steps,
        resolver.storage,
        band_rows=rows,
        history_frames=history_frames,
        look_ahead=preset.settings.look_ahead,
        windows=max((window_count(each, steps) for each in windowed), default=0),
        recursion=recursion,
        changes=changes,
        shared=shared,
        half=half,
        staged=resolver.launcher.stages,
    )
    return of_sequence(sequence, held, layers)


def _plans(
    sequence: FrameSequence, preset: Preset, effects: Asked, *, denoised: bool
) -> Iterator[tuple[int, bool, Plan]]:
    """Yield number, whether a new history starts, and plan of every frame."""
    past: Past | None = None
    jitters = JittersBefore()
    for number in sequence.numbers:
        frame = with_effects(sequence.outline(number), effects)
        frame = without_noise(frame) if denoised else frame
        if past is not None and not past.continues_in(frame, preset.choices):
            past = None
        camera = None if past is None else past.camera
        before = jitters.of(frame, camera)
        yield number, past is None, plan_frame(preset, frame, camera, every=effects == "all", jitters=before)
        past = Past.of(frame)


def _time(
    section: Section, planned: Plan, sequence: FrameSequence, resolver: Resolver, effects: Asked, rounds: int
) -> None:
    """Time the last frame of ``section`` after the one before it: as planned, each step toggled, with every step."""
    place = max(sequence.numbers.index(section.last), 1)
    before, frame = (with_effects(sequence.frame(n), effects) for n in sequence.numbers[place - 1 : place + 1])
    resolver.reset()
    resolver.resolve(replace(before, cut=True))
    resolver.resolve(replace(frame, cut=False))
    every = resolver.plan
    assert every is not None
    variants = {PLANNED: planned, EVERY: every}
    for step in section.steps:
        variant = toggled(planned, resolver.preset, step.name)
        # A channel that the preset never reads has no plane on the device, so its step cannot be timed.
        if all(getattr(every.steps, name) or not getattr(variant.steps, name) for name in CHANNELS):
            variants[step.name] = variant

    def run(variant: Plan) -> Callable[[], None]:
        def once() -> None:
            resolver.plan = variant
            resolver.run_again(frame, before)

        return once

    samples = measure({name: run(variant) for name, variant in variants.items()}, rounds, warm_up=2)
    section.milliseconds = _milliseconds(samples, PLANNED)
    section.every_milliseconds = _milliseconds(samples, EVERY)
    for step in section.steps:
        if step.name not in variants:
            continue
        # The median of the paired differences, so that varying load cancels.
        pairs = samples.seconds(step.name, Clock.WALL) - samples.seconds(PLANNED, Clock.WALL)
        step.milliseconds = float(np.median(-pairs if step.on else pairs)) * 1e3


def _milliseconds(samples: Samples, job: str) -> float:
    return float(np.median(samples.seconds(job, Clock.WALL))) * 1e3
