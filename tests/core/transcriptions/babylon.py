"""The TAA of Babylon.js in its four modes, from its documentation and its shader, in plain NumPy.

Documentation: "TAA Rendering Pipeline". Source: ``taa.fragment.fx`` 2637897, ``thinTAAPostProcess.ts`` 041978b.

Every choice, in the order of the shader:

1.  Jitter: N = 8 points, (H2(i) - 1/2, H3(i) - 1/2) px, i = 1 .. N, cyclic, not centred. Without reprojection it is
    drawn only while the camera stands (``jitter_px`` gives it for every frame; a capture of a moving camera by this
    rule has none). The phase after a reset is not 0 in the source, which only shifts which frame has which point.
2.  c = the raw current texel, RGBA. Without an alpha channel A is 1.
3.  History: ``accumulate`` and ``disable-on-camera-move`` fetch the same texel. ``reproject`` and ``reproject-clamp``
    read one bilinear tap at pixel centre + motion, the correct motion of the pixel's own sample: no dilation.
    Addressing is clamp to edge, and there is no off-screen test.
4.  Box (``reproject-clamp`` alone): channel by channel over the 3x3 of the current image, **RGBA**, with the search
    seeded at 1 for the least and at 0 for the greatest: lo = min(1, least), hi = max(0, greatest). An HDR neighbourhood
    all above 1 therefore has lo = 1. What a fetch beyond the border gives is undefined in the source;
    here the texel of the edge. History is clamped to [lo, hi], alpha too.
5.  out = history + factor (c - history) for all four channels, in linear RGBA; factor = 0.05.
6.  factor = 1 in the first update after a reset (size, enabling, mode), and in ``disable-on-camera-move`` in every
    frame whose camera differs from that of the frame before. The output (then c) goes into the history as ever.
7.  Reset: first frame, a gap, a change of size; a cut too (the source knows none).
8.  Storage: half-float targets in the ping-pong, and UNSIGNED_BYTE by default for the pass itself; here nothing is
    rounded.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cltaa.frame import Frame
from tests.core.transcriptions.graphics import (
    Array,
    bilinear,
    halton,
    pixel_centres,
    same_camera,
    square,
    starts_anew,
    velocity_buffer,
)

MODES = ("accumulate", "disable-on-camera-move", "reproject", "reproject-clamp")
FACTOR = 0.05
SAMPLES = 8


def jitter_px(index: int) -> tuple[float, float]:
    """Where frame ``index`` samples its pixels: position.xy += s * w moves the image by s, y up, the sample by -s."""
    i = index % SAMPLES + 1
    return -(halton(2, i) - 0.5), halton(3, i) - 0.5


def resolve(frames: Iterable[Frame], mode: str) -> list[Array]:
    """The resolved images [H, W, 3 or 4] of ``frames`` in one of ``MODES``."""
    assert mode in MODES, mode
    images: list[Array] = []
    previous: Frame | None = None
    history = np.empty(0)
    for frame in frames:
        current = with_alpha(frame)
        if (
            previous is None
            or starts_anew(frame, previous)
            or (mode == "disable-on-camera-move" and not same_camera(frame.camera, previous.camera))
        ):
            history = current
        else:
            past = history
            if mode.startswith("reproject"):
                past = reprojected_history(history, velocity_buffer(frame, previous))
            if mode == "reproject-clamp":
                least, greatest = box(current)
                past = np.minimum(np.maximum(past, least), greatest)
            history = past + (current - past) * FACTOR
        images.append(history if frame.alpha is not None else history[..., :3])
        previous = frame
    return images


def with_alpha(frame: Frame) -> Array:
    """Colour and alpha [H, W, 4]; alpha is 1 where the frame has none."""
    alpha = np.ones_like(frame.depth) if frame.alpha is None else frame.alpha
    return np.concatenate([frame.colour, alpha[..., None]], axis=-1).astype(np.float64)


def reprojected_history(history: Array, velocity: Array) -> Array:
    """Step 3 with reprojection; ``velocity`` [H, W, 2] in pixels points to the previous position."""
    x, y = pixel_centres(history.shape[0], history.shape[1])
    return bilinear(history, x + velocity[..., 0], y + velocity[..., 1])


def box(current: Array) -> tuple[Array, Array]:
    """Step 4: least and greatest RGBA, each [H, W, 4]."""
    least, greatest = np.ones_like(current), np.zeros_like(current)
    for texel in square(current):
        least, greatest = np.minimum(least, texel), np.maximum(greatest, texel)
    return least, greatest
