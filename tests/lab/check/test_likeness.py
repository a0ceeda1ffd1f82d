"""Jitter of patterns finer than a pixel, where shifts are measured wrong: the likeness of samples tells it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.io.sequence import open_sequence
from cltaa.lab.check.jitter import declared_jitter, measure_likeness
from cltaa.lab.check.registration import Shot
from cltaa_capture.sequence import Request, capture_sequence
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, mistakes
from tests.sequence_factory import make_camera, make_frame


@pytest.mark.parametrize("name", ["morphing", "smoke", "cloth", "everything"])
def test_patterns_finer_than_a_pixel_raise_no_alarm(name: str, small: Scene) -> None:
    assert mistakes(small(name)) == []


@pytest.mark.parametrize(
    ("scene", "jitter"), [("occluder", "r2:2"), ("occluder", "halton:2"), ("occluder", "r2:3"), ("still", "r2:4")]
)
def test_few_positions_fit_many_maps_and_raise_no_alarm(scene: str, jitter: str, tmp_path: Path) -> None:
    capture_sequence(Request(scene, tmp_path, frames=12, width=96, height=54, jitter=jitter, fps=24.0, seed=1))
    assert mistakes(list(open_sequence(tmp_path))) == []


@pytest.mark.parametrize(
    "mistake",
    ["jitter-negated", "jitter-y-flipped", "jitter-swapped", "jitter-scaled-2", "jitter-units-uv", "jitter-late"],
)
def test_patterns_finer_than_a_pixel_tell_mistakes(mistake: str, small: Scene) -> None:
    assert mistakes(MISTAKES[mistake].plant(small("morphing"))) == [mistake]


def test_glints_of_few_frames_are_not_taken_for_half_a_jitter(small: Scene) -> None:
    assert mistakes(MISTAKES["jitter-negated"].plant(small("glints")[:8])) == ["jitter-negated"]


@pytest.mark.parametrize("mistake", ["motion-negated", "motion-y-flipped", "motion-units-uv"])
def test_slow_vectors_are_not_taken_for_half_of_them(mistake: str, small: Scene) -> None:
    """Half of the right vectors matches as well, where all are half a pixel long."""
    assert mistakes(MISTAKES[mistake].plant(small("spinner"))) == [mistake]


def waves(index: int, jitter: tuple[float, float]) -> Frame:
    """Waves across and down, taken at ``jitter``."""
    y, x = np.mgrid[:40, :60] + 0.5
    light = 0.5 + 0.2 * np.sin((x + jitter[0]) * 1.3) + 0.2 * np.sin((y + jitter[1]) * 1.7)
    colour = np.repeat(light[..., None], 3, -1).astype(np.float32)
    frame = make_frame(index, width=60, height=40, jitter_px=jitter)
    return replace(frame, colour=colour, depth=np.full((40, 60), 5.0, np.float32), camera=make_camera())


def shot(frames: list[Frame]) -> Shot:
    return Shot(frames, (60, 40))


OFFSETS = [(0.1, -0.4), (-0.3, 0.2), (0.4, 0.45), (-0.15, -0.05), (0.25, -0.2), (-0.45, 0.35)]


def test_the_scatter_is_least_under_the_jitter_that_the_samples_have() -> None:
    frames = [waves(index, jitter) for index, jitter in enumerate(OFFSETS)]
    measured = measure_likeness(shot(frames))
    assert measured is not None
    jitter = declared_jitter(frames)
    right = measured.scatter(jitter)
    for factors in ((-1, -1), (1, -1), (-1, 1), (0.5, 0.5), (2, 2), (0, 0)):
        assert measured.scatter(jitter * factors) > 1.2 * right


def test_few_frames_follow_any_distance() -> None:
    """Six pairs of nine neighbours are enough, three are not."""
    frames = [waves(index, jitter) for index, jitter in enumerate(OFFSETS)]
    measured = measure_likeness(shot(frames))
    assert measured is not None
    jitter = declared_jitter(frames)
    jitter[4:] = np.nan
    assert np.isfinite(measured.scatter(jitter))
    jitter[3:] = np.nan
    assert measured.scatter(jitter) == np.inf


def test_what_moves_or_shows_nothing_has_no_likeness() -> None:
    frames = [waves(index, jitter) for index, jitter in enumerate(OFFSETS)]
    assert measure_likeness(shot(frames)) is not None
    moving = [replace(frame, camera=make_camera((0.1 * frame.index, 0.0, 5.0))) for frame in frames]
    assert measure_likeness(shot(moving)) is None
    assert measure_likeness(Shot(frames, (60, 40), has_camera=False)) is None
    assert measure_likeness(shot([*frames[:3], *(replace(f, index=f.index + 1) for f in frames[3:])])) is None
    vectors = np.random.default_rng(0).random((40, 60, 2)).astype(np.float32)
    assert measure_likeness(shot([replace(frame, motion=vectors) for frame in frames])) is None
    flat = [replace(frame, colour=np.full_like(frame.colour, 0.5)) for frame in frames]
    assert measure_likeness(shot(flat)) is None
