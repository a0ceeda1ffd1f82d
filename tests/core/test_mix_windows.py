"""How temporal windows are mixed, and moved to what light does now: by hand, of texels that are given."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.core.buffers import FrameRing
from cltaa.core.build import FRAME_DTYPE, Build, Steps, settings_record
from cltaa.core.constants import WINDOW_REACH
from cltaa.core.parameters import Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset
from cltaa.core.record import Past
from cltaa.core.resolver import Resolver
from cltaa.lab.timing import Motion, make_frames
from cltaa.reference import KERNELS
from cltaa.reference.launcher import NumpyLauncher
from cltaa.reference.mix_windows import drift_of, mix_windows, shared_weights, students_t_of_drift, window_weight
from cltaa.reference.real import Run
from tests.kernels.hard_planes import padded
from tests.sequence_factory import make_frame

WIDTH, HEIGHT = 40, 30
LIGHTS = 1.0, 0.98, 0.8, 0.4
FLAT = 1.0, 1.0, 1.0, 1.0
DRIFT = 0.02 * (1.0 - (2.0 / (0.02 / (0.01 * 0.98))) ** 2)  # from 0.98 to 1.0, as far as t says that it is no chance


def test_the_drift_is_students_t() -> None:
    random = np.random.default_rng(0)
    layout = Layout(WIDTH, HEIGHT)
    then = random.uniform(0.2, 1.0, (1, HEIGHT, WIDTH)).astype(np.float32)
    now = (then + random.normal(0.01, 0.03, then.shape)).astype(np.float32)
    was, there = (padded(values, layout)[0] for values in (then, now))
    drift = drift_of(was, there, np.full_like(was, 0.25), layout)
    mean, t = drift.mean, students_t_of_drift(drift)
    side, inside = 2 * WINDOW_REACH + 1, np.s_[WINDOW_REACH:-WINDOW_REACH, WINDOW_REACH:-WINDOW_REACH]
    windows = np.lib.stride_tricks.sliding_window_view(now[0].astype(np.float64) - then[0], (side, side))
    expected = windows.mean((-1, -2))
    level = np.lib.stride_tricks.sliding_window_view(then[0].astype(np.float64), (side, side)).mean((-1, -2))
    # Differences of values below 1 are off by 2^-24 each, their deviation is hardly below 0.02 here.
    assert np.allclose(mean[inside], expected, atol=1e-6)
    assert np.allclose(
        t[inside], np.abs(expected) / (windows.std((-1, -2), ddof=1) / side + 0.01 * level), rtol=1e-4, atol=1e-4
    )


def mixed(
    errors: tuple[float, float, float, float],
    now: float = np.nan,
    ratio: float = 0.75,
    drift_share: float = 1.0,
    beside: tuple[float, int] | None = None,
    *,
    ahead: bool = False,
) -> float:
    """What flat windows come to, each of which leaves its error in every texel: 1.0 the latest four frames, 0.98 the
    latest eight, 0.8 all and 0.4 all without motion; the current samples are missing or have the light ``now``, and the
    one so many columns ``beside`` the pixel another."""
    layout, build = Layout(WIDTH, HEIGHT), Build(steps=Steps(alpha=False, look_ahead=ahead, centred=ahead))
    windows = layout.zeros(len(errors) * 5)
    for planes, light, error in zip(windows.reshape(len(errors), 5, *windows.shape[1:]), LIGHTS, errors, strict=True):
        planes[:3], planes[3], planes[4] = light, error, 7.0
    output, count = layout.zeros(4), layout.zeros(1)
    frame = np.zeros((), FRAME_DTYPE)
    frame["width"], frame["height"] = WIDTH, HEIGHT
    settings = settings_record(Settings())
    planes = {"windows": windows, "output": output, "output_count": count}
    planes |= {"current": np.full_like(layout.zeros(3), now), "alpha": None}
    if beside is not None:
        light, columns = beside
        layout.inside(planes["current"])[:, HEIGHT // 2, WIDTH // 2 + columns] = light
    planes |= {"frames": 48, "static_frames": 48, "lag_ratio": ratio, "drift_share": drift_share}
    mix_windows(build, layout, frame=frame, settings=settings, **planes)
    return float(layout.inside(output)[0, HEIGHT // 2, WIDTH // 2])


def test_a_span_counts_by_its_error_and_is_moved_to_the_shortest_where_that_is_no_chance() -> None:
    def moved(light: float) -> float:
        t = (1.0 - light) / (0.01 * light)  # over a hundredth of the light; the texels do not differ
        return light + (1.0 - light) * max(1.0 - (2.0 / t) ** 2, 0.0)

    places = [1.0, *(moved(light) for light in LIGHTS[1:])]
    for errors in ((1.0, 1.0, 1.0, 1.0), (1.0, 1.1, 0.9, 1.2), (5.0, 1.0, 1.0, 4.0)):
        shares = np.array([(min(errors) / error) ** 16 for error in errors])
        assert mixed(errors) == pytest.approx(np.average(places, weights=shares), abs=1e-6)
        # Beside frames ahead the third, of all frames, counts twice, and errors by their 8th power.
        twice = pytest.approx(np.average(places, weights=np.sqrt(shares) * [1, 1, 2, 1]), abs=1e-6)
        assert mixed(errors, ahead=True) == twice


def test_light_that_goes_on_changing_is_followed_as_far_as_the_current_samples_are() -> None:
    # From 0.98 to 1.0 in the two frames between the middles of the two windows; that of the latest is 1.5 frames ago.
    still, trend = mixed(FLAT), DRIFT * 1.5 / 2.0
    for now, moved in ((2.0, trend), (1.0 + trend / 2.0, trend / 2.0), (1.0, 0.0), (0.9, 0.0)):
        further = np.clip(now - (still + moved), 0.0, DRIFT)
        assert mixed(FLAT, now) == pytest.approx(still + moved + further, abs=1e-6)


def test_a_pixel_goes_on_by_the_drift_until_it_meets_a_sample_of_the_3x3() -> None:
    still = mixed(FLAT, ratio=0.0)
    for light, further in ((2.0, 1.0), (still + 0.3 * DRIFT, 0.3), (still, 0.0), (0.5, 0.0), (np.nan, 0.0)):
        went = mixed(FLAT, 2.0, 0.0, beside=(light, -1)), mixed(FLAT, 2.0, 0.0, beside=(light, 2))
        assert went == pytest.approx((still + further * DRIFT, still + DRIFT), abs=1e-6)
    assert mixed(FLAT, 2.0, 0.0, drift_share=0.0) == still


# Of a shot of 20 frames: ages of the four and of the eight frames by hand, 1.5 and 3.5 where all are earlier or later.
@pytest.mark.parametrize(
    ("ahead", "index", "ratio"),
    [
        (0, 19, 1.5 / 2.0),
        (0, 6, 0.0),  # six frames are no whole window
        (8, 19, 1.5 / 2.0),
        (8, 18, 0.5 / 2.0),
        (8, 17, 0.0),  # as many ahead as earlier
        (8, 10, 0.0),
        (8, 1, 0.5 / 2.0),  # both ahead
        (8, 0, 1.5 / 2.0),
    ],
)
def test_windows_lag_where_the_frames_ahead_do_not_balance_the_earlier_ones(
    ahead: int, index: int, ratio: float
) -> None:
    frames = make_frames(8, 8, Motion.UNIFORM, 20)
    ring = FrameRing(NumpyLauncher(), Layout(8, 8), 8, Steps(), ahead)
    ring.past = tuple(Past.of(frame) for frame in reversed(frames))
    assert ring.lag_ratio(frames[index]) == ratio


@pytest.mark.parametrize(
    ("preset", "reactive", "drift_shares"),
    [("gather-8", False, {1.0, 0.75}), ("gather-8+8", False, {1.0, 0.75}), ("gather-8", True, {0.0})],
)
def test_pixels_go_on_less_where_windows_do_not_lag_and_not_at_all_under_a_reactive_mask(
    preset: str, reactive: bool, drift_shares: set[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def mix(*_: object, lag_ratio: float, drift_share: float, **__: object) -> None:
        seen.append((lag_ratio > 0.0, float(drift_share)))

    monkeypatch.setitem(KERNELS, "mix_windows", mix)
    resolver = Resolver(load_preset(preset), "numpy")
    for number in range(20):
        resolver.feed(make_frame(number, width=8, height=8, effects=None, reactive=reactive))
    resolver.flush()
    assert {drift_share for _, drift_share in seen} == drift_shares
    assert all((drift_share == 1.0) == lags for lags, drift_share in seen)


def test_a_highlight_that_appears_is_no_drift_of_the_light_around_it() -> None:
    layout = Layout(WIDTH, HEIGHT)
    then = np.random.default_rng(0).uniform(0.2, 1.0, (3, HEIGHT, WIDTH)).astype(np.float32)
    now = then.copy()
    now[:, 12] = 1e4  # a fifth of the texels around those beside it: by a plain mean t is 2.4, and the drift 2000
    windows = padded(then, layout), padded(now, layout)
    weights = shared_weights(*windows, Run(Build(), layout, settings=settings_record(Settings())))
    for was, there in zip(*windows, strict=True):
        drift = drift_of(was, there, weights, layout)
        beside = np.s_[10:12, WINDOW_REACH:-WINDOW_REACH]
        assert (drift.mean[beside] < 2).all()
        assert (students_t_of_drift(drift)[beside] < 0.1).all()


@pytest.mark.parametrize(("ahead", "power"), [(False, -16), (True, -8)])
def test_window_weight_falls_with_the_error_and_never_to_nothing(ahead: bool, power: int) -> None:
    error, build = np.array([1.0, 1.1, 2.0, 1e30], np.float32), Build(steps=Steps(centred=ahead))
    expected = [1.0, 1.1**power, 2.0**power, 64.0**power]
    assert np.allclose(window_weight(error, error[:1], build), expected, rtol=1e-5)
    assert window_weight(np.zeros(1, np.float32), np.zeros(1, np.float32), build) == 1.0
