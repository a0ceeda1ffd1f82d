"""What a frame brings onto the device: its channels in the planes that the kernels read."""

from __future__ import annotations

import numpy as np

from cltaa.cameras import closeness, closeness_at
from cltaa.frames import Frame
from cltaa.parameters.build import Steps
from cltaa.parameters.choices import Settings
from cltaa.resolve.buffers import Buffers

# What a channel that a frame does not have would hold: no vector, all covered, nothing to distrust.
NOTHING = {"motion": np.nan, "alpha": 1.0, "reactive": 0.0}


def upload(frame: Frame, buffers: Buffers, steps: Steps, settings: Settings) -> None:
    """Bring the channels that ``steps`` read onto the device; those that the frame does not have hold nothing.

    Where the device takes them as they lie in the frame, nobody changes that until the next one is brought.
    """
    layout = buffers.layout
    buffers.bring("current", np.moveaxis(frame.colour, -1, 0))
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
            buffers.bring(name, np.atleast_3d(channel).transpose(2, 0, 1))
        elif wanted:
            buffers.bring(name, np.full((planes_of[name], 1, 1), NOTHING[name], np.float32))
