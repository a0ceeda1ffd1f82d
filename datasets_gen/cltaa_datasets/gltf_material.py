"""The materials of a glTF file, with their textures (glTF 2.0, sections 3.8 and 3.9)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa_datasets.gltf_file import GltfFile
from cltaa_datasets.scene import AlphaMode, Colour, Material, Texture, Wrap

LARGEST_COLOUR = 65504.0  # largest half
WRAPS = {33071: Wrap.CLAMP, 33648: Wrap.MIRROR, 10497: Wrap.REPEAT}
REPEAT, NEAREST, LINEAR = 10497, 9728, 9729


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """Where the textures of a material lie on a surface."""

    of: int  # set of texture coordinates
    matrix: NDArray[np.float64]  # [2, 3], from these coordinates to those of the textures


class Materials:
    """Reads the materials of a file, each once."""

    def __init__(self, file: GltfFile) -> None:
        """Read nothing yet."""
        self._file = file
        self._read: dict[int | None, tuple[Material, Placement]] = {}
        self._textures: dict[tuple[Any, ...], Texture] = {}

    def read(self, index: int | None) -> tuple[Material, Placement]:
        """Return a material, the default without an index; raises DataError, ValueError and KeyError."""
        if index not in self._read:
            entry = {} if index is None else self._file.item("materials", index)
            pbr = _shiny(entry) or entry.get("pbrMetallicRoughness", {})
            base, extensions = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), entry.get("extensions", {})
            strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
            unlit = "KHR_materials_unlit" in extensions
            places = pbr.get("baseColorTexture"), pbr.get("metallicRoughnessTexture"), entry.get("emissiveTexture")
            material = Material(
                base_colour=(*_light(base[:3]), _share(base[3])),
                base_texture=self._texture(places[0]),
                metallic=0.0 if unlit else _share(pbr.get("metallicFactor", 1.0)),
                roughness=_share(pbr.get("roughnessFactor", 1.0)),
                metallic_roughness_texture=None if unlit else self._texture(places[1], srgb=False),
                emissive=_light(strength * part for part in entry.get("emissiveFactor", (0.0, 0.0, 0.0))),
                emissive_texture=self._texture(places[2]),
                alpha_mode=AlphaMode(entry.get("alphaMode", "OPAQUE")),
                alpha_cutoff=_finite(entry.get("alphaCutoff", 0.5)),
                double_sided=bool(entry.get("doubleSided", False)),
                unlit=unlit,
            )
            self._read[index] = material, _placement(place for place in places if place is not None)
        return self._read[index]

    def _texture(self, reference: dict[str, int] | None, *, srgb: bool = True) -> Texture | None:
        if reference is None:
            return None
        texture = self._file.item("textures", reference["index"])
        source = texture.get("source", texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
        if source is None:  # only in a format that Pillow does not read
            return None
        sampler = self._file.item("samplers", texture["sampler"]) if "sampler" in texture else {}
        wrap = WRAPS[sampler.get("wrapS", REPEAT)], WRAPS[sampler.get("wrapT", REPEAT)]
        key = source, srgb, sampler.get("magFilter", LINEAR) != NEAREST, wrap
        if key not in self._textures:
            self._textures[key] = Texture(self._file.image(source), *key[1:])
        return self._textures[key]


def _placement(places: Iterable[dict[str, Any]]) -> Placement:
    """Return where all textures of a material lie (extension KHR_texture_transform)."""
    found = set()
    for place in places:
        moved = place.get("extensions", {}).get("KHR_texture_transform", {})
        numbers = *moved.get("offset", (0.0, 0.0)), moved.get("rotation", 0.0), *moved.get("scale", (1.0, 1.0))
        found.add((moved.get("texCoord", place.get("texCoord", 0)), *map(_finite, numbers)))
    if len(found) > 1:
        raise ValueError("the textures of one material lie in different places")
    of, right, down, turn, across, along = found.pop() if found else (0, 0.0, 0.0, 0.0, 1.0, 1.0)
    c, s = np.cos(turn), np.sin(turn)  # anticlockwise, where v grows downwards
    return Placement(of, np.array([[c * across, s * along, right], [-s * across, c * along, down]]))


def _finite(number: Any) -> float:
    found = float(number)
    if not np.isfinite(found):
        raise ValueError(f"{found} in a material")
    return found


def _share(number: Any) -> float:
    """Clamp a number to [0, 1], its range in the specification."""
    return min(max(_finite(number), 0.0), 1.0)


def _light(numbers: Any) -> Colour:
    """Check a colour of a material; raises ValueError for an invalid one."""
    red, green, blue = found = [_finite(number) for number in numbers]
    if not (min(red, green, blue) >= 0.0 and max(red, green, blue) <= LARGEST_COLOUR):
        raise ValueError(f"a colour {found} in a material, expected numbers from 0 to {LARGEST_COLOUR:g}")
    return red, green, blue


def _shiny(entry: dict[str, Any]) -> dict[str, Any]:
    """Approximate a material of KHR_materials_pbrSpecularGlossiness by metallic-roughness without metal."""
    found = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if found is None:
        return {}
    base = {"baseColorTexture": found["diffuseTexture"]} if "diffuseTexture" in found else {}
    colour, gloss = found.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)), found.get("glossinessFactor", 1.0)
    return {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 1.0 - gloss, **base}
