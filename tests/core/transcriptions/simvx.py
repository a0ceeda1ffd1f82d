"""The desktop TAA pass of simvx (same size in and out), from its documentation and its shader, in plain NumPy.

Documentation: ``simvx.graphics.renderer.taa_pass``. Package: simvx-graphics
0.0.0.dev3104, written anew from its formulas.

Every choice, in the order of the shader:

1.  Jitter: 8 points, idx = (idx + 1) mod 8 before use, (H2(idx + 1) - 1/2, H3(idx + 1) - 1/2) px: Halton indices 2 .. 8
    and then 1; not centred. It moves the image by -j texels in UV, so the sample by +j px, y down. ``jitter_px``. Only
    the colour and depth are drawn with it; velocity and all matrices are clean.
2.  c = the raw current texel. In the first frame, after a change of size and when enabled again the output is c.
3.  Velocity: an RG16F image in NDC, now - before, cleared to the sentinel (-2, -2); one LINEAR tap at the pixel's
    centre, which is the texel itself at equal sizes, so no sentinel is mixed with a vector. Valid if v.x > -1.5. Motion
    that is NaN stands for the sentinel; so does all of it in a frame without the channel. A true motion of 3/4 of the
    width or more to the right is taken for the sentinel too, as in the source. No dilation.
4.  Valid: h = pixel centre + motion. Else from depth: d = the pixel's own reverse-Z depth in [0, 1] (near 1, far 0;
    here (1 - z_ndc) / 2 of the camera's own near and far), d' = d <= 1e-4 ? 1e-3 : d, so that the sky and all that is
    very far lie at the finite distance where d is 1e-3; X = (P V)^-1 (2 uv - 1, d', 1) **at the pixel's centre**
    although the depth was drawn at the jittered sample, h = P' V' X, all matrices without jitter.
5.  Box: 3x3 of the current image in YCoCg (CLAMP_TO_EDGE), least and greatest channel by channel.
6.  Off screen: if h_uv < 0 or > 1 in either axis, the output is c; exactly 0 and 1 are inside.
7.  History filter: one bilinear tap at h, CLAMP_TO_EDGE.
8.  Rectification: a clamp, channel by channel, in YCoCg.
9.  out = RGB(c + 0.9 (clamped - c)), the blend in YCoCg; alpha is the current one.
10. Reset: first frame, a gap, a change of size; a cut too (the source has no call for it).
11. Storage: RGBA16F; here nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cltaa.frame import Frame
from tests.core.transcriptions.graphics import (
    Array,
    bilinear,
    clip_depth,
    halton,
    pixel_centres,
    reprojected,
    resolved,
    rgb_to_ycocg,
    square,
    ycocg_to_rgb,
)

HISTORY_WEIGHT = 0.9
SENTINEL, VALID_ABOVE = -2.0, -1.5
SKY_BELOW, SKY_DEPTH = 1e-4, 1e-3


def jitter_px(index: int) -> tuple[float, float]:
    """Where frame ``index`` (from 0) samples its pixels."""
    k = (index + 1) % 8 + 1
    return halton(2, k) - 0.5, halton(3, k) - 0.5


def resolve(frames: Iterable[Frame]) -> list[Array]:
    """The resolved images [H, W, 3 or 4] of ``frames``."""

    def step(frame: Frame, previous: Frame, current: Array, history: Array) -> Array:
        return resolve_frame(current, history, *history_position(frame, previous))

    return resolved(frames, step)


def history_position(frame: Frame, previous: Frame) -> tuple[Array, Array]:
    """Steps 3 and 4: pixel positions in the history, x and y [H, W]."""
    x, y = pixel_centres(frame.height, frame.width)
    velocity = np.full((frame.height, frame.width, 2), SENTINEL)  # NDC, y up
    if frame.motion is not None:
        has_vector = ~np.isnan(frame.motion).any(-1)
        to_ndc = np.array([-2.0 / frame.width, 2.0 / frame.height])
        velocity[has_vector] = frame.motion[has_vector] * to_ndc
    valid = velocity[..., 0] > VALID_ABOVE

    reverse_depth = (1 - clip_depth(frame.depth.astype(np.float64), frame.camera)) / 2
    reverse_depth = np.where(reverse_depth <= SKY_BELOW, SKY_DEPTH, reverse_depth)
    depth_x, depth_y = reprojected(x, y, 1 - 2 * reverse_depth, frame, previous)
    by_velocity_x = x - 0.5 * velocity[..., 0] * frame.width
    by_velocity_y = y + 0.5 * velocity[..., 1] * frame.height
    return np.where(valid, by_velocity_x, depth_x), np.where(valid, by_velocity_y, depth_y)


def resolve_frame(current: Array, history: Array, x: Array, y: Array) -> Array:
    """Steps 5 to 9 on images [H, W, 3] with history positions x, y."""
    height, width = current.shape[:2]
    now = rgb_to_ycocg(current)
    least, greatest = np.full_like(now, 1e9), np.full_like(now, -1e9)
    for texel in square(now):
        least, greatest = np.minimum(least, texel), np.maximum(greatest, texel)
    off_screen = (x < 0) | (y < 0) | (x > width) | (y > height)
    clamped = np.minimum(np.maximum(rgb_to_ycocg(bilinear(history, x, y)), least), greatest)
    blended = ycocg_to_rgb(now + (clamped - now) * HISTORY_WEIGHT)
    return np.where(off_screen[..., None], current, blended)
