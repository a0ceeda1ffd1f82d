"""Small captures of every scene, made once for all tests of the detector."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cltaa.frame import Frame
from cltaa.io.sequence import open_sequence
from cltaa_capture.sequence import Request, capture_sequence
from cltaa_datasets.scenes import build_scene

MOTIONS = {"orbit": "orbit", "turning": "turntable"}  # of a model, by names that no scene has
SLOW = {"dolly": 4.0, "halt": 4.0}  # frames a second, so that 8 frames see the camera change its speed

Scene = Callable[[str], list[Frame]]


@pytest.fixture(autouse=True, scope="session")
def scenes_built_once() -> Iterator[None]:
    """Let captures of one scene in several sizes share its meshes and textures, which take up to seconds to make."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cltaa_capture.sequence.build_scene", cache(build_scene))
        yield


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Frames of a scene, or of a model under one of ``MOTIONS``, 8 of 160 x 90."""
    folder = tmp_path_factory.mktemp("checked")

    @cache
    def capture(name: str) -> list[Frame]:
        motion = MOTIONS.get(name)
        source = name if motion is None else f"file:{_model(folder)}"
        capture_sequence(
            Request(
                source,
                folder / name,
                frames=8,
                width=160,
                height=90,
                jitter="halton:8",
                motion=motion,
                fps=SLOW.get(name, 12.0),
                seed=1,
            )
        )
        return list(open_sequence(folder / name))

    return capture


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Frames of a scene, 16 of 96 x 54."""
    return sixteen(tmp_path_factory.mktemp("small"), 96, 54)


def sixteen(folder: Path, width: int, height: int) -> Scene:
    """16 frames of a scene in this size, each scene captured once."""

    @cache
    def capture(name: str) -> list[Frame]:
        capture_sequence(
            Request(name, folder / name, frames=16, width=width, height=height, jitter="halton:8", fps=12, seed=1)
        )
        return list(open_sequence(folder / name))

    return capture


def _model(folder: Path) -> Path:
    """Write a heap of boxes with coloured corners."""
    path = folder / "boxes.glb"
    if not path.exists():
        rng = np.random.default_rng(0)
        boxes = []
        for _ in range(12):
            box = trimesh.creation.box((0.5, 0.5, 0.5)).subdivide().subdivide()
            box.apply_translation(rng.uniform(-1, 1, 3))
            box.visual.vertex_colors = rng.integers(20, 255, (len(box.vertices), 4)).astype(np.uint8) | [0, 0, 0, 255]
            boxes.append(box)
        trimesh.util.concatenate(boxes).export(path)  # type: ignore[no-untyped-call]
    return path
