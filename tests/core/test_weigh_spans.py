"""How spans of the past are weighed, and moved to what light does now: by hand, of texels that are given."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.core.build import FRAME_DTYPE, Build, Steps, settings_record
from cltaa.core.constants import SPAN_REACH, SPANS
from cltaa.core.parameters import Settings
from cltaa.core.planes import Layout
from cltaa.reference.real import Array
from cltaa.reference.span_now import held_by_now, moved_to_now
from cltaa.reference.span_weights import around, drift_of, drifts_of, t_of, trust
from cltaa.reference.weigh_spans import weigh_spans
from tests.kernels.hard_planes import padded

WIDTH, HEIGHT = 40, 30


def test_the_drift_is_students_t() -> None:
    random = np.random.default_rng(0)
    layout = Layout(WIDTH, HEIGHT)
    then = random.uniform(0.2, 1.0, (1, HEIGHT, WIDTH)).astype(np.float32)
    now = (then + random.normal(0.01, 0.03, then.shape)).astype(np.float32)
    nothing = np.zeros_like(now[0])
    texels = [list(around(padded(values, layout)[0], layout)) for values in (then, now)]
    drift = drift_of(texels[0], texels[1], [np.full_like(now[0], 0.25)] * len(texels[0]))
    mean, t = drift.mean, t_of(drift, nothing, nothing)
    side, inside = 2 * SPAN_REACH + 1, np.s_[SPAN_REACH:-SPAN_REACH, SPAN_REACH:-SPAN_REACH]
    windows = np.lib.stride_tricks.sliding_window_view(now[0].astype(np.float64) - then[0], (side, side))
    expected = windows.mean((-1, -2))
    # Differences of values below 1 are off by 2^-24 each, their deviation is hardly below 0.02 here.
    assert np.allclose(mean[inside], expected, atol=1e-6)
    assert np.allclose(t[inside], np.abs(expected) / (windows.std((-1, -2), ddof=1) / side), rtol=1e-4, atol=1e-4)


def weighed(error: float, repeated: float | None = None, now: Array | None = None) -> float:
    """What flat spans of a light that grows come to where each texel leaves an error: 1.0 the latest four frames, 0.98
    the latest eight, 0.8 all; repeated samples leave as much unless told, and no texel of now can be used."""
    layout = Layout(WIDTH, HEIGHT)
    spans = layout.zeros(SPANS * 5)
    nothing = np.full((3, HEIGHT, WIDTH), np.nan, np.float32)
    current = padded(nothing if now is None else now.astype(np.float32), layout)
    for planes, light in zip(spans.reshape(SPANS, 5, *spans.shape[1:]), (1.0, 0.98, 0.8, 0.8), strict=True):
        planes[:3], planes[3], planes[4] = light, error, 7.0
    output, count = layout.zeros(4), layout.zeros(1)
    settings = settings_record(Settings())
    frame = np.zeros((), FRAME_DTYPE)
    frame["width"], frame["height"] = WIDTH, HEIGHT
    build = Build(steps=Steps(alpha=False))
    beside = layout.zeros(4), np.full_like(layout.zeros(1), 5.0)  # neither begun anew nor lasted, beside 7
    repeats = np.full_like(layout.zeros(1), error if repeated is None else repeated)
    weigh_spans(
        build,
        layout,
        current=current,
        spans=spans,
        repeats=repeats,
        recursive=beside[0],
        recursive_count=beside[1],
        output=output,
        output_count=count,
        frame=frame,
        settings=settings,
    )
    return float(layout.inside(output)[0, HEIGHT // 2, WIDTH // 2])


def test_light_that_changes_steadily_is_carried_on_where_that_is_sure() -> None:
    # t of the step is 0.02 over a thousandth, and SURE_T 3; to that all but the shortest span are moved from 2 over a
    # hundredth, or 20 over it.
    step, t = 0.02, 20 / 0.98
    sure, moved, far = 1 - (3 / t) ** 2, 1 - (2 / (t / 10)) ** 2, 1 - (2 / (19 / 0.8)) ** 2
    middle = 0.98 + step * max(moved, 0.0) + 0.5 * step * sure
    old = 0.8 + 0.19 * far + (0.5 + 0.5) * step * sure
    assert weighed(0.0) == pytest.approx((1.0 + 0.5 * step * sure + middle + 2 * old) / 4, abs=1e-6)


def test_what_the_texels_of_now_say_is_taken_from_them_where_they_agree() -> None:
    flat = np.ones((3, HEIGHT, WIDTH))
    noise = np.random.default_rng(0).normal(0.0, 0.02, (3, HEIGHT, WIDTH))
    said = weighed(1.0)
    for light in (said, said + 0.01):
        assert weighed(1.0, now=light * flat) == pytest.approx(light, abs=1e-6)
    assert weighed(1.0, now=said + 0.01 + noise) == pytest.approx(said, abs=1e-6)


def test_what_is_far_from_all_texels_of_now_is_held_by_them() -> None:
    low, high = np.full((2, 3, HEIGHT, WIDTH), [[[[0.1]]], [[[0.2]]]], np.float32)
    layout, far = Layout(WIDTH, HEIGHT), np.full((HEIGHT, WIDTH), 0.9, np.float32)
    now = padded(np.where(np.arange(WIDTH) % 2 == 0, low, high), layout)
    for colour, expected in (
        (far, 0.4),
        (-far, -0.1),
        (far / 3, 0.3),
        (far / 6, 0.15),
    ):  # twice as wide again on each side
        assert np.allclose(held_by_now((colour, colour, colour), now, layout), expected, atol=1e-6)


def moved_by_now(said: Array, now: Array, jitter: float = 0.0) -> Array:
    """How far [H, W] spans that all say ``said`` [W] are moved where the texels of now show ``now`` [W]."""
    layout, frame = Layout(WIDTH, HEIGHT), np.zeros((), FRAME_DTYPE)
    frame["jitter_x"] = jitter
    said, now = (np.broadcast_to(v.astype(np.float32), (3, HEIGHT, WIDTH)) for v in (said, now))
    spans, shares = [padded(said, layout)] * SPANS, [np.full((HEIGHT, WIDTH), 0.25, np.float32)] * (SPANS - 1)
    given = (Build(), layout, frame, settings_record(Settings()))
    moved = moved_to_now((said[0], said[1], said[2]), spans, shares, padded(now, layout), *given)
    inside: Array = (moved[0] - said[0])[SPAN_REACH:-SPAN_REACH, SPAN_REACH:-SPAN_REACH]
    return inside


def test_what_is_moved_to_now_is_what_is_no_chance() -> None:
    flat, chance = np.full(WIDTH, 0.5), 12 * 0.0001 * 0.5
    for step, expected in ((0.0012, 0.0012 - chance), (-0.0012, chance - 0.0012), (0.0003, 0.0)):
        assert np.allclose(moved_by_now(flat, flat + step), expected, atol=1e-6)


def test_a_slope_seen_by_jitter_is_no_change_of_light() -> None:
    slope = 0.5 + 0.01 * np.arange(WIDTH)
    chance = 12 * 0.0001 * slope[SPAN_REACH:-SPAN_REACH]
    assert np.allclose(moved_by_now(slope, slope - 0.004, jitter=-0.4), 0.0, atol=1e-6)
    assert np.allclose(moved_by_now(slope, slope - 0.008, jitter=-0.4), chance - 0.004, atol=1e-5)
    assert np.allclose(moved_by_now(slope, slope + 0.004, jitter=-0.4), 0.004 - chance, atol=1e-5)


def test_where_samples_repeat_what_reaches_far_is_believed_and_stays() -> None:
    assert weighed(1.0, repeated=0.0) == pytest.approx(0.8, abs=1e-6)
    assert weighed(1.0, repeated=1.0) > 0.9


def test_a_step_that_jitter_may_have_made_is_not_carried_on() -> None:
    # Of samples that are off by 0.5 the texels have 0.003 of the variance of 0.25 / 3 / 4 in common: 0.008.
    assert weighed(4 * 0.25) < 1.0
    assert weighed(0.0) > weighed(4 * 0.25)


def test_a_highlight_that_appears_is_no_drift_of_the_light_around_it() -> None:
    layout = Layout(WIDTH, HEIGHT)
    then = np.random.default_rng(0).uniform(0.2, 1.0, (3, HEIGHT, WIDTH)).astype(np.float32)
    now = then.copy()
    now[:, 12] = 1e4  # a fifth of the texels around those beside it: by a plain mean t is 2.4, and the drift 2000
    spans, share = (padded(then, layout), padded(now, layout), padded(now, layout)), np.zeros_like(then[0])
    for drift in drifts_of(*spans, share, Build(), layout, settings_record(Settings())):
        beside = np.s_[10:12, SPAN_REACH:-SPAN_REACH]
        assert (drift.mean[beside] < 2).all()
        assert (t_of(drift, share, share)[beside] < 0.1).all()


def test_trust_falls_with_the_error_and_never_to_nothing() -> None:
    error = np.array([1.0, 1.1, 2.0, 1e30], np.float32)
    assert np.allclose(trust(error, error[:1]), [1.0, 1.1**-16, 2.0**-16, 2.0**-96], rtol=1e-5)
    assert trust(np.zeros(1, np.float32), np.zeros(1, np.float32)) == 1.0
