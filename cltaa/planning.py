"""The plan: which steps of the resolve a frame calls for, each with its reason.

A sequence that declares its effects promises that nothing else happens in it; one that declares none gets every step
that its channels and cameras call for. A step that is left out would have changed no bit; what a declared stillness or
an absence of highlights *replaces* (plain mean, plain weights) is another estimate, and docs/effects.md bounds it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, NamedTuple

import msgspec

from cltaa.build import Steps
from cltaa.cameras import is_still
from cltaa.frames import Camera, Effect, Frame
from cltaa.params import (
    Choices,
    Dilation,
    ExposureChange,
    HistoryOf,
    LightChange,
    Preset,
    ReactiveMask,
    Rectify,
    Reject,
    Reproject,
    Settings,
    Weighting,
)


class Reason(NamedTuple):
    """One decision of the plan."""

    step: str
    on: bool
    why: str


class Plan(NamedTuple):
    """What is compiled and with which settings, for one frame."""

    choices: Choices
    settings: Settings
    steps: Steps
    reasons: tuple[Reason, ...]


# Steps that are left out without changing a bit: name among ``Steps`` -> word.
STEP_NAMES = {
    "camera_motion": "reprojection", "own_motion": "own motion", "exposure": "exposure", "alpha": "alpha",
    "reactive": "reactive",
}  # fmt: skip
# Steps whose absence is another estimate.
RECTIFICATION, REJECTION, WEIGHTS, GATHERING = "rectification", "rejection", "luminance weights", "gathering"
LIGHT = "change of light"

# Effects that can make a pixel's history wrong.
CHANGING = frozenset({Effect.CAMERA, Effect.MOTION, Effect.UNCOVER, Effect.SHADING, Effect.REACTIVE, Effect.EXPOSURE})


def plan_frame(preset: Preset, frame: Frame, previous: Camera | None, *, every: bool = False) -> Plan:
    """The plan of ``frame`` whose predecessor was seen by ``previous`` (None at the start and after a cut).

    ``every`` adds each step that the preset allows and the frame does not call for: it costs time and changes no bit.
    """
    declared = frame.effects
    if previous is None:
        # There is no history to read; the kernel that the next frame needs will do for this one too.
        camera_moves = declared is None or Effect.CAMERA in declared
    else:
        camera_moves = not is_still(frame.camera, previous)
    steps = _steps(preset, frame, camera_moves, every=every)
    reasons = _every_reason(steps) if every else _reasons(preset, steps, camera_moves, declared)
    choices, settings = preset.choices, preset.settings
    if previous is None:
        # A first frame is what was drawn, to the bit; the blur is for pixels that appear amid others with a past.
        settings = msgspec.structs.replace(settings, fresh_blur=0.0)
    if choices.history_of is HistoryOf.SAMPLES:
        choices, reason = _gathered(choices, declared)
        reasons.append(reason)
    # A published resolve does what it does whether the scene calls for it or not.
    free = not preset.published
    still = nothing_changes(declared)
    if free and still:
        choices, settings = plain_mean(choices, settings)
    elif free and _light_may_change(declared):
        settings = for_changing_light(choices, settings, declared)
    choices, reason = _testing_light(choices, declared, free)
    reasons.append(reason)
    reasons.append(Reason(RECTIFICATION, not (free and still), _why_rectified(free, still)))
    choices, reason = _rejecting(choices, declared, free)
    reasons.append(reason)
    if free and declared is not None and Effect.HDR not in declared:
        choices = msgspec.structs.replace(choices, weighting=Weighting.NONE)
    weighted = choices.weighting is Weighting.LUMINANCE
    reasons.append(Reason(WEIGHTS, weighted, _declared_or_not(Effect.HDR, declared) if free else "as published"))
    return Plan(choices, settings, steps, tuple(reasons))


def nothing_changes(declared: frozenset[Effect] | None) -> bool:
    """True where a sequence promises that every frame shows the same."""
    return declared is not None and not declared & CHANGING


def plain_mean(choices: Choices, settings: Settings) -> tuple[Choices, Settings]:
    """Nothing can make history wrong: the plain mean of all samples is the best estimate there is."""
    choices = msgspec.structs.replace(
        choices, rectify=Rectify.NONE, dilation=Dilation.NONE, reject=Reject.NONE, history_of=HistoryOf.RESULT
    )
    return choices, msgspec.structs.replace(settings, sample_limit=2.0**20)


def for_changing_light(choices: Choices, settings: Settings, declared: frozenset[Effect] | None) -> Settings:
    """Light that changes without motion: where a change is declared and tested for, the test tells of what stands, and
    the box there may be wide; else the box alone tells, and is no wider than the 3x3."""
    tested = declared is not None and choices.light_change is LightChange.TEST
    still = max(settings.gamma_still, settings.changing_gamma) if tested else min(settings.gamma_still, 1.0)
    changed = {"gamma_still": still, "gamma_moving": min(settings.gamma_moving, 1.0)}
    if declared is not None:
        changed["sample_limit"] = min(settings.sample_limit, settings.changing_limit)
        changed["resample_cost"] = max(settings.resample_cost, settings.changing_cost)
    return msgspec.structs.replace(settings, **changed)


def toggled(plan: Plan, preset: Preset, step: str) -> Plan:
    """``plan`` with one of the steps that its reasons name turned on where it is off, and off where it is on."""
    on = next(reason.on for reason in plan.reasons if reason.step == step)
    if step == RECTIFICATION:
        whole = msgspec.structs.replace(preset.choices, weighting=plan.choices.weighting), preset.settings
        choices, settings = plain_mean(plan.choices, plan.settings) if on else whole
        return plan._replace(choices=choices, settings=settings)
    if step == REJECTION:
        reject = Reject.NONE if on else Reject.DEPTH
        return plan._replace(choices=msgspec.structs.replace(plan.choices, reject=reject))
    if step == GATHERING:
        history_of = HistoryOf.RESULT if on else HistoryOf.SAMPLES
        return plan._replace(choices=msgspec.structs.replace(plan.choices, history_of=history_of))
    if step == LIGHT:
        light_change = LightChange.IGNORE if on else LightChange.TEST
        return plan._replace(choices=msgspec.structs.replace(plan.choices, light_change=light_change))
    if step == WEIGHTS:
        weighting = Weighting.NONE if on else Weighting.LUMINANCE
        return plan._replace(choices=msgspec.structs.replace(plan.choices, weighting=weighting))
    field = next(name for name, said in STEP_NAMES.items() if said == step)
    return plan._replace(steps=msgspec.structs.replace(plan.steps, **{field: not on}))


def with_effects(frame: Frame, effects: frozenset[Effect] | Literal["auto", "all"]) -> Frame:
    """``frame`` as it is to be planned: as it declares (``auto``), as if it declared nothing (``all``), or with just
    the effects of a set and the channels that belong to them."""
    if effects == "auto":
        return frame
    if effects == "all":
        return replace(frame, effects=None)
    channels = {Effect.MOTION: "motion", Effect.REACTIVE: "reactive", Effect.ALPHA: "alpha"}
    dropped: dict[str, Any] = {channel: None for effect, channel in channels.items() if effect not in effects}
    return replace(frame, effects=effects, **dropped)


def _why_rectified(free: bool, still: bool) -> str:
    if not free:
        return "as published"
    return "declared still: plain mean of all samples" if still else "something may make history wrong"


def _light_may_change(declared: frozenset[Effect] | None) -> bool:
    return declared is None or bool(declared & {Effect.SHADING, Effect.REACTIVE})


def _testing_light(choices: Choices, declared: frozenset[Effect] | None, free: bool) -> tuple[Choices, Reason]:
    """Where no change of light is declared there is none to test for."""
    if not free or choices.light_change is LightChange.IGNORE:
        return choices, Reason(LIGHT, choices.light_change is LightChange.TEST, "as the preset says")
    if declared is not None and _light_may_change(declared):
        return choices, Reason(LIGHT, True, "effect shading or reactive is declared")
    why = "neither effect shading nor reactive is declared"
    return msgspec.structs.replace(choices, light_change=LightChange.IGNORE), Reason(LIGHT, False, why)


def _gathered(choices: Choices, declared: frozenset[Effect] | None) -> tuple[Choices, Reason]:
    """What gathering samples asks of a sequence: old samples say nothing of light that has changed since."""
    if declared is None:
        return choices, Reason(GATHERING, True, "the sequence declares no effects: the past is held in its box")
    if _light_may_change(declared):
        why = "light changes without motion: the resolved image forgets faster than samples do"
        return msgspec.structs.replace(choices, history_of=HistoryOf.RESULT), Reason(GATHERING, False, why)
    why = "no change of light is declared: samples of the same surface stand"
    return msgspec.structs.replace(choices, rectify=Rectify.NONE), Reason(GATHERING, True, why)


def _rejecting(choices: Choices, declared: frozenset[Effect] | None, free: bool) -> tuple[Choices, Reason]:
    """Depth tells what was uncovered; where nothing is, it has nothing to reject. Samples are chosen by it always."""
    why = _declared_or_not(Effect.UNCOVER, declared) if free else "as published"
    if free and choices.history_of is HistoryOf.SAMPLES:
        why = "which surface a kept sample shows"
    elif free and declared is not None and Effect.UNCOVER not in declared:
        choices = msgspec.structs.replace(choices, reject=Reject.NONE)
    return choices, Reason(REJECTION, choices.reject is not Reject.NONE, why)


def _steps(preset: Preset, frame: Frame, camera_moves: bool, *, every: bool) -> Steps:
    reproject = preset.choices.reproject
    exposure = frame.effects is None or Effect.EXPOSURE in frame.effects
    return Steps(
        camera_motion=(every or camera_moves) and reproject is not Reproject.NONE,
        own_motion=(every or frame.motion is not None) and reproject is Reproject.FULL,
        orthographic=frame.camera.orthographic,
        exposure=(every or exposure) and preset.choices.exposure_change is ExposureChange.FOLLOW,
        alpha=every or frame.alpha is not None,
        reactive=(every or frame.reactive is not None) and preset.choices.reactive_mask is ReactiveMask.USE,
    )


def _every_reason(steps: Steps) -> list[Reason]:
    return [Reason(said, getattr(steps, name), "every step is asked for") for name, said in STEP_NAMES.items()]


def _reasons(preset: Preset, steps: Steps, camera_moves: bool, declared: frozenset[Effect] | None) -> list[Reason]:
    reproject = preset.choices.reproject
    return [
        Reason(
            "reprojection",
            steps.camera_motion,
            _of_preset(reproject, Reproject.CAMERA, Reproject.FULL)
            or ("the camera moves" if camera_moves else "the camera stands"),
        ),
        Reason(
            "own motion",
            steps.own_motion,
            _of_preset(reproject, Reproject.FULL)
            or ("channel backward.u" if steps.own_motion else "no motion channel"),
        ),
        Reason("exposure", steps.exposure, _declared_or_not(Effect.EXPOSURE, declared)),
        Reason("alpha", steps.alpha, "channel A" if steps.alpha else "no alpha channel"),
        Reason("reactive", steps.reactive, "channel reactive" if steps.reactive else "no reactive channel"),
    ]


def _of_preset(reproject: Reproject, *wanted: Reproject) -> str:
    """Why a step of reprojection is off whatever the frame holds; empty where the preset allows it."""
    return "" if reproject in wanted else f"the preset says reproject = {reproject}"


def _declared_or_not(effect: Effect, declared: frozenset[Effect] | None) -> str:
    if declared is None:
        return "the sequence declares no effects, so any may occur"
    return f"effect {effect} is {'declared' if effect in declared else 'not declared'}"
