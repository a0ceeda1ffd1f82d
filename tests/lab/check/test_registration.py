"""Registration: pictures as signals, the shift between two of them, and pairs of frames with the points that count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.inputs.bilinear import sample
from cltaa.lab.check.registration import (
    FARTHEST_PX,
    LEAST_POINTS,
    MOST_POINTS,
    Fit,
    Pair,
    Shot,
    blur,
    fit_shift,
    grid_points,
    register_signal,
    residual_of,
    squeezed_light,
    with_gradient,
)
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame


def test_sampling() -> None:
    for height, width in [(5, 7), (1, 7), (5, 1), (1, 1), (2, 2)]:
        random = np.random.default_rng(0)
        planes = random.integers(0, 256, (2, height, width)).astype(np.float32)
        rows, columns = (axis.ravel().astype(float) for axis in np.mgrid[:height, :width])
        np.testing.assert_array_equal(sample(planes, columns, rows), planes.reshape(2, -1))
        # Quarters of whole numbers are exact, so that the order of the sum is of no matter.
        x, y = random.integers(0, 4 * width - 3, 50) / 4, random.integers(0, 4 * height - 3, 50) / 4
        near = (1 - np.abs(columns - x[:, None])).clip(0) * (1 - np.abs(rows - y[:, None])).clip(0)
        np.testing.assert_array_equal(sample(planes, x, y), planes.reshape(2, -1) @ near.T)
        np.testing.assert_array_equal(sample(planes[0], x, y), sample(planes, x, y)[0])
        outside = np.array([-0.25, width - 0.75, np.nan, np.inf, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, height - 0.5])
        assert np.isnan(sample(planes, *outside)).all(), (height, width)


def picture(height: int = 30, width: int = 40) -> np.ndarray:
    return np.random.default_rng(1).random((height, width, 3), dtype=np.float32)


def test_light_is_squeezed_about_its_own_middle() -> None:
    grey = np.repeat(np.array([[[0.0], [1.0], [2.0], [6.0]]], np.float32), 3, -1)
    # The weights of luminance sum to 1 but for their rounding; of what shines, 2 is the middle.
    np.testing.assert_allclose(squeezed_light(grey), [[0, 1 / 3, 1 / 2, 3 / 4]], rtol=8 * 2.0**-24)
    assert not squeezed_light(0 * grey).any()


def test_exposure_cancels() -> None:
    np.testing.assert_array_equal(squeezed_light(picture() * np.float32(8.0)), squeezed_light(picture()))


def test_what_is_no_light_is_dark_and_what_is_infinite_bright() -> None:
    colour = picture()
    colour[1], colour[2], colour[3], colour[4] = np.nan, -5.0, -np.inf, np.inf
    light = squeezed_light(colour)
    assert not light[1:4].any()
    assert (light[4] > 0.999).all()
    assert (light[5:] < 0.999).all()
    assert np.isfinite(register_signal(colour)).all()


@pytest.mark.parametrize("sigma", [0.6, 4.0])
def test_a_blur_spreads_by_its_deviation_and_keeps_the_sum(sigma: float) -> None:
    point = np.zeros((65, 67), np.float32)
    point[30, 34] = 1.0
    across = np.arange(67) - 34.0, np.arange(65) - 30.0
    blurred = blur(point, sigma).astype(np.float64)
    for axis, places in enumerate(across):
        weights = blurred.sum(axis)
        assert weights.sum() == pytest.approx(1.0, abs=1e-5)  # 65 * 67 roundings of numbers that sum to 1
        assert weights @ places == pytest.approx(0.0, abs=1e-4)
        # Cut off beyond 3 deviations, where 1.1 % of the variance of the continuous one lies.
        assert np.sqrt(weights @ places**2) == pytest.approx(sigma, rel=0.02)


def test_edges_are_repeated() -> None:
    ramp = np.repeat(np.array([[0.0]] * 20 + [[8.0]] * 20, np.float32), 30, 1)
    blurred = blur(ramp, 1.0)
    # Seven weights that sum to 1 but for their rounding, twice.
    np.testing.assert_allclose(blurred[-1], 8.0, rtol=16 * 2.0**-24)
    assert not blurred[0].any()
    np.testing.assert_allclose(blur(np.ones((30, 40), np.float32), 4.0), 1.0, rtol=64 * 2.0**-24)


def test_the_band_holds_neither_slow_light_nor_noise_of_single_pixels() -> None:
    """Of waves of 64, 8 and 2 pixels the middle one is left; by the Gaussians' transfer exp(-2 (pi sigma f)^2)."""
    x = np.arange(160)
    found = {}
    for length in (64, 8, 2):
        light = 1.0 + 0.5 * np.cos(2 * np.pi * x / length)
        colour = np.repeat(np.repeat(light[None, :, None], 40, 0), 3, -1).astype(np.float32)
        band, whole = (signal[8:-8, 32:-32] for signal in (register_signal(colour), squeezed_light(colour)))
        found[length] = float(band.std() / whole.std())
    assert found[64] < 0.1  # 1 - exp(-2 (pi 4 / 64)^2) = 0.07
    assert found[8] == pytest.approx(0.9, abs=0.02)  # exp(-2 (pi 0.6 / 8)^2) - 0.007, and overtones of the squeeze
    # Weights 1, 0.249 and 0.004 of pixels 0, 1 and 2 apart: (1 - 0.498 + 0.008) / (1 + 0.498 + 0.008).
    assert found[2] == pytest.approx(0.339, abs=0.01)


