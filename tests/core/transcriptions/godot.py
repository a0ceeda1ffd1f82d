"""Godot's temporal anti-aliasing, from its shader ``taa_resolve.glsl``, in plain NumPy.

Source: https://github.com/godotengine/godot at 0c64c88, servers/rendering/renderer_rd/shaders/effects/taa_resolve.glsl,
with variance_dynamic 1, written anew from its formulas.

1.  c = Reinhard of the current texel, c / (1 + c) a channel. The first frame is copied, and counts for no sample.
2.  Motion: the nearest depth of the 3x3, the far plane never; but the velocity is read one texel left of and above it,
    since the place is counted from the corner of a tile that has a border. Beyond the image it is 0.
3.  History, kept as light: Catmull-Rom in nine bilinear taps; then Reinhard. The count is read bilinearly.
4.  Box: mean and deviation of the 3x3 in YCoCg with weights 1 / (1 + Y), the deviation times a scale from 1 at rest
    to 0.4 in motion; history beyond it moves along the line to the mean.
5.  Weight 1 / (count + 1), times (1 - |difference of luma| / max(both, 1.001))^2; off screen 1.
6.  out = inverse Reinhard of history + weight (c - history); the count grows by 1 up to 16.

The test holds the preset to all of this but what the preset approximates, of which this has the preset's form: luma is
Y, negative light becomes 0 in step 6 alone, not in 3 and 4 too, and the scale is linear in the larger component of
motion. The source has Rec. 601, and the square of 1 - length(v) / (128 / 1080), v in widths and heights. It also counts
fewer samples where the velocities of two frames differ, by 0.01 a pixel.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cltaa.frame import Frame
from tests.core.transcriptions.bevy import taps
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

MOST_SAMPLES, NARROWEST, NARROW_FROM, KNEE = 16.0, 0.4, 0.08, 1.001


def nine_taps(history: Array, x: Array, y: Array) -> Array:
    """The filter of step 3 at pixel positions x, y."""
    total = np.zeros((*x.shape, 3))
    for at_x, across in zip(*taps(x), strict=True):
        for at_y, down in zip(*taps(y), strict=True):
            total += bilinear(history, at_x, at_y) * (across * down)[..., None]
    return total


def beside_nearest(velocity: Array, depth: Array) -> Array:
    """Step 2."""
    row, column = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    nearest = np.full(depth.shape, np.inf)
    motion = fetch(velocity, column - 1, row - 1, "zero")
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            there = fetch(depth[..., None].astype(np.float64), column + dx, row + dy)[..., 0]
            nearer = there < nearest
            nearest = np.where(nearer, there, nearest)
            motion = np.where(nearer[..., None], fetch(velocity, column + dx - 1, row + dy - 1, "zero"), motion)
    return motion


def clipped(history: Array, current: Array, velocity: Array) -> Array:
    """Step 4."""
    texels = square(rgb_to_ycocg(current))
    weights = [1 / (1 + t[..., :1]) for t in texels]
    total = sum(weights[1:], weights[0])
    mean = sum((w * t for w, t in zip(weights, texels, strict=True)), np.zeros_like(current)) / total
    squares = sum((w * t * t for w, t in zip(weights, texels, strict=True)), np.zeros_like(current)) / total
    speed = np.abs(velocity).max(-1, keepdims=True) / (NARROW_FROM * current.shape[1])
    scale = NARROWEST + (1 - NARROWEST) * np.maximum(1 - speed, 0)
    extent = np.maximum(np.sqrt(np.abs(squares - mean * mean)) * scale, 1e-15)
    way = rgb_to_ycocg(history) - mean
    far = np.abs(way / extent).max(-1, keepdims=True)
    return ycocg_to_rgb(mean + way / np.maximum(far, 1))


def resolve(frames: Iterable[Frame]) -> list[Array]:
    """The resolved images [H, W, 3 or 4] of ``frames``."""
    images: list[Array] = []
    previous: Frame | None = None
    history = count = np.empty(0)
    for frame in frames:
        current = frame.colour.astype(np.float64)
        if previous is None or starts_anew(frame, previous):
            history, count = current, np.zeros(current.shape[:2])
        else:
            velocity = beside_nearest(velocity_buffer(frame, previous), frame.depth)
            x, y = pixel_centres(frame.height, frame.width)
            x, y = x + velocity[..., 0], y + velocity[..., 1]
            off_screen = (x < 0) | (y < 0) | (x > frame.width) | (y > frame.height)
            now = current / (1 + current)
            past = nine_taps(history, x, y)
            past = clipped(past / (1 + np.maximum(past, 0)), now, velocity)
            count = np.where(off_screen, 0.0, bilinear(count[..., None], x, y)[..., 0])
            lumas = rgb_to_ycocg(now)[..., 0], rgb_to_ycocg(past)[..., 0]
            alike = 1 - np.abs(lumas[0] - lumas[1]) / np.maximum(np.maximum(*lumas), KNEE)
            weight = np.where(off_screen, 1.0, alike * alike / (count + 1))
            mixed = np.maximum(past + (now - past) * weight[..., None], 0)
            history, count = mixed / (1 - mixed), np.minimum(count + 1, MOST_SAMPLES)
        alpha = [] if frame.alpha is None else [frame.alpha[..., None]]
        images.append(np.concatenate([history, *alpha], axis=-1))
        previous = frame
    return images
