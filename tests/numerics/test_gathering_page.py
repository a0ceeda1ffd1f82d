"""The equations of docs/algorithm.md for gathering, in float64 from the page alone, against the presets.

They are those of a smooth surface: no depth edge and no vectors. As in test_algorithm_page.py, nothing
comes from the kernels or their twins. The recursive result is that of the default, which that module computes.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import cltaa
from cltaa.core.parameters import Recursion
from cltaa.core.planes import Layout
from tests.numerics.test_algorithm_page import FALLOFF, HEIGHT, KNEE, WIDTH, X, Y, around, to_ycocg

Array = NDArray[np.float64]
Effect = cltaa.Effect
# Colours up to 4.7. The oracle computes in float32: worst seen 8e-7.
TOLERANCE = 1.5e-6
RING, AHEAD = 7, 8
WINDOWS, CENTRED_WINDOWS = (3, 7), (4, 6, 14)
RIDGE, REACH, DEPTH = 0.125, 0.8, 0.05
EXPONENT, CENTRED_EXPONENT, LEAST_RATIO = 16, 8, 2.0**-6
DRIFT_T, INVISIBLE, LAG, BALANCED = 2.0, 0.01, 0.75, 0.75
REFUTED, NEIGHBOURS_ERR, LEAST_NEIGHBOURS = 7, 2.0, 0.25


class Case(NamedTuple):
    """What is declared, how light and texture change without vectors, and what the page says of it."""

    effects: frozenset[cltaa.Effect]
    light: Callable[[int], float] = lambda _: 1.0
    flow: float = 0.0  # pixels a frame
    windows: bool = True
    filter_samples: float = 4.0
    ahead: bool = False

    @property
    def ends(self) -> tuple[int, ...]:
        """The number of the ring's frames in each window."""
        return (*CENTRED_WINDOWS, RING + AHEAD) if self.ahead else WINDOWS if self.windows else (RING,)


CHANGING = frozenset({Effect.DISOCCLUSION, Effect.HDR, Effect.ILLUMINATION})
CASES = {
    "one-window": Case(frozenset({Effect.CAMERA, Effect.HDR, Effect.DISOCCLUSION}), windows=False, filter_samples=1.0),
    "constant": Case(CHANGING | {Effect.CAMERA}),
    "rising": Case(CHANGING | {Effect.CAMERA}, lambda k: 1 + 0.05 * k),
    "stepping": Case(CHANGING | {Effect.CAMERA}, lambda k: 1.0 + (k > 13)),
    "ahead": Case(CHANGING | {Effect.CAMERA}, lambda k: 1 + 0.05 * k, ahead=True),
    "standing-constant": Case(CHANGING),
    "standing-rising": Case(CHANGING, lambda k: 1 + 0.05 * k),
    "standing-stepping": Case(CHANGING, lambda k: 1.0 + (k > 9)),
    "standing-flowing": Case(CHANGING, flow=3.0),
}


