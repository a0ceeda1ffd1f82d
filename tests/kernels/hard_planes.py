"""Planes of a frame, its history and its frames in the ring that hold every hard case at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.core.build import Steps, window_count
from cltaa.core.constants import value as value_of
from cltaa.core.parameters import Choices, Recursion
from cltaa.core.planes import Layout
from tests.sequence_factory import SPECIAL_BITS

Planes = dict[str, NDArray[Any]]

DOMAIN_LIMIT, TINY = value_of("DOMAIN_LIMIT"), value_of("TINY")
KEPT = 3  # frames whose samples are gathered
WINDOWS = window_count(Choices(recursion=Recursion.STANDING), Steps(long_ring=True))  # the most that a build has


def hard_planes(layout: Layout, seed: int = 0) -> Planes:
    """Padded planes by the names of the fused kernel's arguments.

    Tiles of 8x8 have their own mean (1e-2 to 1e6) and relative spread (1e-7 to 1: nearly and wholly flat ones among
    them), so that sums cancel; bit patterns that a careless path lets spread are strewn over all of it.
    """
    random = np.random.default_rng(seed)
    shape = (layout.height, layout.width)
    mean, spread = 10 ** tiles(random, shape, -2, 6), 10 ** tiles(random, shape, -7, 0)
    spread[tiles(random, shape, 0, 1) < 0.1] = 0.0

    def near_mean(planes: int) -> NDArray[np.float32]:
        return (mean * (1 + spread * random.normal(size=(planes, *shape)))).astype(np.float32)

    colour, inverse_depth = near_mean(3), 10 ** tiles(random, shape, -3, 1)
    inverse_depth = inverse_depth * (1 + spread * random.normal(size=shape))
    motion = random.choice([np.nan, np.nan, 0.0, 0.0, 1.0, -2.0, 0.5, 1e-7, 1e6, 1e30], (2, *shape))
    motion += random.choice([0.0, 1.0], shape) * random.normal(0, 3, (2, *shape))
    history = np.concatenate([near_mean(3), random.uniform(-0.2, 1.2, (1, *shape))])
    # Reactivity with a draw of its own, so that all else stays: rough in half of the tiles, in the others even.
    shares = np.random.default_rng((seed, 43))
    even, rough = tiles(shares, shape, 0, 1), tiles(shares, shape, 0, 1) < 0.5
    earlier = inverse_depth * random.choice([1.0, 1.02, 1.3], shape)
    strewn = (
        strew(colour, random, 0.01),  # with holes, below
        strew(inverse_depth[None], random, 0.02),
        strew(motion, random, 0.02),
        strew(random.uniform(-0.2, 1.2, (1, *shape)), random, 0.02),
        strew(np.where(rough, random.choice([0.0, 1.0, 0.3], (1, *shape)), even), random, 0.02),
        storable(strew(history, random, 0.002)),
        random.choice([0.0, 1.0, 7.0, 24.0, 1000.0], (1, *shape)),
        strew(earlier[None], random, 0.02),
    )
    names = (
        "current",
        "inverse_depth",
        "motion",
        "alpha",
        "reactive",
        "history",
        "history_count",
        "previous_inverse_depth",
    )
    # Holes of a draw of their own, wider than a 3x3: of frames in the ring too, but not at the same places.
    holes = np.random.default_rng((seed, 44))

    def with_holes(planes: NDArray[np.float32]) -> NDArray[np.float32]:
        for size in (3, 5, 9):
            if 3 * size < min(shape):
                top, left = (int(holes.integers(0, side - size)) for side in shape)
                planes[:, top : top + size, left : left + size] = np.nan
        return planes

    # Of each frame of the ring r, g, b, inverse depth, own motion, alpha and reactivity.
    ring = [
        plane
        for _ in range(KEPT)
        for plane in (
            *with_holes(strew(near_mean(3), random, 0.01)),
            *strew((inverse_depth * random.choice([1.0, 1.0, 1.02, 1.3], shape))[None], random, 0.02),
            *strew(motion + random.choice([0.0, 0.1], shape), random, 0.02),
            *strew(random.uniform(-0.2, 1.2, (1, *shape)), random, 0.02),
            *strew((even + shares.choice([0.0, 0.05, -0.08, 0.3], shape))[None], shares, 0.02),
        )
    ]
    # Of each window r, g, b, error, count and alpha; the errors of many are alike.
    errors = mean * random.choice([1.0, 1.0, 1.001, 0.1, 1e8], shape)
    windows = [
        plane
        for _ in range(WINDOWS)
        for plane in (
            *storable(strew(near_mean(3), random, 0.01)),
            *(errors * (1 + 0.1 * random.random((1, *shape)))).astype(np.float32),
            *random.choice([1.0, 7.0, 48.0], (1, *shape)),
            *random.uniform(0, 1, (1, *shape)),
        )
    ]
    with_holes(strewn[0])
    named = {**dict(zip(names, strewn, strict=True)), "ring": np.array(ring), "windows": np.array(windows)}
    return {name: padded(planes, layout) for name, planes in named.items()}


def tiles(random: np.random.Generator, shape: tuple[int, int], low: float, high: float) -> NDArray[np.float64]:
    """[H, W] uniform in [low, high], one value a tile of 8x8."""
    coarse = random.uniform(low, high, (-(-shape[0] // 8), -(-shape[1] // 8)))
    return np.repeat(np.repeat(coarse, 8, 0), 8, 1)[: shape[0], : shape[1]]


def strew(planes: NDArray[Any], random: np.random.Generator, share: float) -> NDArray[np.float32]:
    """``planes`` as float32 with ``SPECIAL_BITS``, the ends of the domain and fireflies at a share of the texels."""
    beyond = np.nextafter(np.float32(DOMAIN_LIMIT), np.float32(np.inf))
    numbers = [0.0, -1.0, 65504, 65520, 1e5, 1e30, -1e30, DOMAIN_LIMIT, beyond]
    hard = np.concatenate([np.array(SPECIAL_BITS, np.uint32).view(np.float32), np.array(numbers, np.float32)])
    single = planes.astype(np.float32)
    return np.where(random.random(planes.shape) < share, random.choice(hard, planes.shape), single)


def storable(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """``planes`` as a resolve can have stored them (accumulate.h): inside the domain, no denormal, no -0."""
    size = np.abs(planes)
    return np.where((size <= DOMAIN_LIMIT) & (size >= TINY), planes, np.float32(0.0))


def padded(planes: NDArray[Any], layout: Layout) -> NDArray[np.float32]:
    """[C, H, W] with its halo, the edge repeated."""
    out = layout.zeros(len(planes))
    layout.inside(out)[:] = planes
    layout.extend_edges(out)
    return out
