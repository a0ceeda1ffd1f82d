"""A projection that turns the picture over, before pictures of noise, in which vectors alone can bear it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.lab.check.camera import check_upside_down
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.registration import Shot
from tests.lab.check.mistakes import FLIP_Y, full_motion
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

FLIP_X = np.diag([-1.0, 1.0, 1.0, 1.0])


def climbing(flip: np.ndarray = FLIP_Y) -> list[Frame]:
    """Three frames of a camera that climbs, whose projection is turned over by ``flip``."""
    cameras = [make_camera((0.0, 0.2 * index, 5.0)) for index in range(3)]
    return [make_frame(n, camera=Camera(c.world_to_view, flip @ c.view_to_clip)) for n, c in enumerate(cameras)]


def found(frames: Sequence[Frame]) -> list[Finding]:
    return check_upside_down(Shot(frames, (WIDTH, HEIGHT)))


def test_nothing_bears_it_out() -> None:
    (finding,) = found(climbing())
    assert finding.name == "camera-y-flipped"
    assert finding.fix == {"camera": {"flip_y": True}}
    assert finding.evidence == "it scales y by -1.73 and x by 1.08: the world would be seen mirrored"


@pytest.mark.parametrize("flip", [np.eye(4), FLIP_X, FLIP_X @ FLIP_Y], ids=["upright", "mirrored", "half-a-turn"])
def test_what_keeps_y_or_turns_both_is_not_looked_at(flip: np.ndarray) -> None:
    assert found(climbing(flip)) == []


def between(share: float) -> list[Frame]:
    """Vectors in every pixel, ``share`` of the way from the declared camera's to those of the camera turned over."""
    frames = climbing()
    ways = zip(frames, full_motion(frames), full_motion(climbing(np.eye(4))), strict=True)
    out = []
    for frame, declared, turned in ways:
        assert declared.motion is not None
        assert turned.motion is not None
        vectors = declared.motion + np.float32(share) * (turned.motion - declared.motion)
        out.append(replace(frame, motion=vectors))
    return out


@pytest.mark.parametrize(("share", "names"), [(0.0, []), (0.15, []), (0.3, ["camera-y-flipped"])])
def test_vectors_that_fill_the_picture_bear_it_out_where_they_are_clearly_its_own(
    share: float, names: list[str]
) -> None:
    """A quarter as far from the declared motion as from the other, which 0.2 of the way is."""
    assert [finding.name for finding in found(between(share))] == names


def test_they_must_do_so_in_every_pair() -> None:
    assert len(found([*between(0.0)[:2], between(1.0)[2]])) == 1


@pytest.mark.parametrize(("rows", "count"), [(HEIGHT, 0), (HEIGHT // 2 + 2, 0), (HEIGHT // 2 - 2, 1)])
def test_vectors_of_less_than_half_the_picture_do_not_bear_it_out(rows: int, count: int) -> None:
    frames = between(0.0)
    for frame in frames:
        assert frame.motion is not None
        frame.motion[rows:] = np.nan
    assert len(found(frames)) == count
