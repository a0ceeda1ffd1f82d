"""Each score against a sequence that has exactly its fault: it finds the amount, and the others stay quiet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from cltaa.frame import Frame, Image
from cltaa.lab.judge.video_scores import RANK, SCORES, VideoScores, judge_detail
from tests.sequence_factory import make_camera, make_frame

WIDTH, HEIGHT, FRAMES = 96, 64, 10
STEP = 4  # pixels a frame that the card moves to the right
CARD = (slice(16, 48), 8, 40)  # rows; first and last column in frame 0

Display = NDArray[np.float64]  # [H, W, 3], sRGB-encoded


def linear(display: Display) -> Image:
    """The inverse of the display transform, IEC 61966-2-1."""
    low = display <= 0.0031308 * 12.92
    light: Image = np.where(low, display / 12.92, ((display + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return light


def grating(index: int, *, frequency: float = 0.25, pan: float = 0.0, shift: float = 0.0) -> Display:
    """Grey waves along x, moving ``pan`` pixels a frame to the left."""
    _, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    wave = 0.5 + 0.2 * np.sin(2 * np.pi * frequency * (x + pan * index + shift) + 0.3)
    display: Display = np.repeat(wave[..., None], 3, axis=-1)
    return display


def backdrop(index: int, *, frequency: float = 0.25, pan: float = 0.0) -> tuple[Frame, Display]:
    """A flat picture before a still camera, or panned by its motion channel."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), jitter_px=(0.0, 0.0), effects=None)
    motion = np.full((HEIGHT, WIDTH, 2), (pan, 0.0), np.float32)
    frame = replace(frame, depth=np.full_like(frame.depth, 10.0), motion=motion)
    return frame, grating(index, frequency=frequency, pan=pan)


def moving_card(index: int) -> tuple[Frame, Display]:
    """A bright card before the still backdrop, nearer, with its motion."""
    frame, truth = backdrop(index)
    rows, left, right = CARD
    card = (rows, slice(left + STEP * index, right + STEP * index))
    truth[card] = (0.9, 0.85, 0.95)
    frame.depth[card] = 5.0
    assert frame.motion is not None
    frame.motion[card] = (-STEP, 0.0)
    return frame, truth


Scene = Callable[[int], tuple[Frame, Display]]
Fault = Callable[[int, Display], Display]  # frame, truth


def judge(scene: Scene, fault: Fault) -> dict[str, float]:
    scores = VideoScores()
    for index in range(FRAMES):
        frame, truth = scene(index)
        scores.add(frame, linear(truth), [linear(fault(index, truth))])
    return scores.totals[0].scores()


def ghost(strength: float) -> Fault:
    """Whatever the card disoccluded in this frame still shows a share of the card."""

    def fault(index: int, truth: Display) -> Display:
        result = truth.copy()
        rows, left, _ = CARD
        for age in range(1, min(index, 8) + 1):
            start = left + STEP * (index - age)
            behind = (rows, slice(start, start + STEP))
            result[behind] += strength * ((0.9, 0.85, 0.95) - truth[behind])
        return result

    return fault


def pulse(strength: float) -> Fault:
    """All of the picture is brighter in every other frame."""
    return lambda index, truth: truth + strength * (index % 2)


def soften(_index: int, truth: Display) -> Display:
    """(1, 2, 1) / 4 along x, around the edge, since the waves fit into the width."""
    return np.roll(truth, 1, axis=1) / 4 + truth / 2 + np.roll(truth, -1, axis=1) / 4


def slanted_edge(index: int) -> tuple[Frame, Display]:
    """A still edge, 1 in 5, as its exact coverage: a ramp."""
    frame, _ = backdrop(index)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    ramp = np.clip(x - WIDTH / 2 + (y - HEIGHT / 2) / 5 + 0.5, 0, 1)
    return frame, np.repeat(0.2 + 0.6 * ramp[..., None], 3, axis=-1)


def staircase(_index: int, truth: Display) -> Display:
    """One sample a pixel, in its middle: coverage becomes all or nothing."""
    return np.where(truth > 0.5, 0.8, 0.2)


def perfect(_index: int, truth: Display) -> Display:
    return truth


# float32 colour, decoded and encoded again, moves a display value by 1e-7; what the least squares of
# cltaa.lab.judge.video_scores take for rounding is 1e-5 (the root of RANK) of a detail below 0.5.
QUIET = 5e-6


def assert_quiet(scores: dict[str, float], *names: str) -> None:
    assert all(math.isnan(scores[name]) or abs(scores[name]) <= QUIET for name in names), scores


@pytest.mark.parametrize("scene", [backdrop, moving_card, slanted_edge])
def test_the_truth_has_no_fault(scene: Scene) -> None:
    scores = judge(scene, perfect)
    assert list(scores) == [score.name for score in SCORES]
    assert_quiet(scores, *scores)
    assert math.isnan(scores["ghosting"]) == (scene is not moving_card)


@pytest.mark.parametrize(
    ("fault", "strength", "name"),
    [(ghost, 0.1, "ghosting"), (ghost, 0.5, "ghosting"), (pulse, 0.01, "flicker"), (pulse, 0.05, "flicker")],
)
def test_a_ghost_and_pulsing_raise_their_own_score_alone(
    fault: Callable[[float], Fault], strength: float, name: str
) -> None:
    scores = judge(moving_card, fault(strength))
    assert scores.pop(name) == pytest.approx(strength, abs=QUIET)
    assert_quiet(scores, *scores)


