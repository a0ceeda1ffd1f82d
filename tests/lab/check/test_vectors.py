"""The linear model of vectors that are read almost right, where gain, leak and shift are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike

from cltaa.lab.check.motion import TIE, Model, Observed, explanations, fit_model
from cltaa.lab.check.registration import with_gradient

Y, X = np.mgrid[:24, :48].astype(np.float64)
# Half of the picture rises by 1 to the right and the other by 2 downwards: slopes without a curve.
BEFORE = with_gradient(np.where(X < 24, X, 2 * Y).astype(np.float32))
THERE = (X % 24 >= 6) & (X % 24 < 18) & (Y >= 6) & (Y < 18)  # no vector and no shift leads across the crease
CHANGES = np.array([(0.5, -0.25), (-0.375, 0.5), (0.125, 0.625), (-0.25, -0.5)])
# A tie of a millionth of the mean information draws towards the start by that, times the mean over the least of its
# eigenvalues (11), times how far away that is (1).
WEAK, DRAWN = 1e-6, 2e-5


def observed(
    gain: ArrayLike, leak: ArrayLike, shift: tuple[float, float] | None = None, spoilt: Sequence[int] = ()
) -> list[Observed]:
    """Four pairs of vectors up to 1.5 px whose pixels moved by ``gain`` m + ``shift`` + ``leak`` c."""
    random, pairs = np.random.default_rng(0), []
    x, y = X[THERE], Y[THERE]
    for change in CHANGES:
        own = random.uniform(-1.5, 1.5, (2, len(x)))
        u, v = np.array(gain) @ own + (np.array(shift or (0.0, 0.0)) + np.array(leak) @ change)[:, None]
        now = np.where(x < 24, x + u, 2 * (y + v))
        now[list(spoilt)] += 200.0
        pairs.append(Observed(own, x, y, now, BEFORE, 1.0, None if shift is None else np.array(shift), change))
    return pairs


IDENTITY, NONE = np.eye(2), np.zeros((2, 2))
TURNED = [[0.9, 0.2], [-0.1, 1.2]]
LEAKS = [[1.0, 0.25], [-0.125, 0.75]]


@pytest.mark.parametrize(("gain", "leak"), [(IDENTITY, NONE), (TURNED, NONE), (IDENTITY, LEAKS), (TURNED, LEAKS)])
@pytest.mark.parametrize("shift", [None, (0.25, -0.5)])
def test_gain_and_leak_are_found(
    gain: ArrayLike, leak: ArrayLike, shift: tuple[float, float] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.lab.check.motion.TIE", WEAK)
    model = fit_model(observed(gain, leak, shift))
    np.testing.assert_allclose(model.gain, np.array(gain), rtol=0, atol=DRAWN)
    np.testing.assert_allclose(model.leak, np.array(leak), rtol=0, atol=DRAWN)


def test_points_that_show_something_else_count_for_next_to_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two hundred times the scale away they pull by 200^-3 of it, less than 1e-6 and of a twentieth of the points."""
    monkeypatch.setattr("cltaa.lab.check.motion.TIE", WEAK)
    model = fit_model(observed(TURNED, LEAKS, spoilt=range(0, 288, 20)))
    np.testing.assert_allclose(model.gain, TURNED, rtol=0, atol=DRAWN)
    np.testing.assert_allclose(model.leak, LEAKS, rtol=0, atol=DRAWN)


def test_points_outside_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.lab.check.motion.TIE", WEAK)
    pairs = []
    for pair in observed(TURNED, LEAKS):
        far = np.arange(len(pair.x)) % 10 == 0
        pairs.append(pair._replace(x=np.where(far, -40.0, pair.x), now=np.where(far, 0.0, pair.now)))
    np.testing.assert_allclose(fit_model(pairs).gain, TURNED, rtol=0, atol=DRAWN)


def test_what_the_pixels_do_not_tell_stays_as_declared() -> None:
    """Vectors that all lead right, and a jitter that changes across alone, say nothing of the second columns."""
    pairs = []
    for pair in observed([[0.75, 0.0], [0.25, 1.0]], [[0.5, 0.0], [0.0, 0.0]]):
        own, change = pair.own * [[1.0], [0.0]], pair.jitter_change * (1.0, 0.0)
        u, v = np.array([[0.75], [0.25]]) * own[0] + np.array([[0.5], [0.0]]) * change[0]
        now = np.where(pair.x < 24, pair.x + u, 2 * (pair.y + v))
        pairs.append(pair._replace(own=own, now=now, jitter_change=change))
    model = fit_model(pairs)
    assert (model.gain[:, 1].tolist(), model.leak[:, 1].tolist()) == ([0.0, 1.0], [0.0, 0.0])
    # The tie is a thousandth of the mean information; the least that is not 0 is a fifth of that mean.
    np.testing.assert_allclose(model.gain[:, 0], [0.75, 0.25], rtol=0, atol=0.01 * 0.25)
    np.testing.assert_allclose(model.leak[:, 0], [0.5, 0.0], rtol=0, atol=0.01 * 0.5)


def test_what_the_pixels_hardly_tell_is_drawn_to_what_was_declared() -> None:
    """As far as the tie is the stronger, and no farther however often it is solved for."""
    pairs, truth = [], np.array([1.0, 0.0, 0.0, 1.375, 0.0, 0.0, 0.0, 0.0])
    for pair in observed(IDENTITY, NONE):
        own = pair.own * [[1.0], [0.02]]
        now = np.where(pair.x < 24, pair.x + own[0], 2 * (pair.y + 1.375 * own[1]))
        pairs.append(pair._replace(own=own, now=now))
    model, start = fit_model(pairs), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    tie = TIE * np.trace(model.information) / 8 * np.eye(8)
    expected = np.linalg.solve(model.information + tie, model.information @ truth + tie @ start)
    found = np.concatenate([model.gain.ravel(), model.leak.ravel()])
    assert 1.1 < found[3] < 1.275
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3)  # the least step that is taken


def test_a_step_of_the_fit_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.lab.check.motion.ITERATIONS", 1)
    model = fit_model(observed(-IDENTITY, NONE))
    assert model.gain.diagonal().tolist() == [0.5, 0.5]


def test_a_distance_is_weighed_by_the_information() -> None:
    model = Model(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0], [7.0, 8.0]]), np.diag(10.0 ** np.arange(8)))
    assert model.distance(model.gain, model.leak) == 0.0
    for place in range(8):
        step = np.zeros(8)
        step[place] = 0.5
        apart = model.distance(model.gain + step[:4].reshape(2, 2), model.leak + step[4:].reshape(2, 2))
        assert apart == 0.25 * 10.0**place


def test_each_explanation_is_nearest_where_it_is_so() -> None:
    """Vectors that hold the change of jitter need it taken away: then L is -1."""
    maps = {"": IDENTITY, "scaled-2": 2 * IDENTITY, "negated": -IDENTITY}
    for name, gain, leak in (
        ("", IDENTITY, NONE),
        ("scaled-2", 2 * IDENTITY, NONE),
        ("jittered", IDENTITY, -IDENTITY),
        ("jittered-reversed", IDENTITY, IDENTITY),
    ):
        leaks = {"jittered": 1, "jittered-reversed": -1}
        distances = explanations(fit_model(observed(gain, leak, (0.0, 0.0))), maps, leaks)
        assert set(distances) == {*maps, "jittered", "jittered-reversed"}
        assert min(distances, key=lambda found: distances[found]) == name
