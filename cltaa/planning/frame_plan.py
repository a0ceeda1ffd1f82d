"""The plan: which steps of the resolve a frame calls for, each with its reason.

A sequence that declares its effects promises that nothing else happens in it; one that declares none gets every step
that its channels and cameras call for. A step that is left out would have changed no bit; what a declared stillness or
an absence of highlights *replaces* (plain mean, plain weights) is another estimate, and docs/effects.md bounds it.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import Any, Literal, NamedTuple

import msgspec

from cltaa.cameras import is_still
from cltaa.frames import Camera, Effect, Frame
from cltaa.parameters.build import Steps
from cltaa.parameters.choices import (
    Choices,
    ExposureChange,
    HistoryOf,
    LightChange,
    ReactiveMask,
    Reject,
    Reproject,
    Settings,
    Weighting,
)
from cltaa.parameters.presets import Preset
from cltaa.planning.estimates import (
    DOUBLING,
    GATHERING,
    LIGHT,
    RECTIFICATION,
    REJECTION,
    WEIGHTS,
    Reason,
    declared_or_not,
    declined,
    estimate,
    plain_mean,
)


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
# The choices without one of which a preset does not have such a step: name among ``Steps`` -> field, values.
WANTED: dict[str, tuple[Any, ...]] = {
    "camera_motion": ("reproject", Reproject.CAMERA, Reproject.FULL), "own_motion": ("reproject", Reproject.FULL),
    "exposure": ("exposure_change", ExposureChange.FOLLOW), "reactive": ("reactive_mask", ReactiveMask.USE),
}  # fmt: skip
# Those that are one choice: step -> field among ``Choices``, its value where the step does not run, and where it does.
CHOICE_OF_STEP: dict[str, tuple[str, StrEnum, StrEnum]] = {
    REJECTION: ("reject", Reject.NONE, Reject.DEPTH),
    GATHERING: ("history_of", HistoryOf.RESULT, HistoryOf.SAMPLES),
    DOUBLING: ("history_of", HistoryOf.RESULT, HistoryOf.DOUBLED),
    LIGHT: ("light_change", LightChange.IGNORE, LightChange.TEST),
    WEIGHTS: ("weighting", Weighting.NONE, Weighting.LUMINANCE),
}


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
    reasons = _reasons(preset, steps, camera_moves, declared, every=every)
    settings = preset.settings
    if previous is None:
        # The blur is for pixels that appear amid others with a past.
        settings = msgspec.structs.replace(settings, fresh_blur=0.0)
    choices, settings, estimated = estimate(preset, settings, declared)
    return Plan(choices, settings, steps, (*reasons, *estimated))


def recursive(preset: Preset) -> Preset:
    """The recursive resolve that runs beside the spans of ``preset``: its own choices, with a history of results."""
    choices = msgspec.structs.replace(preset.choices, history_of=HistoryOf.RESULT, light_change=LightChange.TEST)
    return msgspec.structs.replace(preset, choices=choices)


def toggled(plan: Plan, preset: Preset, step: str) -> Plan:
    """``plan`` with one of the steps that its reasons name turned on where it is off, and off where it is on."""
    on = next(reason.on for reason in plan.reasons if reason.step == step)
    if step == RECTIFICATION:
        whole = msgspec.structs.replace(preset.choices, weighting=plan.choices.weighting), preset.settings
        choices, settings = plain_mean(plan.choices, plan.settings) if on else whole
        return plan._replace(choices=choices, settings=settings)
    if step in CHOICE_OF_STEP:
        field, off, runs = CHOICE_OF_STEP[step]
        if (own := getattr(preset.choices, field)) is not off:
            runs = own
        return plan._replace(choices=msgspec.structs.replace(plan.choices, **{field: off if on else runs}))
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


def channel_steps(preset: Preset, *, motion: bool, alpha: bool, reactive: bool, every: bool) -> Steps:
    """The steps that read channels of a frame that has these, as far as ``preset`` lets them run; else as ``Steps``."""
    return Steps(
        own_motion=(every or motion) and preset.choices.reproject is Reproject.FULL,
        alpha=every or alpha,
        reactive=(every or reactive) and preset.choices.reactive_mask is ReactiveMask.USE,
    )


def _steps(preset: Preset, frame: Frame, camera_moves: bool, *, every: bool) -> Steps:
    has = {name: getattr(frame, name) is not None for name in ("motion", "alpha", "reactive")}
    exposure = frame.effects is None or Effect.EXPOSURE in frame.effects
    return msgspec.structs.replace(
        channel_steps(preset, **has, every=every),
        camera_motion=(every or camera_moves) and preset.choices.reproject is not Reproject.NONE,
        orthographic=frame.camera.orthographic,
        exposure=(every or exposure) and preset.choices.exposure_change is ExposureChange.FOLLOW,
    )


def _reasons(
    preset: Preset, steps: Steps, camera_moves: bool, declared: frozenset[Effect] | None, *, every: bool
) -> list[Reason]:
    called_for = {
        "camera_motion": "the camera moves" if camera_moves else "the camera stands",
        "own_motion": "channel backward.u" if steps.own_motion else "no motion channel",
        "exposure": declared_or_not(Effect.EXPOSURE, declared),
        "alpha": "channel A" if steps.alpha else "no alpha channel",
        "reactive": "channel reactive" if steps.reactive else "no reactive channel",
    }
    reasons = []
    for name, said in STEP_NAMES.items():
        why = declined(preset, *WANTED[name]) if name in WANTED else ""
        why = why or ("every step is asked for" if every else called_for[name])
        reasons.append(Reason(said, getattr(steps, name), why))
    return reasons
