"""Blends of shapes, skins and swarms against motions that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa_datasets import animation, deform, meshes, swarms
from cltaa_datasets.scene import Shape

U = 2.0**-53
# Four products of float64 numbers of size 3 at most, summed: no more than 16 roundings of 3. Worst seen 1.3e-15.
ROUNDED = 16 * 3.0 * U


@pytest.fixture(scope="module")
def ball() -> Shape:
    mesh = meshes.sphere(1.0, cells=8)
    return Shape(np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals))


def test_a_morph_of_no_weight_is_the_rest(ball: Shape) -> None:
    shape = deform.morphed(ball, (ball,), (0.0,))
    assert np.array_equal(shape.positions, ball.positions)
    assert np.abs(shape.normals - ball.normals).max() <= ROUNDED


def test_a_morph_adds_displacements(ball: Shape) -> None:
    aside = Shape(np.tile([0.0, 2.0, 0.0], (len(ball.positions), 1)), np.zeros_like(ball.normals))
    grown = Shape(ball.positions, np.zeros_like(ball.normals))
    shape = deform.morphed(ball, (aside, grown), (0.5, 0.25))
    assert np.abs(shape.positions - (1.25 * ball.positions + [0.0, 1.0, 0.0])).max() <= ROUNDED
    assert np.abs(np.linalg.norm(shape.normals, axis=1) - 1.0).max() <= ROUNDED


def test_a_skin_whose_joints_move_alike_moves_rigidly(ball: Shape) -> None:
    pose = animation.translation((1.0, -1.0, 0.5)) @ animation.rotation((1.0, 2.0, 0.3), 0.7)
    rng = np.random.default_rng(0)
    weights = rng.random((len(ball.positions), 3))
    weights /= weights.sum(axis=1, keepdims=True)
    shape = deform.skinned(ball, rng.integers(0, 4, weights.shape), weights, [pose] * 4)
    assert np.abs(shape.positions - (ball.positions @ pose[:3, :3].T + pose[:3, 3])).max() <= ROUNDED
    assert np.abs(shape.normals - ball.normals @ pose[:3, :3].T).max() <= ROUNDED


def test_a_skinned_normal_stays_square_to_its_surface(ball: Shape) -> None:
    # One joint squeezes: tangents follow the matrix, normals its inverse transpose.
    squeeze = np.diag([0.3, 2.0, 1.0, 1.0])
    shape = deform.skinned(ball, np.zeros((len(ball.positions), 1), int), np.ones((len(ball.positions), 1)), [squeeze])
    tangents = np.cross(ball.normals, [0.3, 0.5, 0.8]) @ squeeze[:3, :3].T
    assert np.abs((tangents * shape.normals).sum(axis=1)).max() <= ROUNDED


def test_no_body_of_a_swarm_jumps_while_it_is_seen() -> None:
    speeds = np.full(3, -1.0), np.full(3, 1.0)
    path = swarms.fountain(
        np.random.default_rng(1),
        200,
        life=0.8,
        rest=0.1,
        speeds=speeds,
        pull=np.array([0.0, -9.8, 0.0]),
        growth=0.3,
        size=0.01,
    )
    jumped = 0
    for frame in range(1, 60):
        (before, smaller), (now, size) = path((frame - 1) / 30.0), path(frame / 30.0)
        far = np.linalg.norm(now - before, axis=1) > (np.sqrt(3.0) + 9.8 * 0.8) / 30.0  # fastest possible
        jumped += int(far.sum())
        assert not (far & ((size > 0.0) & (smaller > 0.0))).any()
        assert not (far & (size > 0.0)).any()  # the frame in which it is seen first knows where it was
    assert jumped > 100
