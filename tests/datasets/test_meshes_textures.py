"""Meshes against volumes and directions known from geometry; textures against their encoding and their seams."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from cltaa_datasets import animation, meshes, textures
from cltaa_datasets.scene import Texture

# name -> mesh, volume of the ideal shape, largest share of it that flat facets may miss
CLOSED = {
    "box": (meshes.box((1.0, 2.0, 3.0)), 6.0, 1e-12),
    # Chords of angle t lie t^2 / 12 of their radius inside it on average; twice, for the chords of two directions,
    # times surface x radius / volume: 3 for the sphere, 2 for the section of the torus.
    "sphere": (meshes.sphere(2.0), 4.0 / 3.0 * np.pi * 8.0, 3.0 * 2.0 * (2.0 * np.pi / 96) ** 2 / 12.0),
    "torus": (meshes.torus(2.0, 0.5), 2.0 * np.pi**2 * 2.0 * 0.25, 2.0 * 2.0 * (2.0 * np.pi / 32) ** 2 / 12.0),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_enclose_their_volume_from_outside(name: str) -> None:
    mesh, volume, missing = CLOSED[name]
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    found = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0  # divergence theorem: negative if inside out
    assert volume * (1.0 - missing) <= found <= volume * (1.0 + 1e-12)


@pytest.mark.parametrize(
    "mesh",
    [meshes.box((1.0, 2.0, 3.0)), meshes.sphere(1.0), meshes.knot(1.0, 0.2), meshes.bar((0, 0, 0), (1, 2, 3), 0.1)],
)
def test_normals_are_of_unit_length_and_agree_with_the_faces(mesh: trimesh.Trimesh) -> None:
    normals = mesh.vertex_normals
    assert np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() <= 1e-12
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    area = np.linalg.norm(faces, axis=1)
    mean = normals[mesh.faces].mean(axis=1)
    assert np.all((faces * mean).sum(axis=1)[area > 1e-9] > 0.0)


def test_sphere_normals_point_away_from_the_centre() -> None:
    mesh = meshes.sphere(3.0)
    # At the ends of a parameter the tangent is taken 1e-4 of it away: 2 pi 1e-4 radians where it goes all around.
    assert np.abs(mesh.vertex_normals - mesh.vertices / 3.0).max() <= 2.0 * np.pi * 1.1e-4


def test_box_textures_stand_upright() -> None:
    mesh = meshes.box((1.0, 2.0, 3.0))
    sides = np.abs(mesh.vertex_normals[:, 1]) < 0.5
    uv = meshes.texture_coordinates(mesh)
    assert np.array_equal(uv[sides, 1] > 0.5, mesh.vertices[sides, 1] > 0.0)


def test_merged_meshes_keep_their_places() -> None:
    pose = animation.translation((5.0, 0.0, 0.0)) @ animation.rotation((0.0, 0.0, 1.0), np.pi / 2.0)
    mesh = meshes.merge([meshes.box((1.0, 1.0, 1.0)), meshes.moved(meshes.box((2.0, 4.0, 6.0)), pose)])
    assert np.abs(mesh.bounds - [[-0.5, -1.0, -3.0], [7.0, 1.0, 3.0]]).max() <= 1e-12


def test_look_at_turns_the_view_to_its_target() -> None:
    view = animation.look_at((1.0, 2.0, 3.0), (1.0, 2.0, -7.0))
    assert np.abs(view @ [1.0, 2.0, -7.0, 1.0] - [0.0, 0.0, -10.0, 1.0]).max() <= 1e-12
    assert np.abs(view @ [2.0, 3.0, 3.0, 1.0] - [1.0, 1.0, 0.0, 1.0]).max() <= 1e-12


def test_srgb_encoding_at_known_values() -> None:
    # 0.0031308 is where the curve's two pieces meet; 0.21404 is the linear value of code 127.5 (IEC 61966-2-1).
    linear = np.array([0.0, 0.0031308, 0.2140, 0.2141, 1.0, 7.0, -1.0])
    texels = textures.make_texture(np.broadcast_to(linear[:, None, None], (7, 1, 3))).texels
    assert texels[:, 0].tolist() == [[code, code, code, 255] for code in (0, 10, 127, 128, 255, 255, 0)]


RANDOM: dict[str, Callable[[np.random.Generator], Texture]] = {
    "blocks": lambda rng: textures.blocks(rng, (0.6, 0.3, 0.2), (0.5, 0.5, 0.5), 6, 12, 0.01),
    "planks": lambda rng: textures.planks(rng, (0.5, 0.3, 0.2)),
    "mottle": lambda rng: textures.mottle(rng, (0.1, 0.1, 0.1), (0.8, 0.8, 0.8)),
    "leaves": lambda rng: textures.leaves(rng, (0.0, 0.1, 0.0), (0.2, 0.4, 0.1)),
    "lettering": lambda rng: textures.lettering(rng, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "checker": lambda rng: textures.checker((0.9, 0.9, 0.9), (0.1, 0.1, 0.1), 8, rng),
}


def test_textures_follow_their_seed() -> None:
    for name in RANDOM:
        one, same, other = (RANDOM[name](np.random.default_rng(seed)).texels for seed in (3, 3, 4))
        assert one.shape == (textures.SIZE, textures.SIZE, 4), name
        assert one.flags.c_contiguous, name
        assert np.array_equal(one, same), name
        assert not np.array_equal(one, other), name


def test_an_enlarged_grid_is_the_spline_of_scipy() -> None:
    # Values up to 1 through about 30 roundings: of the filter's poles, and of four taps along each axis.
    grid = np.random.default_rng(0).random((3, 8))
    exact = ndimage.zoom(grid, (7, 5), order=3, mode="grid-wrap", grid_mode=True)
    assert np.abs(textures.enlarged(grid, 21, 40) - exact).max() <= 30 * np.finfo(float).eps


def test_noise_tiles_without_a_seam() -> None:
    field = textures.noise(np.random.default_rng(0), 4)
    for axis in (0, 1):
        steps = np.abs(np.diff(field, axis=axis, append=field[:1] if axis == 0 else field[:, :1]))
        seam = steps.take(-1, axis=axis)
        assert seam.mean() <= 2.0 * steps.mean()  # a seam of unrelated values would be tens of steps high
    assert (field.min(), field.max()) == (0.0, 1.0)


@pytest.mark.parametrize("texture", [textures.lattice((1.0, 1.0, 1.0)), RANDOM["leaves"](np.random.default_rng(0))])
def test_cut_outs_have_holes(texture: Texture) -> None:
    covered = (texture.texels[..., 3] >= 128).mean()
    assert 0.2 < covered < 0.9
