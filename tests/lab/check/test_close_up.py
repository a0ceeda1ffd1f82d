"""Close-ups: most of the picture moves on its own, and what rests bears matrices and depth out by its vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.lab.check.report import check_frames
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, full_motion, mistakes

RESTS = 0.2  # of the columns


def close_up(frames: Sequence[Frame], near: float, *, vectors: bool = True) -> list[Frame]:
    """``frames`` whose columns but the first are something ``near`` times as far, that moves as what was there does."""
    made = []
    for frame in full_motion(frames):
        depth = frame.depth.copy()
        depth[:, int(RESTS * frame.width) :] *= np.float32(near)
        made.append(replace(frame, depth=depth, motion=frame.motion if vectors else None))
    return made


NEAR = [0.5, *(pytest.param(near, marks=pytest.mark.big) for near in (0.25, 2.0))]  # each takes 4 seconds


@pytest.mark.parametrize("near", NEAR)
@pytest.mark.parametrize("name", ["corridor", "orbit"])
def test_what_moves_on_its_own_does_not_make_depth_one_of_another_unit(name: str, near: float, scene: Scene) -> None:
    assert mistakes(close_up(scene(name), near)) == []


@pytest.mark.parametrize("near", NEAR)
@pytest.mark.parametrize("name", ["corridor", "orbit"])
@pytest.mark.parametrize("kind", ["device-reversed", "inverse"])
def test_the_kind_of_depth_is_that_by_which_it_rests(kind: str, name: str, near: float, scene: Scene) -> None:
    """Of two that differ by a factor, whatever the pictures of the rest show."""
    (finding,) = check_frames(MISTAKES[f"depth-{kind}"].plant(close_up(scene(name), near)))
    assert finding.fix == {"depth": {"kind": kind}}


def test_without_vectors_the_pictures_raise_no_more_than_a_question(scene: Scene) -> None:
    (finding,) = check_frames(close_up(scene("corridor"), 0.25, vectors=False))
    assert (finding.name, finding.mistake, finding.question, finding.fix) == ("depth-scaled", False, True, {})


@pytest.mark.parametrize("mistake", ["depth-scaled", "camera-inverse", "camera-mirrored"])
def test_vectors_that_bear_nothing_out_hide_no_mistake(mistake: str, scene: Scene) -> None:
    assert mistakes(MISTAKES[mistake].plant(close_up(scene("corridor"), 1.0))) == [mistake]
