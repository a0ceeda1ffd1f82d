"""Procedural meshes with normals and texture coordinates, in repeats of the texture; v grows upwards, as in trimesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import TextureVisuals

from cltaa_datasets.animation import translation
from cltaa_datasets.scene import Matrix, Vector

Floats = NDArray[np.float64]
SurfacePoint = Callable[[Floats, Floats], Floats]
Curve = Callable[[Floats], Floats]

# Half-width of the central difference for a surface's tangents, in units of its parameter.
TANGENT_STEP = 1e-5
# Distance from the ends of the parameter, where a tangent may vanish (the pole of a sphere).
POLE_MARGIN = 1e-4

# Most repeats of a texture before coordinates have no fractions in float32.
MOST_REPEATS = 2.0**24


def make_mesh(vertices: Floats, faces: NDArray[np.int64], normals: Floats, uv: Floats) -> trimesh.Trimesh:
    """Build a mesh without merging vertices: [V, 3], [F, 3], [V, 3], [V, 2]."""
    return trimesh.Trimesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=normals,
        visual=TextureVisuals(uv=uv),  # type: ignore[no-untyped-call]
        process=False,
    )


def texture_coordinates(mesh: trimesh.Trimesh) -> Floats:
    """Return a mesh's texture coordinates [V, 2]; [0, 2] if it has none."""
    uv = getattr(mesh.visual, "uv", None)
    return np.empty((0, 2)) if uv is None else np.asarray(uv, np.float64)


def merge(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Join meshes of one material into one mesh."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return make_mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.vertex_normals for mesh in meshes]),
        np.concatenate([texture_coordinates(mesh) for mesh in meshes]),
    )


def moved(mesh: trimesh.Trimesh, pose: Matrix) -> trimesh.Trimesh:
    """Return a copy of a mesh under a rigid (or uniformly scaled) pose."""
    turn = pose[:3, :3] / np.cbrt(np.linalg.det(pose[:3, :3]))
    return make_mesh(
        mesh.vertices @ pose[:3, :3].T + pose[:3, 3],
        mesh.faces,
        mesh.vertex_normals @ turn.T,
        texture_coordinates(mesh),
    )


def placed(mesh: trimesh.Trimesh, place: Vector) -> trimesh.Trimesh:
    """Return a copy of a mesh moved by ``place``."""
    return moved(mesh, translation(place))


def surface(point: SurfacePoint, across: int, along: int, repeats: tuple[float, float] = (1.0, 1.0)) -> trimesh.Trimesh:
    """Build the mesh of a surface ``point(u, v) -> [..., 3]``, u and v in [0, 1], in ``across`` by ``along`` cells.

    From the front, u turns to v anticlockwise; normals are dp/du x dp/dv by central differences.
    """
    u, v = np.meshgrid(np.linspace(0.0, 1.0, across + 1), np.linspace(0.0, 1.0, along + 1))
    vertices = point(u, v).reshape(-1, 3)
    inner_u, inner_v = (np.clip(parameter, POLE_MARGIN, 1.0 - POLE_MARGIN) for parameter in (u, v))
    tangent_u = point(inner_u + TANGENT_STEP, inner_v) - point(inner_u - TANGENT_STEP, inner_v)
    tangent_v = point(inner_u, inner_v + TANGENT_STEP) - point(inner_u, inner_v - TANGENT_STEP)
    normals = np.cross(tangent_u, tangent_v).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    index = np.arange((across + 1) * (along + 1)).reshape(along + 1, across + 1)
    corners = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return make_mesh(vertices, faces, normals, np.stack([u.ravel() * repeats[0], v.ravel() * repeats[1]], 1))


def sheet(
    corner: Vector | Floats,
    along_u: Vector | Floats,
    along_v: Vector | Floats,
    repeats: tuple[float, float] = (1.0, 1.0),
    cells: int = 1,
) -> trimesh.Trimesh:
    """Build a flat parallelogram from ``corner`` along two edges; it faces ``along_u x along_v``."""
    origin, edge_u, edge_v = (np.asarray(vector, np.float64) for vector in (corner, along_u, along_v))
    return surface(lambda u, v: origin + u[..., None] * edge_u + v[..., None] * edge_v, cells, cells, repeats)


def floor(half_size: float, repeat: float, cells: int = 16) -> trimesh.Trimesh:
    """Build a horizontal square about the origin, facing up; the texture repeats every ``repeat`` metres."""
    size = 2.0 * half_size
    times = size / repeat
    return sheet((-half_size, 0.0, half_size), (size, 0.0, 0.0), (0.0, 0.0, -size), (times, times), cells)


