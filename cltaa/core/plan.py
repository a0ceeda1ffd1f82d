"""The plan: the steps of the resolve that a frame needs, each with its reason.

A sequence that declares its effects promises that nothing else happens in it. For one that declares none, the plan
omits the steps for effects that were searched for and not found; without a search, every step runs that the channels
and cameras call for. Omitting a step of ``STEP_NAMES`` changes no bit. Any other omission (gathering, recursion,
rectification, weights, tests) and each threshold that effects decide give *another* estimate: docs/effects.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from enum import StrEnum
from functools import lru_cache
from typing import Any, NamedTuple

import msgspec

from cltaa.camera import is_still
from cltaa.core.build import Steps
from cltaa.core.parameters import (
    Box,
    Choices,
    Dilation,
    ExposureChange,
    HistoryKind,
    Illumination,
    ReactiveMask,
    Rectify,
    Recursion,
    Reject,
    Reproject,
    Settings,
    Weighting,
)
from cltaa.core.presets import Preset
from cltaa.frame import Asked, Camera, Effect, Frame, format_effects

PLANS_KEPT = 64  # most cached plans: a sequence has a few, and each frame waits for its own


class Reason(NamedTuple):
    """One decision of the plan."""

    step: str
    on: bool
    why: str


# Steps whose omission gives another estimate.
RECTIFICATION, REJECTION, WEIGHTS, GATHERING = "rectification", "rejection", "luminance weights", "gathering"
LIGHT = "illumination change"
RECURSION = "recursion beside the ring"
REPROJECTION = "reprojection"

# Effects that can make a pixel's history wrong.
CHANGING = frozenset(
    {Effect.CAMERA, Effect.MOTION, Effect.DISOCCLUSION, Effect.ILLUMINATION, Effect.REACTIVE, Effect.EXPOSURE}
)
# Effects that make history wrong where depth shows the same surface; where the camera moves, THIN does so too.
CHANGING_LIGHT = frozenset({Effect.ILLUMINATION, Effect.MOTION, Effect.REACTIVE})

# Where no illumination change is known, beside a ring: factor of drift_t, and divisor of filter_samples.
SURER, FILTER_LESS = 2.0, 4.0
# Where no change was found that the illumination test looks for: factor of its thresholds.
UNLIKELY = 1.5
# Where no illumination change is known: the most of Student's t that one frame counts for. Less than illumination_t, so
# that a lone frame proves nothing away from occluders.
UNLIKELY_T = 2.5
STATIC_SAMPLES = 4.0  # factor of sample_limit, where all is found static
# filter_samples where nothing moves: the jitter places samples evenly, so a history soon needs no filter. A jitter that
# repeats within FEW_POSITIONS frames leaves gaps, which only the filter fills, at its whole share of 1 / n.
STATIC_FILTER_SAMPLES, FEW_POSITIONS = 1.0, 16
# With noise. Factor of falling_t, because dim samples of noise agree and bright ones do not, and of a box of
# deviations, which noise widens.
NOISY_FALLING, NOISY_BOX = 1.2, 0.5
# With noise where light changes. Aliases of an edge agree, samples of noise do not, so less evidence proves a change:
# factors of parameters of the illumination test (docs/lab-notes/illumination.md, Noise).
NOISY_CHANGE = {"illumination_t": 0.82, "illumination_decay": 11 / 12, "illumination_floor": 11 / 12, "falling_t": 1.12}
NOISY_FILTER = 2.0  # factor of filter_samples beside gathered samples there

FOUND, DECLARED, KNOWN = "found", "declared", "known"


def estimate(
    preset: Preset,
    settings: Settings,
    declared: frozenset[Effect] | None,
    word: str,
    *,
    camera: bool,
    followed: bool,
) -> tuple[Choices, Settings, list[Reason]]:
    """Adapt the choices of ``preset`` and ``settings`` to the effects, with a reason for each decision.

    ``word`` says how the effects are known. Only declared effects are a promise, on which a plain mean may rest. With
    ``camera`` frames have one; with ``followed``, it or vectors tell where surfaces were.
    """
    choices, reasons = preset.choices, []
    # A published resolve omits nothing, whether the scene needs it or not.
    free = not preset.published
    still = word == DECLARED and nothing_changes(declared)
    standing = word != DECLARED and all_static(declared)
    gathers = choices.history is HistoryKind.FRAMES
    # In a shot that stands a ring holds no more than all frames so far, but with frames ahead. Early in a hold it may.
    recursive = free and standing and gathers and not settings.look_ahead and word != KNOWN
    in_turn = free and standing and gathers and not recursive and choices.recursion is Recursion.STANDING
    if free and still:
        choices, settings = plain_mean(choices, settings)
    elif recursive:
        choices = msgspec.structs.replace(choices, history=HistoryKind.ACCUMULATED)
    noisy = free and declared is not None and Effect.NOISE in declared
    changing = noisy and declared is not None and bool(declared & CHANGING_LIGHT)
    choices, reason = _testing_illumination(preset, choices, declared, word, noisy=changing)
    reasons.append(reason)
    tested = (
        choices.illumination is Illumination.TEST and free and word != DECLARED and not _refuting(choices, declared)
    )
    if tested or in_turn:
        settings = found_constant(settings, standing=standing)
    if free and not _illumination_may_change(declared):  # so aliases that agree in a frame are no change of light
        settings = msgspec.structs.replace(settings, largest_t=min(settings.largest_t, UNLIKELY_T))
    if choices.illumination is Illumination.STATIC and _illumination_may_change(declared) and free:
        settings = with_narrow_box(settings)
    if preset.choices.history is HistoryKind.FRAMES:
        reasons.append(_gathered(choices, word, still=still, recursive=recursive, in_turn=in_turn))
        splits = camera or (followed and settings.look_ahead > 0)
        choices, reason = _with_recursion(
            preset, choices, declared, word, splits=splits, followed=followed, in_turn=in_turn
        )
        reasons.append(reason)
        if not _illumination_may_change(declared):
            filtered = max(settings.filter_samples / FILTER_LESS, STATIC_FILTER_SAMPLES)
            settings = msgspec.structs.replace(
                settings, drift_t=SURER * settings.drift_t, filter_samples=filtered, refuted_samples=0.0
            )
    rectified = choices.rectify is not Rectify.NONE
    reasons.append(Reason(RECTIFICATION, rectified, _why_rectified(preset, rectified)))
    choices, reason = _rejecting(preset, choices, declared, word)
    reasons.append(reason)
    if noisy:
        settings = among_noise(choices, settings, changing=changing)
    if noisy or (free and declared is not None and Effect.HDR not in declared):
        choices = msgspec.structs.replace(choices, weighting=Weighting.NONE)
    weighted = choices.weighting is Weighting.LUMINANCE
    why = declined(preset, "weighting", Weighting.LUMINANCE)
    why = why or (declared_or_not(Effect.NOISE if noisy else Effect.HDR, declared, word) if free else "as published")
    reasons.append(Reason(WEIGHTS, weighted, why))
    return choices, settings, reasons


def declined(preset: Preset, field: str, *wanted: StrEnum) -> str:
    """Return which choice of the preset rules a step out; empty where that choice is one of ``wanted``."""
    choice = getattr(preset.choices, field)
    return "" if choice in wanted else f"the preset says {field} = {choice}"


def nothing_changes(declared: frozenset[Effect] | None) -> bool:
    """True where a sequence promises that every frame shows the same."""
    return declared is not None and not declared & CHANGING


def all_static(declared: frozenset[Effect] | None) -> bool:
    """True where neither camera, objects nor light are declared or found to change."""
    return declared is not None and not declared & (CHANGING_LIGHT | {Effect.CAMERA})


def plain_mean(choices: Choices, settings: Settings) -> tuple[Choices, Settings]:
    """Switch to the plain mean of all samples, the best estimate where nothing can make history wrong."""
    choices = msgspec.structs.replace(
        choices, rectify=Rectify.NONE, dilation=Dilation.NONE, reject=Reject.NONE, history=HistoryKind.ACCUMULATED
    )
    return choices, msgspec.structs.replace(settings, sample_limit=2.0**20, filter_samples=STATIC_FILTER_SAMPLES)


def found_constant(settings: Settings, *, standing: bool) -> Settings:
    """Demand more of the illumination test, and where all is ``standing`` limit and filter the history less."""
    thresholds = ("illumination_t", "disocclusion_t", "passing_t", "behind_t")
    asked = {name: UNLIKELY * getattr(settings, name) for name in thresholds}
    if standing:
        asked["sample_limit"] = STATIC_SAMPLES * settings.sample_limit
        asked["filter_samples"] = STATIC_FILTER_SAMPLES
    return msgspec.structs.replace(settings, **asked)


def with_narrow_box(settings: Settings) -> Settings:
    """Limit the box to the 3x3: light may change, and only the box detects that."""
    return msgspec.structs.replace(
        settings,
        box_scale_static=min(settings.box_scale_static, 1.0),
        box_scale_moving=min(settings.box_scale_moving, 1.0),
    )


def among_noise(choices: Choices, settings: Settings, *, changing: bool) -> Settings:
    """Adapt thresholds to noisy samples, so that tests are as sure of bright ones as of dim ones. Where light is
    ``changing``, the test asks for less evidence, and gathered samples are filtered for longer."""
    box = NOISY_BOX if choices.box is Box.VARIANCE else 1.0
    settings = msgspec.structs.replace(
        settings,
        falling_t=NOISY_FALLING * settings.falling_t,
        box_scale_static=box * settings.box_scale_static,
        box_scale_moving=box * settings.box_scale_moving,
    )
    if not changing:
        return settings
    if choices.history is HistoryKind.FRAMES:
        return msgspec.structs.replace(settings, filter_samples=NOISY_FILTER * settings.filter_samples)
    asked = {name: factor * getattr(settings, name) for name, factor in NOISY_CHANGE.items()}
    return msgspec.structs.replace(settings, **asked)


def _why_rectified(preset: Preset, rectified: bool) -> str:
    if rectified:
        return "as published" if preset.published else "the history may be wrong"
    if preset.choices.rectify is Rectify.NONE:
        return "the preset says rectify = none"
    return "declared static: plain mean of all samples"


def _illumination_may_change(declared: frozenset[Effect] | None) -> bool:
    return declared is None or bool(declared & {Effect.ILLUMINATION, Effect.REACTIVE})


def _refuting(choices: Choices, declared: frozenset[Effect] | None) -> frozenset[Effect]:
    """Return the effects that make history wrong where depth shows the same surface.

    Light changes, moving surfaces turn in the light, or a camera moves past sub-pixel features, which a resampled
    history blurs into what is beside them. A camera that moves past solid surfaces, or is still before thin ones, needs
    no test, and gathered samples stay what they were.
    """
    known = frozenset() if declared is None else declared
    resampled = choices.history is HistoryKind.ACCUMULATED
    return known & (CHANGING_LIGHT | {Effect.THIN} if resampled and Effect.CAMERA in known else CHANGING_LIGHT)


def _testing_illumination(
    preset: Preset, choices: Choices, declared: frozenset[Effect] | None, word: str, *, noisy: bool
) -> tuple[Choices, Reason]:
    """Keep the illumination test, unless the effects promise that nothing refutes the history; found ones do not. Where
    light changes among ``noisy`` samples, a box takes the test too, since noise widens it."""
    if noisy and choices.rectify is not Rectify.NONE and choices.illumination is Illumination.STATIC:
        choices = msgspec.structs.replace(choices, illumination=Illumination.TEST)
        return choices, Reason(LIGHT, True, f"effect noise is {word}: a box that it widens keeps wrong history")
    if why := declined(preset, "illumination", Illumination.TEST, Illumination.WINDOW):
        return choices, Reason(LIGHT, False, why)
    if choices.history is HistoryKind.FRAMES:  # windows have a test of their own
        choices = msgspec.structs.replace(choices, illumination=Illumination.WINDOW)
    if preset.published:
        return choices, Reason(LIGHT, True, "as published")
    if declared is None:
        return choices, Reason(LIGHT, True, declared_or_not(Effect.ILLUMINATION, declared, word))
    if found := _refuting(choices, declared):
        why = f"{word}: {format_effects(found)}"
        if choices.history is HistoryKind.ACCUMULATED and not _illumination_may_change(declared):
            why += "; no illumination: only a change that lasts counts"
        return choices, Reason(LIGHT, True, why)
    why = f"none of illumination, motion and reactive is {word}"
    if choices.history is HistoryKind.ACCUMULATED:
        why += ", nor thin with a camera"
    if word != DECLARED and choices.history is HistoryKind.ACCUMULATED:
        choices = msgspec.structs.replace(choices, illumination=Illumination.TEST)
        return choices, Reason(LIGHT, True, f"{why}: only a change that lasts counts")
    return msgspec.structs.replace(choices, illumination=Illumination.STATIC), Reason(LIGHT, False, why)


def _with_recursion(
    preset: Preset,
    choices: Choices,
    declared: frozenset[Effect] | None,
    word: str,
    *,
    splits: bool,
    followed: bool,
    in_turn: bool,
) -> tuple[Choices, Reason]:
    """Drop the recursive resolve beside the ring where a camera moves: no pixel is static, and each result then depends
    on the frames in the ring alone, so that a shot ``splits`` anywhere.

    Vectors alone lead back frame by frame with errors that add up, so recursion then shows more than a ring without
    frames ahead. Where no motion can be ``followed``, every pixel is static, and only recursion shows what motion has
    refuted. It stays where both are taken ``in_turn``.
    """
    if why := declined(preset, "recursion", Recursion.STANDING):
        return choices, Reason(RECURSION, False, why)
    if in_turn:
        return choices, Reason(RECURSION, True, f"{word} static: the result where it holds more frames than the ring")
    if choices.illumination is not Illumination.WINDOW:
        why = "one window of all frames" if choices.history is HistoryKind.FRAMES else "nothing is gathered"
    elif splits and declared is not None and Effect.CAMERA in declared:
        why = f"effect camera is {word}"
    else:
        why = "static pixels have more samples than the ring holds" if followed else "no motion can be followed"
        return choices, Reason(RECURSION, True, why)
    return msgspec.structs.replace(choices, recursion=Recursion.NONE), Reason(RECURSION, False, why)


def recursive_choices(choices: Choices) -> Choices | None:
    """Return the choices of the recursive resolve beside gathered samples; None where there is none."""
    if choices.recursion is Recursion.NONE or choices.history is not HistoryKind.FRAMES:
        return None
    return msgspec.structs.replace(
        choices, history=HistoryKind.ACCUMULATED, illumination=Illumination.TEST, recursion=Recursion.NONE
    )


def _gathered(choices: Choices, word: str, *, still: bool, recursive: bool, in_turn: bool) -> Reason:
    """Return why samples are gathered, or not."""
    if in_turn:
        return Reason(GATHERING, True, f"{word} static: uses all samples where the ring has more than the history")
    if recursive:
        return Reason(GATHERING, False, "found static: a running mean holds as many samples as the ring or more")
    if still:
        return Reason(GATHERING, False, "declared static: plain mean of all samples")
    if choices.illumination is Illumination.WINDOW:
        return Reason(GATHERING, True, "mixes the temporal windows that agree with the latest samples")
    return Reason(GATHERING, True, "constant light: uses all samples of a surface")


def _rejecting(
    preset: Preset, choices: Choices, declared: frozenset[Effect] | None, word: str
) -> tuple[Choices, Reason]:
    """Drop the depth test where nothing is disoccluded; gathering always selects samples by depth."""
    free = not preset.published
    why = declared_or_not(Effect.DISOCCLUSION, declared, word) if free else "as published"
    if not_wanted := declined(preset, "reject", Reject.DEPTH):
        why = not_wanted
    elif free and choices.history is HistoryKind.FRAMES:
        why = "tells which surface a sample of the ring shows"
    elif free and declared is not None and Effect.DISOCCLUSION not in declared:
        choices = msgspec.structs.replace(choices, reject=Reject.NONE)
    return choices, Reason(REJECTION, choices.reject is not Reject.NONE, why)


def declared_or_not(effect: Effect, declared: frozenset[Effect] | None, word: str) -> str:
    """Return why a step that belongs to one effect runs, or not."""
    if declared is None:
        return "the sequence declares no effects, so any may occur"
    return f"effect {effect} is {'' if effect in declared else 'not '}{word}"


class Plan(NamedTuple):
    """Choices, settings and steps of one frame, each decision with its reason."""

    choices: Choices
    settings: Settings
    steps: Steps
    reasons: tuple[Reason, ...]


# Steps whose omission changes no bit: name among ``Steps`` -> word.
STEP_NAMES = {
    "camera_motion": REPROJECTION,
    "own_motion": "own motion",
    "exposure": "exposure",
    "alpha": "alpha",
    "reactive": "reactive",
}
# Choices that a preset needs to have such a step: name among ``Steps`` -> field, any of these values.
WANTED: dict[str, tuple[Any, ...]] = {
    "camera_motion": ("reproject", Reproject.CAMERA, Reproject.FULL),
    "own_motion": ("reproject", Reproject.FULL),
    "exposure": ("exposure_change", ExposureChange.FOLLOW),
    "reactive": ("reactive_mask", ReactiveMask.USE),
}
# Steps that are one choice: step -> field among ``Choices``, its value when off, and when on.
CHOICE_OF_STEP: dict[str, tuple[str, StrEnum, StrEnum]] = {
    REJECTION: ("reject", Reject.NONE, Reject.DEPTH),
    GATHERING: ("history", HistoryKind.ACCUMULATED, HistoryKind.FRAMES),
    RECURSION: ("recursion", Recursion.NONE, Recursion.STANDING),
    LIGHT: ("illumination", Illumination.STATIC, Illumination.TEST),
    WEIGHTS: ("weighting", Weighting.NONE, Weighting.LUMINANCE),
    RECTIFICATION: ("rectify", Rectify.NONE, Rectify.CLAMP),
}


class Facts(NamedTuple):
    """Everything about a frame and its predecessor that decides a plan."""

    motion: bool  # which channels exist
    alpha: bool
    reactive: bool
    depth: bool
    camera: bool
    orthographic: bool
    effects: frozenset[Effect] | None  # as declared, or else as found
    word: str  # which of the two
    first: bool  # at the start and after a cut
    moves: bool  # the camera, since the previous frame
    few_positions: bool  # the jitter has repeated within FEW_POSITIONS frames
    width: int  # pixels


def plan_frame(
    preset: Preset,
    frame: Frame,
    previous: Camera | None,
    *,
    every: bool = False,
    jitters: Iterable[tuple[float, float]] = (),
    only_kept: bool = False,
) -> Plan:
    """Return the plan of ``frame``, whose predecessor has the camera ``previous`` (None at the start and after a cut).

    ``jitters`` are those of previous frames, the latest last, in pixels (``JittersBefore``). ``only_kept`` says that
    the predecessor has no result. ``every`` adds each step that the preset allows and the frame does not need: it costs
    time and changes no bit.
    """
    effects, word = _known(frame.effects, frame.found)
    if not only_kept and is_hold(preset, frame, previous):
        assert effects is not None
        effects, word = effects - {Effect.CAMERA}, KNOWN
    noisy = effects is not None and Effect.NOISE in effects  # a position shows something else every time
    few_positions = not noisy and previous is not None and _repeats(list(jitters), frame.jitter_px)
    facts = Facts(
        frame.motion is not None,
        frame.alpha is not None,
        frame.reactive is not None,
        frame.has_depth,
        frame.has_camera,
        frame.camera.orthographic,
        effects,
        word,
        previous is None,
        previous is not None and not is_still(frame.camera, previous),
        few_positions,
        frame.width,
    )
    return _planned(preset, facts, every)


def _repeats(before: Sequence[tuple[float, float]], now: tuple[float, float]) -> bool:
    """True where the jitter of an earlier frame is that of ``now``, and not of all: then there is none."""
    return now in before and len(set(before)) > 1


class JittersBefore:
    """Jitters of the FEW_POSITIONS previous frames of one history, since the camera moved."""

    def __init__(self) -> None:
        self._of: dict[int, tuple[float, float]] = {}

    def of(self, frame: Frame, previous: Camera | None) -> list[tuple[float, float]]:
        """Return those before ``frame``, whose predecessor has the camera ``previous`` (None where no history goes on);
        then add its own."""
        stands = previous is not None and is_still(frame.camera, previous)
        before = [(index, jitter) for index, jitter in self._of.items() if stands and index < frame.index]
        self._of = dict(before[-FEW_POSITIONS:])
        jitters = list(self._of.values())
        self._of[frame.index] = frame.jitter_px
        return jitters

    def kept(self) -> tuple[tuple[int, tuple[float, float]], ...]:
        """Return the number and the jitter of each frame that is kept."""
        return tuple(self._of.items())

    def restore(self, kept: Iterable[tuple[int, tuple[float, float]]]) -> None:
        """Continue after the frames that were ``kept``."""
        self._of = dict(kept)


def _known(declared: frozenset[Effect] | None, found: frozenset[Effect] | None) -> tuple[frozenset[Effect] | None, str]:
    """Return the effects of a frame, and how they are known."""
    if declared is None and found is not None:
        return frozenset(found), FOUND
    return None if declared is None else frozenset(declared), DECLARED


def is_hold(preset: Preset, frame: Frame, previous: Camera | None) -> bool:
    """True where the camera has not moved since the ``previous`` frame, in a shot in which it is known to move.

    The plan of ``frame``, which may be an outline, is then that of a standing camera, and its result continues the one
    before.
    """
    effects, _ = _known(frame.effects, frame.found)
    choices, moves = preset.choices, effects is not None and Effect.CAMERA in effects and frame.has_camera
    kept = choices.history is HistoryKind.ACCUMULATED or choices.recursion is Recursion.STANDING
    free = kept and not preset.published
    return moves and free and previous is not None and is_still(frame.camera, previous)


def from_ring_alone(preset: Preset, frame: Frame) -> bool:
    """True where results of ``preset`` for frames like ``frame``, which may be an outline, depend on the ring alone,
    but in a hold."""
    followed = frame.has_camera or frame.motion is not None
    choices, *_ = estimate(
        preset, preset.settings, *_known(frame.effects, frame.found), camera=frame.has_camera, followed=followed
    )
    return choices.history is HistoryKind.FRAMES and choices.recursion is Recursion.NONE


@lru_cache(maxsize=PLANS_KEPT)
def _planned(preset: Preset, facts: Facts, every: bool) -> Plan:
    declared, moves = facts.effects, facts.moves
    if facts.first:
        # No history is read, so the kernel that the next frame needs serves this one too.
        moves = facts.camera and (declared is None or Effect.CAMERA in declared)
    steps = _steps(preset, facts, moves, every=every)
    reasons = _reasons(preset, steps, moves, facts, every=every)
    if not facts.camera:
        reasons = [reason._replace(why="no camera") if reason.step == REPROJECTION else reason for reason in reasons]
    elif facts.first and moves:
        why = "no previous frame: the camera may move"
        reasons = [reason._replace(why=why) if reason.step == REPROJECTION else reason for reason in reasons]
    settings = preset.settings
    if settings.motion_widths:
        settings = msgspec.structs.replace(settings, motion_px=settings.motion_widths * facts.width)
    if facts.first and not preset.published:
        # The blur is for pixels without history among others that have one.
        settings = msgspec.structs.replace(settings, disocclusion_blur=0.0)
    followed = facts.camera or facts.motion
    choices, settings, estimated = estimate(
        preset, settings, declared, facts.word, camera=facts.camera, followed=followed
    )
    if not facts.depth:  # all is as far as the sky, and there are no depth edges
        # BESIDE then reads motion beside the pixel itself instead of beside the nearest surface.
        dilation = choices.dilation if choices.dilation is Dilation.BESIDE else Dilation.NONE
        choices = msgspec.structs.replace(choices, reject=Reject.NONE, dilation=dilation)
        estimated = [Reason(REJECTION, False, "no depth") if why.step == REJECTION else why for why in estimated]
    fades_sooner = all_static(declared) and settings.filter_samples < preset.settings.filter_samples
    if fades_sooner and facts.few_positions:
        settings = msgspec.structs.replace(settings, filter_samples=2.0**20)
    if moves and choices.recursion is not Recursion.NONE:
        choices = msgspec.structs.replace(choices, recursion=Recursion.NONE)
        why = "no previous frame" if facts.first else "the camera moves, so no pixel is static"
        alone = Reason(RECURSION, False, why)
        estimated = [alone if reason.step == RECURSION else reason for reason in estimated]
    return Plan(choices, settings, steps, (*reasons, *estimated))


def reads_depth(choices: Choices) -> bool:
    """True where any step reads depth: to reproject, to reject, to find depth edges, or from the ring."""
    never = Reproject.NONE, Reject.NONE, Dilation.NONE, HistoryKind.ACCUMULATED
    return (choices.reproject, choices.reject, choices.dilation, choices.history) != never


def toggled(plan: Plan, preset: Preset, step: str) -> Plan:
    """Return ``plan`` with one of the steps that its reasons name turned off where it is on, and on where it is off."""
    on = next(reason.on for reason in plan.reasons if reason.step == step)
    if step in CHOICE_OF_STEP:
        field, off, runs = CHOICE_OF_STEP[step]
        if (own := getattr(preset.choices, field)) is not off:
            runs = own
        return plan._replace(choices=msgspec.structs.replace(plan.choices, **{field: off if on else runs}))
    field = next(name for name, said in STEP_NAMES.items() if said == step)
    return plan._replace(steps=msgspec.structs.replace(plan.steps, **{field: not on}))


def with_effects(frame: Frame, effects: Asked) -> Frame:
    """Return ``frame`` for planning: as declared or else found (``auto``), as found (``find``), with nothing known
    (``all``), or with just the effects of a set and the channels that belong to them."""
    if effects == "auto":
        return frame
    if effects in ("all", "find"):
        return replace(frame, effects=None, found=frame.found if effects == "find" else None)
    assert not isinstance(effects, str)
    channels = {Effect.MOTION: "motion", Effect.REACTIVE: "reactive", Effect.ALPHA: "alpha"}
    dropped: dict[str, Any] = {channel: None for effect, channel in channels.items() if effect not in effects}
    return replace(frame, effects=effects, **dropped)


def channel_steps(preset: Preset, *, motion: bool, alpha: bool, reactive: bool, every: bool) -> Steps:
    """Return the steps that read these channels, as far as ``preset`` allows them; the others as ``Steps`` has them."""
    return Steps(
        own_motion=(every or motion) and preset.choices.reproject is Reproject.FULL,
        alpha=every or alpha,
        reactive=(every or reactive) and preset.choices.reactive_mask is ReactiveMask.USE,
    )


def _steps(preset: Preset, facts: Facts, moves: bool, *, every: bool) -> Steps:
    exposure = facts.effects is None or Effect.EXPOSURE in facts.effects
    return msgspec.structs.replace(
        channel_steps(preset, motion=facts.motion, alpha=facts.alpha, reactive=facts.reactive, every=every),
        camera_motion=(every or moves) and preset.choices.reproject is not Reproject.NONE,
        orthographic=facts.orthographic,
        exposure=(every or exposure) and preset.choices.exposure_change is ExposureChange.FOLLOW,
    )


def _reasons(preset: Preset, steps: Steps, camera_moves: bool, facts: Facts, *, every: bool) -> list[Reason]:
    called_for = {
        "camera_motion": "the camera moves" if camera_moves else "the camera stands still",
        "own_motion": "channel backward.u" if steps.own_motion else "no motion channel",
        "exposure": declared_or_not(Effect.EXPOSURE, facts.effects, facts.word),
        "alpha": "channel A" if steps.alpha else "no alpha channel",
        "reactive": "channel reactive" if steps.reactive else "no reactive channel",
    }
    reasons = []
    for name, said in STEP_NAMES.items():
        why = declined(preset, *WANTED[name]) if name in WANTED else ""
        why = why or ("every step was requested" if every else called_for[name])
        reasons.append(Reason(said, getattr(steps, name), why))
    return reasons
