"""The equations of docs/algorithm.md, in float64 from the page alone, against the default preset; and its names.

Where the two part, one of them is wrong. Nothing here comes from the kernels or their twins: the motion of the camera
is that of whole matrices, and statistics are NumPy's.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import cltaa
from cltaa.core.parameters import Choices, Settings
from cltaa.core.presets import override

PAGE = Path(__file__).parents[2] / "docs" / "algorithm.md"
LINKED = re.compile(r"\[`[^`]+`\]\(([^)#]+)\)")
Array = NDArray[np.float64]

HEIGHT, WIDTH, FRAMES = 24, 40, 6
# Colours up to 2.4. The oracle computes in float32 and carries its own roundings through six frames: worst seen 5.8e-7.
TOLERANCE = 1e-6
KNEE, FALLOFF, FILTER_SAMPLES, SAMPLE_LIMIT = 4.0, 1.5, 8.0, 24.0
LIGHT_T, COVERED_T, PASSED_T, LIGHT_DECAY, LIGHT_FLOOR, MOST_CHANGE = 2.6, 0.8, 0.4, 0.72, 0.03, 8.0
COVERED_SHARE, BEHIND_T, EDGE_SAMPLES = 0.25, 1.0, 2.0
EDGE, PASSED, DEPTH, RESAMPLING_PENALTY = 0.03, 0.25, 0.05, 0.8
AROUND = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)


class Case(NamedTuple):
    """What is declared, what the page's tables say of it, and what is set beside the default."""

    effects: frozenset[cltaa.Effect] | None
    tests: bool  # light and depth
    weighs: bool
    reactive: bool = False
    boxed: bool = False  # rectified as step 8 says


CASES = {
    "nothing-declared": Case(None, tests=True, weighs=True),
    "nothing-declared-reactive": Case(None, tests=True, weighs=True, reactive=True),
    "camera-declared": Case(frozenset({cltaa.Effect.CAMERA}), tests=False, weighs=False),
    "rectified": Case(frozenset({cltaa.Effect.CAMERA}), tests=False, weighs=False, boxed=True),
}
STATIC, MOVING = 1.5, 1.25
BOXED = {"rectify": "clamp", "box_scale_static": STATIC, "box_scale_moving": MOVING}


class Left(NamedTuple):
    """What a frame leaves to the next one."""

    colour: Array
    samples: Array
    change: Array
    inverse_depth: Array
    camera: cltaa.Camera


