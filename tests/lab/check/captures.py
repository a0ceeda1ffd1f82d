"""Captures that ``check`` is judged by, all of them right: every scene under other seeds, and models of primitives.

Each is small and its place in the list decides everything about it, so that the table in ``docs/inputs.md`` can be made
again. Margins are set on ``TUNING``; ``COUNTED`` are looked at for the table alone.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from cltaa.frame import Frame
from cltaa.io.sequence import open_sequence
from cltaa_capture.sequence import Request, capture_sequence
from cltaa_datasets.scenes import registered

WIDTH, HEIGHT = 96, 54
JITTERS = ("lattice:64", "halton:8", "r2:16", "hammersley:16", "none", "halton:32", "babylon")
SPEEDS = (30.0, 12.0, 24.0, 8.0)  # frames a second
COUNTS = (6, 8, 12)
KINDS: tuple[Callable[[np.random.Generator], trimesh.Trimesh], ...] = (
    lambda rng: trimesh.creation.box(rng.uniform(0.3, 1.5, 3)),
    lambda rng: trimesh.creation.icosphere(subdivisions=int(rng.integers(0, 4)), radius=rng.uniform(0.3, 1.0)),
    lambda rng: trimesh.creation.cylinder(
        rng.uniform(0.1, 0.8), rng.uniform(0.2, 2.0), sections=int(rng.integers(3, 32))
    ),
    lambda rng: trimesh.creation.cone(rng.uniform(0.2, 0.9), rng.uniform(0.3, 2.0), sections=int(rng.integers(3, 32))),
    lambda rng: trimesh.creation.capsule(rng.uniform(0.3, 1.5), rng.uniform(0.1, 0.6)),
    lambda rng: trimesh.creation.torus(rng.uniform(0.6, 1.2), rng.uniform(0.05, 0.4)),
    lambda rng: trimesh.creation.annulus(rng.uniform(0.1, 0.5), rng.uniform(0.6, 1.2), rng.uniform(0.1, 1.0)),
    lambda rng: trimesh.creation.uv_sphere(rng.uniform(0.3, 1.0)),
)


class Capture(NamedTuple):
    """What decides the pixels of one capture; ``model`` is the seed of a model, None for a scene."""

    scene: str
    model: int | None
    seed: int
    jitter: str
    fps: float
    frames: int

    @property
    def name(self) -> str:
        return f"{self.scene}-{self.seed if self.model is None else self.model}-{self.jitter.replace(':', '')}"

    def frames_in(self, folder: Path) -> list[Frame]:
        """Its frames, drawn into ``folder``."""
        scene, motion, output = self.scene, None, folder / self.name
        if self.model is not None:
            scene, motion = f"file:{model(self.model, folder)}", self.scene
        drawn = Request(
            scene,
            output,
            frames=self.frames,
            width=WIDTH,
            height=HEIGHT,
            jitter=self.jitter,
            motion=motion,
            fps=self.fps,
            seed=self.seed,
        )
        capture_sequence(drawn)
        return list(open_sequence(output))


def model(seed: int, folder: Path) -> Path:
    """Write one primitive or a heap of them: plain, coloured by face or by corner, lying any way."""
    rng = np.random.default_rng(seed)
    parts: list[trimesh.Trimesh] = []
    kind = KINDS[seed % len(KINDS)]
    heap = 1 if rng.random() < 0.6 else int(rng.integers(2, 14))
    colours = ("none", "face", "corner")[int(rng.integers(0, 3))]
    for _ in range(heap):
        mesh = kind(rng)
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        if heap > 1:
            mesh.apply_translation(rng.uniform(-1.5, 1.5, 3))
        if colours == "face":
            mesh.unmerge_vertices()
            mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=_any_colours(rng, len(mesh.faces)))
        if colours == "corner":
            mesh = mesh.subdivide() if len(mesh.faces) < 500 else mesh
            mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=_any_colours(rng, len(mesh.vertices)))
        parts.append(mesh)
    path = folder / f"model-{seed}.{'obj' if colours == 'none' else 'glb'}"
    if not path.exists():
        trimesh.util.concatenate(parts).export(path)  # type: ignore[no-untyped-call]
    return path


def _any_colours(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(20, 255, (count, 4)).astype(np.uint8) | np.array([0, 0, 0, 255], np.uint8)


def _captures(first: int, seeds: int, models: int) -> list[Capture]:
    made: list[Capture] = []
    scenes = [(entry.name, None, first + n) for n in range(seeds) for entry in registered()]
    shapes = [(motion, first + n, 0) for n in range(models) for motion in ("turntable", "orbit")]
    for place, (scene, shape, seed) in enumerate([*scenes, *shapes]):
        jitter, fps = JITTERS[place % len(JITTERS)], SPEEDS[place // 3 % len(SPEEDS)]
        made.append(Capture(scene, shape, seed, jitter, fps, COUNTS[place // 5 % len(COUNTS)]))
    return made


TUNING = _captures(first=1, seeds=2, models=40)
COUNTED = _captures(first=1000, seeds=4, models=90)
