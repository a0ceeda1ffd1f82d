"""glTF that is not played: vertices, faces, materials and what is shown, and one line for what cannot be."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cltaa.errors import DataError
from cltaa_datasets.gltf_model import at_rest, triangles
from cltaa_datasets.meshes import texture_coordinates
from cltaa_datasets.scene import Part
from cltaa_datasets.scenes import build_scene
from tests.capture.analytic_scenes import drawing
from tests.datasets.gltf_writer import BYTE, FLOAT, SHORT, SQUARE, Writer, skinned_square


def test_a_model_at_rest_is_what_it_is_before_it_is_played(tmp_path: Path) -> None:
    (part,), (pose,) = at_rest(skinned_square(tmp_path / "skin.glb"))
    assert not part.deforms
    assert np.array_equal(np.asarray(part.mesh.vertices), SQUARE)  # its joints stand where they were bound
    assert np.array_equal(pose, np.eye(4))


def shown(writer: Writer, tmp_path: Path) -> tuple[Part, ...]:
    return at_rest(writer.write(tmp_path / "a.glb"))[0]


def test_colours_and_coordinates_of_whole_numbers_are_fractions(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}], materials=[{"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 1]}}])
    attributes = {
        "COLOR_0": writer.add([(51, 102, 255, 255)] * 4, BYTE, normalized=True),
        "TEXCOORD_0": writer.add([(0, 65535)] * 4, SHORT, normalized=True),
    }
    writer.json["meshes"] = [{"primitives": [writer.square(attributes=attributes, material=0)]}]
    (part,) = shown(writer, tmp_path)
    assert part.colours is not None
    assert part.colours[0].tolist() == pytest.approx([0.2, 0.4, 1.0, 1.0], abs=2.0**-24)  # linear, and not decoded
    assert part.material.base_colour == (0.1, 0.2, 0.3, 1)
    assert texture_coordinates(part.mesh).tolist() == [[0.0, 0.0]] * 4


def test_numbers_that_are_no_integers_are_not_normalised(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    colours = writer.add(np.full((4, 3), 0.5), normalized=True)
    writer.json["meshes"] = [{"primitives": [writer.square(attributes={"COLOR_0": colours})]}]
    (part,) = shown(writer, tmp_path)
    assert part.colours is not None
    assert part.colours[0].tolist() == [0.5, 0.5, 0.5, 1.0]


def test_the_matrix_of_a_node_is_affine(tmp_path: Path) -> None:
    matrix = np.arange(16.0).reshape(4, 4)
    writer = Writer(nodes=[{"mesh": 0, "matrix": matrix.T.ravel().tolist()}])
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    _, (pose,) = at_rest(writer.write(tmp_path / "a.glb"))
    assert pose.tolist() == [*matrix[:3].tolist(), [0.0, 0.0, 0.0, 1.0]]


def test_only_what_is_in_the_scene_is_shown(tmp_path: Path) -> None:
    nodes = [{"mesh": 0, "name": "spare"}, {"children": [2]}, {"mesh": 0, "name": "shown"}]
    writer = Writer(nodes=nodes, scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=1)
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    assert [part.name for part in shown(writer, tmp_path)] == ["2 shown 0"]


@pytest.mark.parametrize(
    ("mode", "corners", "faces"),
    [
        (4, [0, 1, 2, 0, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
    ids=["triangles", "strip", "fan"],
)
def test_faces_of_each_mode(mode: int, corners: list[int], faces: list[list[int]]) -> None:
    assert triangles(mode, np.array(corners)).tolist() == faces


def test_without_normals_faces_are_flat(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    folded = {"POSITION": writer.add([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])}
    faces = writer.add([0, 1, 2, 0, 3, 1], SHORT)
    writer.json["meshes"] = [{"primitives": [{"attributes": folded, "indices": faces}]}]
    (part,) = shown(writer, tmp_path)
    assert np.asarray(part.mesh.vertex_normals).tolist() == [[0, 0, 1]] * 3 + [[0, 1, 0]] * 3


def test_a_corner_without_a_normal_has_that_of_its_face(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    folded = {"POSITION": writer.add([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])}
    folded["NORMAL"] = writer.add([(1, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 0)])
    faces = writer.add([0, 1, 2, 0, 3, 1], SHORT)
    writer.json["meshes"] = [{"primitives": [{"attributes": folded, "indices": faces}]}]
    (part,) = shown(writer, tmp_path)
    kept = [1, 0, 0]
    assert np.asarray(part.mesh.vertex_normals).tolist() == [kept, [0, 0, 1], kept, kept, kept, [0, 1, 0]]


CORNERS = [(0, 0), (1, 0), (1, 1), (0, 1)]


def textured(tmp_path: Path, place: dict[str, Any], corners: Any = CORNERS, **entry: Any) -> Part:
    """A square whose texture is black on the left and white on the right, and lies as ``place`` says."""
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "a.png")
    writer = Writer(nodes=[{"mesh": 0}], images=[{"uri": "a.png"}], samplers=[entry.pop("sampler", {})])
    writer.json["textures"] = [{"source": 0, "sampler": 0}]
    sets = {"TEXCOORD_0": writer.add(corners), "TEXCOORD_1": writer.add(np.array(corners) * 0.25)}
    writer.json["meshes"] = [{"primitives": [writer.square(attributes=sets, material=0)]}]
    writer.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0} | place}, **entry}]
    (part,) = shown(writer, tmp_path)
    return part


def moved(**how: Any) -> dict[str, Any]:
    return {"extensions": {"KHR_texture_transform": how}}


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ({}, CORNERS),
        ({"texCoord": 1}, [(0, 0), (0.25, 0), (0.25, 0.25), (0, 0.25)]),
        ({"texCoord": 1} | moved(texCoord=0, scale=[2, 3]), [(0, 0), (2, 0), (2, 3), (0, 3)]),
        # An example of the extension: the lower left quadrant, turned clockwise.
        (moved(offset=[0, 1], rotation=np.pi / 2, scale=[0.5, 0.5]), [(0, 1), (0, 0.5), (0.5, 0.5), (0.5, 1)]),
    ],
    ids=["plain", "second-set", "scaled", "turned"],
)
def test_a_texture_lies_where_the_material_says(place: dict[str, Any], found: Any, tmp_path: Path) -> None:
    coordinates = texture_coordinates(textured(tmp_path, place).mesh)
    assert np.abs(coordinates * (1, -1) + (0, 1) - found).max() <= 2.0**-52  # v grows upwards; pi is rounded


def test_textures_in_different_places_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="the textures of one material lie in different places"):
        textured(tmp_path, {}, emissiveTexture={"index": 0, "texCoord": 1})


@pytest.mark.parametrize(
    ("sampler", "row"),
    [({}, "0101"), ({"wrapS": 10497}, "0101"), ({"wrapS": 33648}, "101"), ({"wrapS": 33071}, "01")],
    ids=["none", "repeat", "mirror", "clamp"],
)
def test_a_texture_goes_on_beside_itself_as_its_sampler_says(sampler: Any, row: str, tmp_path: Path) -> None:
    """From -1 to 1 across a square of no light but its own, with the texels' edges kept."""
    part = textured(
        tmp_path,
        {},
        corners=[(-1, 0), (1, 0), (1, 1), (-1, 1)],
        sampler=sampler | {"magFilter": 9728},
        extensions={"KHR_materials_unlit": {}},
    )
    assert part.material.base_texture is not None
    assert not part.material.base_texture.smooth
    scene = build_scene(f"file:{tmp_path / 'a.glb'}")
    dark = replace(scene.at(0.0), sky=None, lights=())
    with drawing(scene, 64, 36) as renderer:
        drawn = renderer.draw(dark, scene.at(-1.0), (0.0, 0.0))
    assert drawn.motion is not None
    red = drawn.colour[18, np.isfinite(drawn.motion[18, :, 0]), 0]  # of the square in the middle row
    assert "".join(f"{value:g}" for value, _ in groupby(red.tolist())) == row


