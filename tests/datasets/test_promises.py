"""What a scene promises holds for its pixels: every declared effect shows in them, and no other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cltaa.frame import Effect
from cltaa_datasets.scene import Instant, Scene
from cltaa_datasets.scenes import registered
from tests.built_scenes import built
from tests.capture.analytic_scenes import drawing

WIDTH, HEIGHT = 96, 54
FPS = 30.0
FRAMES = (3, 13, 14, 25)  # of 48: on both sides of a cut and of a step of exposure
BRIGHT = 8.0  # "far above 1"
# Things that change a pixel under one jitter although the camera stands.
CHANGING = {Effect.MOTION, Effect.ILLUMINATION, Effect.REACTIVE, Effect.EXPOSURE, Effect.CAMERA, Effect.CUT}


class Shots:
    """Some frames of a scene, all with one jitter."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.instants: list[Instant] = [scene.at(index / FPS) for index in FRAMES]
        with drawing(scene, WIDTH, HEIGHT) as renderer:
            self.drawn = [
                renderer.draw(now, scene.at((index - 1) / FPS), (0.2, -0.3))
                for index, now in zip(FRAMES, self.instants, strict=True)
            ]


@pytest.fixture(scope="module", params=[entry.name for entry in registered()])
def shots(request: pytest.FixtureRequest) -> Shots:
    return Shots(built(request.param))


def test_each_scene_shows_the_effects_that_it_declares(shots: Shots) -> None:
    effects, drawn = shots.scene.effects, shots.drawn
    colours = [d.colour for d in drawn]
    assert all(np.isfinite(c).all() and c.min() >= 0.0 for c in colours)
    infinite = any(np.isinf(d.depth).any() for d in drawn)
    assert infinite == bool({Effect.SKY, Effect.ALPHA} & effects)
    assert (max(c[..., :3].max() for c in colours) > BRIGHT) == (Effect.HDR in effects)
    assert (min(c[..., 3].min() for c in colours) < 1.0) == (Effect.ALPHA in effects)
    changes = any(not np.array_equal(a, b) for a, b in pairwise(colours))
    assert changes == bool(CHANGING & effects)
    if not {Effect.CAMERA, Effect.MOTION, Effect.CUT} & effects:
        assert all(np.array_equal(a.depth, b.depth) for a, b in pairwise(drawn))
    motions = [d.motion for d in drawn if d.motion is not None]
    assert len(motions) == (len(drawn) if Effect.MOTION in effects else 0)
    assert not motions or any((np.abs(motion) > 0.0).any() for motion in motions)
    shares = [d.reactive for d in drawn if d.reactive is not None]
    assert len(shares) == (len(drawn) if Effect.REACTIVE in effects else 0)
    assert not shares or max(share.max() for share in shares) > 0.0
