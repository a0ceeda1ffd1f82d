"""Synthetic frames to time on: content that no cache or compiler can guess, and two kinds of camera motion."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from cltaa.frame import Camera, Effect, Frame, Image

DISTANCE = 5.0  # of the plane that is seen, scene units
SHIFT_PX = (0.37, -0.61)  # uniform motion, pixels a frame
TURN_RADIANS = 0.01  # rotation about the viewing axis, a frame
ZOOM = 1.004  # of the focal length, a frame
SCALE = 1.0 / np.tan(np.radians(60.0) / 2)
STEPS = 8  # in depth, over the picture's width
EFFECTS = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.HDR})


class Motion(StrEnum):
    """How the camera moves: what a CPU's vector loads depend on."""

    UNIFORM = "uniform"  # along a plane that it faces: one displacement for all pixels
    TURN = "turn"  # rotation about the viewing axis with a zoom: another one at every pixel


def camera_at(index: int, motion: Motion, width: int, height: int) -> Camera:
    """The camera of frame ``index``."""
    view, zoom = np.eye(4), 1.0
    if motion is Motion.UNIFORM:
        # A plane at DISTANCE moves by focal length / DISTANCE a unit of travel.
        metre = np.array([SCALE * height / width * width / 2, SCALE * height / 2]) / DISTANCE
        view[:2, 3] = np.array(SHIFT_PX) / metre * index
    else:
        angle = TURN_RADIANS * index
        view[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        zoom = ZOOM**index
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = zoom * SCALE * height / width, zoom * SCALE
    clip[2, 2], clip[2, 3], clip[3, 2] = -1.0, -0.2, -1.0
    return Camera(world_to_view=view, view_to_clip=clip)


def make_frames(width: int, height: int, motion: Motion, count: int = 3) -> list[Frame]:
    """``count`` frames: smooth waves, noise from frame to frame, some bright pixels; depth in steps where it may vary.

    Under ``UNIFORM`` motion the depth is one plane, else the displacement would vary with it.
    """
    random = np.random.default_rng(0)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    waves = 1.0 + 0.5 * np.sin(x[..., None] / np.array([7.0, 11.0, 13.0], np.float32))
    waves *= 1.0 + 0.4 * np.cos(y[..., None] / np.array([5.0, 9.0, 17.0], np.float32))
    depth = np.full((height, width), DISTANCE, np.float32)
    if motion is Motion.TURN:
        # Slanted, so that no two neighbours are equally near and which of them leads is no matter of order.
        depth += np.floor(x * STEPS / width) + np.float32(0.17) * x / width + np.float32(0.1) * y / height
    return [_frame(index, motion, waves.astype(np.float32), depth, random) for index in range(count)]


def _frame(index: int, motion: Motion, waves: Image, depth: Image, random: np.random.Generator) -> Frame:
    height, width = depth.shape
    colour = waves * (0.75 + 0.5 * random.random((height, width, 1), dtype=np.float32))
    colour[random.random((height, width)) < 1e-4] *= 50.0
    jitter = tuple(random.random(2) - 0.5)
    return Frame(
        index=index,
        colour=np.moveaxis(np.ascontiguousarray(np.moveaxis(colour, -1, 0)), 0, -1),
        depth=depth,
        camera=camera_at(index, motion, width, height),
        jitter_px=(float(jitter[0]), float(jitter[1])),
        scene=f"bench {motion}",
        effects=EFFECTS,
    )