def test_a_lamp_of_a_material_is_as_strong_as_it_says(tmp_path: Path) -> None:
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}
    part = textured(tmp_path, {}, emissiveFactor=[1.0, 0.5, 0.0], extensions=strong)
    assert part.material.emissive == (8.0, 4.0, 0.0)


def test_a_material_of_diffuse_and_gloss_is_one_without_metal(tmp_path: Path) -> None:
    shiny = {"diffuseFactor": [0.5, 0.25, 0.125, 1.0], "glossinessFactor": 0.75}
    writer = Writer(nodes=[{"mesh": 0}], materials=[{"extensions": {"KHR_materials_pbrSpecularGlossiness": shiny}}])
    writer.json["meshes"] = [{"primitives": [writer.square(material=0)]}]
    (part,) = shown(writer, tmp_path)
    material = part.material
    assert (material.base_colour, material.metallic, material.roughness) == ((0.5, 0.25, 0.125, 1.0), 0.0, 0.25)


def bomb(writer: Writer) -> int:
    """An accessor of zeros that the file does not hold, 36 GB of them."""
    writer.json["accessors"].append({"componentType": FLOAT, "count": 3 * 10**9, "type": "VEC3"})
    return len(writer.json["accessors"]) - 1


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda w, p: p | {"indices": w.add([0, 1, 4], SHORT)}, "a face has vertex 4 of 4"),
        (lambda w, p: p | {"attributes": p["attributes"] | {"COLOR_0": w.add([(1, 1, 1)])}}, "COLOR_0 of 1 vertices"),
        (lambda w, p: p | {"attributes": {"POSITION": bomb(w)}}, "3000000000 values, more than the file has bytes"),
        (lambda w, _: {"attributes": {"POSITION": w.add([(np.nan, 0, 0)] * 3)}}, "POSITION is not finite"),
    ],
    ids=["face", "count", "bomb", "nan"],
)
def test_invalid_vertices_are_reported(spoil: Any, says: str, tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    writer.json["meshes"] = [{"primitives": [spoil(writer, writer.square())]}]
    with pytest.raises(DataError, match=f"cannot be read .*{says}.*; export the model again"):
        shown(writer, tmp_path)


def test_cyclic_nodes_are_reported(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}])
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    with pytest.raises(DataError, match="its nodes form no trees"):
        shown(writer, tmp_path)


def test_a_long_chain_of_nodes_is_followed(tmp_path: Path) -> None:
    length = 2 * sys.getrecursionlimit()
    chain = [{"children": [index - 1], "translation": [1, 0, 0]} for index in range(1, length)]
    writer = Writer(nodes=[{"mesh": 0}, *chain], scenes=[{"nodes": [length - 1]}])
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    (_,), (pose,) = at_rest(writer.write(tmp_path / "a.glb"))
    assert pose[0, 3] == length - 1
