"""The outputs of the stages, and the natural size of an error in each: what a bound is a multiple of."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Build, Real, unmoved_window
from cltaa.core.constants import PAD_X, PAD_Y, WINDOW_REACH
from cltaa.core.constants import value as value_of
from cltaa.reference.accumulate import current_pixel
from cltaa.reference.colour import filled_texels, whole_samples
from cltaa.reference.disocclusion import on_screen
from cltaa.reference.gather_fit import SampleSums
from cltaa.reference.gather_samples import gather_samples
from cltaa.reference.gather_sides import layers_of
from cltaa.reference.gather_track import Track
from cltaa.reference.neighbourhood import nearest_surface
from cltaa.reference.planes import read_rows
from cltaa.reference.real import Run, outside_domain, quiet
from cltaa.reference.reprojection import Motion
from cltaa.reference.sampling import footprint_of
from tests.kernels.stage_chain import ALL_STEPS, Work

Values = Any  # [H, W] or [C, H, W]
U = 2.0**-24
UNMOVED = unmoved_window(ALL_STEPS)


class Output(NamedTuple):
    """Some channels of a plane that a kernel writes; ``scale(work)`` is the unit of its errors, over u."""

    kernel: str
    label: str
    plane: str
    channels: slice
    unit: str
    scale: Callable[[Work], Any]


def usable(work: Work, reach: int = 1) -> Values:
    """Largest usable magnitude of each channel within ``reach`` texels, [C, H, W]."""
    current = work.planes["current"]
    bad = np.logical_or.reduce([outside_domain(plane) for plane in current])
    magnitudes = np.where(bad, 0.0, np.abs(current))
    high, wide = work.layout.height, work.layout.width
    steps = range(-reach, reach + 1)
    shifts = [(PAD_Y + j, PAD_X + i) for j in steps for i in steps]
    return reduce(np.maximum, (magnitudes[:, y : y + high, x : x + wide] for y, x in shifts))


def colour(work: Work) -> Values:
    """Largest magnitude of any channel in the 5x5: what the 3x3 and the repair of its texels read."""
    return usable(work, 2).max(0)


def spread(work: Work) -> Values:
    """60 standard deviations and the colour twice: what the box space's own rounding adds."""
    return 60 * work.layout.inside(work.planes["statistics_out"])[3:6] + 2 * colour(work)


def displacement(work: Work) -> Values:
    """16 max(1, d), which over u is 2^-20 max(1, d), where the previous position is on the screen."""
    m = surface_motion(work)
    size = np.maximum(1.0, np.maximum(np.abs(m.u), np.abs(m.v)))
    return np.where(on_screen(m, work.layout), 16 * size, np.nan)


def surface_motion(work: Work) -> Motion:
    u, v, scale, shift, visible = work.layout.inside(work.planes["motion_out"])[:5]
    return Motion(u, v, scale, shift, visible > 0.5)


def scaled(work: Work) -> Values:
    """max(1, s^2): the scale is a reciprocal, whose error goes with its square."""
    return np.maximum(1.0, surface_motion(work).scale ** 2)


def taps(work: Work, name: str, channels: slice) -> Values:
    """Largest magnitude of the 16 taps of each pixel, [C, H, W]."""
    m = surface_motion(work)
    f = footprint_of(m, on_screen(m, work.layout), work.layout)
    near = [(f.row + j, f.column + i) for j in (-1, 0, 1, 2) for i in (-1, 0, 1, 2)]
    return reduce(np.maximum, (np.abs(work.planes[name][channels, y, x]) for y, x in near))


@quiet
def box(work: Work) -> Values:
    """Largest magnitude of the history and of the extremes of the neighbourhood."""
    inside = work.layout.inside
    extremes = np.abs(inside(work.planes["statistics_out"])).max(0)
    return np.maximum(np.abs(inside(work.planes["history_at"])[:3]).max(0), extremes)


def parts(work: Work) -> list[Values]:
    """Current sample, the mean around it, and history and its change where they are used, [3, H, W]."""
    inside = work.layout.inside
    mean, history, change = (inside(work.planes[name])[:3] for name in ("statistics_out", "history_at", "change_out"))
    current = inside(work.planes["statistics_out"])[12:15]
    used = inside(work.planes["history_at"])[7] > 0.5
    return [current, mean, np.where(used, history, 0.0), np.where(used, change, 0.0)]