def test_points_are_of_a_regular_grid_and_not_too_many() -> None:
    for height, width, step in [(90, 160, 1), (200, 300, 1), (200, 301, 2), (600, 800, 3), (1080, 1920, 6)]:
        x, y = grid_points(height, width)
        assert len(x) <= MOST_POINTS, (height, width)
        across, down = np.arange(step // 2, width, step), np.arange(step // 2, height, step)
        np.testing.assert_array_equal(x, np.tile(across, len(down)))
        np.testing.assert_array_equal(y, np.repeat(down, len(across)))


Y, X = np.mgrid[:24, :32].astype(np.float64)
# Points whose neighbours rise by 1 to the right, and such whose neighbours rise by 2 downwards.
ACROSS = (X >= 3) & (X < 13) & (Y >= 4) & (Y < 20)
DOWN = (X >= 19) & (X < 29) & (Y >= 4) & (Y < 20)
BEFORE = with_gradient(np.where(X < 16, X, 2 * Y).astype(np.float32))
# Sums of 320 terms, of up to 50 each: 320 * 50 * 2^-53.
ROUNDING = 2.0**-39


def fit(there: np.ndarray, shift: tuple[float, float]) -> Fit:
    x, y = X[there], Y[there]
    now = np.where(x < 16, x + shift[0], 2 * (y + shift[1]))
    return fit_shift(now, BEFORE, x, y, 1.0)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.25, -0.5), (-0.75, 1.25), (1.5, 0.375)])
def test_a_shift_is_found(shift: tuple[float, float]) -> None:
    found = fit(ACROSS | DOWN, shift)
    np.testing.assert_allclose(found.shift, shift, rtol=0, atol=ROUNDING)
    assert found.residual < ROUNDING
    assert (ACROSS | DOWN).sum() == 320
    # All points count in full, with the noise that is taken for the least: a thousandth of the scale.
    np.testing.assert_allclose(found.information, np.diag([160.0, 4 * 160.0]) / 1e-3**2, rtol=1e-9)


def test_a_shift_is_at_most_so_far() -> None:
    assert fit(ACROSS | DOWN, (2.75, -0.5)).shift.tolist() == pytest.approx([FARTHEST_PX, -0.5], abs=ROUNDING)


