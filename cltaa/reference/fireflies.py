"""Twin of ``taa/fireflies.h``: isolated samples far brighter than their neighbours and their history."""

from __future__ import annotations

import numpy as np

from cltaa.core.build import Record
from cltaa.core.parameters import Fireflies
from cltaa.reference.accumulate import Pixel
from cltaa.reference.colour import Colour, repaired_planes, to_range
from cltaa.reference.history import History
from cltaa.reference.real import NEIGHBOURS, Array, Run, greater, lesser, neighbour


def luminance_4(v: Colour) -> Array:
    """Four times the luminance."""
    return (v[0] + v[2]) + 2.0 * v[1]


def clamp_firefly(v: Colour, reference: Array, h: History, settings: Record) -> Colour:
    """Replace samples of more than ``firefly_threshold`` times the luminance ``reference`` (4 Y): by the history, or
    without it by themselves dimmed to that luminance."""
    y = luminance_4(v)
    is_firefly = y > settings["firefly_threshold"] * reference
    return np.where(is_firefly & h.valid, h.rgb, v * np.where(is_firefly, reference / y, 1.0))


def without_firefly(p: Pixel, current: Array, h: History, run: Run) -> Pixel:
    """Remove fireflies: samples far above both the second greatest of the eight texels around them and their history,
    filtered samples far above the third of the nine; ``current`` are padded planes [3, rows, stride]."""
    if run.choices.fireflies is Fireflies.KEEP:
        return p
    first = second = third = np.zeros_like(h.count)
    y = luminance_4(to_range(repaired_planes(current, run.layout).astype(first.dtype), run.build))
    for step in (step for step in NEIGHBOURS if any(step)):
        there = neighbour(y, *step, run.layout)
        third = greater(third, lesser(second, there))
        second = greater(second, lesser(first, there))
        first = greater(first, there)
    past = np.where(h.valid, luminance_4(h.rgb), 0.0)
    least = greater(past, 4.0 * run.settings["firefly_floor"])
    own = clamp_firefly(p.own, greater(second, least), h, run.settings)
    third = greater(third, lesser(second, neighbour(y, 0, 0, run.layout)))
    return p._replace(own=own, filtered=clamp_firefly(p.filtered, greater(third, least), h, run.settings))
