"""Segments that lie on texels read one tap: to the same bits, and really one.

The twin reads every tap of every pixel, so that it is what a kernel without the short cuts gives.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.backend import storage_dtype
from cltaa.core.build import Build, Steps, Storage
from cltaa.core.parameters import Choices, HistoryFilter, Reject
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import Planes, padded, storable
from tests.kernels.stage_chain import Work, chain_work, differing, run_stage

Moves = NDArray[np.float32]
SIZE = 70, 41
DOMAIN_LIMIT, TINY = np.float32(2.0**50), np.float32(2.0**-100)


def moves(name: str) -> Moves:
    """Displacements [2, H, W] of which segments lie in one of the ways that a kernel tells apart."""
    random, shape = np.random.default_rng(5), (SIZE[1], SIZE[0])
    whole = np.broadcast_to(random.choice([-3.0, 0.0, 1.0, 2.0], (2, shape[0], 1)), (2, *shape)).copy()
    if name == "still":
        whole[:] = 0.0
    if name == "still, -0":
        whole[:] = -0.0
    if name == "on rows":
        whole[0] += random.random(shape)
    if name == "on columns":
        whole[1] += random.random(shape)
    if name == "whole, not alike":  # on texels, by numbers that differ: close, and apart
        whole += random.choice([0.0, 1.0], whole.shape) * random.choice([1.0, 5.0], (2, shape[0], 1))
    if name == "one lane between":  # no two neighbouring segments are of one kind
        lane = random.random((2, *shape)) < 1 / 8
        whole = np.where(lane, whole + random.choice([0.5, 1e-7, 1e-30], whole.shape), whole)
    if name == "nothing seen":
        whole[:] = 1e9
    return whole.astype(np.float32)


WAYS = [
    "still",
    "still, -0",
    "on texels",
    "on rows",
    "on columns",
    "whole, not alike",
    "one lane between",
    "nothing seen",
]


def work_with(motion: Moves, history: NDArray[np.float32] | None = None) -> Work:
    """The hard frame moved by ``motion``, all of it visible; its history, unless given, is of every size."""
    base = chain_work(*SIZE)
    moved = base.planes["motion_out"].copy()
    moved[:2] = padded(motion, base.layout)
    base.layout.inside(moved)[4] = 1.0
    if history is None:
        random, shape = np.random.default_rng(6), (4, SIZE[1], SIZE[0])
        sizes = random.choice(np.array([DOMAIN_LIMIT, -DOMAIN_LIMIT, TINY, -TINY, 0.0, 1.0, -0.3, 65504.0]), shape)
        history = storable((sizes * random.choice([1.0, random.random()], shape)).astype(np.float32))
    return dataclasses.replace(
        base, planes={**base.planes, "motion_out": moved, "history": padded(history, base.layout)}
    )


def build_of(kind: HistoryFilter, lanes: int, storage: Storage = Storage.FLOAT) -> Build:
    choices = Choices(history_filter=kind, reject=Reject.NONE)
    return Build(
        choices=choices, steps=Steps(alpha=True, exposure=False), strict=True, lanes=lanes, rows=1, storage=storage
    )


def read(work: Work, build: Build) -> tuple[Planes, Planes]:
    """What the kernel and its twin read."""
    with np.errstate(over="ignore"):
        stored = work.planes["history"].astype(storage_dtype(build))
    stored[stored == 0] = 0.0  # nor is -0 ever stored in halves
    work = dataclasses.replace(work, planes={**work.planes, "history": stored})
    ours, theirs = (run_stage("sample_history", build, work, on) for on in (DeviceLauncher(), NumpyLauncher()))
    return ours, theirs


@pytest.mark.parametrize(
    ("kind", "lanes"),
    [*((kind, 8) for kind in HistoryFilter), (HistoryFilter.CATMULL_ROM, 1), (HistoryFilter.CROSS_20, 1)],
)
def test_fewer_taps_give_the_same_bits(kind: HistoryFilter, lanes: int) -> None:
    for way in WAYS:
        work = work_with(moves(way))
        assert differing(work, *read(work, build_of(kind, lanes))) == 0, way


def test_fewer_taps_give_the_same_bits_of_halves() -> None:
    for way in WAYS:
        work = work_with(moves(way))
        work.planes["history"][:] = np.clip(work.planes["history"], -65504, 65504)
        assert differing(work, *read(work, build_of(HistoryFilter.CATMULL_ROM, 8, Storage.HALF))) == 0, way


@pytest.mark.parametrize("kind", list(HistoryFilter))
def test_taps_without_weight_are_not_read(kind: HistoryFilter) -> None:
    # What is NaN spreads through any filter that reads it. All lie on even rows and in every other segment, which alone
    # hold numbers.
    height, width = SIZE[1], SIZE[0]
    y, x = np.mgrid[:height, :width]
    history = np.where((y % 2 == 0) & (x % 16 < 8), np.float32(2.0), np.float32(np.nan))
    motion = np.array([np.where(x % 16 < 8, 0.0, -8.0), -(y % 2)], np.float32)
    work = work_with(motion, np.broadcast_to(history, (4, height, width)))
    lanes = 8  # a single lane, a GPU's, reads them all
    whole = slice(width // lanes * lanes)  # segments that lie in the image with all their lanes
    ours, theirs = (
        work.layout.inside(planes["history_at"])[..., whole] for planes in read(work, build_of(kind, lanes))
    )
    assert (ours[:3] == 2.0).all()
    assert (ours[7] == 1.0).all()
    assert (theirs[7] == 0.0).mean() > 0.9  # the twin reads them all
