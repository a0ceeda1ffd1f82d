"""Twin of ``taa/colour.h``: RGB, the box space, and the repair of texels outside the domain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cltaa.core.build import Build
from cltaa.core.constants import FILL_REACH, PAD_X, PAD_Y, value
from cltaa.core.parameters import AlphaFrom, BoxSpace, Tonemap
from cltaa.core.planes import Layout
from cltaa.reference.real import (
    NEIGHBOURS,
    Array,
    Mask,
    Run,
    greater,
    limit,
    outside_domain,
    quiet,
    real_type,
)

Colour = Array  # [3, H, W]


def box_units(build: Build) -> tuple[float, float, float]:
    """Scale of the kernels' coordinates against the box space's own: ``BOX_A``, ``BOX_B`` and ``BOX_A`` again.

    Powers of two change no digit, but shift where numbers or their squares overflow or underflow.
    """
    return (4.0, 2.0, 4.0) if build.choices.box_space is BoxSpace.YCOCG else (1.0, 1.0, 1.0)


def a_channel(factors: Sequence[float]) -> Array:
    """Three factors, one for each channel of a colour; exact in float32."""
    return np.array(factors, np.float32)[:, None, None]


def inner(a: Colour, b: Colour) -> Array:
    """Sum of the products, channel by channel."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def to_box_space(v: Colour, build: Build) -> Colour:
    """RGB to 4 Y, 2 Co, 4 Cg (or unchanged where the box is in RGB)."""
    if build.choices.box_space is BoxSpace.RGB:
        return v
    r, g, b = v
    rb, green = r + b, 2.0 * g
    return np.stack((rb + green, r - b, green - rb))


def in_units(v: Colour, build: Build) -> Colour:
    """The kernels' coordinates in the box space's own."""
    return a_channel([1.0 / each for each in box_units(build)]) * v


def from_units(v: Colour, build: Build) -> Colour:
    """The inverse of ``in_units``."""
    return a_channel(box_units(build)) * v


def from_box_space(v: Colour, build: Build) -> Colour:
    """The inverse of ``to_box_space``."""
    if build.choices.box_space is BoxSpace.RGB:
        return v
    a, b, c = v
    t = 0.25 * (a - c)
    return np.stack((t + 0.5 * b, 0.25 * (a + c), t - 0.5 * b))


def luminance(v: Colour) -> Array:
    """R/4 + G/2 + B/4."""
    r, g, b = v
    return 0.25 * (r + b) + 0.5 * g


def peak(v: Colour) -> Array:
    """max(r, g, b, 0)."""
    return greater(greater(greater(v[0], v[1]), v[2]), 0.0)


def to_range(v: Colour, build: Build) -> Colour:
    """Tonemap scene-referred colour to the range in which it is compared and blended."""
    if build.choices.tonemap in (Tonemap.NONE, Tonemap.BLEND):
        return v
    if build.choices.tonemap is Tonemap.CHANNEL:
        return v / (1.0 + greater(v, 0.0))
    return peak_range(v)


def peak_range(v: Colour) -> Colour:
    """c / (1 + max(r, g, b))."""
    return v * (1.0 / (1.0 + peak(v)))


def to_blend_range(v: Colour, build: Build) -> Colour:
    """Tonemap for the blend alone."""
    return peak_range(v) if build.choices.tonemap is Tonemap.BLEND else v


def from_range(v: Colour, build: Build) -> Colour:
    """The inverse of ``to_range``, with at least LEAST_HEADROOM of headroom."""
    if build.choices.tonemap is Tonemap.NONE:
        return v
    least = value("LEAST_HEADROOM")
    if build.choices.tonemap is Tonemap.CHANNEL:
        return v / greater(1.0 - greater(v, 0.0), least)
    return v * (1.0 / greater(1.0 - peak(v), least))


def share_in_domain(v: Array, otherwise: float) -> Array:
    """Clamp alpha or reactivity to [0, 1]; outside the domain it is ``otherwise``."""
    return np.where(outside_domain(v), otherwise, limit(v, 0, 1))


def accumulates_alpha(build: Build) -> bool:
    """Whether alpha is accumulated; then whatever judges the history judges its alpha too."""
    return build.steps.alpha and build.choices.alpha_from is AlphaFrom.BLEND