@quiet
def filled(work: Work) -> Values:
    """Largest magnitude, any channel, of what stands in for a missing sample."""
    run = Run(Build(steps=ALL_STEPS, real=Real.DOUBLE), work.layout, work.frame, work.settings)
    current, alpha = whole_samples(work.planes["current"], work.planes["alpha"], run)
    return np.abs(filled_texels(current, alpha, run.build, work.layout)[0]).max(0)


def both(work: Work) -> Values:
    """The largest magnitude of all that is blended, any channel."""
    return np.maximum.reduce([*(np.abs(part).max(0) for part in parts(work)), filled(work)])


@quiet
def conditioned(work: Work) -> Values:
    """How much the luminance weights magnify an error.

    By (knee + R/4 + G/2 + B/4 of magnitudes) / (knee + Y) where negative light cancels, and by the ratio of the two
    weights, because 1 - weight keeps only an absolute error where the weight is nearly 1.
    """
    knee = float(work.settings["luminance_knee"])
    current, _, history, change = parts(work)

    def weighed(value: Values) -> Values:
        return knee + np.maximum(0.25 * (value[0] + value[2]) + 0.5 * value[1], 0.0)

    x, h = weighed(current), weighed(history + change)
    magnified = np.maximum(weighed(np.abs(current)) / x, weighed(np.abs(history) + np.abs(change)) / h)
    return magnified * np.maximum(x / h, h / x)


@quiet
def gathered(work: Work) -> Values:
    """Largest magnitude of the current sample, what lies around it or stands in for it, and the mean of what was
    gathered, any channel."""
    build = Build(steps=ALL_STEPS, real=Real.DOUBLE)
    planes, layout = work.planes, work.layout
    run = Run(build, layout, work.frame, work.settings)
    current, _ = whole_samples(planes["current"], planes["alpha"], run)
    rows = read_rows(current, planes["inverse_depth"], planes["motion"], run)
    p = current_pixel(rows, None, None, run)
    surface = nearest_surface(*rows, run)
    ring = planes["ring"].reshape(len(work.past), -1, layout.rows, layout.stride)
    layers, none = layers_of(*rows, surface, run), SampleSums(np.zeros_like(p.alpha))
    g = gather_samples(
        ring,
        work.past,
        none,
        p,
        surface,
        layers,
        run,
        far_only=False,
        track=Track.of(surface, build),
        before=0,
        recent=0,
    )
    weight = np.where(g.count > 0, g.weight, 1.0)
    past = [now + total / weight for now, total in zip(p.own, g.sum, strict=True)]
    return np.maximum(np.abs([*p.own, *p.stats.mean, *p.stats.low, *p.stats.high, *past]).max(0), filled(work))


def halves(scale: Callable[[Work], Any]) -> Callable[[Work], Any]:
    """The distance of halves at a magnitude of ``scale``, over u: 2^-10 of it, the least normal half's at least."""
    return lambda work: value_of("HALF_STEP") / U * np.maximum(scale(work), value_of("HALF_NORMAL"))


def one(work: Work) -> float:  # noqa: ARG001
    return 1.0


def counts(work: Work) -> Values:
    return 1 + taps(work, "history_count", slice(0, 1))


def blended(work: Work) -> Values:
    return both(work) * conditioned(work)


def drawn(work: Work) -> Values:
    """Largest usable magnitude of the frame and of those kept: whose samples a pixel gathers, its motion says."""
    ring = work.planes["ring"].reshape(len(work.past), -1, work.layout.rows, work.layout.stride)[:, :3]
    planes = [work.layout.inside(plane) for plane in (*work.planes["current"], *ring.reshape(-1, *ring.shape[2:]))]
    return max(float(np.abs(plane[~outside_domain(plane)]).max()) for plane in planes)


def squared(work: Work) -> Values:
    """The same, squared."""
    return drawn(work) ** 2


def of_windows(work: Work) -> Values:
    """Largest magnitude of any window's colour in the 5x5."""
    windows = work.planes["windows"]
    planes = windows.reshape(-1, 6, *windows.shape[1:])[:, :3].reshape(-1, *windows.shape[1:])
    side = 2 * WINDOW_REACH + 1
    around = np.lib.stride_tricks.sliding_window_view(np.abs(planes).max(0), (side, side)).max((-1, -2))
    top, left = PAD_Y - WINDOW_REACH, PAD_X - WINDOW_REACH
    return around[top : top + work.layout.height, left : left + work.layout.width]


