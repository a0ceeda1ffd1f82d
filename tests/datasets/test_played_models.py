"""Animated glTF: files written here, byte by byte, against motions that are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.errors import DataError, InputMissing
from cltaa.frame import Effect
from cltaa_datasets.gltf_animation import Channel, quaternion_matrix, slerp
from cltaa_datasets.gltf_file import GltfFile
from cltaa_datasets.gltf_model import AnimatedModel
from cltaa_datasets.scenes import build_scene
from tests.capture.analytic_scenes import drawing
from tests.datasets.gltf_writer import FLOAT, HALF_TURN, JOINTS, SHORT, SQUARE, WHOLE, Writer, skinned_square


def positions(model: AnimatedModel, time: float) -> np.ndarray[Any, Any]:
    poses, shapes = model.at(time)
    (part,) = model.parts
    points = shapes[part.name].positions if part.deforms else np.asarray(part.mesh.vertices)
    return np.asarray(points @ poses[0][:3, :3].T + poses[0][:3, 3])


def test_nodes_move_and_carry_their_children(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"children": [1], "translation": [0, 0, 5]}, {"mesh": 0, "scale": [2, 2, 2]}])
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    writer.animate(0, "rotation", [0.0, 2.0], [(0, 0, 0, 1), HALF_TURN])
    writer.animate(1, "translation", [0.0, 1.0, 2.0], [(0, 0, 0), (4, 0, 0), (4, 0, 0)], "STEP")
    model = AnimatedModel(writer.write(tmp_path / "a.glb"))
    # A quarter turn about z, of a square of twice the size, 4 to the side from second 1 on.
    corners = 2.0 * SQUARE + (4.0, 0.0, 0.0)
    expected = np.stack([-corners[:, 1], corners[:, 0], np.full(4, 5.0)], 1)
    assert np.abs(positions(model, 1.0) - expected).max() <= 1e-14
    assert np.abs(positions(model, 5.0) - positions(model, 1.0)).max() <= 1e-14  # it starts again after 2 seconds


def test_a_cubic_spline_follows_its_tangents() -> None:
    # t^3 has the slopes 0 and 3 at its ends, and is its own spline.
    keys = np.array([[[9.0], [0.0], [0.0]], [[3.0], [1.0], [9.0]]])
    channel = Channel(np.array([0.0, 1.0]), keys, "CUBICSPLINE", turns=False)
    assert [float(channel.at(t)[0]) for t in (-1.0, 0.0, 0.25, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.25**3, 0.125, 1.0, 1.0]


def test_quaternions_turn_along_the_shorter_arc() -> None:
    a, b = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, np.sin(0.3), np.cos(0.3)])
    third = quaternion_matrix(slerp(a, -b, 1.0 / 3.0))
    assert np.abs(third[:2, 0] - [np.cos(0.2), np.sin(0.2)]).max() <= 1e-15
    assert np.array_equal(slerp(a, a, 0.4), a)


NONE = [(0, 0, 0, 0)] * 4


@pytest.mark.parametrize(
    "told",
    [
        {},
        {"bound": 3},  # glTF allows more matrices than joints
        {"weights": ([(9, 0, 0, 0)] * 4,)},
        {"weights": (NONE,)},
        {"joints": (NONE, JOINTS), "weights": (NONE, WHOLE)},
    ],
    ids=["usual", "more-matrices", "weights-of-another-sum", "no-weights", "second-set"],
)
def test_a_skin_follows_its_joints_and_not_its_node(told: dict[str, Any], tmp_path: Path) -> None:
    model = AnimatedModel(skinned_square(tmp_path / "skin.glb", **told))
    moved = positions(model, 0.5) - SQUARE
    assert np.abs(moved - [[0, 0, 0], [0, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]).max() <= 1e-14


def test_a_mirrored_skin_is_seen_from_its_front(tmp_path: Path) -> None:
    model = AnimatedModel(skinned_square(tmp_path / "skin.glb", above={"scale": [-1, 1, 1]}))
    (pose,), shapes = model.at(0.0)
    (shape,) = shapes.values()
    assert np.abs(positions(model, 0.0) - SQUARE * (-1.0, 1.0, 1.0)).max() <= 1e-14
    assert np.linalg.det(pose[:3, :3]) < 0.0  # the winding is reversed, and the renderer told
    assert np.abs(shape.normals - (0.0, 0.0, 1.0)).max() <= 1e-14


def test_too_few_matrices_of_a_skin_are_counted(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="1 inverse bind matrices for 2 joints"):
        AnimatedModel(skinned_square(tmp_path / "skin.glb", bound=1))


def test_targets_blend_by_animated_weights(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    up = np.tile(np.array([0, 0, 2], np.float32), (4, 1))
    sparse = {
        "indices": {"bufferView": 0, "componentType": SHORT},
        "values": {"bufferView": 1},
        "count": 1,
    }
    writer.add([3], SHORT)
    writer.add([(7.0, 0.0, 0.0)])
    writer.json["accessors"].append({"componentType": FLOAT, "count": 4, "type": "VEC3", "sparse": sparse})
    targets = [{"POSITION": writer.add(up)}, {"POSITION": 2}]
    writer.json["meshes"] = [{"primitives": [writer.square(targets=targets)], "weights": [0.0, 0.0]}]
    writer.animate(0, "weights", [0.0, 1.0], [0.0, 0.0, 1.0, 0.5])
    model = AnimatedModel(writer.write(tmp_path / "morph.glb"))
    moved = positions(model, 0.5) - SQUARE
    assert np.abs(moved - [[0, 0, 1], [0, 0, 1], [0, 0, 1], [1.75, 0, 1]]).max() <= 1e-14
    writer.json["animations"] = []
    writer.json["meshes"][0]["weights"] = [0.0, 0.0, 1.0]
    with pytest.raises(DataError, match="3 weights for 2 morph targets"):
        AnimatedModel(writer.write(tmp_path / "odd.glb"))


def test_a_played_file_is_captured_with_its_motion(tmp_path: Path) -> None:
    scene = build_scene(f"file:{skinned_square(tmp_path / 'skin.glb')}")
    assert Effect.MOTION in scene.effects
    assert Effect.CAMERA not in scene.effects
    with drawing(scene, 96, 54) as renderer:
        motion = renderer.draw(scene.at(0.5), scene.at(0.4), (0.0, 0.0)).motion
    assert motion is not None
    own = np.isfinite(motion[..., 0])
    assert 200 < own.sum() < 0.8 * own.size
    assert 0.5 < np.abs(motion[own]).max() < 10.0


def test_a_played_file_far_from_the_origin_keeps_its_digits(tmp_path: Path) -> None:
    far, stood = 2.0**27, []
    for place in (0.0, far):
        model = skinned_square(tmp_path / "skin.glb", above={"translation": [place, 0, 0]})
        instant = build_scene(f"file:{model}").at(0.5)
        (shape,), pose = instant.shapes.values(), instant.poses[0]
        assert pose is not None
        assert np.abs(shape.positions).max() <= 2.0  # about their own middle, as float32 holds them
        stood.append(shape.positions @ pose[:3, :3].T + pose[:3, 3])
    assert np.abs(stood[1] - stood[0]).max() <= far * 2.0**-50  # a few roundings of float64 at that distance


@pytest.mark.parametrize("size", [2.0**-35, 2.0**35])
def test_a_played_file_of_any_scale_is_drawn_the_same(size: float, tmp_path: Path) -> None:
    drawn = []
    for scale in (1.0, size):
        scene = build_scene(f"file:{skinned_square(tmp_path / 'skin.glb', above={'scale': [scale] * 3})}")
        with drawing(scene, 32, 18) as renderer:
            drawn.append(renderer.draw(scene.at(0.5), scene.at(0.4), (0.0, 0.0)))
    np.testing.assert_array_equal(drawn[1].colour, drawn[0].colour)  # a power of two changes no digit
    np.testing.assert_array_equal(drawn[1].motion, drawn[0].motion)


def test_a_vertex_that_no_face_uses_does_not_shrink_a_played_file(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}])
    square = writer.square()
    normals = writer.add(np.tile([0.0, 0.0, 1.0], (5, 1)))
    square["attributes"] = {"POSITION": writer.add([*SQUARE, (1e6, 0, 0)]), "NORMAL": normals}
    writer.json["meshes"] = [{"primitives": [square]}]
    writer.animate(0, "rotation", [0.0, 1.0], [(0, 0, 0, 1), HALF_TURN])
    instant = build_scene(f"file:{writer.write(tmp_path / 'a.glb')}").at(0.0)
    assert instant.poses[0] is not None
    assert np.abs(np.linalg.det(instant.poses[0][:3, :3])) > 0.1


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("empty.glb", b"", "is no glTF 2.0 file"),
        ("cut.glb", b"glTF\2\0\0\0\x40\0\0\0", "is no glTF 2.0 file"),
        ("list.gltf", b"[]", "is no glTF 2.0 file"),
        (
            "packed.gltf",
            b'{"asset": {}, "extensionsRequired": ["KHR_draco_mesh_compression"]}',
            "needs the extension .*; export without it",
        ),
    ],
)
def test_unreadable_files(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=says) as caught:
        GltfFile(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a b.bin", "n" * 300])
def test_a_missing_buffer_is_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text(f'{{"asset": {{}}, "buffers": [{{"uri": "{name}", "byteLength": 4}}]}}')
    with pytest.raises(InputMissing, match=f"there is no {name} beside the model; copy it there"):
        GltfFile(tmp_path / "a.gltf")


@pytest.mark.parametrize(
    ("table", "key", "said"),
    [
        ("bufferViews", "byteLength", r"buffer view 0 is cut short \(expected 9, found 8\)"),
        ("accessors", "count", "accessor 0 cannot be read"),
    ],
)
def test_what_runs_out_is_named(table: str, key: str, said: str, tmp_path: Path) -> None:
    writer = Writer()
    index = writer.add([1.0, 2.0])
    writer.json[table][0][key] = 9
    with pytest.raises(DataError, match=said):
        GltfFile(writer.write(tmp_path / "a.glb")).array(index)


def test_the_wheels_turn_and_the_body_stays(tmp_path: Path) -> None:
    writer = Writer(
        nodes=[
            {"name": "body", "mesh": 0, "children": [1, 2]},
            {"name": "front wheel", "mesh": 0, "translation": [2, -1, 0]},
            {"name": "rear wheel", "mesh": 0, "translation": [-2, -1, 0]},
        ]
    )
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    for wheel in (1, 2):
        writer.animate(wheel, "rotation", [0.0, 2.0], [(0, 0, 0, 1), HALF_TURN])
    scene = build_scene(f"file:{writer.write(tmp_path / 'cart.glb')}")
    now, before = scene.at(0.5), scene.at(0.5 - 1.0 / 30.0)
    turning = [
        part.name
        for part, pose, earlier in zip(scene.parts, now.poses, before.poses, strict=True)
        if pose is not None and earlier is not None and not np.array_equal(pose, earlier)
    ]
    assert len(scene.parts) > len(turning) == 2
    assert all("wheel" in name for name in turning)
