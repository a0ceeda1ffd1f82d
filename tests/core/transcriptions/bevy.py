"""Bevy's temporal anti-aliasing, from its shader ``taa.wesl`` with TONEMAP on, in plain NumPy.

Source: https://github.com/bevyengine/bevy at 4805ca7, crates/bevy_anti_alias/src/taa/taa.wesl, written anew from its
formulas.

1.  c = tonemapped current texel, c / (1 + max(r, g, b)). The first frame is kept, with confidence 1 / 0.015.
2.  Motion: that of the nearest depth of the texel itself and of those two away along both diagonals, first the lower.
3.  History, kept tonemapped: Catmull-Rom in nine bilinear taps without the four in the corners, weights as they are.
4.  Box: mean and deviation of the 3x3 in YCoCg; history beyond it moves along the line to the mean.
5.  Confidence, read at the pixel itself: 1 where it moves 0.01 px or more along an axis, else ten more than before.
6.  out = history + clamp(1 / confidence, 0.015, 0.1) (c - history); where history lies off screen c, with confidence 1.
    Negative light becomes 0 here; in the source it does so after step 4.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cltaa.frame import Frame
from tests.core.transcriptions.graphics import (
    Array,
    bilinear,
    fetch,
    pixel_centres,
    rgb_to_ycocg,
    square,
    starts_anew,
    velocity_buffer,
    ycocg_to_rgb,
)

LEAST, MOST, STANDS = 0.015, 0.1, 0.01
CORNERS = ((-2, 2), (2, 2), (-2, -2), (2, -2))


def tonemap(colour: Array) -> Array:
    """c / (1 + max(r, g, b))."""
    mapped: Array = colour / (1 + colour.max(-1, keepdims=True))
    return mapped


def inverse(colour: Array) -> Array:
    """The inverse of ``tonemap``."""
    light: Array = colour / (1 - colour.max(-1, keepdims=True))
    return light


def five_taps(history: Array, x: Array, y: Array) -> Array:
    """Step 3 at pixel positions x, y."""
    (x0, x12, x3), (wx0, wx12, wx3) = taps(x)
    (y0, y12, y3), (wy0, wy12, wy3) = taps(y)
    five = (x12, y0, wx12 * wy0), (x0, y12, wx0 * wy12), (x12, y12, wx12 * wy12), (x3, y12, wx3 * wy12)
    total = np.zeros((*x.shape, 3))
    for at_x, at_y, weight in (*five, (x12, y3, wx12 * wy3)):
        total += bilinear(history, at_x, at_y) * weight[..., None]
    return total


def taps(position: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Places and weights of the first, the two middle ones as one, and the last of four taps along an axis."""
    middle = np.floor(position - 0.5) + 0.5
    f = position - middle
    w0, w2 = f * (-0.5 + f * (1 - 0.5 * f)), f * (0.5 + f * (2 - 1.5 * f))
    w12 = 1 + f * f * (-2.5 + 1.5 * f) + w2
    return (middle - 1, middle + w2 / w12, middle + 2), (w0, w12, f * f * (-0.5 + 0.5 * f))


def dilated(velocity: Array, depth: Array) -> Array:
    """Step 2."""
    row, column = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    nearest, motion = depth.astype(np.float64), velocity
    for dx, dy in CORNERS:
        there = fetch(depth[..., None].astype(np.float64), column + dx, row + dy)[..., 0]
        nearer = there < nearest
        nearest = np.where(nearer, there, nearest)
        motion = np.where(nearer[..., None], fetch(velocity, column + dx, row + dy), motion)
    return motion


def clipped(history: Array, current: Array) -> Array:
    """Step 4."""
    texels = square(rgb_to_ycocg(current))
    mean = sum(texels[1:], texels[0]) / 9
    deviation = np.sqrt(np.maximum(sum((t * t for t in texels[1:]), texels[0] ** 2) / 9 - mean * mean, 0)) + 1e-8
    way = rgb_to_ycocg(history) - mean
    far = np.abs(way / deviation).max(-1, keepdims=True)
    return ycocg_to_rgb(mean + way / np.maximum(far, 1))


def resolve(frames: Iterable[Frame]) -> list[Array]:
    """The resolved images [H, W, 3 or 4] of ``frames``."""
    images: list[Array] = []
    previous: Frame | None = None
    history = confidence = np.empty(0)
    for frame in frames:
        current = tonemap(frame.colour.astype(np.float64))
        if previous is None or starts_anew(frame, previous):
            history, confidence = current, np.full(current.shape[:2], 1 / LEAST)
        else:
            velocity = dilated(velocity_buffer(frame, previous), frame.depth)
            x, y = pixel_centres(frame.height, frame.width)
            x, y = x + velocity[..., 0], y + velocity[..., 1]
            confidence = np.where((np.abs(velocity) < STANDS).all(-1), confidence + 10, 1.0)
            off_screen = (x < 0) | (y < 0) | (x > frame.width) | (y > frame.height)
            confidence = np.where(off_screen, 1.0, confidence)
            weight = np.where(off_screen, 1.0, np.clip(1 / confidence, LEAST, MOST))[..., None]
            past = clipped(five_taps(history, x, y), current)
            history = np.maximum(past + (current - past) * weight, 0)
        alpha = [] if frame.alpha is None else [frame.alpha[..., None]]
        images.append(np.concatenate([inverse(history), *alpha], axis=-1))
        previous = frame
    return images
