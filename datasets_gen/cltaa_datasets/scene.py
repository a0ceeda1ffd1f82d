"""The data of a scene: parts that are uploaded once, and a function of time that returns their state.

Independent of the renderer. Lengths are metres, angles radians, colours linear Rec. 709, world y is up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from cltaa.frame import Effect

Colour = tuple[float, float, float]
Vector = tuple[float, float, float]
Matrix = NDArray[np.float64]
Texels = NDArray[np.uint8]


class AlphaMode(StrEnum):
    """How the base colour's alpha gives coverage; names and meaning of glTF 2.0 section 3.9.4."""

    OPAQUE = "OPAQUE"
    MASK = "MASK"
    BLEND = "BLEND"


class Wrap(StrEnum):
    """What lies beside a texture; names and meaning of OpenGL."""

    REPEAT = "REPEAT"
    MIRROR = "MIRRORED_REPEAT"
    CLAMP = "CLAMP_TO_EDGE"


@dataclass(frozen=True, eq=False, slots=True)
class Texture:
    """Texels [H, W, 4] uint8, row 0 at the top; without mipmaps.

    A mipmap level depends on the pixel grid. Without mipmaps a picture is a function of position alone, so that the
    supersampled reference integrates the same function that the single samples sample.
    """

    texels: Texels
    srgb: bool = True  # colour channels are sRGB-encoded and decoded before filtering; alpha is always linear
    smooth: bool = True  # bilinear filter; False: nearest texel
    wrap: tuple[Wrap, Wrap] = (Wrap.REPEAT, Wrap.REPEAT)  # across, down


@dataclass(frozen=True, eq=False, slots=True)
class Material:
    """Metallic-roughness material as in glTF 2.0 section 3.9, with ``specular`` of KHR_materials_specular.

    A material with ``metallic`` 0 and ``specular`` 0 is matt: its colour does not depend on the view direction.
    """

    base_colour: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_texture: Texture | None = None
    metallic: float = 0.0
    roughness: float = 1.0
    metallic_roughness_texture: Texture | None = None  # roughness in green, metallic in blue
    specular: float = 1.0
    emissive: Colour = (0.0, 0.0, 0.0)  # radiance, unbounded
    emissive_texture: Texture | None = None
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    unlit: bool = False  # the base colour is radiance, and ``metallic`` 0 (KHR_materials_unlit)


def matt(texture: Texture) -> Material:
    """Return a material whose colour does not depend on the view direction."""
    return Material(base_texture=texture, specular=0.0)


def cut_out(texture: Texture) -> Material:
    """Return a matt material, seen from both sides, whose texture's alpha cuts holes."""
    return Material(base_texture=texture, specular=0.0, alpha_mode=AlphaMode.MASK, double_sided=True)


def emitting(light: Colour, texture: Texture | None = None, **others: Any) -> Material:
    """Return a material of its own ``light``, times a texture's, which does not depend on other light."""
    black = (0.0, 0.0, 0.0, 1.0)
    return Material(base_colour=black, specular=0.0, emissive=light, emissive_texture=texture, **others)


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """One mesh with one material, uploaded once; texture coordinates are in ``mesh.visual.uv``."""

    name: str
    mesh: trimesh.Trimesh
    material: Material
    colours: NDArray[np.float32] | None = None  # [vertices, 4] linear, multiplied with the base colour
    deforms: bool = False  # every instant has a Shape of it


@dataclass(frozen=True, eq=False, slots=True)
class Shape:
    """The vertices of a deforming part at one time; its faces and texture coordinates stay."""

    positions: NDArray[np.float64]  # [vertices, 3], in the part's own space
    normals: NDArray[np.float64]  # [vertices, 3], unit


@dataclass(frozen=True, slots=True)
class Shadow:
    """A square shadow map of a sun, over the ball around ``centre`` that casts and receives shadows.

    The map is fixed in the world, not in the picture, so that shadows are a function of position alone.
    """

    centre: Vector
    radius: float
    texels: int = 1024


@dataclass(frozen=True, slots=True)
class Sun:
    """A light at infinity: ``direction`` points from the surface to it; ``irradiance`` is at normal incidence."""

    direction: Vector
    irradiance: Colour
    shadow: Shadow | None = None  # for at most one sun


@dataclass(frozen=True, slots=True)
class Lamp:
    """A point light: ``intensity`` is the irradiance at normal incidence one metre away."""

    position: Vector
    intensity: Colour


@dataclass(frozen=True, slots=True)
class Sky:
    """Radiance from infinity as a function of direction alone; also the ambient light and the colour of fog."""

    zenith: Colour = (0.18, 0.34, 0.70)
    horizon: Colour = (0.72, 0.80, 0.88)
    ground: Colour = (0.20, 0.18, 0.16)
    glow: Colour = (0.0, 0.0, 0.0)  # added towards ``glow_direction``
    glow_direction: Vector = (0.0, 1.0, 0.0)
    ambient: float = 1.0  # share of the sky's light that reaches a surface
    fog: float = 0.0  # extinction, 1/metre
    stars: float = 0.0  # radiance of stars, one or two milliradians wide


@dataclass(frozen=True, slots=True)
class Perspective:
    """Pinhole lens: vertical field of view in radians; only ``near`` clips."""

    field_of_view: float
    near: float = 0.05


@dataclass(frozen=True, slots=True)
class Orthographic:
    """Parallel lens: the picture is ``2 * half_height`` metres high, and clipped at ``near`` and ``far``."""

    half_height: float
    near: float
    far: float


Light = Sun | Lamp
Lens = Perspective | Orthographic


@dataclass(frozen=True, eq=False, slots=True)
class Instant:
    """A scene at one time: camera, poses, lights and sky."""

    world_to_view: Matrix  # [4, 4], camera looks along -z, y up
    lens: Lens
    poses: tuple[Matrix | None, ...]  # model_to_world [4, 4] of each part; None: absent
    lights: tuple[Light, ...]
    sky: Sky | None  # None: black, transparent background
    exposure: float = 1.0  # factor on every colour
    shot: int = 0  # number of the shot: there is a cut between instants of different shots
    shapes: Mapping[str, Shape] = field(default_factory=dict)  # of the deforming parts, by name

    def looks_like(self, other: Instant) -> bool:
        """Return whether pictures of both instants are equal: at most the shot differs."""
        return (
            (self.lens, self.lights, self.sky, self.exposure) == (other.lens, other.lights, other.sky, other.exposure)
            and self.shapes.keys() == other.shapes.keys()
            and all(_same(a, b) for a, b in zip(self._arrays(), other._arrays(), strict=True))
        )

    def _arrays(self) -> list[Matrix | None]:
        shapes = [self.shapes[name] for name in sorted(self.shapes)]
        sides = [side for shape in shapes for side in (shape.positions, shape.normals)]
        return [self.world_to_view, *self.poses, *sides]


def _same(one: Matrix | None, other: Matrix | None) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A function of time. Previous poses are ``at(previous time)``, so motion needs no stored state."""

    name: str
    effects: frozenset[Effect]
    parts: tuple[Part, ...]
    at: Callable[[float], Instant]  # seconds -> Instant
