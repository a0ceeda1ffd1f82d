"""Exposures that change from frame to frame, in the pixels, in what is declared, or in both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.lab.check.colour import check_exposure
from cltaa.lab.check.report import check_frames
from tests.lab.check.conftest import Scene
from tests.sequence_factory import make_frame

SCENES = ("spinner", "starry", "corridor", "silhouettes")  # one of them before black


def exposed(frames: list[Frame], pixels: float, declared: float) -> list[Frame]:
    """As many stops more a frame in the colour, and in what is declared, which begins anywhere."""
    return [
        replace(f, colour=f.colour * np.float32(2 ** (pixels * n)), exposure=3 * f.exposure * 2 ** (declared * n))
        for n, f in enumerate(frames)
    ]


@pytest.mark.parametrize("name", SCENES)
def test_it_is_named(name: str, scene: Scene) -> None:
    for pixels, declared, expected in [
        (0.2, 0.2, []),
        (0.2, 0.0, [("exposure-missing", False)]),
        (-0.2, 0.0, [("exposure-missing", False)]),
        (0.0, 0.2, [("exposure-not-applied", True)]),
        (0.2, -0.2, [("exposure-inverted", True)]),
        (0.2, 0.4, [("exposure-missing", False)]),  # neither
        (0.005, 0.0, []),  # too little to be told from what moves
    ]:
        found = check_exposure(exposed(scene(name), pixels, declared))
        assert [(finding.name, finding.mistake) for finding in found] == expected, (pixels, declared)
        assert all(0.5 < finding.confidence < 1.0 for finding in found)
        assert all(finding.mistake or "as exposure in --camera FILE" in finding.what for finding in found)


def test_it_is_one_of_the_detectors_findings_and_hides_no_other(scene: Scene) -> None:
    spoilt = [replace(f, jitter_px=(-f.jitter_px[0], -f.jitter_px[1])) for f in exposed(scene("starry"), 0.2, 0.0)]
    assert [finding.name for finding in check_frames(spoilt)] == ["exposure-missing", "jitter-negated"]


@pytest.mark.parametrize("name", ["shadow", "glints", "flash", "exposure", "everything", "cut"])
def test_lights_that_change_and_shots_are_none(name: str, scene: Scene) -> None:
    assert check_exposure(scene(name)) == []


def test_a_shot_of_another_brightness_is_none(scene: Scene) -> None:
    frames = [replace(f, cut=n == 4) for n, f in enumerate(scene("starry"))]
    frames[4:] = [replace(f, colour=f.colour * np.float32(3)) for f in frames[4:]]
    assert check_exposure(frames) == []
    assert len(check_exposure([replace(f, cut=False) for f in frames])) == 1


def test_a_pattern_of_light_and_dark_hides_none() -> None:
    """A floor of two tiles: its middle brightness is that of the one in the first frame, then that of the other."""
    random = np.random.default_rng(0)
    frames = []
    for index in range(8):
        bright = np.arange(23 * 37) < (430 if index else 420)  # of 851
        light = np.where(bright, 0.6, 0.12) * random.uniform(0.98, 1.02, bright.size)
        colour = np.repeat(light.astype(np.float32).reshape(23, 37, 1), 3, axis=-1)
        frames.append(replace(make_frame(index), colour=colour))
    assert check_exposure(frames) == []
    assert [finding.name for finding in check_exposure(exposed(frames, 0.2, 0.0))] == ["exposure-missing"]


def test_black_frames_say_nothing(scene: Scene) -> None:
    assert check_exposure([replace(f, colour=np.zeros_like(f.colour)) for f in scene("starry")]) == []
