"""Twin of ``taa/illumination.h``: pairs nine current samples with the history at their positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Record
from cltaa.core.constants import value
from cltaa.core.parameters import BoxSpace, Illumination
from cltaa.core.planes import Layout
from cltaa.reference.colour import (
    Colour,
    a_channel,
    accumulates_alpha,
    box_units,
    colour_outside_domain,
    repaired_planes,
    sample_is_missing,
    to_box_space,
    to_range,
)
from cltaa.reference.neighbourhood import spread_of_three
from cltaa.reference.real import NEIGHBOURS, Array, Run, greater, lesser, limit, neighbour
from cltaa.reference.sampling import Footprint


def history_in_range(colour: Colour, run: Run) -> Colour:
    """Scale history to the current exposure and tonemap it to the range of comparison."""
    if run.steps.exposure:
        colour = colour * run.frame["exposure_ratio"]
    return to_range(colour, run.build)


class DifferenceMoments(NamedTuple):
    """Mean of three differences, and 3/2 of their spread."""

    mean: Array
    spread: Array


def difference_row(left: Array, centre: Array, right: Array) -> DifferenceMoments:
    """Three differences of a row."""
    dl, dr = left - centre, right - centre
    return DifferenceMoments(centre + (dl + dr) * value("ONE_THIRD"), spread_of_three(dl, dr))


def third_of_students_t(rows: Sequence[DifferenceMoments], least: Array) -> Array:
    """A third of Student's t of nine differences, with the sign of their mean; ``least`` is added to their
    deviation."""
    above, centre, below = rows
    da, db = above.mean - centre.mean, below.mean - centre.mean
    mean = centre.mean + (da + db) * value("ONE_THIRD")
    spread = ((above.spread + centre.spread) + below.spread) + 3.0 * spread_of_three(da, db)
    return mean / (np.sqrt(spread * value("TWO_27THS")) + least)


def nine_differences(difference: Callable[[int, int], tuple[Array, Array]]) -> tuple[list[DifferenceMoments], Array]:
    """The rows of the differences of nine texels, and the sum of their levels; ``difference`` gives both of one."""
    rows: list[DifferenceMoments] = []
    levels = []
    for j in (-1, 0, 1):
        (left, first), (own, second), (right, third) = (difference(i, j) for i in (-1, 0, 1))
        rows.append(difference_row(left, own, right))
        levels.append((first + second) + third)
    return rows, (levels[0] + levels[1]) + levels[2]


def illumination_difference(now: Colour, past: Colour, run: Run) -> Colour:
    """Current minus history in the kernels' coordinates (``to_box_space``)."""
    was = history_in_range(past, run)
    if run.choices.box_space is not BoxSpace.YCOCG:
        return now - was
    r, g, b = was
    rb, green = r + b, 2.0 * g
    return np.stack(((now[0] - rb) - green, now[1] - (r - b), (now[2] + rb) - green))


def least_deviation(level: Array, tiny: float, settings: Record) -> Array:
    """What is added to the deviation of a channel whose nine samples have this sum of levels."""
    return settings["illumination_floor"] * (level * value("ONE_THIRD")) + tiny


def alpha_t(alpha: Array, history: Array, row: Array, column: Array, run: Run, like: Array) -> Array:
    """A third of Student's t of the nine differences of padded planes of alpha [rows, stride]."""
    share = alpha.astype(like.dtype)

    def difference(i: int, j: int) -> tuple[Array, Array]:
        now = neighbour(share, i, j, run.layout)
        return now - history[row + j, column + i].astype(like.dtype), now

    rows, level = nine_differences(difference)
    return third_of_students_t(rows, least_deviation(level, value("TINY"), run.settings))


def tests_light(build: Build) -> bool:
    """Whether the build tests light; the count's planes then hold the illumination change too."""
    return build.choices.illumination is not Illumination.STATIC


def stored_change(change: Array) -> Array:
    """Clamp the stored change to MOST_CHANGE, and flush denormals."""
    most = value("MOST_CHANGE")
    kept = limit(change, -most, most)
    return np.where(np.abs(kept) < value("TINY"), 0.0, kept)


class IlluminationResult(NamedTuple):
    """The history's reduced sample count, and the illumination change."""

    samples: Array
    change: Array


def illumination_test(
    held: Array,
    threshold: Array,
    current: Array,
    alpha: Array | None,
    history: Array,
    history_change: Array,
    f: Footprint,
    run: Run,
) -> IlluminationResult:
    """Divide the history's ``held`` [H, W] samples by max(1, |change| / ``threshold``)^2.

    The change is Student's t of the channel that changed most, negative where luminance falls, or alpha where that
    changed most, plus ``illumination_decay`` times the stored change of the previous frame. Where light falls,
    ``falling_t * threshold`` replaces ``threshold`` [H, W]. ``current`` [3, rows, stride], ``alpha`` [1, ...],
    ``history`` [3 or 4, ...] and ``history_change`` [rows, stride], of the previous frame, are padded planes.
    """
    real: Any = f.fx.dtype
    colour = repaired_planes(current, run.layout).astype(real)
    zero = np.zeros_like(f.fx)
    row, column = (
        at + np.where(fraction >= 0.5, 1.0, zero).astype(np.int64) for at, fraction in ((f.row, f.fy), (f.column, f.fx))
    )

    def difference(i: int, j: int) -> tuple[Colour, Array]:
        now = to_box_space(to_range(neighbour(colour, i, j, run.layout), run.build), run.build)
        past = history[:3, row + j, column + i].astype(real)
        return illumination_difference(now, past, run), np.abs(now[0])

    rows, level = nine_differences(difference)
    first, *_ = units = box_units(run.build)
    least = least_deviation(level, first * value("TINY"), run.settings)
    ta, tb, tc = third_of_students_t(rows, a_channel([unit / first for unit in units]) * least)
    largest: Array = greater(np.abs(ta), greater(np.abs(tb), np.abs(tc)))
    signed_t = ta
    if accumulates_alpha(run.build) and alpha is not None:
        of_alpha = alpha_t(alpha[0], history[3], row, column, run, level)
        signed_t = np.where(np.abs(of_alpha) > largest, of_alpha, ta)
        largest = greater(largest, np.abs(of_alpha))
    t = lesser(3.0 * largest, run.settings["largest_t"])
    before = history_change[row, column].astype(real)
    change = np.where(signed_t < 0.0, -t, t) + run.settings["illumination_decay"] * before
    falling_t = run.settings["falling_t"] * threshold
    by = greater(np.abs(change) / np.where(change < 0.0, falling_t, threshold), 1.0)
    rendered = _rendered(current, run.layout, zero)
    untested = sample_is_missing(current, run.layout) & (rendered < 5.0)
    return IlluminationResult(
        np.where(untested, held, held / (by * by)), np.where(untested, zero, stored_change(change))
    )


def _rendered(current: Array, layout: Layout, zero: Array) -> Array:
    """Number of usable texels in the 3x3 of each pixel, with the image's edge repeated."""
    usable = ~colour_outside_domain(current[:3])
    return zero + sum(neighbour(usable, *step, layout) for step in NEIGHBOURS)
