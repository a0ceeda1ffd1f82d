"""Models that no modeller means: what is drawn is finite, in colour, depth and truth, and what is not is one line."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cltaa.errors import DataError
from cltaa.io.sequence import open_sequence
from cltaa_capture.sequence import Request, capture_sequence
from tests.datasets.gltf_writer import SHORT, SQUARE, Writer

SHEET = "v -1 0 -0.5\nv 1 0 -0.5\nv 1 0.2 0.5\nv -1 0.2 0.5\n"
WHOLE = "f 1 2 3\nf 1 3 4\n"
NORMAL = "f 1//1 2//1 3//1\nf 1//1 3//1 4//1\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
Primitive = dict[str, Any]


def with_attribute(name: str, values: Any) -> Callable[[Writer, Primitive], Primitive]:
    return lambda w, p: p | {"attributes": p["attributes"] | {name: w.add(values)}}


def gltf(spoil: Callable[[Writer, Primitive], Primitive] = lambda _, p: p, **top: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        writer = Writer(**({"nodes": [{"mesh": 0}]} | top))
        writer.json["meshes"] = [{"primitives": [spoil(writer, writer.square(material=0))]}]
        writer.json.setdefault("materials", [{}])
        writer.write(path)

    return write


def standing(**node: Any) -> Callable[[Path], None]:
    return gltf(nodes=[{"mesh": 0, **node}])


def played(path: str, times: Any, values: Any, interpolation: str = "LINEAR") -> Callable[[Path], None]:
    def write(to: Path) -> None:
        writer = Writer(nodes=[{"mesh": 0}])
        writer.json["meshes"] = [{"primitives": [writer.square()]}]
        writer.animate(0, path, times, values, interpolation)
        writer.write(to)

    return write


def material(**keys: Any) -> Callable[[Path], None]:
    return gltf(materials=[keys])


GLASS = {"alphaMode": "BLEND"}
DRACO = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
NAN, HUGE = float("nan"), 1e38
HALF = "2 corners of triangles, which have 3 each"
# A name's suffix is its format; it holds text, bytes or what writes it. None is drawn, else the line is of that.
MODELS: dict[str, tuple[Any, str | None]] = {
    "two-sided.obj": (SHEET + WHOLE + "f 3 2 1\nf 4 3 1\n", None),
    "zero-normals.obj": (SHEET + "vn 0 0 0\n" + NORMAL, None),
    "huge-normals.obj": (SHEET + "vn 1e30 1e30 0\n" + NORMAL, None),
    "tiny-normals.obj": (SHEET + "vn 1e-30 1e-30 0\n" + NORMAL, None),
    "nan-normals.obj": (SHEET + "vn nan nan nan\n" + NORMAL, "normals of mesh .* are not finite"),
    "opposite-normals.obj": (SHEET + "vn 0 1 0\nvn 0 -1 0\nf 1//1 2//2 3//1\nf 1//1 3//1 4//2\n", None),
    "nan-vertex.obj": (SHEET + "v nan 0 0\n" + WHOLE + "f 1 2 5\n", "vertices of mesh .* are not finite"),
    "collapsed.obj": (SHEET + WHOLE + "f 1 1 2\nf 3 3 3\nf 1 2 3\n", None),
    "line.obj": ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle in it has an area"),
    "huge.obj": ("v 0 0 0\nv 1e30 0 0\nv 0 1e30 0\nf 1 2 3\n", "no size that can be shown"),
    "far.obj": ("v 1e8 0 0\nv 100000001 0 0\nv 1e8 1 0\nf 1 2 3\n", None),
    "stray-vertex.obj": (SHEET + "v 1e30 0 0\n" + WHOLE, None),
    "some-uv.obj": (SHEET + "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 1 3 4\n", None),
    "nan-uv.obj": (SHEET + "vt nan 0\nf 1/1 2/1 3/1\n", "texture coordinates of mesh .* are not finite"),
    "endless-uv.obj": (SHEET + "vt 1e39 0\nf 1/1 2/1 3/1\n", "texture coordinates of .* or beyond 1.67"),
    "from-zero.obj": (SHEET + "f 0 1 2\nf 0 2 3\n", "a face has vertex 0, and the first is 1"),
    "flat.obj": ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "vertices of mesh .* are not three numbers"),
    "latin-1.obj": (f"# Straße\n{SHEET}{WHOLE}".encode("latin-1"), None),
    "utf-16.obj": (f"# Straße\n{SHEET}{WHOLE}".encode("utf-16"), None),
    "utf-8-mark.obj": ((SHEET + WHOLE).encode("utf-8-sig"), None),
    "no-such-vertex.ply": (PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "has vertex 9 of 3"),
    "vertex-before-the-first.ply": (PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "has vertex -1 of 3"),
    "cut.stl": (bytes(80) + b"\2\0\0\0" + b"\xff" * 60, "trimesh cannot read it .it is cut short"),
    "nan.ply": (PLY + "nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "vertices of mesh .* are not finite"),
    "zero-normals.glb": (gltf(with_attribute("NORMAL", np.zeros((4, 3)))), None),
    "opposite-normals.glb": (gltf(with_attribute("NORMAL", [(0, 0, 1), (0, 0, -1)] * 2)), None),
    "nan-tangents.glb": (gltf(with_attribute("TANGENT", np.full((4, 4), NAN))), None),  # which nothing reads
    "flat-positions.glb": (gltf(with_attribute("POSITION", SQUARE[:, :2])), "POSITION of 2 numbers a vertex"),
    "huge-colour.glb": (gltf(with_attribute("COLOR_0", np.full((4, 4), HUGE)), materials=[GLASS]), None),
    "negative-colour.glb": (gltf(with_attribute("COLOR_0", np.full((4, 4), -1.0)), materials=[GLASS]), None),
    "endless-texture.glb": (
        gltf(with_attribute("TEXCOORD_0", SQUARE[:, :2] * HUGE)),
        "TEXCOORD_0 is beyond 1.67",
    ),
    "tiny.glb": (gltf(with_attribute("POSITION", SQUARE * 1e-38)), "no size that can be shown"),
    "no-faces.glb": (gltf(lambda w, p: p | {"indices": w.add(np.zeros(0), SHORT)}), "no triangles in it"),
    "half-a-face.glb": (gltf(lambda w, p: p | {"indices": w.add([0, 1], SHORT)}), HALF),
    "draco.glb": (gltf(lambda _, p: p | {"extensions": DRACO}), "needs the extension KHR_draco_mesh_compression"),
    "in-many-places.glb": (
        standing(extensions={"EXT_mesh_gpu_instancing": {}}),
        "needs the extension EXT_mesh_gpu",
    ),
    "flattened.glb": (standing(scale=[1, 1, 0]), None),
    "almost-flattened.glb": (standing(scale=[1, 1e-300, 1]), None),
    "no-turn.glb": (standing(rotation=[0, 0, 0, 0]), None),
    "nan-scale.glb": (standing(scale=[1, NAN, 1]), "no size that can be shown"),
    "nan-turn.glb": (standing(rotation=[0, 0, 0, NAN]), "no size that can be shown"),
    "no-joints.glb": (standing(skin=0), "cannot be read .*JOINTS_0"),
    "no-turn-played.glb": (played("rotation", [0.0, 1.0], np.zeros((2, 4))), None),
    "shrinks-to-nothing.glb": (played("scale", [0.0, 0.05], [(1, 1, 1), (0, 0, 0)]), None),
    "nan-keys.glb": (played("translation", [0.0, 1.0], [(0, 0, 0), (NAN, 0, 0)]), "keys are none, or not finite"),
    "keys-back.glb": (played("translation", [1.0, 0.0], SQUARE[:2]), "its keys are not in order"),
    "no-tangents.glb": (played("translation", [0.0, 1.0], SQUARE[:2], "CUBICSPLINE"), "translation of 1 number a key"),
    "three-turns.glb": (played("rotation", [0.0, 1.0], SQUARE[:2]), "rotation of 3 numbers a key"),
    "wobbles.glb": (played("translation", [0.0, 1.0], SQUARE[:2], "WOBBLE"), "no interpolation WOBBLE"),
    "nan-base.glb": (material(pbrMetallicRoughness={"baseColorFactor": [NAN] * 4}), "nan in a material"),
    "three-of-four.glb": (material(pbrMetallicRoughness={"baseColorFactor": [1] * 3}), "cannot be read"),
    "rough.glb": (material(pbrMetallicRoughness={"roughnessFactor": 1e20, "metallicFactor": -5}), None),
    "emissive-word.glb": (material(emissiveFactor="red"), "cannot be read"),
    "nodes-by-name.glb": (gltf(nodes={"a": {"mesh": 0}}), "cannot be read"),
    "no-material.glb": (gltf(lambda _, p: p | {"material": 7}), "it refers to materials 7 of 1"),
    "material-before-the-first.glb": (gltf(lambda _, p: p | {"material": -1}), "it refers to materials -1 of 1"),
    "no-child.glb": (standing(children=[9]), "it refers to nodes 9 of 1"),
    "its-own-child.glb": (standing(children=[0]), "its nodes form no trees"),
    "two-parents.glb": (gltf(nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}]), "its nodes form no trees"),
    "next-version.gltf": ('{"asset": {"version": "3.0"}}', r"is no glTF 2.0 file .*its version is 3\.0"),
    "endless.gltf": ('{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 1e400}], "nodes": 5}', "cannot be read"),
}


@pytest.mark.parametrize("name", MODELS)
def test_what_is_drawn_is_finite_and_what_is_not_is_named(name: str, tmp_path: Path) -> None:
    content, line = MODELS[name]
    path = tmp_path / name
    if callable(content):
        content(path)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    drawn = Request(f"file:{path}", tmp_path / "out", frames=2, width=32, height=18, reference=4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if line is not None:
            with pytest.raises(DataError, match=line) as caught:
                capture_sequence(drawn)
            assert str(caught.value).startswith(f"{path}: ")
            assert "\n" not in str(caught.value)
            return
        capture_sequence(drawn)
    found = open_sequence(tmp_path / "out")
    assert found.reference is not None
    for frame, truth in zip(found, found.reference, strict=True):
        assert np.isfinite(frame.colour).all()
        assert np.isfinite(truth).all()
        assert not np.isnan(frame.depth).any()
        assert (frame.depth > 0.0).all()
        assert frame.motion is None or not np.isinf(frame.motion).any()
        assert frame.reactive is None or (frame.reactive.min() >= 0.0 and frame.reactive.max() <= 1.0)
        assert frame.colour.min() >= 0.0


def test_a_texture_beyond_opengl_is_named(tmp_path: Path) -> None:
    Image.new("RGB", (70_000, 1)).save(tmp_path / "wide.png")
    (tmp_path / "wide.mtl").write_text("newmtl wide\nmap_Kd wide.png\n")
    square = f"mtllib wide.mtl\nusemtl wide\n{SHEET}vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (tmp_path / "wide.obj").write_text(square)
    drawn = Request(f"file:{tmp_path / 'wide.obj'}", tmp_path / "out", frames=1, width=32, height=18)
    with pytest.raises(DataError, match=r"a texture of wide.obj is too large .*found 70000 x 1\); make it smaller"):
        capture_sequence(drawn)