def counted(work: Work) -> Values:
    """1 + the largest count of a window."""
    planes = work.planes["windows"].reshape(-1, 6, *work.planes["windows"].shape[1:])[:, 4]
    return 1 + np.max([work.layout.inside(plane) for plane in planes], axis=0)


def outputs_of_window(window: int) -> list[Output]:
    """The rows of one window."""
    name, first = ("short", "middle", "all", "unmoved")[window], 6 * window
    parts = [
        (RGB, "colour", "u·M", gathered if window < UNMOVED else drawn),
        (FOURTH, "error", "u·M²", squared),
        (slice(4, 5), "count n", "u·(1 + n)", one),
        (slice(5, 6), "alpha", "u", one),
    ]
    return [
        Output(
            "gather_windows", f"window {name}: {said}", "windows", slice(first + at.start, first + at.stop), unit, scale
        )
        for at, said, unit, scale in parts
    ]


RGB, FOURTH, FIRST = slice(0, 3), slice(3, 4), slice(0, 1)
HISTORY, STATISTICS, MOTION = "sample_history", "neighbourhood_statistics", "surface_motion"
OUTPUTS = [
    Output("repair_colour", "repair: mean of usable texels", "repaired", RGB, "u·M", usable),
    Output(STATISTICS, "statistics: mean", "statistics_out", RGB, "u·M", colour),
    Output(STATISTICS, "statistics: deviation σ", "statistics_out", slice(3, 6), "u·(60σ + 2M)", spread),
    Output(STATISTICS, "statistics: low, high", "statistics_out", slice(6, 12), "u·M", colour),
    Output(STATISTICS, "statistics: current sample", "statistics_out", slice(12, 15), "u·M", colour),
    Output(MOTION, "motion: displacement d", "motion_out", slice(0, 2), "2⁻²⁰·max(1, d) px", displacement),
    Output(MOTION, "motion: scale s, shift", "motion_out", slice(2, 4), "u·max(1, s²)", scaled),
    Output(MOTION, "motion: visible, inverse depth", "motion_out", slice(4, 10), "u", one),
    Output(HISTORY, "history: colour", "history_at", RGB, "u·M", lambda work: taps(work, "history", RGB)),
    Output(HISTORY, "history: alpha", "history_at", FOURTH, "u·M", lambda work: taps(work, "history", FOURTH)),
    Output(HISTORY, "history: count n", "history_at", slice(4, 5), "u·(1 + n)", counts),
    Output(HISTORY, "history: fraction of a texel", "history_at", slice(5, 7), "u", one),
    Output(HISTORY, "history: usable", "history_at", slice(7, 8), "u", one),
    Output(HISTORY, "history: illumination change", "history_at", slice(8, 9), "u", one),
    Output("rectify_history", "rectify: change", "change_out", RGB, "u·M", box),
    Output("rectify_history", "rectify: blend boost, anti-flicker factor", "change_out", slice(3, 5), "u", one),
    Output("blend", "blend: colour", "output", RGB, "u·M·k", blended),
    Output("blend", "blend: alpha", "output", FOURTH, "u·k", conditioned),
    Output("blend", "blend: count n", "output_count", FIRST, "u·(1 + n)", counts),
    Output("resolve", "resolve: colour", "output", RGB, "u·M·k", blended),
    Output("resolve", "resolve: alpha", "output", FOURTH, "u·k", conditioned),
    Output("resolve", "resolve: count n", "output_count", FIRST, "u·(1 + n)", counts),
    Output("gather", "gather: colour", "output", RGB, "u·M", gathered),
    Output("gather", "gather: alpha", "output", FOURTH, "u", one),
    Output("gather", "gather: count n", "output_count", FIRST, "u·(1 + n)", one),
    *(output for window in (0, UNMOVED) for output in outputs_of_window(window)),  # with KEPT frames the others repeat
    Output("mix_windows", "mixed: colour", "output", RGB, "u·M", of_windows),
    Output("mix_windows", "mixed: alpha", "output", FOURTH, "u", one),
    Output("mix_windows", "mixed: count n", "output_count", FIRST, "u·(1 + n)", counted),
]
# The blend's output where the history is kept in halves: the error of the storage beside that of the arithmetic.
STORED = [
    Output("blend", "colour as stored", "output", RGB, "2⁻¹⁰·M·k", halves(blended)),
    Output("blend", "alpha as stored", "output", FOURTH, "2⁻¹⁰·k", halves(conditioned)),
]