@pytest.mark.parametrize(
    "there", [ACROSS, DOWN, (ACROSS | DOWN) & (np.cumsum(ACROSS | DOWN).reshape(X.shape) < LEAST_POINTS)]
)
def test_slopes_of_one_direction_and_few_points_decide_nothing(there: np.ndarray) -> None:
    assert fit(there, (0.5, 0.5)).shift.tolist() == [0.0, 0.0]


def test_a_residual_counts_at_most_one_a_point() -> None:
    x, y = np.array([4.0, 5.0, 6.0, -3.0]), np.full(4, 8.0)
    now = np.array([4.0, 5.5, 16.0, 0.0])  # as before; a quarter of the scale off; far off; outside
    assert residual_of(now, BEFORE, x, y, 2.0) == (0.0 + 0.25 + 1.0 + 1.0) / 4
    assert residual_of(now[:0], BEFORE, x[:0], y[:0], 2.0) == 1.0


Two = tuple[float, float]
STANDS, NOWHERE = make_camera(), (np.nan, np.nan)


def shot(*frames: Frame) -> Shot:
    return Shot(frames, (WIDTH, HEIGHT))


def pair_of(now: Frame, before: Frame) -> Pair:
    (pair,) = shot(before, now).pairs
    return pair


def test_a_cut_and_a_gap_part_two_frames() -> None:
    frames = [make_frame(0), make_frame(1), make_frame(2, cut=True), make_frame(3), make_frame(5), make_frame(6)]
    found = [(pair.previous.index, pair.frame.index) for pair in shot(*frames).pairs]
    assert found == [(0, 1), (2, 3), (5, 6)]
    apart = [replace(make_frame(index), step=3) for index in (0, 3, 9, 12)]
    assert [(pair.previous.index, pair.frame.index) for pair in shot(*apart).pairs] == [(0, 3), (9, 12)]


def test_reactive_and_non_finite_pixels_are_not_used() -> None:
    frame = make_frame(1)
    colour, reactive = frame.colour.copy(), np.zeros((HEIGHT, WIDTH), np.float32)
    colour[4, 7, 1] = np.nan  # one channel is enough
    colour[5, 8, 2] = np.inf
    reactive[6, 9], reactive[7, 10] = 0.05, 0.2
    pair = pair_of(replace(frame, colour=colour, reactive=reactive), make_frame(0))
    unused = {(int(pair.y[n]), int(pair.x[n])) for n in np.flatnonzero(~pair.usable)}
    assert unused == {(4, 7), (5, 8), (7, 10)}


