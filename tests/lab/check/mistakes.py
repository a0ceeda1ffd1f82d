"""Mistakes that writers of sequences make, planted into correct frames; under the detector's names.

``MISTAKES[name] = (scenes that can show it, plant)``; ``plant(frames)`` returns the spoilt frames. What would be a
mistake of the pixels is planted into the declaration, which is the same disagreement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cltaa.camera import displacement, is_still, reprojected
from cltaa.camera import inverse_depth as planar_inverse_depth
from cltaa.frame import Camera, Frame, Image
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.registration import Shot
from cltaa.lab.check.report import check_frames
from cltaa.lab.check.unverifiable import unverifiable

Frames = Sequence[Frame]
Plant = Callable[[Frames], list[Frame]]


class Mistake(NamedTuple):
    """Scenes in which the mistake can be seen, and how to make it."""

    scenes: tuple[str, ...]
    plant: Plant


def found_in(frames: Frames, **told: Any) -> list[Finding]:
    """Return the mistakes that the check finds in ``frames``."""
    return [finding for finding in check_frames(frames, **told) if finding.mistake]


def mistakes(frames: Frames, **told: Any) -> list[str]:
    """Return the names of the mistakes that the check finds in ``frames``."""
    return [finding.name for finding in found_in(frames, **told)]


def not_told(frames: Frames) -> list[str]:
    """Return the lines about what the check cannot verify."""
    return unverifiable(Shot(frames, (frames[0].width, frames[0].height)))


def each(change: Callable[[Frame], Frame]) -> Plant:
    return lambda frames: [change(frame) for frame in frames]


def jitter(matrix: object, offset: tuple[float, float] = (0.0, 0.0)) -> Plant:
    def change(frame: Frame) -> Frame:
        x, y = np.array(matrix, float) @ frame.jitter_px + offset
        return replace(frame, jitter_px=(float(x), float(y)))

    return each(change)


def jitter_delayed(by: int) -> Plant:
    def plant(frames: Frames) -> list[Frame]:
        return [replace(f, jitter_px=frames[(n - by) % len(frames)].jitter_px) for n, f in enumerate(frames)]

    return plant


def motion(matrix: object, offset: float = 0.0) -> Plant:
    """Declare vectors = matrix @ true + offset."""

    def change(frame: Frame) -> Frame:
        assert frame.motion is not None
        spoilt = frame.motion.astype(np.float64) @ np.array(matrix, float).T + offset
        return replace(frame, motion=spoilt.astype(np.float32))

    return each(change)


def motion_in(unit: Callable[[Frame], tuple[float, float]], offset: float = 0.0) -> Plant:
    def plant(frames: Frames) -> list[Frame]:
        return motion(np.diag(1.0 / np.array(unit(frames[0]), float)), offset)(frames)

    return plant


def uv(frame: Frame) -> tuple[float, float]:
    return frame.width, frame.height


def ndc(frame: Frame) -> tuple[float, float]:
    return frame.width / 2, -frame.height / 2


def motion_jittered(sign: float) -> Plant:
    def plant(frames: Frames) -> list[Frame]:
        out = []
        for n, frame in enumerate(frames):
            assert frame.motion is not None
            change = np.subtract(frame.jitter_px, frames[max(n - 1, 0)].jitter_px)
            out.append(replace(frame, motion=(frame.motion + sign * change).astype(np.float32)))
        return out

    return plant


def full_motion(frames: Frames) -> list[Frame]:
    """Fill every vector in, as most renderers write them."""
    out = []
    for n, frame in enumerate(frames):
        vectors = camera_motion(frame, frames[max(n - 1, 0)].camera)
        if frame.motion is not None:
            vectors = np.where(np.isfinite(frame.motion), frame.motion, vectors)
        out.append(replace(frame, motion=vectors.astype(np.float32)))
    return out


def motion_delayed(frames: Frames) -> list[Frame]:
    """Give each frame the vectors of the one before."""
    return [replace(frame, motion=frames[max(n - 1, 0)].motion) for n, frame in enumerate(frames)]


def camera_motion(frame: Frame, previous: Camera) -> Image:
    """Motion [H, W, 2] by matrices and depth alone."""
    if is_still(frame.camera, previous):
        return np.zeros((frame.height, frame.width, 2), np.float32)
    near = np.empty((frame.height, frame.width), np.float32)
    planar_inverse_depth(frame.depth, near, parallel=frame.camera.orthographic)
    y, x = np.mgrid[: frame.height, : frame.width].astype(np.float64)
    px, py = x + 0.5 + frame.jitter_px[0] - frame.width / 2, y + 0.5 + frame.jitter_px[1] - frame.height / 2
    moved = displacement(frame.camera, previous, frame.width, frame.height)
    u, v, _, visible = reprojected(px, py, near.astype(np.float64), moved, parallel=False)
    return np.where(visible[..., None], np.stack([u, v], -1), np.nan).astype(np.float32)


def then(*plants: Plant) -> Plant:
    def plant(frames: Frames) -> list[Frame]:
        for one in plants:
            frames = one(frames)
        return list(frames)

    return plant


def depth(change: Callable[[Frame, Image], Image]) -> Plant:
    def spoil(frame: Frame) -> Frame:
        with np.errstate(divide="ignore", over="ignore"):
            return replace(frame, depth=change(frame, frame.depth).astype(np.float32))

    return each(spoil)


def ray_distance(frame: Frame, plane: Image) -> Image:
    y, x = np.mgrid[: frame.height, : frame.width]
    n_x = (x + 0.5 + frame.jitter_px[0]) / frame.width * 2 - 1
    n_y = 1 - (y + 0.5 + frame.jitter_px[1]) / frame.height * 2
    clip = frame.camera.view_to_clip
    return np.asarray(plane * np.sqrt(1 + (n_x / clip[0, 0]) ** 2 + (n_y / clip[1, 1]) ** 2), np.float32)


def device_depth(_: Frame, plane: Image) -> Image:
    return np.minimum((1 / NEAR - 1 / plane) / (1 / NEAR - 1 / FAR), 1).astype(np.float32)


def near_plane(frame: Frame) -> float:
    clip = frame.camera.view_to_clip
    return float(clip[2, 3] / (clip[2, 2] - 1.0))


def camera(change: Callable[[Camera], Camera]) -> Plant:
    return each(lambda frame: replace(frame, camera=change(frame.camera)))


def left_handed(c: Camera) -> Camera:
    """As Direct3D has it."""
    return Camera(FLIP_Z @ c.world_to_view @ FLIP_Z, c.view_to_clip @ FLIP_Z)


def camera_delayed(by: int) -> Plant:
    def plant(frames: Frames) -> list[Frame]:
        last = len(frames) - 1
        return [replace(f, camera=frames[min(max(n - by, 0), last)].camera) for n, f in enumerate(frames)]

    return plant


def camera_jittered(frame: Frame) -> Frame:
    shift = np.eye(4)
    shift[0, 3], shift[1, 3] = -2 * frame.jitter_px[0] / frame.width, 2 * frame.jitter_px[1] / frame.height
    return replace(frame, camera=Camera(frame.camera.world_to_view, shift @ frame.camera.view_to_clip))


def colour(change: Callable[[Image], Image]) -> Plant:
    return each(lambda frame: replace(frame, colour=change(frame.colour).astype(np.float32)))


def srgb(linear: Image) -> Image:
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055).astype(np.float32)


SWAP = [[0, 1], [1, 0]]
NEAR, FAR = 0.1, 200.0
EVERY = ("corridor", "occluder", "spinner", "still")
MOVING = ("occluder", "spinner")  # things move
TRAVEL = ("corridor", "orbit")  # the camera moves
FLIP_Z, FLIP_Y = np.diag([1.0, 1, -1, 1]), np.diag([1.0, -1, 1, 1])

MISTAKES: dict[str, Mistake] = {
    "jitter-negated": Mistake(EVERY, jitter(-np.eye(2))),
    "jitter-x-negated": Mistake(EVERY, jitter(np.diag([-1, 1]))),
    "jitter-y-flipped": Mistake(EVERY, jitter(np.diag([1, -1]))),
    "jitter-swapped": Mistake(EVERY, jitter(SWAP)),
    "jitter-scaled-0.5": Mistake(EVERY, jitter(2 * np.eye(2))),
    "jitter-scaled-2": Mistake(EVERY, jitter(0.5 * np.eye(2))),
    "jitter-units-uv": Mistake(EVERY, lambda f: jitter(np.diag(1 / np.array(uv(f[0]))))(f)),
    "jitter-units-ndc": Mistake(EVERY, lambda f: jitter(np.diag(1 / np.array(ndc(f[0]))))(f)),
    "jitter-missing": Mistake(EVERY, jitter(np.zeros((2, 2)))),
    "jitter-late": Mistake(EVERY, jitter_delayed(1)),
    "jitter-biased": Mistake(EVERY, jitter(np.eye(2), (0.5, 0.5))),
    "motion-negated": Mistake(MOVING, motion(-np.eye(2))),
    "motion-x-negated": Mistake(("spinner",), motion(np.diag([-1, 1]))),
    "motion-y-flipped": Mistake(("spinner",), motion(np.diag([1, -1]))),
    "motion-swapped": Mistake(MOVING, motion(SWAP)),
    "motion-scaled-0.5": Mistake(MOVING, motion(2 * np.eye(2))),
    "motion-scaled-2": Mistake(MOVING, motion(0.5 * np.eye(2))),
    "motion-scaled-0.25": Mistake(MOVING, motion(4 * np.eye(2))),
    "motion-scaled-0.125": Mistake(MOVING, motion(8 * np.eye(2))),
    "motion-scaled-0.25-negated": Mistake(MOVING, motion(-4 * np.eye(2))),
    "motion-scaled-4": Mistake(MOVING, motion(0.25 * np.eye(2))),
    "motion-units-uv": Mistake(MOVING, motion_in(uv)),
    "motion-units-ndc": Mistake(MOVING, motion_in(ndc)),
    "motion-swapped-units-uv": Mistake(MOVING, then(motion_in(uv), motion(SWAP))),
    "motion-swapped-units-ndc": Mistake(MOVING, then(motion_in(ndc), motion(SWAP))),
    "motion-centred-on-half-uv": Mistake(MOVING, motion_in(uv, 0.5)),
    "motion-jittered": Mistake((*TRAVEL, *MOVING), then(full_motion, motion_jittered(1.0))),
    "motion-jittered-reversed": Mistake(MOVING[::-1], motion_jittered(-1.0)),
    "depth-inverse": Mistake(("corridor", "still"), depth(lambda _, z: (1 / z).astype(np.float32))),
    "depth-device": Mistake(EVERY, depth(device_depth)),
    "depth-device-reversed": Mistake(TRAVEL, depth(lambda f, z: near_plane(f) / z)),
    "depth-ray": Mistake(EVERY, depth(ray_distance)),
    "depth-negative": Mistake(EVERY, depth(lambda _, z: -z)),
    "depth-scaled": Mistake(("corridor", "orbit"), depth(lambda _, z: 100 * z)),
    "camera-transposed": Mistake(EVERY, camera(lambda c: Camera(c.world_to_view.T, c.view_to_clip.T))),
    "camera-inverse": Mistake(
        TRAVEL, camera(lambda c: Camera(np.linalg.inv(c.world_to_view).astype(float), c.view_to_clip))
    ),
    "camera-z-forward": Mistake(EVERY, camera(lambda c: Camera(FLIP_Z @ c.world_to_view, c.view_to_clip))),
    "camera-mirrored": Mistake(TRAVEL, camera(lambda c: Camera(c.world_to_view @ FLIP_Z, c.view_to_clip))),
    "camera-left-handed": Mistake(TRAVEL, camera(left_handed)),
    "camera-transposed-left-handed": Mistake(
        TRAVEL, camera(lambda c: Camera(left_handed(c).world_to_view.T, left_handed(c).view_to_clip.T))
    ),
    "camera-transposed-z-forward-projection": Mistake(
        TRAVEL, camera(lambda c: Camera((FLIP_Z @ c.world_to_view).T, (c.view_to_clip @ FLIP_Z).T))
    ),
    "camera-y-flipped": Mistake(("orbit",), camera(lambda c: Camera(c.world_to_view, FLIP_Y @ c.view_to_clip))),
    "camera-late": Mistake(("dolly",), camera_delayed(1)),
    "camera-jittered": Mistake(EVERY, each(camera_jittered)),
    "colour-encoded": Mistake(EVERY, colour(srgb)),
}
