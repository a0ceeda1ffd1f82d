"""Scenes whose pictures can be worked out by hand: flat quads, no texture or flat colour, and a ray tracer for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.frame import Effect
from cltaa_capture.cameras import view_to_clip
from cltaa_capture.osmesa import open_context
from cltaa_datasets import meshes
from cltaa_datasets.scene import Instant, Lens, Light, Material, Matrix, Orthographic, Part, Perspective, Scene, Sky

if TYPE_CHECKING:
    from cltaa_capture.render import SceneRenderer

WIDTH, HEIGHT = 48, 32
LENS = Perspective(field_of_view=np.radians(60.0), near=0.1)
# One unit a pixel, picture centre at the origin: what is at (x, y) is drawn at pixel (x + WIDTH / 2, HEIGHT / 2 - y).
PIXELS = Orthographic(half_height=HEIGHT / 2.0, near=1.0, far=9.0)
WHITE = Material(base_colour=(0.0, 0.0, 0.0, 1.0), specular=0.0, emissive=(1.0, 1.0, 1.0), double_sided=True)


def quad(half: float = 1.0) -> trimesh.Trimesh:
    """Square in the plane z = 0 about the origin, facing +z."""
    return meshes.sheet((-half, -half, 0.0), (2.0 * half, 0.0, 0.0), (0.0, 2.0 * half, 0.0))


def place(x: float, y: float, z: float) -> Matrix:
    """Translation."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def instant(
    *poses: Matrix,
    lens: Lens = PIXELS,
    view: Matrix | None = None,
    lights: tuple[Light, ...] = (),
    sky: Sky | None = None,
) -> Instant:
    """An instant seen from z = 5 (parallel lens) or from the origin, along -z, unless ``view`` says otherwise."""
    default = place(0.0, 0.0, -5.0) if isinstance(lens, Orthographic) else np.eye(4)
    return Instant(default if view is None else view, lens, poses, lights, sky)


def scene(at: Callable[[float], Instant], *parts: tuple[trimesh.Trimesh, Material], effects: str = "") -> Scene:
    """A scene of some meshes; ``effects`` separated by spaces."""
    named = tuple(Part(f"part {i}", mesh, material) for i, (mesh, material) in enumerate(parts))
    return Scene("analytic", frozenset(map(Effect, effects.split())), named, at)


@contextmanager
def drawing(what: Scene, width: int = WIDTH, height: int = HEIGHT) -> Iterator[SceneRenderer]:
    """A renderer with a context of its own."""
    context = open_context()
    from cltaa_capture.render import SceneRenderer

    renderer = SceneRenderer(what, width, height)
    try:
        yield renderer
    finally:
        renderer.delete()
        context.close()


def sample_ndc(
    jitter: tuple[float, float] = (0.0, 0.0), width: int = WIDTH, height: int = HEIGHT
) -> NDArray[np.float64]:
    """Un-jittered NDC [H, W, 2] of every pixel's sample: pixel (x, y) at (x + 0.5 + jx, y + 0.5 + jy), y down."""
    x, y = np.meshgrid(np.arange(width) + 0.5 + jitter[0], np.arange(height) + 0.5 + jitter[1])
    return np.stack([2.0 * x / width - 1.0, 1.0 - 2.0 * y / height], -1)


def seen_points(
    pose: Matrix,
    view: Matrix,
    lens: Lens,
    jitter: tuple[float, float] = (0.0, 0.0),
    width: int = WIDTH,
    height: int = HEIGHT,
) -> NDArray[np.float64]:
    """Where every pixel's ray meets the plane z = 0 of a model: model coordinates [H, W, 4], float64.

    From (clip) = M (x, y, 0, 1): the rows x - ndc_x w = 0 and y - ndc_y w = 0 are two linear equations in x and y.
    """
    matrix = view_to_clip(lens, width / height) @ view @ pose
    ndc = sample_ndc(jitter, width, height)
    rows = matrix[:2] - ndc[..., None] * matrix[3]  # [H, W, 2, 4]
    xy = np.linalg.solve(rows[..., :2], -rows[..., 3:])[..., 0]
    return np.concatenate([xy, np.zeros_like(xy[..., :1]), np.ones_like(xy[..., :1])], -1)


def to_pixels(
    points: NDArray[np.float64], pose: Matrix, view: Matrix, lens: Lens, width: int = WIDTH, height: int = HEIGHT
) -> NDArray[np.float64]:
    """Project model points [H, W, 4] to pixel coordinates [H, W, 2], y down."""
    clip = points @ (view_to_clip(lens, width / height) @ view @ pose).T
    ndc = clip[..., :2] / clip[..., 3:]
    return np.stack([(ndc[..., 0] + 1.0) * width / 2.0, (1.0 - ndc[..., 1]) * height / 2.0], -1)
