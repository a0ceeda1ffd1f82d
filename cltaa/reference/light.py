"""Twin of ``light.h``: nine samples of now paired with what the history holds at their places."""

from __future__ import annotations

from typing import Any

import numpy as np

from cltaa.build import Build, Record
from cltaa.constants import PAD_X, PAD_Y
from cltaa.layout import Layout
from cltaa.reference.colour import Colour, to_box_space, to_range
from cltaa.reference.neighbourhood import Moments, row_moments, window_moments
from cltaa.reference.real import Array, constant, greater, number
from cltaa.reference.repair import repaired_planes
from cltaa.reference.sampling import Footprint


def history_in_range(colour: Colour, build: Build, frame: Record) -> Colour:
    """History as the current exposure would show it, in the range that everything is compared in."""
    r, g, b = colour
    if build.steps.exposure:
        ratio = number(frame["exposure_ratio"], r)
        r, g, b = r * ratio, g * ratio, b * ratio
    return to_range((r, g, b), build)


def paired_t(above: Moments, centre: Moments, below: Moments, least: Array) -> Array:
    """Student's t of nine differences with the sign of their mean, ``least`` added to their deviation."""
    m = window_moments(above, centre, below)
    deviation = np.sqrt(m.spread * constant("TWO_27THS", m.spread))
    t: Array = number(3.0, least) * (m.shift + m.offset) / (deviation + least)
    return t


def change_of_light(
    current: Array,
    history: Array,
    history_count: Array,
    f: Footprint,
    build: Build,
    layout: Layout,
    frame: Record,
    settings: Record,
) -> Array:
    """What the history's count [H, W] is divided by: t over ``change_t`` of the channel that changed most, at least 1,
    and 1 where luminance does not go the way that it went in the frame before; negative where it falls.

    ``current`` [3, rows, stride], ``history`` [3 or 4, rows, stride] and ``history_count`` [rows, stride], whose sign
    is what this one's was in the frame before, are padded planes.
    """
    real: Any = f.fx.dtype
    colour = repaired_planes(current, layout).astype(real)
    half = number(0.5, f.fx)
    row, column = (
        at + np.floor(fraction + half).astype(np.int64) for at, fraction in ((f.row, f.fy), (f.column, f.fx))
    )

    def difference(i: int, j: int) -> tuple[Colour, Array]:
        there = slice(PAD_Y + j, PAD_Y + j + layout.height), slice(PAD_X + i, PAD_X + i + layout.width)
        now = to_box_space(to_range((colour[0][there], colour[1][there], colour[2][there]), build), build)
        r, g, b = (plane[row + j, column + i].astype(real) for plane in history[:3])
        past = to_box_space(history_in_range((r, g, b), build, frame), build)
        return (now[0] - past[0], now[1] - past[1], now[2] - past[2]), np.abs(now[0])

    rows: list[list[Moments]] = []
    levels = []
    for j in (-1, 0, 1):
        (left, left_size), (own, own_size), (right, right_size) = (difference(i, j) for i in (-1, 0, 1))
        rows.append([row_moments(left[k], own[k], right[k]) for k in range(3)])
        levels.append((left_size + own_size) + right_size)
    level = (levels[0] + levels[1]) + levels[2]
    floor = number(settings["change_floor"], level)
    least = floor * (level * constant("ONE_THIRD", level)) + constant("TINY", level)
    a, b, c = (paired_t(rows[0][k], rows[1][k], rows[2][k], least) for k in range(3))
    t = greater(np.abs(a), greater(np.abs(b), np.abs(c))) / number(settings["change_t"], level)
    one, zero = number(1.0, level), number(0.0, level)
    sign = np.where(a < zero, -one, one)
    goes_on = sign * history_count[row, column].astype(real) > zero
    divisor: Array = np.where(goes_on, sign * greater(t, one), sign)
    return divisor
