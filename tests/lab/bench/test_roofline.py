"""The roofline of a measurement, and the operations that it counts."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from cltaa.core.build import Build, Storage
from cltaa.core.parameters import Dilation, Rectify
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.lab.bench.contenders import BASELINE
from cltaa.lab.bench.environment import Environment
from cltaa.lab.bench.frames import Motion, make_frames
from cltaa.lab.bench.kernels import KernelBench, Row, Timing
from cltaa.lab.bench.roofline import CountingTwins, draw, operations
from cltaa.lab.timing import Interval

NANOSECONDS = 7.0


def test_every_contender_is_drawn(tmp_path: Path) -> None:
    """With the operations of what it computes."""
    pytest.importorskip("matplotlib")
    counts = {"core": BASELINE, "basic": load_preset("basic"), "plain port": BASELINE}
    picture = tmp_path / "roof.svg"
    draw(measured([*counts]), picture)
    text = picture.read_text(encoding="utf-8")
    for name, preset in counts.items():
        assert f"{name}: {operations(preset, Motion.UNIFORM).total() / NANOSECONDS:.3g}" in text


def measured(names: list[str]) -> KernelBench:
    """What ``cltaa bench kernels`` would have found of these contenders."""
    time, one = (Interval(median=number, low=number, high=number) for number in (NANOSECONDS, 1.0))
    rows = [
        Row(
            name=name,
            rounds=3,
            wall_ns=time,
            device_ns=None,
            least_wall_ns=NANOSECONDS,
            ratio=one,
            device_ratio=None,
            gigabytes_a_second=3.0,
            of_floor=0.5,
        )
        for name in names
    ]
    timing = Timing(
        motion=Motion.UNIFORM,
        rows=rows,
        absent={},
        opengl=None,
        noisy=False,
        device_noisy=False,
        floor_ns=1.0,
        copy_gigabytes_a_second=20.0,
    )
    where = Environment(
        date="2026-01-02 03:04",
        system="",
        cpu="a processor",
        cores=3,
        cpu_flags=[],
        load_before=0.0,
        load_after=0.0,
        device="a device",
        libraries={},
        kernels_sha256="",
        options=[],
    )
    return KernelBench(width=64, height=32, storage=Storage.HALF, rounds=3, environment=where, timings=[timing])


def test_the_operations_are_those_of_the_twin() -> None:
    """Of one that can be counted by hand: a comparison and an addition for each of three planes, halo or none."""
    layout, twins = Layout(20, 9), CountingTwins()
    image, halves = layout.zeros(3), layout.zeros(3, np.float16)
    steps = {"first": 0, "row_step": layout.stride, "column_step": 1, "plane_step": layout.plane}
    twins.run(
        "pack", Build(), layout, {"image": image, "target": halves.reshape(-1), "planes": 3, "halves": 1, **steps}
    )
    assert twins.done == {"greater_equal": 3, "add": 3}


@pytest.mark.parametrize(
    "choices",
    [{"rectify": Rectify.NONE}, {"dilation": Dilation.NONE}],
    ids=lambda choices: next(iter(choices)),
)
def test_a_step_that_is_left_out_is_not_counted(choices: dict[str, object]) -> None:
    without = msgspec.structs.replace(BASELINE, choices=msgspec.structs.replace(BASELINE.choices, **choices))
    fewer, all_of_them = (operations(preset, Motion.TURN) for preset in (without, BASELINE))
    assert 0 < fewer.total() < all_of_them.total()
    assert fewer <= all_of_them


def test_who_counts_does_not_change_the_picture() -> None:
    counted, plain = (Resolver(BASELINE, launcher) for launcher in (CountingTwins(), "numpy"))
    for frame in make_frames(40, 24, Motion.TURN):
        assert np.array_equal(counted.resolve(frame), plain.resolve(frame))