def test_the_scale_is_twice_the_deviation_of_the_signal() -> None:
    pair = pair_of(make_frame(1), make_frame(0))
    assert pair.scale == 2 * np.std(pair.now)
    flat = replace(make_frame(1), colour=np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    assert pair_of(flat, replace(flat, index=0)).scale >= 1e-6  # nothing is divided by 0


def with_motion(motion: np.ndarray, camera: Camera = STANDS) -> Pair:
    frame = replace(make_frame(1, camera=camera), motion=motion.astype(np.float32))
    return pair_of(frame, make_frame(0, camera=STANDS))


def moving(pair: Pair) -> list[bool]:
    """Of each column, where all its rows agree."""
    rows: np.ndarray = pair.moving.reshape(HEIGHT, WIDTH)
    assert (rows == rows[0]).all()
    return [bool(column) for column in rows[0]]


def columns(rest: Two, move: Two, few: int) -> np.ndarray:
    """Vectors [H, W, 2] that are ``rest``, and in the first ``few`` columns ``move``."""
    motion = np.empty((HEIGHT, WIDTH, 2))
    motion[:], motion[:, :few] = rest, move
    return motion


def test_what_has_a_vector_moves() -> None:
    """Where few have one, and wherever the camera travels."""
    assert moving(with_motion(columns(NOWHERE, (0.0, 0.0), 10))) == [True] * 10 + [False] * (WIDTH - 10)
    assert moving(with_motion(columns((1.0, 0.0), (3.0, 0.0), 10), make_camera((0.1, 0.0, 5.0)))) == [True] * WIDTH


@pytest.mark.parametrize("rest", [(0.0, 0.0), (2.0, -1.0)])
def test_in_a_picture_full_of_vectors_that_moves_which_goes_another_way_than_most(rest: tuple[float, float]) -> None:
    """Before a camera that stands; what is off by less than a thousandth of the fastest was rounded."""
    right, down = rest
    motion = columns(rest, (right, down + 4.0), 10)
    motion[:, 10] = right + 0.002, down
    motion[:, 11] = right + 0.02, down
    assert moving(with_motion(motion)) == [True] * 10 + [False, True] + [False] * (WIDTH - 12)


def test_where_all_have_one_vector_nothing_moves() -> None:
    assert moving(with_motion(columns((2.0, -1.0), (2.0, -1.0), 10))) == [False] * WIDTH


def test_where_less_than_half_rests_all_that_has_a_vector_moves() -> None:
    motion = columns((0.0, 0.0), (1.0, 0.0), WIDTH // 3)
    motion[:, -(WIDTH // 3) :] = -1.0, 0.0
    assert moving(with_motion(motion)) == [True] * WIDTH


def test_the_cameras_motion_is_that_of_the_projected_points() -> None:
    """A few dozen operations on numbers below 100, of which an inverse may cost three digits: 50 * 1e5 * 2^-53."""
    jitter = (0.375, -0.25)
    frame = make_frame(1, camera=make_camera((0.3, -0.2, 4.5)), jitter_px=jitter)
    pair = pair_of(frame, make_frame(0, camera=STANDS, jitter_px=(-0.5, 0.125)))
    size = np.array([[WIDTH], [-HEIGHT]]) / 2
    px = np.stack([pair.x + 0.5 + jitter[0] - WIDTH / 2, pair.y + 0.5 + jitter[1] - HEIGHT / 2])
    seen = np.isfinite(frame.depth.ravel())
    depth = frame.depth.ravel()[seen].astype(np.float64)
    view = np.concatenate([px[:, seen] / size * depth, [-depth, np.ones_like(depth)]])
    view[:2] /= np.diag(frame.camera.view_to_clip)[:2, None]
    world = np.linalg.inv(frame.camera.world_to_view) @ view
    clip = STANDS.view_to_clip @ STANDS.world_to_view @ world
    before = clip[:2] / clip[3] * size
    np.testing.assert_allclose(pair.camera_motion()[:, seen], before - px[:, seen], rtol=0, atol=6e-10)
    # The sky does not move before a camera that does not turn.
    assert np.abs(pair.camera_motion()[:, ~seen]).max() < 6e-10
    assert not pair_of(frame, replace(frame, index=0)).camera_motion().any()


def test_the_declared_motion_is_the_channel_and_elsewhere_the_cameras() -> None:
    pair = with_motion(columns(NOWHERE, (0.25, -4.0), 10), make_camera((0.3, -0.2, 4.5)))
    declared, given = pair.declared_motion(), pair.x < 10
    assert (declared[:, given] == [[0.25], [-4.0]]).all()
    np.testing.assert_array_equal(declared[:, ~given], pair.camera_motion()[:, ~given])


def test_a_point_that_was_behind_the_camera_has_no_motion() -> None:
    """The camera went back by 5: what is 4 before it now was 1 behind it then."""
    pair = pair_of(
        make_frame(1, camera=make_camera((0.0, 0.0, 5.0))), make_frame(0, camera=make_camera((0.0, 0.0, 0.0)))
    )
    for distance, seen in ((4.0, False), (10.0, True)):
        motion = pair.camera_motion(inverse_depth=np.full(len(pair.x), 1.0 / distance))
        assert np.isfinite(motion).all() == np.isfinite(motion).any() == seen


def test_the_change_of_jitter_is_this_frames_minus_the_last_ones() -> None:
    pair = pair_of(make_frame(1, jitter_px=(0.5, -0.25)), make_frame(0, jitter_px=(0.125, 0.25)))
    assert pair.jitter_change.tolist() == [0.375, -0.5]
