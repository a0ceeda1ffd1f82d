"""What a declaration replaces by another estimate: plain mean, plain weights, a wider or a narrower box, gathering.

Unlike the steps that ``frame_plan`` leaves out, these change the picture. Each rests on the promise that nothing
happens but what a sequence declares, and docs/effects.md bounds what it may change.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import msgspec

from cltaa.frames import Effect
from cltaa.parameters.choices import Choices, Dilation, HistoryOf, LightChange, Rectify, Reject, Settings, Weighting
from cltaa.parameters.presets import Preset


class Reason(NamedTuple):
    """One decision of the plan."""

    step: str
    on: bool
    why: str


# Steps whose absence is another estimate.
RECTIFICATION, REJECTION, WEIGHTS, GATHERING = "rectification", "rejection", "luminance weights", "gathering"
LIGHT, DOUBLING = "change of light", "history at 200 %"

# Effects that can make a pixel's history wrong.
CHANGING = frozenset({Effect.CAMERA, Effect.MOTION, Effect.UNCOVER, Effect.SHADING, Effect.REACTIVE, Effect.EXPOSURE})


def estimate(
    preset: Preset, settings: Settings, declared: frozenset[Effect] | None
) -> tuple[Choices, Settings, list[Reason]]:
    """The choices of ``preset`` and ``settings`` as the declared effects ask for, with a reason for each decision."""
    choices, reasons = preset.choices, []
    if choices.history_of is HistoryOf.SAMPLES:
        choices, reason = _gathered(choices, declared)
        reasons.append(reason)
    if choices.history_of is HistoryOf.DOUBLED:
        choices, reason = _doubled(choices, declared)
        reasons.append(reason)
    # A published resolve does what it does whether the scene calls for it or not.
    free = not preset.published
    still = nothing_changes(declared)
    if free and still:
        choices, settings = plain_mean(choices, settings)
    elif free and _light_may_change(declared):
        settings = for_changing_light(choices, settings, declared)
    choices, reason = _testing_light(preset, choices, declared)
    reasons.append(reason)
    rectified = choices.rectify is not Rectify.NONE
    reasons.append(Reason(RECTIFICATION, rectified, _why_rectified(preset, rectified, free and still)))
    choices, reason = _rejecting(preset, choices, declared)
    reasons.append(reason)
    if free and declared is not None and Effect.HDR not in declared:
        choices = msgspec.structs.replace(choices, weighting=Weighting.NONE)
    weighted = choices.weighting is Weighting.LUMINANCE
    why = declined(preset, "weighting", Weighting.LUMINANCE)
    why = why or (declared_or_not(Effect.HDR, declared) if free else "as published")
    reasons.append(Reason(WEIGHTS, weighted, why))
    return choices, settings, reasons


def declined(preset: Preset, field: str, *wanted: StrEnum) -> str:
    """Why a step is off whatever the frame holds: a choice of the preset; empty where that is one of ``wanted``."""
    choice = getattr(preset.choices, field)
    return "" if choice in wanted else f"the preset says {field} = {choice}"


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
    tested = declared is not None and choices.light_change is not LightChange.IGNORE
    still = max(settings.gamma_still, settings.changing_gamma) if tested else min(settings.gamma_still, 1.0)
    changed = {"gamma_still": still, "gamma_moving": min(settings.gamma_moving, 1.0)}
    if declared is not None:
        changed["resample_cost"] = max(settings.resample_cost, settings.changing_cost)
    return msgspec.structs.replace(settings, **changed)


def _why_rectified(preset: Preset, rectified: bool, still: bool) -> str:
    if rectified:
        return "as published" if preset.published else "something may make history wrong"
    if preset.choices.rectify is Rectify.NONE:
        return "the preset says rectify = none"
    return "declared still: plain mean of all samples" if still else "kept samples are chosen, not moved into a box"


def _light_may_change(declared: frozenset[Effect] | None) -> bool:
    return declared is None or bool(declared & {Effect.SHADING, Effect.REACTIVE})


def _testing_light(preset: Preset, choices: Choices, declared: frozenset[Effect] | None) -> tuple[Choices, Reason]:
    """Where no change of light is declared there is none to test for."""
    if why := declined(preset, "light_change", LightChange.TEST, LightChange.SPANS):
        return choices, Reason(LIGHT, False, why)
    if preset.published:
        return choices, Reason(LIGHT, True, "as published")
    if declared is not None and _light_may_change(declared):
        return choices, Reason(LIGHT, True, "effect shading or reactive is declared")
    why = "neither effect shading nor reactive is declared"
    return msgspec.structs.replace(choices, light_change=LightChange.IGNORE), Reason(LIGHT, False, why)


def _gathered(choices: Choices, declared: frozenset[Effect] | None) -> tuple[Choices, Reason]:
    """What gathering samples asks of a sequence: old samples say nothing of light that has changed since, so that
    several spans of the past have to be told apart, or the resolved image has to do, which forgets faster."""
    if declared is None:
        return choices, Reason(GATHERING, True, "the sequence declares no effects: the past is held in its box")
    if _light_may_change(declared) and choices.light_change is not LightChange.SPANS:
        why = "light changes without motion: the resolved image forgets faster than samples do"
        return msgspec.structs.replace(choices, history_of=HistoryOf.RESULT), Reason(GATHERING, False, why)
    if _light_may_change(declared):
        why = "light changes without motion: each pixel from the span of the past that its latest samples bear out"
        return msgspec.structs.replace(choices, rectify=Rectify.NONE), Reason(GATHERING, True, why)
    why = "no change of light is declared: samples of the same surface stand"
    return msgspec.structs.replace(choices, rectify=Rectify.NONE), Reason(GATHERING, True, why)


def _doubled(choices: Choices, declared: frozenset[Effect] | None) -> tuple[Choices, Reason]:
    """What a history at 200 % asks of a sequence: it holds more samples of one place, and so forgets more slowly."""
    if nothing_changes(declared):
        why = "declared still: plain mean of all samples"
    elif declared is not None and _light_may_change(declared):
        why = "light changes without motion: a history at 100 % forgets faster"
    else:
        return choices, Reason(DOUBLING, True, "what moves is read between texels of half the size")
    return msgspec.structs.replace(choices, history_of=HistoryOf.RESULT), Reason(DOUBLING, False, why)


def _rejecting(preset: Preset, choices: Choices, declared: frozenset[Effect] | None) -> tuple[Choices, Reason]:
    """Depth tells what was uncovered; where nothing is, it has nothing to reject. Samples are chosen by it always."""
    free = not preset.published
    why = declared_or_not(Effect.UNCOVER, declared) if free else "as published"
    if not_wanted := declined(preset, "reject", Reject.DEPTH):
        why = not_wanted
    elif free and choices.history_of is HistoryOf.SAMPLES:
        why = "which surface a kept sample shows"
    elif free and declared is not None and Effect.UNCOVER not in declared:
        choices = msgspec.structs.replace(choices, reject=Reject.NONE)
    return choices, Reason(REJECTION, choices.reject is not Reject.NONE, why)


def declared_or_not(effect: Effect, declared: frozenset[Effect] | None) -> str:
    """Why a step that belongs to one effect runs, or does not."""
    if declared is None:
        return "the sequence declares no effects, so any may occur"
    return f"effect {effect} is {'declared' if effect in declared else 'not declared'}"
