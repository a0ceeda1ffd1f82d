"""An animated glTF file as a scene: it plays before a still camera, on the floor that other models turn on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cltaa.errors import CltaaError, DataError
from cltaa.frames import Effect
from cltaa_datasets import animation, meshes, model_files, textures
from cltaa_datasets.gltf_model import AnimatedModel
from cltaa_datasets.scene import AlphaMode, Instant, Material, Matrix, Part, Perspective, Scene, Shape, Sun

LOOKS = 16  # instants at which the size of what is played is measured


def default_motion(path: str) -> str:
    """How a file is shown where nobody says: as it is animated, else on a turntable."""
    try:
        return "play" if AnimatedModel.animates(Path(path)) else "turntable"
    except CltaaError:
        return "turntable"  # whose reader knows more formats, and says what is wrong


def played_scene(path: str, seed: int) -> Scene:
    """Stand an animated model on a tiled floor, scaled to a radius of 1 over all that it does; raises DataError."""
    model = AnimatedModel(Path(path))
    rng = np.random.default_rng(seed)
    tiles = textures.blocks(rng, (0.50, 0.48, 0.45), (0.20, 0.19, 0.18), 4, 4, 0.02, bonded=False)
    floor = Part("floor", meshes.floor(80.0, 1.2, 48), Material(base_texture=tiles, specular=0.0))
    stand, height = _standing(model, Path(path))
    stand = animation.rotation(animation.UP, float(rng.uniform(-model_files.START, model_files.START))) @ stand
    effects = model_files.ALWAYS | {Effect.MOTION}
    if any(part.material.alpha_mode is AlphaMode.BLEND for part in model.parts):
        effects |= {Effect.REACTIVE}
    lights = (Sun(model_files.SUN, (3.2, 3.0, 2.6)),)
    eye = (0.0, height / 2.0 + model_files.RISE, model_files.DISTANCE)
    view, lens = animation.look_at(eye, (0.0, height / 2.0, 0.0)), Perspective(model_files.FIELD_OF_VIEW)

    def at(time: float) -> Instant:
        poses, shapes = model.at(time)
        placed = (*(stand @ pose for pose in poses), np.eye(4))
        return Instant(view, lens, placed, lights, model_files.SKY, shapes=shapes)

    return Scene(model_files.scene_name(path), effects, (*model.parts, floor), at)


def _standing(model: AnimatedModel, path: Path) -> tuple[Matrix, float]:
    """The pose that puts the model on the ground with a radius of 1, and its height there."""
    corners = []
    for time in np.linspace(0.0, model.tree.duration, LOOKS).tolist():
        poses, shapes = model.at(time)
        for part, pose in zip(model.parts, poses, strict=True):
            shape: Shape | None = shapes.get(part.name)
            points = np.asarray(part.mesh.vertices if shape is None else shape.positions) @ pose[:3, :3].T + pose[:3, 3]
            corners += [points.min(axis=0), points.max(axis=0)]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    radius = float(np.linalg.norm(high - low)) / 2.0
    if not np.isfinite(radius) or radius == 0.0:
        raise DataError(
            "the model has no size", path=path, expected="finite bounds", found=[low.tolist(), high.tolist()]
        )
    centre = (low + high) / 2.0
    stand = animation.scaling(1.0 / radius) @ animation.translation((-centre[0], -low[1], -centre[2]))
    return stand, float(high[1] - low[1]) / radius
