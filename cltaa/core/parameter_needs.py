"""What a parameter needs of a preset's other parameters to have an effect: a value that nothing reads changes nothing.

Only what no plan can give it is listed: samples that are gathered, for example, may come to a running mean instead, so
whatever accumulates has an effect there too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, get_type_hints

from cltaa.core.parameters import (
    Accumulate,
    AntiFlicker,
    Box,
    Choice,
    Choices,
    CurrentFilter,
    Dilation,
    FilterUse,
    Fireflies,
    HistoryKind,
    Illumination,
    Neighbourhood,
    Rectify,
    Recursion,
    Reject,
    Reproject,
    Settings,
    Tonemap,
    Weighting,
)

_FIELDS: dict[type, str] = {kind: name for name, kind in get_type_hints(Choices).items()}


class Need(NamedTuple):
    """A condition: on which parameters, in words, whether it is met, and what there is instead."""

    fields: tuple[str, ...]
    words: str
    met: Callable[[Choices, Settings], bool]
    found: Callable[[Choices, Settings], str]


def _any_of(*wanted: Choice) -> Need:
    """Return the need of any of these values, of one choice or of several."""
    fields = tuple(dict.fromkeys(_FIELDS[type(value)] for value in wanted))

    def met(choices: Choices, _: Settings) -> bool:
        return any(getattr(choices, _FIELDS[type(value)]) is value for value in wanted)

    def found(choices: Choices, _: Settings) -> str:
        return ", ".join(f"{field} = {getattr(choices, field)}" for field in fields)

    def said(field: str) -> str:
        values = [value for value in wanted if _FIELDS[type(value)] == field]
        others = [value for value in type(values[0]) if value not in values]
        return f"{field} other than {others[0]}" if len(others) == 1 < len(values) else f"{field} = {', '.join(values)}"

    return Need(fields, " or ".join(map(said, fields)), met, found)


def _but(value: Choice) -> tuple[Choice, ...]:
    """Return the other values of a choice."""
    return tuple(other for other in type(value) if other is not value)


_ACCUMULATED = _any_of(HistoryKind.ACCUMULATED)
_ADAPTED = _any_of(Accumulate.ADAPTIVE, Accumulate.CAPPED)
_BOXED = _any_of(*_but(Rectify.NONE), AntiFlicker.CLAMP_DISTANCE)
_BETWEEN = _any_of(*_but(Reproject.NONE))
_DIFFERENCE = _any_of(AntiFlicker.DIFFERENCE)
_FILTERED = _any_of(*_but(CurrentFilter.NONE))
_FIREFLIES = _any_of(Fireflies.CLAMP)
_GATHERED = _any_of(HistoryKind.FRAMES)
_RECTIFIED = _any_of(*_but(Rectify.NONE))
_REJECTED = _any_of(Reject.DEPTH)
_SCALED = _any_of(Box.VARIANCE, Box.BOTH, Box.EXTREMES)
_STANDING = _any_of(Recursion.STANDING)
# A box is given the illumination test where light changes among noise.
_TESTED = _any_of(*_but(Illumination.STATIC), *_but(Rectify.NONE))
_TWO_SCALES = Need(
    ("box_scale_static", "box_scale_moving"),
    "box_scale_static and box_scale_moving that differ",
    lambda _, settings: settings.box_scale_static != settings.box_scale_moving,
    lambda _, settings: f"{settings.box_scale_static:g} for both",
)

# Parameter -> what it needs, all of it.
NEEDS: dict[str, tuple[Need, ...]] = {
    "agreeing_share": (_DIFFERENCE,),
    "behind_t": (_TESTED, _REJECTED),
    "blend_weight": (_any_of(*_but(Accumulate.COUNT)),),
    "box": (_BOXED,),
    "box_floor": (_any_of(Rectify.CLIP, Rectify.ELLIPSOID),),
    "box_leak": (_RECTIFIED,),
    "box_scale_moving": (_BOXED, _SCALED),
    "box_scale_static": (_BOXED, _SCALED),
    "clip_rate": (_ADAPTED, _RECTIFIED),
    "covered_share": (_REJECTED,),
    "depth_tolerance": (_any_of(Reject.DEPTH, *_but(Illumination.STATIC), HistoryKind.FRAMES),),
    "difference_knee": (_DIFFERENCE,),
    "differing_share": (_DIFFERENCE,),
    "disocclusion_t": (_TESTED, _REJECTED),
    "drift_t": (_GATHERED, _TESTED),
    "edge_samples": (_TESTED, _REJECTED),
    "edge_tolerance": (_any_of(Dilation.EDGE, *_but(Illumination.STATIC), HistoryKind.FRAMES),),
    "falling_t": (_TESTED,),
    "filter_falloff": (_any_of(CurrentFilter.GAUSSIAN, Neighbourhood.JITTERED),),
    "filter_samples": (_FILTERED, _any_of(FilterUse.FEW)),
    "filter_use": (_FILTERED,),
    "fireflies": (_ACCUMULATED,),
    "firefly_floor": (_ACCUMULATED, _FIREFLIES),
    "firefly_threshold": (_ACCUMULATED, _FIREFLIES),
    "fit_reach": (_GATHERED,),
    "fit_ridge": (_GATHERED,),
    "history_frames": (_GATHERED,),
    "history_range": (_any_of(*_but(Tonemap.NONE)),),
    "illumination_decay": (_TESTED,),
    "illumination_floor": (_TESTED,),
    "illumination_t": (_TESTED,),
    "largest_t": (_TESTED,),
    "luma_scale": (_BOXED, _any_of(Box.VARIANCE)),
    "luminance_knee": (_any_of(Weighting.LUMINANCE),),
    "motion_px": (
        _BOXED,
        _SCALED,
        _TWO_SCALES,
        Need(
            ("motion_widths",),
            "motion_widths = 0",
            lambda _, its: not its.motion_widths,
            lambda _, its: f"{its.motion_widths:g}",
        ),
    ),
    "motion_rate": (_ADAPTED,),
    "motion_widths": (_BOXED, _SCALED, _TWO_SCALES),
    "moving_weight": (_any_of(Accumulate.ADAPTIVE, Accumulate.CAPPED, Accumulate.STANDING),),
    "off_screen": (_BETWEEN,),
    "passing_t": (_TESTED, _REJECTED),
    "ray_through": (_BETWEEN,),
    "recursion": (_GATHERED, _TESTED),
    "refuted_samples": (_GATHERED, _TESTED, _STANDING, _FILTERED, _any_of(FilterUse.FEW)),
    "resampling_penalty": (_BETWEEN,),
    "sky_below": (
        Need(("sky_at",), "sky_at above 0", lambda _, its: its.sky_at > 0.0, lambda _, its: f"{its.sky_at:g}"),
    ),
    "subpixel_frames": (_GATHERED,),
}


def unmet(key: str, choices: Choices, settings: Settings) -> Iterator[Need]:
    """Yield what ``key`` lacks to have an effect."""
    return (need for need in NEEDS.get(key, ()) if not need.met(choices, settings))