def frames(case: Case) -> list[cltaa.Frame]:
    """A slanted wall of waves and noise, before a camera that turns and slides where one is declared."""
    rng = np.random.default_rng(3)
    near, focal, phase = 0.1, 1 / np.tan(np.radians(60) / 2), np.array([0.0, 1.0, 2.0])
    lens = [[focal * HEIGHT / WIDTH, 0, 0, 0], [0, focal, 0, 0], [0, 0, -1, -2 * near], [0, 0, -1, 0]]
    made = []
    for index in range(RING + 1 + AHEAD):
        jitter = tuple(rng.uniform(-0.5, 0.5, 2))
        x, y = (place[..., None] + jitter[axis] for axis, place in enumerate((X, Y)))
        waves = 1.2 + np.sin((x - case.flow * index) / 2 + phase) * np.cos(y / 3 + phase)
        colour = ((waves + 0.2 * rng.random(waves.shape)) * case.light(index)).astype(np.float32)
        turn, view = 0.004 * index, np.eye(4)
        if Effect.CAMERA in case.effects:
            view[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
            view[:3, 3] = -0.03 * index, 0.01 * index, 0.02 * index
        camera = cltaa.Camera(view, np.array(lens))
        made.append(cltaa.Frame(index, colour, (5 + 0.05 * X).astype(np.float32), camera, jitter, effects=case.effects))
    return made


def colour_of(frame: cltaa.Frame) -> Array:
    return frame.colour.astype(np.float64)


def weight_of(colour: Array) -> Array:
    """1 / (knee + Y)."""
    weight: Array = 1 / (KNEE + to_ycocg(colour)[..., 0])
    return weight


def difference(colour: Array, other: Array) -> Array:
    """Of colours, each times knee / (knee + Y)."""
    return KNEE * (weight_of(colour)[..., None] * colour - weight_of(other)[..., None] * other)


def texels_around(image: Array) -> Array:
    """The 25 images of the 5x5 around each pixel, edges repeated."""
    wide = np.pad(image, [(2, 2), (2, 2)] + [(0, 0)] * (image.ndim - 2), mode="edge")
    return np.stack([wide[j : j + HEIGHT, i : i + WIDTH] for j in range(5) for i in range(5)])


def filtered(frame: cltaa.Frame) -> tuple[Array, float]:
    """The Gaussian of step 9, and its weight at the centre."""
    columns, rows = (np.exp(-FALLOFF * (np.arange(-1, 2) + j) ** 2) for j in frame.jitter_px)
    weights = np.outer(rows / rows.sum(), columns / columns.sum())
    parts = (weights[1 + dy, 1 + dx] * c for (dy, dx), c in around(colour_of(frame)).items())
    return sum(parts, np.zeros((HEIGHT, WIDTH, 3))), weights[1, 1]


def moved(x: Array, y: Array, q: Array, now: cltaa.Camera, before: cltaa.Camera) -> tuple[Array, Array, Array]:
    """Points of inverse depth q, in pixels from the upper left corner, in the frame of another camera."""
    lens, depth = now.view_to_clip, 1 / q
    across, up = (2 * x / WIDTH - 1) * depth / lens[0, 0], (1 - 2 * y / HEIGHT) * depth / lens[1, 1]
    to_before = before.view_to_clip @ before.world_to_view @ np.linalg.inv(now.world_to_view)
    clip = np.stack([across, up, -depth, np.ones_like(depth)], -1) @ to_before.T
    w = clip[..., 3]
    return (clip[..., 0] / w + 1) * WIDTH / 2, (1 - clip[..., 1] / w) * HEIGHT / 2, 1 / w


class Samples:
    """The samples of pixels: their shares, offsets and colours, the current one first, then the latest."""

    def __init__(self, frame: cltaa.Frame) -> None:
        one = np.ones((HEIGHT, WIDTH))
        jx, jy = frame.jitter_px
        self.frame, self.colour = frame, colour_of(frame)
        self.of: list[tuple[Array, Array, Array, Array]] = [(one, jx * one, jy * one, self.colour)]
        self.latest = 1  # how many of them are of the latest frames

    @property
    def count(self) -> Array:
        """The sum of the shares."""
        total: Array = np.sum([share for share, *_ in self.of], 0)
        return total

    def add(self, past: cltaa.Frame, reach: float) -> None:
        """Add the nine samples of another frame around the pixel's centre there."""
        (jx, jy), (kx, ky), now = self.frame.jitter_px, past.jitter_px, self.frame.camera
        q = 1 / self.frame.depth.astype(np.float64)
        nine = around(q)
        slope_x, slope_y = (nine[0, 1] - nine[0, -1]) / 2, (nine[1, 0] - nine[-1, 0]) / 2

        def there(right: float, down: float) -> tuple[Array, Array, Array]:
            place = X + 0.5 + jx + right, Y + 0.5 + jy + down
            return moved(*place, q + slope_x * right + slope_y * down, now, past.camera)

        step = 1e-4
        sides = [[there(dx * step, dy * step) for dx, dy in pair] for pair in (((1, 0), (-1, 0)), ((0, 1), (0, -1)))]
        jacobian = np.stack([np.stack([(a[i] - b[i]) / (2 * step) for a, b in sides], -1) for i in (0, 1)], -2)
        sample_x, sample_y, sample_q = there(0, 0)
        at = np.stack([sample_x, sample_y], -1) - jacobian @ np.array([jx, jy])
        near, far = (pick(list(nine.values()), 0) * sample_q / q for pick in (np.max, np.min))
        seen = (at >= 0).all(-1) & (at[..., 0] <= WIDTH) & (at[..., 1] <= HEIGHT)
        column, row = np.floor(at[..., 0] - kx), np.floor(at[..., 1] - ky)
        colour, depth = colour_of(past), past.depth.astype(np.float64)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                x, y = column + dx, row + dy
                texel = np.clip(y, 0, HEIGHT - 1).astype(int), np.clip(x, 0, WIDTH - 1).astype(int)
                off = np.stack([x + 0.5 + kx, y + 0.5 + ky], -1) - at
                off = np.linalg.solve(jacobian, off[..., None])[..., 0]
                same = (1 / depth[texel] >= far - DEPTH * near) & (1 / depth[texel] <= near + DEPTH * near)
                inside = seen & (x >= 0) & (y >= 0) & (x < WIDTH) & (y < HEIGHT) & same
                share = np.clip((reach - np.abs(off)) / (2 * reach - 1), 0, 1).prod(-1) * inside
                self.of.append((share, off[..., 0], off[..., 1], colour[texel]))

    def resolved(self, filter_samples: float) -> Array:
        """The fitted plane at the centre, and the filter blended in."""
        weights = [share * weight_of(colour) for share, _, _, colour in self.of]
        total = np.sum(weights, 0)

        def mean(values: list[Array]) -> Array:
            sums = np.sum([(w.T * v.T).T for w, v in zip(weights, values, strict=True)], 0)
            means: Array = (sums.T / total.T).T
            return means

        places = [np.stack([dx, dy], -1) for _, dx, dy, _ in self.of]
        middle, colour = mean(places), mean([c for *_, c in self.of])
        squares = mean([(p - middle)[..., :, None] * (p - middle)[..., None, :] for p in places])
        products = mean(
            [
                (p - middle)[..., :, None] * (c - colour)[..., None, :]
                for p, (*_, c) in zip(places, self.of, strict=True)
            ]
        )
        slope = np.linalg.solve(squares + RIDGE / self.count[..., None, None] * np.eye(2), products)
        fitted = colour - (middle[..., None, :] @ slope)[..., 0, :]
        soft, _ = filtered(self.frame)
        share = np.minimum(1 / self.count, filter_samples / self.count**2) * (KNEE * weight_of(soft)) ** 2
        result: Array = fitted + share[..., None] * (soft - fitted)
        return result

    def error(self, result: Array, count: Array) -> Array:
        """Of a window, before it is summed over 5x5 pixels."""
        off = difference(result, self.colour)
        squares = (
            share * ((difference(colour, self.colour) - off) ** 2).sum(-1)
            for share, _, _, colour in self.of[: self.latest]
        )
        error: Array = sum(squares, np.zeros((HEIGHT, WIDTH))) / (1 - 1 / np.maximum(count, 1.5)) ** 2
        return error


class Window(NamedTuple):
    """A window's result, its error, its samples, how often it counts, and whose drift it has."""

    result: Array
    error: Array
    samples: Array
    times: int = 1
    of_drift: str = "own"  # or the second's, or none, of the current frame


def gathered(frame: cltaa.Frame, past: list[cltaa.Frame], case: Case) -> tuple[list[Window], Samples]:
    """The windows of the ring, and the samples of the last one."""
    samples, windows, begin = Samples(frame), list[Window](), 0
    for end in case.ends:
        for before in past[begin:end]:
            samples.add(before, min(REACH, 0.5 + 1 / np.sqrt(end + 1)))
        samples.latest = 1 + 9 * case.ends[0]
        begin, result = end, samples.resolved(case.filter_samples)
        windows.append(Window(result, samples.error(result, samples.count), samples.count))
    return windows, samples


def drift_of(window: Window, shortest: Array) -> Array:
    weights = texels_around(weight_of(window.result) * weight_of(shortest))[..., None]
    differences, total = texels_around(shortest - window.result), weights.sum(0)
    mean = (weights * differences).sum(0) / total
    variance = (weights * (differences - mean) ** 2).sum(0) / (24 * total)
    light = (weights * np.abs(texels_around(window.result))).sum(0) / total
    t = (np.abs(mean) / (np.sqrt(variance) + INVISIBLE * light)).max(-1, keepdims=True)
    drift: Array = mean * (1 - (DRIFT_T / np.maximum(t, DRIFT_T)) ** 2)
    return drift


def up_to(change: Array, most: Array) -> Array:
    """A change in the direction of ``most``, and no more than that."""
    return np.clip(change, np.minimum(most, 0), np.maximum(most, 0))


def mixed(windows: list[Window], now: Array, *, balanced: bool = False) -> tuple[Array, Array, Array]:
    """The mean of the windows, its samples, and the least error; ``balanced``: by frames ahead."""
    shortest, second, *_ = windows
    errors = [texels_around(window.error).sum(0) for window in windows]
    least, none = np.min(errors, 0), np.zeros_like(now)
    drifts = {"own": none, "second": drift_of(second, shortest.result), "none": none}
    mean, count, followed, total = none, none[..., 0], none[..., 0], none[..., 0]
    for window, error in zip(windows, errors, strict=True):
        weight = window.times * np.maximum(least / error, LEAST_RATIO) ** (CENTRED_EXPONENT if balanced else EXPONENT)
        own = window.of_drift == "own" and window is not shortest
        drift = drift_of(window, shortest.result) if own else drifts[window.of_drift]
        mean, count = mean + weight[..., None] * (window.result + drift), count + weight * window.samples
        followed, total = followed + weight * (window.of_drift != "none"), total + weight
    mean, count, followed = mean / total[..., None], count / total, followed / total
    shared = texels_around(weight_of(now) * weight_of(shortest.result))[..., None]
    lag = (shared * texels_around(now - shortest.result)).sum(0) / shared.sum(0)
    goes_on = followed[..., None] * drifts["second"]
    mean = mean + (0 if balanced else followed[..., None] * up_to(LAG * drifts["second"], lag))
    further = BALANCED * goes_on if balanced else goes_on
    for sample in around(now).values():
        further = up_to(sample - mean, further)
    return mean + further, count, least


def moving(frame: cltaa.Frame, past: list[cltaa.Frame], case: Case) -> Array:
    """The mean of the windows. That of all frames counts three times: it equals the second, or frames lie ahead, and
    that without motion, which the moving camera leaves empty, repeats it."""
    *shorter, longest = gathered(frame, past, case)[0]
    return mixed([*shorter, longest._replace(times=3)], colour_of(frame), balanced=case.ahead)[0]


def standing(frame: cltaa.Frame, past: list[cltaa.Frame], case: Case, held: Array, held_count: Array) -> Array:
    """The mean of the windows, in which the recursive result ``held`` may replace two, and of that result."""
    now = colour_of(frame)
    windows, samples = gathered(frame, past, case)
    unmoved, nothing = Samples(frame), np.zeros((HEIGHT, WIDTH))
    unmoved.of += [(nothing + 1, nothing, nothing, colour_of(before)) for before in past]
    unmoved.latest = 1 + case.ends[0]
    weights = [weight_of(colour)[..., None] for *_, colour in unmoved.of]
    own = np.sum([w * colour for w, (*_, colour) in zip(weights, unmoved.of, strict=True)], 0) / np.sum(weights, 0)
    for judge, result, drift in ((samples, windows[-1].result, "second"), (unmoved, own, "own")):
        longer = held_count > judge.count
        chosen, count = np.where(longer[..., None], held, result), np.where(longer, held_count, judge.count)
        windows.append(Window(chosen, judge.error(chosen, count), count, of_drift=drift))
    soft, centre = filtered(frame)
    refuted = (held_count < REFUTED) & (1 - centre > LEAST_NEIGHBOURS)
    latest = np.sum([share for share, *_ in samples.of[: samples.latest]], 0)
    apart = NEIGHBOURS_ERR * latest * (difference(soft, now) ** 2).sum(-1) / (1 - centre) ** 2
    windows.append(Window(soft, np.where(refuted, apart, np.inf), nothing + 1, of_drift="none"))
    mean, count, least = mixed(windows, now)
    error = texels_around(samples.error(held, held_count)).sum(0)
    share = held_count / (held_count + count) * np.minimum(1, least / error) ** 4
    both: Array = mean + share[..., None] * (held - mean)
    return both


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_equations_of_the_page_are_those_of_gathering(case: Case) -> None:
    preset = cltaa.load_preset("gather-8+8" if case.ahead else "gather-8").replace(subpixel_frames=0)
    resolver = cltaa.Resolver(preset, device="numpy")
    beside = cltaa.Resolver(cltaa.load_preset().replace(filter_samples=case.filter_samples), device="numpy")
    shot = frames(case)
    at = RING if case.ahead else len(shot) - 1
    image, frame, past, later = list(resolver.images(shot))[at], shot[at], shot[at - RING : at][::-1], shot[at + 1 :]
    plan = resolver.plan
    assert plan is not None
    assert plan.settings.filter_samples == case.filter_samples
    if plan.choices.recursion is Recursion.STANDING:
        *_, held = beside.images(shot)
        with beside.recurrent()[1]["history_count"].mapped(write=False) as planes:
            counts = Layout(WIDTH, HEIGHT).inside(np.array(planes[0], np.float64))
        expected = standing(frame, past, case, held.astype(np.float64), counts)
    elif case.windows:
        in_turn = [each for pair in zip_longest(past, later) for each in pair if each is not None]
        expected = moving(frame, in_turn, case)
    else:
        expected = gathered(frame, past, case)[0][0].result
    assert np.abs(image - expected).max() < TOLERANCE
