"""Every scene keeps its promises: what it declares happens, and nothing else does."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cltaa.cli import main
from cltaa.frame import Effect
from cltaa_datasets import textures
from cltaa_datasets.registry import SCENES
from cltaa_datasets.scene import AlphaMode, Instant, Material, Perspective, Scene, Sky
from cltaa_datasets.scenes import build_scene, registered
from tests.built_scenes import built
from tests.datasets.scene_digests import DIGESTS, digest

NAMES = [entry.name for entry in registered()]
TIMES = (0.0, 1.0 / 30.0, 0.7, 1.6)
WHOLE, FEW = textures.SIZE, 64  # texels a side


@pytest.fixture(scope="module", params=NAMES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return built(request.param)


def camera_of(instant: Instant) -> tuple[bytes, object]:
    return instant.world_to_view.tobytes(), instant.lens


def glossy(material: Material) -> bool:
    return material.specular > 0.0 or material.metallic > 0.0


def test_every_effect_has_a_scene_of_its_own() -> None:
    shape = {Effect.DISOCCLUSION, Effect.THIN}  # what comes with the things that are shown
    effects = [entry.effects - shape for entry in registered()]
    # Highlights that do not move or flash are only bright, and a cut is a move of the camera.
    drawn = set(Effect) - {Effect.NOISE}
    alone = drawn - shape - {Effect.HDR, Effect.CUT}
    assert {effect for effect in alone if frozenset({effect}) in effects} == alone
    assert set().union(*(entry.effects for entry in registered())) == drawn
    assert frozenset() in effects


def test_what_happens_is_declared(scene: Scene) -> None:
    instants = [scene.at(time) for time in TIMES]
    # What can be seen through writes no motion; the channel reactive covers it.
    solid = [part.material.alpha_mode is not AlphaMode.BLEND for part in scene.parts]
    poses = {
        tuple(
            None if pose is None else pose.tobytes() for pose, hides in zip(instant.poses, solid, strict=True) if hides
        )
        for instant in instants
    }
    bodies = {part.name for part, hides in zip(scene.parts, solid, strict=True) if hides and part.deforms}
    shapes = {tuple(i.shapes[name].positions.tobytes() for name in sorted(bodies)) for i in instants}
    assert (len(poses) > 1 or len(shapes) > 1) == (Effect.MOTION in scene.effects)
    assert (len({camera_of(instant) for instant in instants}) > 1) == (Effect.CAMERA in scene.effects)
    assert (len({instant.lights for instant in instants}) > 1) <= (Effect.ILLUMINATION in scene.effects)
    assert (len({instant.exposure for instant in instants}) > 1) == (Effect.EXPOSURE in scene.effects)
    assert (len({instant.shot for instant in instants}) > 1) == (Effect.CUT in scene.effects)
    materials = [part.material for part in scene.parts]
    if {Effect.MOTION, Effect.CAMERA} & scene.effects and Effect.ILLUMINATION not in scene.effects:
        # The colour of a shining surface follows the eye.
        assert not any(glossy(material) for material in materials)
    assert any(m.alpha_mode is AlphaMode.BLEND for m in materials) == (Effect.REACTIVE in scene.effects)
    assert (scene.at(0.0).sky is None) == (Effect.ALPHA in scene.effects)


def test_meshes_colours_and_textures_are_what_they_were() -> None:
    assert {name: digest(built(name)) for name in NAMES} == DIGESTS


def test_a_scene_is_a_function_of_time() -> None:
    for scene in map(built, NAMES):
        one, other = scene.at(0.7), scene.at(0.7)
        assert one.looks_like(other), scene.name
        assert len(one.poses) == len(scene.parts), scene.name
        assert len({part.name for part in scene.parts}) == len(scene.parts), scene.name
        assert set(one.shapes) == {part.name for part in scene.parts if part.deforms}, scene.name


def test_the_seed_changes_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    def texels(scene: Scene) -> list[bytes]:
        materials = [part.material for part in scene.parts]
        found = (texture for m in materials for texture in (m.base_texture, m.emissive_texture))
        return [texture.texels.tobytes() for texture in found if texture is not None]

    # Of each texture so few texels that it takes no time to paint.
    monkeypatch.setattr(textures, "SIZE", FEW)
    for painter in (textures.noise, textures.coordinates, textures.zone_plate):
        defaults = tuple(FEW if given == WHOLE else given for given in painter.__defaults__ or ())
        monkeypatch.setattr(painter, "__defaults__", defaults)
    for name in NAMES:
        assert texels(build_scene(name, 0)) != texels(build_scene(name, 1)), name


def test_scenes_are_listed_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["scenes"]
    assert [entry["name"] for entry in listed] == NAMES
    assert all(entry["description"] and entry["effects"] == sorted(entry["effects"]) for entry in listed)


def test_scenes_are_listed_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in NAMES)


def test_an_instant_looks_like_itself_and_notices_every_change() -> None:
    now = build_scene("morphing").at(0.5)
    assert now.looks_like(
        replace(now, shot=now.shot + 1, poses=tuple(None if p is None else p.copy() for p in now.poses))
    )
    (name, shape), *others = now.shapes.items()
    moved, nudged = now.world_to_view.copy(), shape.positions.copy()
    moved[0, 3] += 1e-9
    nudged[0, 0] += 1e-9
    changes: list[dict[str, Any]] = [
        {"world_to_view": moved},
        {"lens": Perspective(0.1)},
        {"poses": (None, *now.poses[1:])},
        {"lights": now.lights[1:]},
        {"sky": Sky(stars=1.0)},
        {"exposure": 2.0},
        {"shapes": dict(others)},
        {"shapes": {**now.shapes, name: replace(shape, positions=nudged)}},
    ]
    for change in changes:
        assert not now.looks_like(replace(now, **change)), list(change)


def test_the_scene_of_the_page_is_drawn_and_keeps_its_promises(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What docs/capture.md gives to start from runs as it stands."""
    page = (Path(__file__).parents[2] / "docs" / "capture.md").read_text()
    (module,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    try:
        exec(compile(module, "docs/capture.md", "exec"), {})
        command = ["capture", "pendulum", "-o", str(tmp_path / "p"), "--frames", "4", "--size", "160x90"]
        assert main(command) == 0
        capsys.readouterr()
        assert main(["inspect", str(tmp_path / "p"), "--pixels", "--json"]) == 0
    finally:
        SCENES.pop("pendulum", None)
    found = json.loads(capsys.readouterr().out)
    assert (found["problems"], found["idle"]) == ([], [])
    assert found["effects"] == ["disocclusion", "motion", "sky"]
