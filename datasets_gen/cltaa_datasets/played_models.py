"""An animated glTF file as a scene: it plays before a still camera, on the floor that other models turn on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import CltaaError
from cltaa.frame import Effect
from cltaa_datasets import animation, model_files
from cltaa_datasets.gltf_model import AnimatedModel
from cltaa_datasets.scene import Instant, Perspective, Scene, Sun

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
    floor = model_files.tiled_floor(rng)
    stand, height = model_files.standing(*_bounds(model), Path(path))
    stand = animation.rotation(animation.UP, model_files.start_angle(rng)) @ stand
    effects = model_files.effects_of(model.parts, Effect.MOTION)
    lights = (Sun(model_files.SUN, (3.2, 3.0, 2.6)),)
    eye = (0.0, height / 2.0 + model_files.RISE, model_files.DISTANCE)
    view, lens = animation.look_at(eye, (0.0, height / 2.0, 0.0)), Perspective(model_files.FIELD_OF_VIEW)

    def at(time: float) -> Instant:
        poses, shapes = model.at(time)
        placed = (*(stand @ pose for pose in poses), np.eye(4))
        return Instant(view, lens, placed, lights, model_files.SKY, shapes=shapes)

    return Scene(model_files.scene_name(path), effects, (*model.parts, floor), at)


def _bounds(model: AnimatedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the greatest coordinates [3] over all that the model does."""
    corners: list[NDArray[np.float64]] = []
    for time in np.linspace(0.0, model.tree.duration, LOOKS).tolist():
        poses, shapes = model.at(time)
        stood = (shapes[p.name].positions if p.name in shapes else np.asarray(p.mesh.vertices) for p in model.parts)
        corners += model_files.bounds(stood, poses)
    return np.min(corners, axis=0), np.max(corners, axis=0)