def colour_outside_domain(v: Colour) -> Mask:
    """True where any channel is unusable."""
    r, g, b = outside_domain(v)
    return r | g | b


def outside_domain_of(v: Colour, alpha: Array | None) -> Mask:
    """True where colour, or alpha where there is one, is unusable: neither is a sample without the other."""
    return colour_outside_domain(v) if alpha is None else colour_outside_domain(v) | outside_domain(alpha)


@quiet
def whole_samples(current: Array, alpha: Array | None, run: Run) -> tuple[Array, Array | None]:
    """Planes of colour [3, rows, stride], NaN where colour or alpha [1, ...] is outside the domain, and of alpha as
    repaired shares: neither is usable without the other."""
    if not run.steps.alpha or alpha is None:
        return current, None
    colour = np.where(outside_domain(alpha[0]), np.float32(np.nan), current[:3])
    return colour, repaired_planes(share_in_domain(alpha, 1.0), run.layout, colour_outside_domain(colour))


@quiet
def repaired_planes(planes: Array, layout: Layout, bad: Mask | None = None) -> Array:
    """Repaired copy of planes of colour or alpha [3 or 1, rows, stride], halo included (the edge repeated), where
    ``bad``: by default where colour is outside the domain.

    The sum runs over the 3x3 row by row and the mean is one division, as in the kernel.
    """
    bad = colour_outside_domain(planes[:3]) if bad is None else bad
    repaired = planes.copy()
    rows, columns = np.nonzero(layout.inside(bad))
    if rows.size:
        rows, columns = rows + PAD_Y, columns + PAD_X
        zero = np.zeros_like(planes[:3, rows, columns])
        total, count = zero, zero[0]
        for i, j in NEIGHBOURS:
            in_domain = ~bad[rows + j, columns + i]
            total = np.where(in_domain, total + planes[:3, rows + j, columns + i], total)
            count = np.where(in_domain, count + 1.0, count)
        repaired[:3, rows, columns] = np.where(count > 0.0, total / greater(count, 1.0), zero)
        layout.extend_edges(repaired)
    return repaired


def sample_is_missing(current: Array, layout: Layout, alpha: Array | None = None) -> Mask:
    """True where a pixel's own texel is outside the domain, [H, W]."""
    return outside_domain_of(layout.inside(current[:3]), None if alpha is None else layout.inside(alpha[0]))


@quiet
def filled_texels(current: Array, alpha: Array | None, build: Build, layout: Layout) -> tuple[Colour, Array]:
    """Each pixel's own colour and alpha [H, W] if usable, else the means of the nearest usable texel along each of
    eight rays, weighted by one over its squared distance; colour tonemapped to the range of comparison."""
    channels = np.stack([*current[:3], *(() if alpha is None else alpha)])
    planes = layout.inside(channels)
    usable = ~sample_is_missing(current, layout)
    rows, columns = np.nonzero(~usable)
    first, total = (np.zeros((len(planes), rows.size), np.float32) for _ in range(2))
    weight = np.zeros(rows.size, np.float32)
    for right, down in (step for step in NEIGHBOURS if any(step)):
        going = np.ones(rows.size, np.bool_)
        for step in range(1, FILL_REACH + 1):
            y, x = rows + step * down, columns + step * right
            going &= (x >= 0) & (x < layout.width) & (y >= 0) & (y < layout.height)
            if not going.any():
                break
            here = going & usable[np.where(going, y, 0), np.where(going, x, 0)]
            texel = planes[:, np.where(here, y, 0), np.where(here, x, 0)]
            share = np.float32(1.0) / np.float32(step * step * (right * right + down * down))
            first = np.where(here & (weight == 0), texel, first)
            total = np.where(here, total + share * (texel - first), total)
            weight = np.where(here, weight + share, weight)
            going &= ~here
    filled = planes.copy()
    filled[:, rows, columns] = np.where(weight > 0, first + total / weight, np.float32(0.0))
    filled = filled.astype(real_type(build))
    opacity = np.ones_like(filled[0]) if alpha is None else limit(filled[3], 0.0, 1.0)
    return to_range(filled[:3], build), opacity


def colour_in_domain(current: Array, run: Run) -> Colour:
    """Each pixel's own colour [H, W], repaired where necessary and tonemapped to the range of comparison."""
    return to_range(run.layout.inside(repaired_planes(current, run.layout)[:3]).astype(real_type(run.build)), run.build)
