"""Convert a scene's parts to pyrender's meshes and textures, which manage their OpenGL objects."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyrender
from numpy.typing import NDArray
from OpenGL import GL

from cltaa.errors import DataError
from cltaa.frame import Matrix
from cltaa_datasets.meshes import texture_coordinates
from cltaa_datasets.scene import AlphaMode, Material, Part, Scene, Texture

POSE_SLOTS = 4
SMALLEST_ALPHA = 1e-6  # least alpha of a base colour as a divisor


class Texels(pyrender.Texture):  # type: ignore[misc]
    """A texture that is decoded before filtering and has no mipmaps (see ``cltaa_datasets.scene.Texture``)."""

    def __init__(self, texture: Texture) -> None:
        """Take the texels without uploading them."""
        super().__init__(source=texture.texels, source_channels="RGBA")
        self._texture = texture

    def _add_to_context(self) -> None:
        # OpenGL's first row is the bottom, v = 0.
        rows = np.ascontiguousarray(self._texture.texels[::-1])
        self._texid = GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texid)
        internal = GL.GL_SRGB8_ALPHA8 if self._texture.srgb else GL.GL_RGBA8
        height, width = rows.shape[:2]
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, internal, width, height, 0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, rows)
        filtering = GL.GL_LINEAR if self._texture.smooth else GL.GL_NEAREST
        for parameter, value in (
            (GL.GL_TEXTURE_MIN_FILTER, filtering),
            (GL.GL_TEXTURE_MAG_FILTER, filtering),
            (GL.GL_TEXTURE_WRAP_S, getattr(GL, f"GL_{self._texture.wrap[0]}")),
            (GL.GL_TEXTURE_WRAP_T, getattr(GL, f"GL_{self._texture.wrap[1]}")),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, parameter, value)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)


class Vertices:
    """Positions, normals and steps of a deforming part, which replace pyrender's own and change every instant."""

    def __init__(self, primitive: Any, slots: tuple[int, int, int]) -> None:
        """Store the attribute slots; ``fill`` allocates."""
        self._primitive, self._slots, self._buffer = primitive, slots, 0

    def fill(self, vertices: NDArray[np.float32]) -> None:
        """Send [V, 9] to the device."""
        self._primitive._bind()
        if not self._buffer:
            self._buffer = int(GL.glGenBuffers(1))
            self._primitive._buffers.append(self._buffer)  # so that pyrender frees it with its own
            GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
            for place, slot in enumerate(self._slots):
                offset = ctypes.c_void_p(place * 3 * vertices.itemsize)
                GL.glVertexAttribPointer(slot, 3, GL.GL_FLOAT, GL.GL_FALSE, vertices.strides[0], offset)
                GL.glEnableVertexAttribArray(slot)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
        GL.glBufferData(GL.GL_ARRAY_BUFFER, vertices.nbytes, vertices, GL.GL_STREAM_DRAW)


@dataclass(frozen=True, eq=False, slots=True)
class Drawable:
    """One part on the device: its primitive, the defines of its shader, and its constant uniforms."""

    part: Part
    primitive: Any  # pyrender.Primitive
    defines: dict[str, int]
    uniforms: dict[str, Any]
    textures: tuple[Texels, ...]  # the index is the texture unit
    centre: Matrix  # [4], of the bounding box, homogeneous
    vertices: Vertices | None  # of a deforming part


def _texture_slots(material: Material) -> dict[str, Texture]:
    candidates = {
        "base_texture": material.base_texture,
        "metallic_roughness_texture": material.metallic_roughness_texture,
        "emissive_texture": material.emissive_texture,
    }
    return {name: texture for name, texture in candidates.items() if texture is not None}


def _primitive(part: Part, textures: dict[str, Texels]) -> tuple[Any, dict[str, int]]:
    """Return pyrender's primitive and the attribute slots of its buffer."""
    mesh = part.mesh
    uv = texture_coordinates(mesh)
    material = pyrender.MetallicRoughnessMaterial(
        # pyrender's own names, used only to manage OpenGL objects.
        baseColorTexture=textures.get("base_texture"),
        metallicRoughnessTexture=textures.get("metallic_roughness_texture"),
        emissiveTexture=textures.get("emissive_texture"),
    )
    primitive = pyrender.Primitive(
        positions=mesh.vertices,
        normals=mesh.vertex_normals,
        texcoord_0=uv if len(uv) else None,
        color_0=part.colours,
        material=material,
        mode=pyrender.GLTF.TRIANGLES,
    )
    # pyrender's setter stores indices as float32, which is wrong from 2^24 on.
    primitive._indices = np.ascontiguousarray(mesh.faces, np.uint32)
    slots = {"NORMAL_SLOT": 1}
    if len(uv):
        slots["TEXCOORD_SLOT"] = len(slots) + 1
    if part.colours is not None:
        slots["COLOUR_SLOT"] = len(slots) + 1
    return primitive, slots


def _drawable(part: Part, shared: dict[int, Texels]) -> Drawable:
    material = part.material
    textures = _texture_slots(material) if len(texture_coordinates(part.mesh)) else {}
    texels = {name: shared.setdefault(id(texture), Texels(texture)) for name, texture in textures.items()}
    primitive, defines = _primitive(part, texels)
    defines |= {name.upper(): 1 for name in texels}
    if material.metallic == 0.0 and material.specular == 0.0:
        defines["MATT"] = 1
    if material.unlit or ("MATT" in defines and not any(material.base_colour[:3])):
        defines["UNLIT"] = 1
    if material.alpha_mode is not AlphaMode.OPAQUE:
        defines[material.alpha_mode.value] = 1
    uniforms: dict[str, Any] = {
        "material.base_colour": np.array(material.base_colour, np.float32),
        "material.emissive": np.array(material.emissive, np.float32),
        "material.metallic": material.metallic,
        "material.roughness": material.roughness,
        "material.specular": material.specular,
        "material.alpha_cutoff": material.alpha_cutoff,
        "cutoff": material.alpha_cutoff / max(material.base_colour[3], SMALLEST_ALPHA),
    }
    uniforms |= {name: unit for unit, name in enumerate(texels)}
    centre = np.append(part.mesh.bounds.mean(axis=0), 1.0)
    vertices = None
    if part.deforms:
        # pyrender reserves four slots after its own attributes for the pose of an instance.
        defines["STEP_SLOT"] = sum(name.endswith("_SLOT") for name in defines) + 1 + POSE_SLOTS
        vertices = Vertices(primitive, (0, defines["NORMAL_SLOT"], defines["STEP_SLOT"]))
    return Drawable(part, primitive, defines, uniforms, tuple(texels.values()), centre, vertices)


def upload(scene: Scene) -> tuple[Any, list[Drawable]]:
    """Prepare a scene's parts: return a pyrender scene that holds them, and the drawables; parts share textures.

    Raises DataError for a texture larger than OpenGL supports.
    """
    shared: dict[int, Texels] = {}
    drawables = [_drawable(part, shared) for part in scene.parts]
    largest = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
    for drawable in drawables:
        for texels in drawable.textures:
            height, width = texels.source.shape[:2]
            if max(width, height) > largest:
                expected, found = f"at most {largest} texels a side", f"{width} x {height}"
                what = f"a texture of {drawable.part.name} is too large"
                raise DataError(what, expected=expected, found=found, cure="make it smaller")
    holder = pyrender.Scene()
    for drawable in drawables:
        holder.add(pyrender.Mesh([drawable.primitive], name=drawable.part.name))
    return holder, drawables
