"""What the resolve remembers of earlier frames, and what it makes of that (parameters, see ``params.py``)."""

from __future__ import annotations

from enum import StrEnum


class HistoryOf(StrEnum):
    """What is remembered of earlier frames."""

    RESULT = "result"  # their resolved image: any number of frames in one
    SAMPLES = "samples"  # the samples of the last frames_kept frames, as they were drawn


class GatherFit(StrEnum):
    """What the gathered samples of a pixel are taken for (history_of samples)."""

    MEAN = "mean"  # as many draws of one value
    PLANE = "plane"  # points of a plane over the pixel, whose value at the centre is taken
    LAYERS = "layers"  # the same, and across a depth edge a nearer surface and a farther one, each on its own way
