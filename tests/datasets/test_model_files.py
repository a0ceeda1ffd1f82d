"""Models from files: every format, colours, materials, and one line for what cannot be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa_datasets import meshes
from cltaa_datasets.model_files import content_sha256, load_model, model_scene
from cltaa_datasets.scene import AlphaMode
from cltaa_datasets.scenes import build_scene


def export(tmp_path: Path, name: str, mesh: Any) -> Path:
    path = tmp_path / name
    whole: Any = trimesh.Scene(mesh) if path.suffix == ".glb" else mesh
    whole.export(path)
    return path


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply", "stl"])
def test_every_format_stands_on_the_ground_with_radius_one(tmp_path: Path, suffix: str) -> None:
    mesh = trimesh.creation.box((2.0, 4.0, 6.0))
    mesh.apply_translation((10.0, 20.0, 30.0))
    parts, poses, height = load_model(export(tmp_path, f"box.{suffix}", mesh))
    corners = np.concatenate(
        [part.mesh.vertices @ pose[:3, :3].T + pose[:3, 3] for part, pose in zip(parts, poses, strict=True)]
    )
    radius = np.sqrt(1.0 + 4.0 + 9.0)
    expected = np.array([[-1.0, 0.0, -3.0], [1.0, 4.0, 3.0]]) / radius
    # The files hold float32, or decimal text of as many digits, of numbers up to 33.
    assert np.abs([corners.min(axis=0), corners.max(axis=0)] - expected).max() <= 33.0 * 2.0**-22 / radius
    assert height == pytest.approx(4.0 / radius, abs=1e-5)


@pytest.mark.parametrize("size", [1e-11, 1e-7, 1e11])
@pytest.mark.parametrize("suffix", ["ply", "stl"])
def test_a_model_of_any_scale_keeps_its_shape(tmp_path: Path, size: float, suffix: str) -> None:
    shapes = []
    for scale in (1.0, size):
        mesh = trimesh.creation.icosphere(subdivisions=2)
        mesh.vertices *= scale
        (part,), (pose,), _ = load_model(export(tmp_path, f"ball{scale}.{suffix}", mesh))
        shapes.append(part.mesh.vertices @ pose[:3, :3].T + pose[:3, 3])
    assert len(shapes[0]) == len(shapes[1])
    assert np.abs(shapes[0] - shapes[1]).max() <= 2.0**-20  # the files hold float32


def test_a_shape_without_normals_keeps_its_edges(tmp_path: Path) -> None:
    (part,), _, _ = load_model(export(tmp_path, "box.stl", trimesh.creation.box((2.0, 2.0, 2.0))))
    assert np.abs(np.abs(part.mesh.vertex_normals).max(axis=1) - 1.0).max() <= 1e-6


def test_vertex_colours_are_decoded(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    mesh.visual.vertex_colors = np.tile(np.array([[188, 0, 255, 255]], np.uint8), (len(mesh.vertices), 1))
    (part,), _, _ = load_model(export(tmp_path, "coloured.ply", mesh))
    assert part.colours is not None
    assert part.colours[0] == pytest.approx([((188 / 255 + 0.055) / 1.055) ** 2.4, 0.0, 1.0, 1.0], abs=1e-6)


def test_materials_and_textures_of_gltf(tmp_path: Path) -> None:
    texels = np.random.default_rng(0).integers(0, 256, (8, 4, 4), np.uint8)
    mesh = meshes.sheet((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    visual: Any = mesh.visual
    material_class: Any = trimesh.visual.material.PBRMaterial
    visual.material = material_class(
        baseColorTexture=Image.fromarray(texels),
        alphaMode="MASK",
        alphaCutoff=0.3,
        doubleSided=True,
        metallicFactor=0.25,
        roughnessFactor=0.75,
        emissiveFactor=[0.5, 0.25, 1.0],
    )
    (part,), _, _ = load_model(export(tmp_path, "sheet.glb", mesh))
    material = part.material
    assert material.base_texture is not None
    assert np.array_equal(material.base_texture.texels, texels)
    assert (material.alpha_mode, material.alpha_cutoff, material.double_sided) == (AlphaMode.MASK, 0.3, True)
    assert (material.metallic, material.roughness, material.emissive) == (0.25, 0.75, (0.5, 0.25, 1.0))
    assert np.allclose(meshes.texture_coordinates(part.mesh), meshes.texture_coordinates(mesh), atol=1e-6)


@pytest.mark.parametrize(("motion", "effect"), [("turntable", Effect.MOTION), ("orbit", Effect.CAMERA)])
def test_what_moves_is_declared(tmp_path: Path, motion: str, effect: Effect) -> None:
    path = export(tmp_path, "my box.v2.glb", trimesh.creation.box((1.0, 1.0, 1.0)))
    scene = model_scene(str(path), motion, 0)
    assert scene.name == "my_box_v2"  # frames are named <name>.<number>.exr
    assert {Effect.MOTION, Effect.CAMERA} & scene.effects == frozenset({effect})
    first, later = scene.at(0.0), scene.at(1.0)
    first_poses, later_poses = (np.stack([p for p in i.poses if p is not None]) for i in (first, later))
    assert np.array_equal(first_poses, later_poses) == (motion == "orbit")
    assert np.array_equal(first.world_to_view, later.world_to_view) == (motion == "turntable")


@pytest.mark.parametrize("name", ["none", "n" * 300])
@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_missing_file(name: str, suffix: str, tmp_path: Path) -> None:
    with pytest.raises(InputMissing, match="there is no such model"):
        load_model(tmp_path / (name + suffix))


TEXTURED = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n"
PICTURED = "ply\nformat ascii 1.0\ncomment TextureFile none.png\nelement vertex 3\nproperty float x\nproperty float y\n"
PICTURED += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
PICTURED += "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize(
    ("name", "content", "library", "says"),
    [
        ("a.obj", TEXTURED, None, r"there is no a\.mtl beside the model; copy it there"),
        ("a.obj", TEXTURED, "newmtl red\nmap_Kd none.png\n", r"there is no none\.png beside the model"),
        ("a.obj", TEXTURED, "newmtl red\nmap_Kd ../../etc/hostname\n", "there is no .*hostname beside the model"),
        (
            "a.obj",
            TEXTURED,
            "newmtl red\nmap_Kd cut.png\n",
            r"image cut\.png cannot be read .*; save it again",
        ),
        ("a.obj", TEXTURED, "newmtl red\nmap_Kd a.mtl.txt\n", r"image a\.mtl\.txt cannot be read \(of no known format"),
        ("a.ply", PICTURED, None, r"there is no none\.png beside the model"),
    ],
)
def test_a_file_beside_a_model_that_cannot_be_read_is_named(
    name: str, content: str, library: str | None, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content)
    Image.effect_noise((64, 64), 99.0).save(tmp_path / "whole.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:999])
    (tmp_path / "a.mtl.txt").touch()
    if library is not None:
        (tmp_path / "a.mtl").write_text(library)
    with pytest.raises((DataError, InputMissing), match=says) as caught:
        load_model(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")


def test_a_library_that_only_the_sum_of_a_model_reads_is_named(tmp_path: Path) -> None:
    """trimesh reads the first of several."""
    (tmp_path / "a.mtl").write_text("newmtl red\n")
    (tmp_path / "a.obj").write_text(TEXTURED + "mtllib b.mtl\n")
    assert load_model(tmp_path / "a.obj")
    with pytest.raises(InputMissing, match=r"there is no b\.mtl beside the model"):
        content_sha256(tmp_path / "a.obj")


@pytest.mark.parametrize("mode", ["I;16", "P", "L", "1"])
def test_a_texture_of_any_depth_keeps_its_values(mode: str, tmp_path: Path) -> None:
    greys = np.array([[0, 255], [255, 0]] if mode == "1" else [[0, 64], [128, 255]], np.uint8)
    deep = Image.fromarray(greys.astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(greys).convert(mode)
    deep.save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl red\nmap_Kd textures\\a.png\n")  # as written on Windows
    (tmp_path / "a.obj").write_text(TEXTURED)
    (part,), _, _ = load_model(tmp_path / "a.obj")
    assert part.material.base_texture is not None
    assert part.material.base_texture.texels.tolist() == np.dstack([greys] * 3 + [np.full_like(greys, 255)]).tolist()


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_what_has_no_animation_is_not_played(suffix: str, tmp_path: Path) -> None:
    path = export(tmp_path, f"box.{suffix}", trimesh.creation.box((1.0, 1.0, 1.0)))
    with pytest.raises(UsageError, match="it has no animation to play; use --motion turntable or orbit"):
        build_scene(f"file:{path}", motion="play")


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "a.obj", "a.ply", "a.stl"])
@pytest.mark.parametrize("content", [b"", b"\0\1\2 nonsense \xff" * 9], ids=["empty", "nonsense"])
def test_unreadable_file(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError) as caught:
        load_model(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(caught.value)


def test_no_size(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n")
    with pytest.raises(DataError, match="the model has no size"):
        load_model(tmp_path / "flat.obj")


def test_unknown_motion(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such motion: jump; use one of "):
        model_scene(str(tmp_path / "a.glb"), "jump", 0)


@pytest.mark.parametrize(
    "change",
    [
        ("v ", "  v  "),
        ("f", "# mtllib none.mtl\n #f 9 9 9\nf"),
        (" ", "\t"),
        ("f", " \tf"),
        ("\n", "\r"),
        ("\n", "\r\n"),
    ],
)
def test_lines_of_wavefront_may_begin_part_and_end_as_they_like(change: tuple[str, str], tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".replace(*change)
    (tmp_path / "a.obj").write_bytes(text.encode())
    (part,), _, _ = load_model(tmp_path / "a.obj")
    assert part.mesh.triangles.shape == (1, 3, 3)


def test_an_object_of_wavefront_is_no_metal(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1.0 0.25 0.0\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (part,), _, _ = load_model(tmp_path / "a.obj")
    assert part.material.metallic == 0.0
    assert part.material.base_colour == pytest.approx((1.0, 0.25, 0.0, 1.0), abs=0.5 / 255)
