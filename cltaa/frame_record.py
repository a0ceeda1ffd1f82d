"""What the kernels are told of a frame beside its pixels, and what of a frame the next one needs to know."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from cltaa.build import FRAME_DTYPE, Record
from cltaa.cameras import Displacement, displacement, is_still, sky_closeness
from cltaa.current_filter import axis_masses, axis_weights
from cltaa.frames import Camera, Frame
from cltaa.layout import Layout
from cltaa.params import Choices, CurrentFilter, FilterUse, OnCameraMove, RayThrough
from cltaa.planning import Plan


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
    record = np.zeros((), FRAME_DTYPE)
    record["width"], record["height"], record["stride"] = layout.width, layout.height, layout.stride
    record["reset"] = int(previous is None)
    record["number"] = frame.index % 2**31
    record["origin_x"] = 0.5 + frame.jitter_px[0] - layout.width / 2.0
    record["origin_y"] = 0.5 + frame.jitter_px[1] - layout.height / 2.0
    for row, letter in enumerate("xyw"):
        for column, by in enumerate("xyq1"):
            record[letter + by] = moved.rows[row, column]
    for column, by in enumerate("xyq1"):
        record["z" + by] = moved.closeness[column]
    record["jitter_x"], record["jitter_y"] = frame.jitter_px
    record["sky_closeness"] = sky_closeness(frame.camera)
    record["exposure_ratio"] = 1.0 if previous is None else frame.exposure / previous.exposure
    if plan is not None:
        if plan.choices.ray_through is RayThrough.CENTRE:
            record["origin_x"], record["origin_y"] = 0.5 - layout.width / 2.0, 0.5 - layout.height / 2.0
        choices = plan.choices
        if previous is None and not frame.cut and choices.filter_use is FilterUse.FEW:
            # A first frame is what was drawn, to the bit. After a cut it is one of a film, and as aliased as that.
            choices = msgspec.structs.replace(choices, current_filter=CurrentFilter.NONE)
        axes = (axis_weights(jitter, choices, plan.settings) for jitter in frame.jitter_px)
        (record["left_weight"], record["right_weight"]), (record["above_weight"], record["below_weight"]) = axes
        masses = (axis_masses(jitter, plan.settings) for jitter in frame.jitter_px)
        (record["left_mass"], record["right_mass"]), (record["upper_mass"], record["lower_mass"]) = masses
    return record
