"""Rigid motion as 4x4 matrices, float64, column vectors: ``world = a @ b @ model`` applies ``b`` first."""

from __future__ import annotations

import numpy as np

from cltaa_datasets.scene import Matrix, Vector

UP: Vector = (0.0, 1.0, 0.0)
ON_BOUNDARY = 1e-6  # periods; tolerance for the rounding of frame times, which are quotients


def translation(offset: Vector) -> Matrix:
    """Return the translation by ``offset``."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def rotation(axis: Vector, angle: float) -> Matrix:
    """Return the rotation by ``angle`` radians about ``axis`` through the origin, right-handed (Rodrigues)."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return matrix


def scaling(factor: float) -> Matrix:
    """Return the uniform scaling by ``factor``."""
    return np.diag([factor, factor, factor, 1.0])


def look_at(eye: Vector, target: Vector, up: Vector = UP) -> Matrix:
    """Return ``world_to_view`` of a camera at ``eye`` that looks at ``target``; the view direction is -z."""
    position = np.asarray(eye, np.float64)
    backward = position - np.asarray(target, np.float64)
    backward /= np.linalg.norm(backward)
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(backward, right), backward])
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


def swing(time: float, period: float, phase: float = 0.0) -> float:
    """Return a sine between -1 and 1 with a ``period`` in seconds; ``phase`` in periods."""
    return float(np.sin(2.0 * np.pi * (time / period + phase)))


def whole_periods(time: float, period: float) -> int:
    """Return the number of whole periods passed; a time on a boundary counts as after it, despite rounding."""
    return int(np.floor(time / period + ON_BOUNDARY))


def direction(azimuth_degrees: float, elevation_degrees: float) -> Vector:
    """Return a unit vector: azimuth 0 is -z (into the picture), 90 is +x (right); elevation is above the ground."""
    azimuth, elevation = np.radians(azimuth_degrees), np.radians(elevation_degrees)
    return (
        float(np.sin(azimuth) * np.cos(elevation)),
        float(np.sin(elevation)),
        float(-np.cos(azimuth) * np.cos(elevation)),
    )
