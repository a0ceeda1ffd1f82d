"""The frame record: what the kernels receive of a frame besides its pixels, and what the next frame needs of it.

The latter also decides whether the history continues.
"""

from __future__ import annotations

from math import exp

import msgspec
import numpy as np

from cltaa.camera import displacement_rows, is_still, sky_inverse_depth
from cltaa.core.build import FRAME_DTYPE, Record
from cltaa.core.cuts import Coarse
from cltaa.core.parameters import Choices, CurrentFilter, Neighbourhood, OnCameraMove, RayThrough, Settings
from cltaa.core.plan import Plan
from cltaa.core.planes import Layout
from cltaa.errors import UsageError
from cltaa.frame import Camera, Frame


def axis_weights(jitter: float, choices: Choices, settings: Settings) -> tuple[float, float]:
    """Return the weights along one axis of the samples before and after a pixel's own, where samples lie ``jitter``
    pixels after their pixels' centres; its own makes the sum 1."""
    if choices.current_filter is CurrentFilter.NONE:
        return 0.0, 0.0
    kind = choices.current_filter
    before, after = _value(abs(jitter - 1.0), kind, settings), _value(abs(jitter + 1.0), kind, settings)
    total = before + _value(abs(jitter), kind, settings) + after
    return before / total, after / total


def _value(d: float, kind: CurrentFilter, settings: Settings) -> float:
    """Return the value of the kernel at distance ``d`` in pixels."""
    if kind is CurrentFilter.BILINEAR:
        return max(0.0, 1.0 - d)
    if kind is CurrentFilter.GAUSSIAN:
        return exp(-settings.filter_falloff * d * d)
    # Lanczos-2 as a polynomial: (d^2 - 1) (d^2 - 4)^3 / 64, within 0.05 of the windowed sinc.
    return (d * d - 1.0) * (d * d - 4.0) ** 3 / 64.0 if d < 2.0 else 0.0


class Past(msgspec.Struct, frozen=True):
    """What the next frame needs of this one, without its pixels."""

    index: int
    camera: Camera
    exposure: float
    shape: tuple[int, ...]
    alpha: bool
    own_motion: bool
    reactive: bool
    jitter_px: tuple[float, float]
    depth: bool = True  # whether a depth was given, and a camera
    has_camera: bool = True
    holds_changes: bool = False  # whether its counts hold illumination changes
    coarse: Coarse = ()  # for finding a cut, where none is declared
    earlier: tuple[Past, ...] = ()  # the previous frames whose samples are kept, the latest first
    jitters: tuple[tuple[int, tuple[float, float]], ...] = ()  # in a checkpoint: those known, by frame (JittersBefore)
    slot: int = 0  # its place in the ring, where it is kept there
    only_kept: bool = False  # in the ring, so that no history holds it
    held: int = 1  # frames of its history that its camera saw, itself included

    @classmethod
    def of(cls, frame: Frame, coarse: Coarse = (), previous: Past | None = None, *, only_kept: bool = False) -> Past:
        """Return the past that ``frame``, whose history continues ``previous``, becomes."""
        channels = frame.alpha is not None, frame.motion is not None, frame.reactive is not None
        there = frame.has_depth, frame.has_camera
        facts = frame.index, frame.camera, frame.exposure, frame.colour.shape, *channels, frame.jitter_px, *there
        return cls(*facts, coarse=coarse, only_kept=only_kept, held=frames_held(frame, previous))

    def refuse_again(self, frame: Frame) -> None:
        """Raise UsageError where ``frame`` has this number again and is no cut."""
        if frame.index == self.index and not frame.cut:
            cure = f"number frames one after the other, {frame.step} apart; before another sequence call reset()"
            raise UsageError(f"index is {frame.index} twice in a row, so no history could go on", cure=cure)

    def continues_in(self, frame: Frame, choices: Choices) -> bool:
        """True where the history continues in ``frame``: no cut, no gap, the same size and inputs, the same kind of
        projection, no reset by a camera move."""
        if frame.cut or frame.index != self.index + frame.step:
            return False
        same_planes = (frame.colour.shape, frame.alpha is not None) == (self.shape, self.alpha)
        same_given = (frame.has_depth, frame.has_camera) == (self.depth, self.has_camera)
        same_kind = same_given and frame.camera.orthographic == self.camera.orthographic
        starts_anew = choices.on_camera_move is OnCameraMove.RESET and not is_still(frame.camera, self.camera)
        return same_planes and same_kind and not starts_anew


def frames_held(frame: Frame, previous: Past | None) -> int:
    """Return the number of frames in the history of ``frame``, which continues ``previous``, that its camera saw."""
    return 1 if previous is None or not is_still(frame.camera, previous.camera) else previous.held + 1


def _box_weights(jitter_px: tuple[float, float], plan: Plan | None) -> tuple[float, ...]:
    """Return weights exp(-falloff d^2) of the columns and rows beside the pixel's own over its, for a jittered box."""
    if plan is None or plan.choices.neighbourhood is not Neighbourhood.JITTERED:
        return (0.0,) * 4
    falloff = plan.settings.filter_falloff
    return tuple(exp(-falloff * (1.0 + side * 2.0 * jitter)) for jitter in jitter_px for side in (-1, 1))


def frame_record(frame: Frame, previous: Past | None, layout: Layout, plan: Plan | None = None) -> Record:
    """Return the kernels' per-frame struct; without a ``plan`` the current filter has no weights."""
    earlier: Camera = frame.camera if previous is None else previous.camera
    moved = displacement_rows(frame.camera, earlier, layout.width, layout.height)
    across, down = frame.jitter_px
    x, y = (across, down) if plan is None or plan.choices.ray_through is not RayThrough.CENTRE else (0.0, 0.0)
    ratio = 1.0 if previous is None else frame.exposure / previous.exposure
    weights: tuple[float, ...] = (0.0,) * 4
    if plan is not None:
        weights = (*axis_weights(across, plan.choices, plan.settings), *axis_weights(down, plan.choices, plan.settings))
    # In the order of FRAME_FIELDS, and in one call: this is on the frame's critical path, and names take a third of it.
    values = (
        layout.width,
        layout.height,
        layout.stride,
        0,
        0,
        int(previous is None),
        frame.index % 2**31,
        0.5 + x - layout.width / 2.0,
        0.5 + y - layout.height / 2.0,
        *moved[0],
        *moved[1],
        *moved[2],
        *moved[3],
        sky_inverse_depth(frame.camera),
        ratio,
        across,
        down,
        0,
        0,
        *weights,
        *_box_weights(frame.jitter_px, plan),
        int(frame.motion is not None),
        int(not is_still(frame.camera, earlier)),
    )
    return np.array(values, FRAME_DTYPE)