def frames(case: Case) -> list[cltaa.Frame]:
    """A box before a slanted wall with a low relief, noise on all, a camera that turns and speeds up, one bad texel."""
    rng = np.random.default_rng(3)
    base, near = rng.random((HEIGHT, WIDTH, 3)) * 2, 0.1
    wall = (5.0 + 0.05 * X) * np.where((X > 28) & (Y < 12), 0.9, 1.0)
    depth = np.where((X > 15) & (X < 24) & (Y > 6), 2.0, wall).astype(np.float32)
    focal = 1 / np.tan(np.radians(60) / 2)
    lens = [[focal * HEIGHT / WIDTH, 0, 0, 0], [0, focal, 0, 0], [0, 0, -1, -2 * near], [0, 0, -1, 0]]
    made = []
    for index in range(FRAMES):
        colour = (base + 0.4 * rng.random(base.shape)).astype(np.float32)
        if index == 2:
            colour[5, 6, 1] = np.nan
        turn, view = 0.004 * index, np.eye(4)
        view[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
        view[:3, 3] = -0.06 * index**2, 0.02 * index, 0.1 * index
        jitter = tuple(rng.uniform(-0.5, 0.5, 2))
        mask = rng.random(depth.shape).astype(np.float32) if case.reactive else None
        camera = cltaa.Camera(view, np.array(lens))
        made.append(cltaa.Frame(index, colour, depth, camera, jitter, effects=case.effects, reactive=mask))
    return made


def around(image: Array) -> dict[tuple[int, int], Array]:
    """The nine images of the 3x3 neighbours of each pixel, edges repeated."""
    wide = np.pad(image, [(1, 1), (1, 1)] + [(0, 0)] * (image.ndim - 2), mode="edge")
    return {(dy, dx): wide[1 + dy : 1 + dy + HEIGHT, 1 + dx : 1 + dx + WIDTH] for dy, dx in AROUND}


def to_ycocg(c: Array) -> Array:
    r, g, b = np.moveaxis(c, -1, 0)
    return np.stack([(r + 2 * g + b) / 4, (r - b) / 2, (2 * g - r - b) / 4], -1)


def from_ycocg(v: Array) -> Array:
    y, o, g = np.moveaxis(v, -1, 0)
    return np.stack([y - g + o, y + g, y - g - o], -1)


def repaired(frame: cltaa.Frame) -> Array:
    """Step 1."""
    colour = frame.colour.astype(np.float64)
    good = np.isfinite(colour).min(-1, keepdims=True)
    usable: Any = sum(around(np.where(good, colour, 0)).values())
    count: Any = sum(around(good.astype(np.float64)).values())
    return np.where(good, colour, usable / np.maximum(count, 1))


def nearest_surface(q: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Step 3: inverse depth and place of the surface that is followed, and the range of the 3x3."""
    near, far = (pick(list(around(q).values()), 0) for pick in (np.max, np.min))
    edge = np.abs((near - q) - (q - far)) > EDGE * np.abs(near)
    followed, right, down = q.copy(), np.zeros_like(q), np.zeros_like(q)
    for dy, dx in sorted(AROUND, key=lambda at: (at[0] != 0, at[0], at[1] != 0, at[1])):
        nearer = edge & (around(q)[dy, dx] > followed)
        followed = np.where(nearer, around(q)[dy, dx], followed)
        right, down = np.where(nearer, dx, right), np.where(nearer, dy, down)
    return followed, right, down, near, far


def reproject(
    q: Array, right: Array, down: Array, frame: cltaa.Frame, before: cltaa.Camera
) -> tuple[Array, Array, Array]:
    """Step 4 by whole matrices: displacement in pixels, and what takes inverse depth to the previous frame."""
    lens, depth = frame.camera.view_to_clip, 1 / q
    x, y = X + right + 0.5 + frame.jitter_px[0], Y + down + 0.5 + frame.jitter_px[1]
    across, up = (2 * x / WIDTH - 1) * depth / lens[0, 0], (1 - 2 * y / HEIGHT) * depth / lens[1, 1]
    seen = np.stack([across, up, -depth, np.ones_like(depth)], -1)
    to_before = before.view_to_clip @ before.world_to_view @ np.linalg.inv(frame.camera.world_to_view)
    clip = seen @ to_before.T
    w = clip[..., 3]
    return (clip[..., 0] / w + 1) * WIDTH / 2 - x, (1 - clip[..., 1] / w) * HEIGHT / 2 - y, depth / w


def taps_along(f: Array) -> tuple[dict[int, Array], dict[int, Array]]:
    """Step 5: what taps -2 to 3 weigh in the linear filter, and what the six add to it."""
    g, linear = 1 - f, {0: 1 - f, 1: f}
    six = {-2: f * g * (0.105 - 0.0376 * f), -1: f * g * (0.3342 * f - 0.6758)}
    six |= {2: f * g * (0.3342 * g - 0.6758), 3: f * g * (0.105 - 0.0376 * g)}
    six[1] = f + 2 * six[-2] + six[-1] - 2 * six[2] - 3 * six[3]
    six[0] = 1 - np.sum(list(six.values()), 0)
    whole = {tap: linear.get(tap, np.zeros_like(f)) for tap in range(-2, 4)}
    return whole, {tap: six[tap] - whole[tap] for tap in whole}


def sampled(texel: Callable[[int, int], Array], fx: Array, fy: Array) -> Array:
    """Step 5: the cross of 20 texels, held near the range of the four around the place."""
    (lx, sx), (ly, sy) = taps_along(fx), taps_along(fy)
    weights = {(i, j): lx[i] * ly[j] + sx[i] * ly[j] + lx[i] * sy[j] for i in lx for j in ly}
    history = np.sum([weight[..., None] * texel(i, j) for (i, j), weight in weights.items()], 0)
    four = [texel(i, j) for i in (0, 1) for j in (0, 1)]
    low, high = np.min(four, 0), np.max(four, 0)
    held: Array = np.clip(history, low - np.minimum(high - low, np.abs(low)) / 4, high + (high - low) / 4)
    return held


def filtered(colour: Array, jitter: tuple[float, float]) -> Array:
    """The Gaussian of step 9."""
    columns, rows = (np.exp(-FALLOFF * (np.arange(-1, 2) + j) ** 2) for j in jitter)
    weights = np.outer(rows / rows.sum(), columns / columns.sum())
    total: Array = sum((weights[1 + dy, 1 + dx] * c for (dy, dx), c in around(colour).items()), np.zeros_like(colour))
    return total


def begun(frame: cltaa.Frame, case: Case) -> Array:
    """Step 9 without history."""
    colour = repaired(frame)
    soft = filtered(colour, frame.jitter_px)
    share = (KNEE / (KNEE + to_ycocg(soft)[..., :1])) ** 2 if case.weighs else 1.0
    started: Array = colour + share * (soft - colour)
    return started


def resolve(frame: cltaa.Frame, left: Left, case: Case) -> Left:
    """One frame by the ten steps of the page."""
    colour, q = repaired(frame), 1 / frame.depth.astype(np.float64)
    box = around(to_ycocg(colour))
    followed, right, down, near, far = nearest_surface(q)
    u, v, scale = reproject(followed, right, down, frame, left.camera)
    valid = (X + u >= -0.5) & (X + u <= WIDTH - 0.5) & (Y + v >= -0.5) & (Y + v <= HEIGHT - 0.5)
    column, row = (np.where(valid, np.floor(p), 0).astype(int) for p in (u, v))
    fx, fy = np.where(valid, u - np.floor(u), 0), np.where(valid, v - np.floor(v), 0)

    def past(plane: Array, dx: Any, dy: Any) -> Array:
        rows, columns = (Y + dy).astype(int) + row, (X + dx).astype(int) + column
        texels: Array = plane[np.clip(rows, 0, HEIGHT - 1), np.clip(columns, 0, WIDTH - 1)]
        return texels

    if case.tests:
        slack = DEPTH * np.maximum(np.abs(near * scale), np.abs(far * scale))
        four = [past(left.inverse_depth, dx, dy) for dx in (0, 1) for dy in (0, 1)]
        weights = [wx * wy for wx in (1 - fx, fx) for wy in (1 - fy, fy)]
        valid &= np.any([(t >= far * scale - slack) & (t <= near * scale + slack) for t in four], 0)
        own_u, own_v, _ = reproject(q, none := np.zeros_like(q), none, frame, left.camera)
        apart = np.maximum(np.abs(own_u - u), np.abs(own_v - v)) >= PASSED
        showing = np.sum([t > (near + far) * scale / 2 for t in four], 0)
        behind = ((right != 0) | (down != 0)) & (showing <= 1) & apart
        threshold = np.where(behind, BEHIND_T, LIGHT_T)
        threshold = np.where(np.max(four, 0) > near * scale + slack, COVERED_T, threshold)
        corners = [past(left.inverse_depth, dx, dy) for dx in (-1, 2) for dy in (-1, 2)]
        nearest = np.max([*four, *corners], 0)
        its_u, its_v, _ = reproject(nearest / scale, none, none, frame, left.camera)
        against = np.maximum(np.abs(its_u - u), np.abs(its_v - v)) >= PASSED
        passed = (nearest > near * scale + slack) & against
        threshold = np.where(passed, PASSED_T, threshold)
        covered = np.sum([w * (t > near * scale + slack) for w, t in zip(weights, four, strict=True)], 0)
        far_u, far_v, _ = reproject(far, none, none, frame, left.camera)
        edge = np.abs((near - q) - (q - far)) > EDGE * np.abs(near)
        mixed = edge & (np.minimum(np.max(four, 0), np.max(corners, 0)) > (near + far) * scale / 2)
        apart = np.maximum(np.abs(far_u - u), np.abs(far_v - v))
        most = np.where(mixed & (apart >= PASSED), EDGE_SAMPLES / np.clip(apart, PASSED, 1), np.inf)
        valid &= ~(passed & (covered > COVERED_SHARE) & (np.max(corners, 0) > near * scale + slack))
    history = sampled(lambda dx, dy: past(left.colour, dx, dy), fx, fy)
    past_colour = history
    linear = ((wx * wy, dx, dy) for dx, wx in ((0, 1 - fx), (1, fx)) for dy, wy in ((0, 1 - fy), (1, fy)))
    count = sum((w * past(left.samples, dx, dy) for w, dx, dy in linear), np.zeros_like(q))

    n = count
    change = np.zeros_like(q)
    if case.tests:
        across, below = (np.where(f >= 0.5, 1, 0) for f in (fx, fy))
        now, differences = around(to_ycocg(colour)), []
        for (dy, dx), own in now.items():
            differences.append(own - to_ycocg(past(left.colour, across + dx, below + dy)))
        mean, deviation = np.mean(differences, 0), np.std(differences, 0)
        level = np.mean([np.abs(own[..., 0]) for own in now.values()], 0)
        t = mean / (deviation / 3 + LIGHT_FLOOR * level[..., None])
        signed = np.where(t[..., 0] < 0, -1, 1) * np.abs(t).max(-1)
        change = signed + LIGHT_DECAY * past(left.change, across, below)
        n = count / np.maximum(1, np.abs(change) / threshold) ** 2
        n = np.minimum(n, most)
    gamma = MOVING + np.maximum(0, 1 - np.maximum(np.abs(u), np.abs(v))) * (STATIC - MOVING)
    low, high = (pick(list(box.values()), 0) for pick in (np.min, np.max))
    centre, extent = (low + high) / 2, gamma[..., None] * (high - low) / 2
    if case.boxed:
        moved = np.clip(to_ycocg(history), centre - extent, centre + extent) - to_ycocg(history)
        history = history + from_ycocg(moved)

    reactivity = np.zeros_like(q) if frame.reactive is None else frame.reactive.astype(np.float64)
    limit = 1 / (1 / SAMPLE_LIMIT + RESAMPLING_PENALTY * (fx * (1 - fx) + fy * (1 - fy)))
    lost = valid & ~np.isfinite(frame.colour).all(-1)  # samples, of pixels whose history is as long as one
    held, kept_as_it_is = np.minimum(n, limit), np.maximum(past_colour, 0)
    n = held * (1 - reactivity)
    soft = filtered(colour, frame.jitter_px)
    share = np.where(valid, np.minimum(1 / (n + 1), FILTER_SAMPLES / (n + 1) ** 2), 1)
    if case.weighs:
        share = share * (KNEE / (KNEE + to_ycocg(soft)[..., 0])) ** 2
    sample = colour + share[..., None] * (soft - colour)
    bright_history, bright_sample = (
        KNEE + to_ycocg(c)[..., 0] if case.weighs else np.ones_like(q) for c in (history, sample)
    )
    now, before = (1 + reactivity * n) * bright_history, (1 - reactivity) * n * bright_sample
    blended = history + (now / (now + before))[..., None] * (sample - history)
    out = np.where(valid[..., None], blended, sample)
    stored = np.where(lost[..., None], kept_as_it_is, np.maximum(out, np.minimum(sample, 0)))
    kept = np.where(valid, np.clip(change, -MOST_CHANGE, MOST_CHANGE), 0)
    samples = np.where(lost, held, np.where(valid, n + 1, 1))
    return Left(stored, samples, kept, q, frame.camera)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_equations_of_the_page_are_those_of_the_default(case: Case) -> None:
    resolver = cltaa.Resolver(override(cltaa.load_preset(), BOXED if case.boxed else {}), device="numpy")
    first, *others = frames(case)
    none = np.zeros((HEIGHT, WIDTH))
    left = Left(begun(first, case), none + 1, none, 1 / first.depth.astype(np.float64), first.camera)
    assert np.abs(resolver.resolve(first) - left.colour).max() < TOLERANCE
    for frame in others:
        left = resolve(frame, left, case)
        assert np.abs(resolver.resolve(frame) - left.colour).max() < TOLERANCE


def text_of(place: Path) -> str:
    """A source file, or all of a folder."""
    files = [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.suffix in (".h", ".py"))
    return "\n".join(path.read_text(encoding="utf-8") for path in files)


def missing(line: str) -> list[str]:
    """What a line of kernel, twin and parameters names and the tree does not have."""
    functions, _, rest = line.partition("*parameters*")
    parameters = {*Choices.__struct_fields__, *Settings.__struct_fields__}
    wrong = [name for name in re.findall(r"`(\w+)`", rest) if name not in parameters]
    parts = LINKED.split(functions)
    for place, names in zip(parts[1::2], parts[2::2], strict=True):
        text = text_of(PAGE.parent / place)
        wrong += [
            f"{place}: {name}"
            for name in re.findall(r"`(\w+)`", names)
            if not re.search(rf"^ *(?:STAGE|def) (?:\w+ )?{name}\(", text, re.MULTILINE)
        ]
    return wrong


def test_every_step_names_functions_and_parameters_that_there_are() -> None:
    lines = re.findall(r"^\*Kernel\*.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(lines) == 11
    assert [name for line in lines for name in missing(line)] == []


def test_names_missing_from_the_sources_are_found() -> None:
    line = "*Kernel* [`taa/rectify.h`](../kernels/taa/rectify.h) `rectify`, `mended` · *parameters* `box`, `boxes`"
    assert missing(line) == ["boxes", "../kernels/taa/rectify.h: mended"]