def box(size: Vector, repeat: float | None = None) -> trimesh.Trimesh:
    """Build a box about the origin; the texture fills each side once, or repeats every ``repeat`` metres."""
    sides = []
    half = np.asarray(size, np.float64) / 2.0
    for axis in range(3):
        for sign in (1.0, -1.0):
            # Upright sides keep the texture upright: u is horizontal, v is up.
            edge_v = np.zeros(3)
            edge_v[1 if axis != 1 else 2] = 2.0 * half[1 if axis != 1 else 2] * (1.0 if axis != 1 else -sign)
            outward = np.zeros(3)
            outward[axis] = sign
            edge_u = np.cross(edge_v, outward)
            edge_u *= 2.0 * float(np.abs(edge_u / np.linalg.norm(edge_u)) @ half) / np.linalg.norm(edge_u)
            corner = outward * half - edge_u / 2.0 - edge_v / 2.0
            lengths = np.linalg.norm(edge_u), np.linalg.norm(edge_v)
            times = (1.0, 1.0) if repeat is None else (float(lengths[0] / repeat), float(lengths[1] / repeat))
            sides.append(sheet(corner, edge_u, edge_v, times))
    return merge(sides)


def sphere(radius: float, repeats: tuple[float, float] = (2.0, 1.0), cells: int = 48) -> trimesh.Trimesh:
    """Build a sphere about the origin, poles on the y axis."""

    def point(u: Floats, v: Floats) -> Floats:
        around, up = 2.0 * np.pi * u, np.pi * (v - 0.5)
        return radius * np.stack([np.sin(around) * np.cos(up), np.sin(up), np.cos(around) * np.cos(up)], -1)

    return surface(point, 2 * cells, cells, repeats)


def cylinder(radius: float, height: float, repeats: tuple[float, float]) -> trimesh.Trimesh:
    """Build an open cylinder on the origin."""

    def point(u: Floats, v: Floats) -> Floats:
        around = 2.0 * np.pi * u
        return np.stack([radius * np.sin(around), height * v, radius * np.cos(around)], -1)

    return surface(point, 32, 4, repeats)


def torus(ring: float, tube: float) -> trimesh.Trimesh:
    """Build a torus about the y axis: ``ring`` is the radius of its centre line, ``tube`` that of its section."""

    def point(u: Floats, v: Floats) -> Floats:
        around, over = 2.0 * np.pi * u, 2.0 * np.pi * v
        reach = ring + tube * np.cos(over)
        return np.stack([reach * np.sin(around), tube * np.sin(over), reach * np.cos(around)], -1)

    return surface(point, 96, 32, (6.0, 2.0))


def tube(path: Curve, aside: Curve, radius: float, cells: int, sides: int = 6) -> trimesh.Trimesh:
    """Build a round bar along ``path(s) -> [..., 3]``, s in [0, 1]; ``aside(s)`` is never parallel to the path."""

    def point(u: Floats, v: Floats) -> Floats:
        tangent = path(u + TANGENT_STEP) - path(u - TANGENT_STEP)
        tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
        side = np.cross(tangent, aside(u))
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        turn = 2.0 * np.pi * v[..., None]
        return path(u) + radius * (np.cos(turn) * side + np.sin(turn) * np.cross(side, tangent))

    return surface(point, cells, sides)


def bar(start: Vector, end: Vector, radius: float, sides: int = 6) -> trimesh.Trimesh:
    """Build a straight round bar between two points."""
    first, last = np.asarray(start, np.float64), np.asarray(end, np.float64)
    # The axis of the bar's least extent is never parallel to it.
    aside = np.eye(3)[np.argmin(np.abs(last - first))]
    return tube(lambda s: first + s[..., None] * (last - first), lambda _: aside, radius, 1, sides)


def knot(radius: float, thickness: float) -> trimesh.Trimesh:
    """Build a (2, 3) torus knot about the origin."""

    def path(s: Floats) -> Floats:
        turn = 2.0 * np.pi * s
        reach = radius * (2.0 + np.cos(3.0 * turn)) / 3.0
        return np.stack([reach * np.cos(2.0 * turn), radius * np.sin(3.0 * turn) / 2.0, reach * np.sin(2.0 * turn)], -1)

    # The path itself serves as ``aside``: a torus knot never runs towards its centre.
    mesh = tube(path, path, thickness, 240, 24)
    return make_mesh(mesh.vertices, mesh.faces, mesh.vertex_normals, texture_coordinates(mesh) * (18.0, 2.0))