@pytest.mark.parametrize("pan", [0.0, 3.0])
@pytest.mark.parametrize("frequency", [1 / 12, 1 / 4, 5 / 12])
def test_softening_raises_the_blur_score_alone(frequency: float, pan: float) -> None:
    scores = judge(partial(backdrop, frequency=frequency, pan=pan), soften)
    # (1, 2, 1) / 4 leaves cos^2(pi f) of a wave.
    assert scores["blur"] == pytest.approx(math.sin(math.pi * frequency) ** 2, abs=1e-3)
    assert_quiet(scores, "flicker", "aliasing")


def test_blur_is_no_ghost_behind_a_moving_thing() -> None:
    """A blur mixes the card into what it disoccluded; as it does so on the other side too, that is no memory."""
    assert abs(judge(moving_card, soften)["ghosting"]) < 1e-3


def test_disoccluded_pixels_exclude_the_column_beside_the_card() -> None:
    scores, (rows, left, _) = VideoScores(), CARD
    for index in range(4):
        frame, truth = moving_card(index)
        scores.add(frame, linear(truth), [linear(truth)])
        expected = np.zeros((HEIGHT, WIDTH), np.bool_)
        if index:
            start = left + STEP * (index - 1)
            expected[rows, start : start + STEP - 1] = True
        np.testing.assert_array_equal(scores.fresh, expected)


def test_a_wire_disoccludes_nothing() -> None:
    def scene(index: int) -> tuple[Frame, Display]:
        frame, truth = backdrop(index)
        column = 8 + STEP * index
        truth[:, column] = 0.9
        frame.depth[:, column] = 5.0
        assert frame.motion is not None
        frame.motion[:, column] = (-STEP, 0.0)
        return frame, truth

    assert math.isnan(judge(scene, perfect)["ghosting"])


def test_stairs_raise_the_aliasing_score_alone() -> None:
    scores = judge(slanted_edge, staircase)
    # Fine detail of the steps is of the order of a pixel's error, uniform in +-0.3 on the one pixel a row that is cut.
    rms = 0.6 / math.sqrt(12) / math.sqrt(WIDTH)
    assert rms / 2 < scores["aliasing"] < rms
    assert_quiet(scores, "flicker")
    assert scores["blur"] < 0  # nothing is lost: hard steps are finer than the ramp


def test_a_blur_of_either_width_in_each_direction_is_no_aliasing() -> None:
    truth = np.random.default_rng(5).random((40, 40, 3))
    kernels = [np.ones(1), np.array([1, 2, 1]) / 4, np.array([1, 4, 6, 4, 1]) / 16]
    tests = [correlate1d(correlate1d(truth, across, 1), down, 0) for across, down in product(kernels, repeat=2)]
    for detail in judge_detail(truth, tests, np.ones((40, 40), bool)):
        # Of the digits of the sums the least eigenvalue that counts takes as many as it is smaller.
        assert detail.false_square <= np.finfo(float).eps / RANK * detail.detail_square


def test_a_lasting_shift_is_neither_blur_nor_aliasing() -> None:
    """Every pixel is 0.1 px off: an error of single images, which PSNR tells."""
    frequency, shift = 1 / 12, 0.1
    scores = judge(
        partial(backdrop, frequency=frequency), lambda index, _: grating(index, frequency=frequency, shift=shift)
    )
    assert scores["blur"] == pytest.approx(1 - math.cos(2 * math.pi * frequency * shift), abs=1e-3)
    assert scores["aliasing"] < 1e-3
    assert_quiet(scores, "flicker")


@pytest.mark.parametrize("change", ["cut", "gap"])
def test_no_score_over_time_spans_a_cut_or_a_gap(change: str) -> None:
    scores = VideoScores()
    for index in range(4):
        number = 2 * index if change == "gap" else index
        frame, truth = moving_card(number)
        scores.add(replace(frame, cut=change == "cut"), linear(truth), [linear(pulse(0.05)(index, truth))])
    values = scores.totals[0].scores()
    assert math.isnan(values["ghosting"])
    assert math.isnan(values["flicker"])
    assert values["blur"] == pytest.approx(0.0, abs=QUIET)


def test_an_image_given_twice_is_judged_as_it_is_alone() -> None:
    """Also where the two differed in the frame before."""
    together, first, second = VideoScores(2), VideoScores(), VideoScores()
    for index in range(FRAMES):
        frame, truth = moving_card(index)
        one, other = linear(pulse(0.05)(index, truth)), linear(ghost(0.3)(index, truth))
        other = one if index % 3 else other
        together.add(frame, linear(truth), [one, other])
        first.add(frame, linear(truth), [one])
        second.add(frame, linear(truth), [other])
    for sums, alone in zip(together.totals, [*first.totals, *second.totals], strict=True):
        assert sums.scores() == pytest.approx(alone.scores(), abs=QUIET)
    assert together.totals[0].scores() != pytest.approx(together.totals[1].scores(), abs=0.01)
