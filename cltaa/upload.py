"""What a frame brings onto the device: its channels in the planes that the kernels read."""

from __future__ import annotations

import numpy as np

from cltaa.buffers import Buffers, fill
from cltaa.build import Steps
from cltaa.cameras import closeness, closeness_at
from cltaa.constants import PAD_X, PAD_Y
from cltaa.errors import DataError
from cltaa.frames import Frame
from cltaa.layout import Layout
from cltaa.settings import Settings

# Kernels count the texels of a plane in 32 bits, and steps from one to another in 31.
MOST_TEXELS = 2**31 - 1
# What a channel that a frame does not have would hold: no vector, all covered, nothing to distrust.
NOTHING = {"motion": np.nan, "alpha": 1.0, "reactive": 0.0}


def upload(frame: Frame, buffers: Buffers, steps: Steps, settings: Settings) -> None:
    """Bring the channels that ``steps`` read onto the device; those that the frame does not have hold nothing."""
    layout = buffers.layout
    fill(buffers.current, layout, np.moveaxis(frame.colour, -1, 0))
    with buffers.closeness.mapped(write=True) as planes:
        inside = layout.inside(planes)[0]
        closeness(frame.depth, frame.camera, out=inside)
        if settings.sky_at > 0.0 and not frame.camera.orthographic:
            sky = inside <= closeness_at(settings.sky_below, frame.camera)
            inside[sky] = closeness_at(settings.sky_at, frame.camera)
        layout.extend_edges(planes)
    planes_of = {"motion": 2, "alpha": 1, "reactive": 1}
    for name, wanted in (("motion", steps.own_motion), ("alpha", steps.alpha), ("reactive", steps.reactive)):
        channel = getattr(frame, name)
        if channel is not None:
            fill(buffers.optional(name, planes_of[name]), layout, np.atleast_3d(channel).transpose(2, 0, 1))
        elif wanted:
            nothing = np.full((planes_of[name], 1, 1), NOTHING[name], np.float32)
            fill(buffers.optional(name, planes_of[name]), layout, nothing)


def check_shapes(frame: Frame) -> None:
    """Raise DataError where a channel holds no floats, channels differ in size, or a plane is too large to count."""
    _check_numbers(frame)
    size = (*frame.colour.shape[:2], 1, 1)[:2]  # of fewer axes too, to say that the shape is wrong
    if Layout(size[1], size[0]).plane > MOST_TEXELS:
        raise DataError(
            "the image is too large",
            path=frame.path,
            frame=frame.index,
            expected=f"at most {MOST_TEXELS} texels, the halo of {PAD_X} columns and {PAD_Y} rows a side included",
            found=f"{size[1]} x {size[0]}",
            cure="resolve it in parts",
        )
    expected = {"colour": (*size, 3), "depth": size, "motion": (*size, 2), "alpha": size, "reactive": size}
    for name, shape in expected.items():
        array = getattr(frame, name)
        if array is not None and (array.shape != shape or 0 in shape):
            raise DataError(
                f"{name} has the wrong shape",
                path=frame.path,
                frame=frame.index,
                expected=shape if 0 not in shape else "at least one pixel",
                found=array.shape,
                cure="all channels of a frame share one size",
            )


def _check_numbers(frame: Frame) -> None:
    for name in ("colour", "depth", *NOTHING):
        array: object = getattr(frame, name)
        if array is None and name in NOTHING:
            continue
        if not isinstance(array, np.ndarray) or array.dtype.kind != "f":
            raise DataError(
                f"{name} is no array of floats",
                path=frame.path,
                frame=frame.index,
                expected="float32",
                found=array.dtype if isinstance(array, np.ndarray) else type(array).__name__,
                cure="bytes of a picture are no linear light: decode them first" if name == "colour" else None,
            )
