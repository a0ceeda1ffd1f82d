"""Rows that a work-item keeps while its segments move alike, of the history and of its differences from the frame: the
same bits as rows worked out anew."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cltaa.core.build import Build, Steps, Storage
from cltaa.core.parameters import Choices, Illumination
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import Work, differing, hard_work, run_stage

WIDTH, HEIGHT = 70, 41
ROWS = 13  # of a work-item: some begin in the midst of what moves alike
CHANGES = {"fraction, x": (0.25, 0.0), "fraction, y": (0.0, 0.25), "whole, x": (1.0, 0.0), "whole, y": (0.0, -1.0)}
BUILDS = [(1, Storage.FLOAT), (8, Storage.HALF), (16, Storage.FLOAT)]


def moved(name: str) -> Work:
    """A frame that moves by a fraction of a texel, alike down to where ``name`` says that it does not."""
    motion = np.broadcast_to(np.array([0.375, -1.625], np.float32)[:, None, None], (2, HEIGHT, WIDTH)).copy()
    random, y = np.random.default_rng(8), np.arange(HEIGHT)[:, None]
    for axis, step in enumerate(CHANGES.get(name, (0.0, 0.0))):
        motion[axis] += step * (y // 5 % 2)  # five rows of this, five of that
    if name == "each segment its own":
        often = np.repeat(np.repeat(random.integers(0, 4, (2, HEIGHT // 3 + 1, WIDTH // 16 + 1)), 3, 1), 16, 2)
        motion += 0.25 * often[:, :HEIGHT, :WIDTH].astype(np.float32)
    if name == "a lane now and then":
        motion += np.where(random.random(motion.shape) < 1 / 200, 0.5, 0.0).astype(np.float32)
    work = hard_work(WIDTH, HEIGHT, seed=3)
    return dataclasses.replace(work, planes={**work.planes, "motion": padded(motion, work.layout)})


@pytest.mark.parametrize(("lanes", "storage"), BUILDS)
def test_kept_rows_give_the_same_bits(lanes: int, storage: Storage) -> None:
    steps = Steps(alpha=True, exposure=False)
    choices = Choices(illumination=Illumination.TEST)
    build = Build(choices=choices, steps=steps, strict=True, lanes=lanes, rows=ROWS, storage=storage)
    for name in ("alike", *CHANGES, "each segment its own", "a lane now and then"):
        work = moved(name)
        if storage is Storage.HALF:
            work.planes["history"][:] = np.clip(work.planes["history"], -65504, 65504)
        ours, theirs = (run_stage("resolve", build, work, launcher) for launcher in (DeviceLauncher(), NumpyLauncher()))
        assert differing(work, ours, theirs) == 0, name


def test_what_stands_still_keeps_no_rows_and_gives_the_same_bits() -> None:
    steps = Steps(camera_motion=False, own_motion=False, alpha=True, exposure=False)
    build = Build(choices=Choices(illumination=Illumination.TEST), steps=steps, strict=True, lanes=8, rows=ROWS)
    work = hard_work(WIDTH, HEIGHT, seed=3)
    ours, theirs = (run_stage("resolve", build, work, launcher) for launcher in (DeviceLauncher(), NumpyLauncher()))
    assert differing(work, ours, theirs) == 0
