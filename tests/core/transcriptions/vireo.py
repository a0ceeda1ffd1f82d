"""The TAA of the Vireo RHI samples, from its article and from its shader, in plain NumPy.

Article: "Example of TAA Implementation with Vireo RHI". Shader: HenriMichelon/vireo_samples
``src/shaders/taa.frag.slang``, last changed 286dae3. ``ARTICLE`` and ``SOURCE`` hold the constants in which they
differ.

Every choice, in the order of the shader:

1.  Jitter: 16 points, k = frame mod 16 + 1, (H2(k) - 1/2, H3(k) - 1/2) over the image size in NDC, not centred. NDC
    spans 2, so this is half of what it means to be: the sample moves by at most a quarter of a pixel. ``jitter_px``.
2.  Velocity: one LINEAR tap at the pixel's centre, which is the texel itself. v = (now - before) in UV; here
    h = pixel centre + motion, the motion being the correct one of the pixel's own sample: no dilation. (The sample
    application's velocity is mirrored in y, keeps a rest of the jitter and a stale view matrix; those are faults of its
    G-buffer pass, not of the resolve.) The application clears the velocity to 0 and draws no sky into it; here
    the sky has its true motion.
3.  c = the raw current texel, RGBA; no reconstruction filter, no tonemap.
4.  Off screen: if h_uv < 0 or > 1 in either axis, the output is c, alpha too; exactly 0 and 1 are inside.
5.  History filter: Catmull-Rom at h, P = h in pixels, q = floor(P - 1/2) + 1/2, f = P - q,
    w0 = -f^3/2 + f^2 - f/2, w1 = 3f^3/2 - 5f^2/2 + 1, w2 = -3f^3/2 + 2f^2 + f/2, w3 = f^3/2 - f^2/2;
    nine bilinear taps at q - 1, q + w2/(w1 + w2), q + 2 a axis with the products of w0, w1 + w2, w3 as weights.
    CLAMP_TO_EDGE; the result is neither cut at 0 nor renormalised (the weights sum to 1).
6.  Box: 3x3 of the current image (CLAMP_TO_EDGE) in YCoCg, uniform weights: mean m1/9, sigma =
    sqrt(max(0, m2/9 - mean^2)); lo = max(mean - sigma, least), hi = min(mean + sigma, greatest), channel by channel.
7.  Rectification: a clamp of the history to [lo, hi], channel by channel, in YCoCg (the article calls it a clip).
8.  History weight a = lerp(rest, moving, max(sat(velocity_scale |v|), sat(clamp_scale |clamped - history|))), |v| the
    Euclidean length in UV (x by the width, y by the height), the second length Euclidean in YCoCg.
9.  out.rgb = c.rgb + (RGB(clamped) - c.rgb) a, in linear RGB.
10. Alpha: the current one, never blended.
11. Reset: none; the history starts undefined. Here the first frame, a gap and a change of size output c, and a cut does
    too (the source knows no cut).
12. Storage: the display's R8G8B8A8_UNORM; here nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from cltaa.frame import Frame
from tests.core.transcriptions.graphics import (
    Array,
    bilinear,
    halton,
    pixel_centres,
    resolved,
    rgb_to_ycocg,
    square,
    velocity_buffer,
    ycocg_to_rgb,
)


class Constants(NamedTuple):
    """What article and source disagree on."""

    velocity_scale: float
    clamp_scale: float
    rest: float
    moving: float


ARTICLE = Constants(velocity_scale=30.0, clamp_scale=3.0, rest=0.95, moving=0.75)
SOURCE = Constants(velocity_scale=50.0, clamp_scale=5.0, rest=0.92, moving=0.70)


def jitter_px(index: int) -> tuple[float, float]:
    """Where frame ``index`` samples its pixels, in the project's convention.

    projection[2][0] = j shifts the image by -j in NDC, so the sample by +j W/2 px in x and, y being up, -j H/2 px in y.
    """
    k = index % 16 + 1
    return (halton(2, k) - 0.5) / 2, -(halton(3, k) - 0.5) / 2


def resolve(
    frames: Iterable[Frame],
    constants: Constants,
) -> list[Array]:
    """The resolved images [H, W, 3 or 4] of ``frames``."""

    def step(frame: Frame, previous: Frame, current: Array, history: Array) -> Array:
        return resolve_frame(current, history, velocity_buffer(frame, previous), constants)

    return resolved(frames, step)


def resolve_frame(current: Array, history: Array, velocity: Array, constants: Constants) -> Array:
    """Steps 4 to 9 on images [H, W, 3]; ``velocity`` [H, W, 2] in pixels points to the previous position."""
    height, width = current.shape[:2]
    x, y = pixel_centres(height, width)
    x, y = x + velocity[..., 0], y + velocity[..., 1]
    off_screen = (x < 0) | (y < 0) | (x > width) | (y > height)

    sampled = rgb_to_ycocg(catmull_rom(history, x, y))
    least, greatest = box(current)
    clamped = np.minimum(np.maximum(sampled, least), greatest)

    speed = np.hypot(velocity[..., 0] / width, velocity[..., 1] / height)
    velocity_weight = np.clip(speed * constants.velocity_scale, 0, 1)
    clamp_weight = np.clip(np.sqrt(((clamped - sampled) ** 2).sum(-1)) * constants.clamp_scale, 0, 1)
    toward_moving = np.maximum(velocity_weight, clamp_weight)
    weight = constants.rest + (constants.moving - constants.rest) * toward_moving

    blended = current + (ycocg_to_rgb(clamped) - current) * weight[..., None]
    return np.where(off_screen[..., None], current, blended)


def catmull_rom(history: Array, x: Array, y: Array) -> Array:
    """Step 5: nine bilinear taps at pixel positions x, y."""
    columns, rows = taps(x), taps(y)
    total = np.zeros((*x.shape, history.shape[-1]), history.dtype)
    for tap_x, weight_x in columns:
        for tap_y, weight_y in rows:
            total += bilinear(history, tap_x, tap_y) * (weight_x * weight_y)[..., None]
    return total


def taps(position: Array) -> list[tuple[Array, Array]]:
    """The three taps of one axis, each a position and a weight."""
    q = np.floor(position - 0.5) + 0.5
    f = position - q
    w0 = f * (-0.5 + f * (1.0 - 0.5 * f))
    w1 = 1.0 + f * f * (-2.5 + 1.5 * f)
    w2 = f * (0.5 + f * (2.0 - 1.5 * f))
    w3 = f * f * (-0.5 + 0.5 * f)
    w12 = w1 + w2
    return [(q - 1, w0), (q + w2 / w12, w12), (q + 2, w3)]


def box(current: Array) -> tuple[Array, Array]:
    """Step 6: least and greatest YCoCg of the box, each [H, W, 3]."""
    m1, m2 = np.zeros_like(current), np.zeros_like(current)
    least, greatest = np.full_like(current, 1e10), np.full_like(current, -1e10)
    for texel in square(current):
        ycocg = rgb_to_ycocg(texel)
        m1 += ycocg
        m2 += ycocg * ycocg
        least, greatest = np.minimum(least, ycocg), np.maximum(greatest, ycocg)
    mean = m1 / 9
    sigma = np.sqrt(np.maximum(0, m2 / 9 - mean * mean))
    return np.maximum(mean - sigma, least), np.minimum(mean + sigma, greatest)
