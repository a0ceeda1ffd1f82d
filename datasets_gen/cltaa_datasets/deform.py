"""Deforming meshes: morph targets and skinning, float64, as glTF 2.0 defines them (sections 3.7.2.2 and 3.7.3.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cltaa.printable import counted
from cltaa_datasets.scene import Matrix, Shape

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


def morphed(rest: Shape, targets: Sequence[Shape], weights: Sequence[float]) -> Shape:
    """Add the weighted ``targets``, displacements of every vertex and normal, to ``rest``.

    Raises ValueError for another number of weights.
    """
    if len(weights) != len(targets):
        raise ValueError(f"{counted(len(weights), 'weight')} for {counted(len(targets), 'morph target')}")
    positions, normals = rest.positions.copy(), rest.normals.copy()
    for target, weight in zip(targets, weights, strict=True):
        positions += weight * target.positions
        normals += weight * target.normals
    return Shape(positions, unit(normals))


def skinned(rest: Shape, joints: Indices, weights: Floats, joint_matrices: Sequence[Matrix]) -> Shape:
    """Apply linear blend skinning.

    ``joints`` and ``weights`` [V, K] are the matrices (rest pose to posed, [4, 4] each) that move each vertex, and
    their weights, which sum to one. Normals use the inverse transpose of the blended matrix.
    """
    blended = np.einsum("vk,vkij->vij", weights, np.stack(joint_matrices)[joints])
    positions = np.einsum("vij,vj->vi", blended[:, :3, :3], rest.positions) + blended[:, :3, 3]
    a, b, c = (blended[:, row, :3] for row in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
    return Shape(positions, unit(np.einsum("vij,vj->vi", cofactors, rest.normals)))


def unit(vectors: Floats) -> Floats:
    """Normalise vectors [N, 3]; a zero vector becomes +z."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, vectors / np.where(length > 0.0, length, 1.0), (0.0, 0.0, 1.0))
