"""What the kernels are told of a frame beside its pixels, and what of a frame the next one needs to know."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from cltaa.cameras import Displacement, displacement, is_still, sky_closeness
from cltaa.frames import Camera, Frame
from cltaa.memory.layout import Layout
from cltaa.parameters.build import FRAME_DTYPE, FRAME_FIELDS, Record
from cltaa.parameters.choices import Choices, CurrentFilter, FilterUse, OnCameraMove, RayThrough
from cltaa.planning.frame_plan import Plan
from cltaa.resolve.current_filter import axis_masses, axis_weights


@dataclass(frozen=True, slots=True)
class Past:
    """What the next frame needs to know of this one, without its pixels."""

    index: int
    camera: Camera
    exposure: float
    shape: tuple[int, ...]
    alpha: bool
    own_motion: bool
    reactive: bool
    jitter_px: tuple[float, float]
    doubled: bool = False  # whether it left a history at 200 %
    marked: bool = False  # whether the counts that it left hold changes of light
    earlier: tuple[Past, ...] = ()  # the frames before it whose samples are kept, the latest first

    @classmethod
    def of(cls, frame: Frame) -> Past:
        """The past that ``frame`` becomes."""
        channels = frame.alpha is not None, frame.motion is not None, frame.reactive is not None
        return cls(frame.index, frame.camera, frame.exposure, frame.colour.shape, *channels, frame.jitter_px)

    def continues_in(self, frame: Frame, choices: Choices) -> bool:
        """Tell whether the history goes on in ``frame``: no cut, no gap, planes and lens of the same kind."""
        if frame.cut or frame.index != self.index + frame.step:
            return False
        same_planes = (frame.colour.shape, frame.alpha is not None) == (self.shape, self.alpha)
        same_kind = frame.camera.orthographic == self.camera.orthographic
        starts_anew = choices.on_camera_move is OnCameraMove.RESET and not is_still(frame.camera, self.camera)
        return same_planes and same_kind and not starts_anew


def frame_record(frame: Frame, previous: Past | None, layout: Layout, plan: Plan | None = None) -> Record:
    """The per-frame struct of the kernels for ``frame``, whose history is that of ``previous`` (None: none).

    Without a ``plan`` the current filter has no weights.
    """
    earlier: Camera = frame.camera if previous is None else previous.camera
    moved: Displacement = displacement(frame.camera, earlier, layout.width, layout.height)
    by_row = zip("xywz", (*moved.rows.tolist(), moved.closeness.tolist()), strict=True)
    origin = frame.jitter_px if plan is None or plan.choices.ray_through is not RayThrough.CENTRE else (0.0, 0.0)
    values: dict[str, float] = {
        "width": layout.width, "height": layout.height, "stride": layout.stride,
        "reset": int(previous is None),
        "number": frame.index % 2**31,
        "origin_x": 0.5 + origin[0] - layout.width / 2.0,
        "origin_y": 0.5 + origin[1] - layout.height / 2.0,
        **{row + column: value for row, values in by_row for column, value in zip("xyq1", values, strict=True)},
        "sky_closeness": sky_closeness(frame.camera),
        "exposure_ratio": 1.0 if previous is None else frame.exposure / previous.exposure,
        "jitter_x": frame.jitter_px[0], "jitter_y": frame.jitter_px[1],
    }  # fmt: skip
    if plan is not None:
        choices = plan.choices
        if previous is None and not frame.cut and choices.filter_use is FilterUse.FEW:
            # A first frame is what was drawn, to the bit. After a cut it is one of a film, and as aliased as that.
            choices = msgspec.structs.replace(choices, current_filter=CurrentFilter.NONE)
        weights = [w for jitter in frame.jitter_px for w in axis_weights(jitter, choices, plan.settings)]
        values |= zip(("left_weight", "right_weight", "above_weight", "below_weight"), weights, strict=True)
        masses = [m for jitter in frame.jitter_px for m in axis_masses(jitter, plan.settings)]
        values |= zip(("left_mass", "right_mass", "upper_mass", "lower_mass"), masses, strict=True)
    # One call for all of them: a frame waits for this.
    return np.array(tuple(values.get(name, 0) for name in FRAME_FIELDS), FRAME_DTYPE)
