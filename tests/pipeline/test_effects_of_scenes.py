"""For every scene: the steps that its plan leaves out change no bit, on frames around a cut and a step of exposure."""

from __future__ import annotations

import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa_capture.jitter import jitter_sequence
from cltaa_datasets.scenes import registered
from tests.built_scenes import built
from tests.capture.analytic_scenes import drawing

WIDTH, HEIGHT = 48, 27
FPS = 30.0
FRAMES = range(11, 14)  # 12 begins what changes every 0.4 s


def captured(name: str) -> list[Frame]:
    scene, jitter = built(name), jitter_sequence("halton:8").tolist()
    frames = []
    with drawing(scene, WIDTH, HEIGHT) as renderer:
        for index in FRAMES:
            now, before, (x, y) = scene.at(index / FPS), scene.at((index - 1) / FPS), jitter[index % len(jitter)]
            drawn = renderer.draw(now, before, (x, y))
            frames.append(drawn.frame(scene, now, index=index, jitter_px=(x, y), cut=now.shot != before.shot))
    return frames


@pytest.mark.parametrize("name", [entry.name for entry in registered()])
def test_the_plan_of_a_scene_changes_no_bit(name: str) -> None:
    planned, every = Resolver(device="numpy", strict=True), Resolver(device="numpy", strict=True, every_step=True)
    for frame in captured(name):
        assert planned.resolve(frame).tobytes() == every.resolve(frame).tobytes()
    assert planned.plan is not None
    assert every.plan is not None
    assert planned.plan.choices == every.plan.choices
    assert planned.plan.steps != every.plan.steps  # no scene calls for every step: something was left out
