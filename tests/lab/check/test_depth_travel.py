"""The kind of depth where no plane tells: path tracers' samples lie anywhere in their pixels, and bend all planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.inputs.convert import planar_depth
from cltaa.inputs.profile import Depth, DepthKind
from cltaa.io.sequence import open_sequence
from cltaa.lab.check.depth import planes_decide
from cltaa.lab.check.depth_travel import ROUNDED, _by_kind, _pairs, check_kind, tells_kind_by_travel
from cltaa.lab.check.registration import Shot
from cltaa.lab.check.report import check_frames
from cltaa.lab.check.unverifiable import unverifiable
from cltaa_capture.sequence import Request, capture_sequence
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import near_plane, ray_distance

WIDTH, HEIGHT, WITHIN = 96, 54, 4  # columns, rows, and places across and down a pixel


@pytest.fixture(scope="module")
def scattered(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """8 frames of a scene, each pixel of which is one sample anywhere in it."""
    folder, random = tmp_path_factory.mktemp("scattered"), np.random.default_rng(0)

    @cache
    def capture(name: str) -> list[Frame]:
        width, height = WITHIN * WIDTH, WITHIN * HEIGHT
        drawn = Request(name, folder / name, frames=8, width=width, height=height, jitter="none", fps=12.0, seed=1)
        capture_sequence(drawn)
        made = []
        for frame in open_sequence(folder / name):
            place = np.mgrid[:HEIGHT, :WIDTH] * WITHIN + random.integers(0, WITHIN, (2, HEIGHT, WIDTH))
            colour, depth = frame.colour[*place], frame.depth[*place]
            bare = Frame(index=frame.index, colour=colour, depth=depth, camera=frame.camera, jitter_px=(0.0, 0.0))
            made.append(bare)
        return made

    return capture


def stored(frames: Sequence[Frame], kind: str) -> list[Frame]:
    made = []
    for frame in frames:
        depth = {
            "planar": frame.depth,
            "ray": ray_distance(frame, frame.depth),
            "inverse": 1.0 / frame.depth,
            "device-reversed": near_plane(frame) / frame.depth,
        }[kind]
        made.append(replace(frame, depth=np.asarray(depth, np.float32)))
    return made


def mistakes(frames: Sequence[Frame]) -> list[str]:
    return [finding.name for finding in check_frames(frames) if finding.mistake or finding.question]


@pytest.mark.parametrize("kind", ["planar", "ray", "inverse"])
def test_the_depth_of_other_frames_tells(kind: str, scattered: Scene) -> None:
    frames = stored(scattered("foliage"), kind)
    assert not planes_decide(frames, Depth())
    assert mistakes(frames) == ([] if kind == "planar" else [f"depth-{kind}"])


@pytest.mark.parametrize("declared", ["planar", "ray", "inverse"])
@pytest.mark.parametrize("kind", ["planar", "ray", "inverse"])
@pytest.mark.parametrize("name", ["corridor", "pan"])
def test_each_kind_is_a_hypothesis_whatever_is_declared(name: str, kind: str, declared: str, scattered: Scene) -> None:
    rule = Depth(kind=DepthKind(declared))
    frames = stored(scattered(name), kind)
    read = [replace(f, depth=planar_depth(f.depth, rule, f.camera, f.jitter_px)) for f in frames]
    found = check_kind(Shot(read, (WIDTH, HEIGHT)), rule)
    assert [finding.fix for finding in found if finding.settled.mistake] == (
        [] if kind == declared else [{"depth": {"kind": kind}}]
    )


@pytest.mark.parametrize("name", ["corridor", "dolly"])
@pytest.mark.parametrize("rounded", [np.float32, np.float16])
def test_reversed_device_depth_is_told_where_no_plane_tells(name: str, rounded: type, scattered: Scene) -> None:
    """Halves bend every plane, as scattered samples do."""
    frames = stored(scattered(name), "device-reversed")
    frames = [replace(frame, depth=frame.depth.astype(rounded).astype(np.float32)) for frame in frames]
    assert mistakes(frames) == ["depth-device-reversed"]


@pytest.mark.parametrize("name", ["corridor", "dolly"])
def test_a_wrong_jitter_does_not_make_another_kind_of_depth_one_of_another_unit(name: str, scene: Scene) -> None:
    """The factor that fits best is not taken where another kind fits better, which the right jitter will show."""
    halves = [
        replace(frame, depth=(near_plane(frame) / frame.depth).astype(np.float16).astype(np.float32))
        for frame in scene(name)
    ]
    upside_down = [replace(frame, jitter_px=(frame.jitter_px[0], -frame.jitter_px[1])) for frame in halves]
    assert "depth-scaled" not in mistakes(upside_down)
    assert mistakes(halves) == ["depth-device-reversed"]


def test_a_camera_that_rolls_or_stands_does_not_tell(scattered: Scene) -> None:
    """About the view axis, points keep their depth of any kind."""
    for name in ("roll", "still"):
        for kind in ("planar", "ray", "inverse"):
            shot = Shot(stored(scattered(name), kind), (WIDTH, HEIGHT))
            assert check_kind(shot, Depth()) == [], (name, kind)
        assert not tells_kind_by_travel(scattered(name)), name
    (line,) = [line for line in unverifiable(Shot(scattered("roll"), (WIDTH, HEIGHT))) if "kind of depth" in line]
    assert line == "the kind of depth: no plane in view lies aslant, and the camera's motion does not tell"
    assert not any("kind of depth" in line for line in unverifiable(Shot(scattered("foliage"), (WIDTH, HEIGHT))))


def test_samples_of_declared_places_agree_to_rounding(scene: Scene) -> None:
    """3e-7 were seen; with the jitter of the other sign it is a thousandth."""
    assert _by_kind(_pairs(scene("corridor")), Depth())[DepthKind.PLANAR].size <= ROUNDED
    spoilt = [replace(f, jitter_px=(-f.jitter_px[0], -f.jitter_px[1])) for f in scene("corridor")]
    assert _by_kind(_pairs(spoilt), Depth())[DepthKind.PLANAR].size > 10 * ROUNDED


def test_wrong_matrices_are_no_kind_of_depth(scattered: Scene) -> None:
    """None fits then: each frame has the camera of another."""
    frames = scattered("foliage")
    cameras = [frame.camera for frame in frames][::-1]
    spoilt = [replace(frame, camera=camera) for frame, camera in zip(frames, cameras, strict=True)]
    assert check_kind(Shot(spoilt, (WIDTH, HEIGHT)), Depth()) == []
    assert not tells_kind_by_travel(spoilt)
    assert tells_kind_by_travel(frames)


def test_frames_across_a_cut_are_not_compared(scattered: Scene) -> None:
    frames = stored(scattered("foliage"), "ray")
    assert check_kind(Shot(frames, (WIDTH, HEIGHT)), Depth())
    cut = [replace(frame, cut=frame.index == frames[4].index) for frame in frames]
    assert check_kind(Shot(cut, (WIDTH, HEIGHT)), Depth()) == []
