"""Choices of the resolve: how pictures are read between their texels."""

from __future__ import annotations

from cltaa.parameters.named_choice import Choice


class HistoryFilter(Choice):
    """How the history is read between its texels."""

    NEAREST = "nearest"
    BILINEAR = "bilinear"
    CATMULL_ROM = "catmull-rom", "4x4 texels"
    CATMULL_ROM_9 = "catmull-rom-9", "the same, regrouped into nine reads between texels"
    CATMULL_ROM_5 = "catmull-rom-5", "those nine without the four in the corners"
    LANCZOS_3 = "lanczos-3", "6x6 texels"


class CurrentFilter(Choice):
    """How the sample at the pixel's centre is rebuilt from the jittered samples of its 3x3."""

    NONE = "none", "the pixel's own sample stands for the pixel"
    BILINEAR = "bilinear", "read between the samples, as a texture unit would at the unjittered place"
    GAUSSIAN = "gaussian", "exp(-filter_falloff d^2), d in pixels from the centre"
    LANCZOS = "lanczos", "windowed sinc of radius 2, its ringing held inside the extremes of the 3x3"


class FilterUse(Choice):
    """Where the current filter stands for the pixel's own sample."""

    ALWAYS = "always"
    FEW = "few-samples", "the less, the more samples there are: its share goes as 1 / n, of a history later as 1 / n^2"
