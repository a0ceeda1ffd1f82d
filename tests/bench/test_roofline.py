"""The roofline of a measurement."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.bench.frames import Motion
from cltaa.bench.kernels import bench_kernels
from cltaa.bench.roofline import OPERATIONS, draw
from cltaa.parameters.presets import load_preset


def test_every_contender_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    bench = bench_kernels(
        [load_preset("t2")], None, width=64, height=64, motions=[Motion.UNIFORM], rounds=3, oracle=False
    )
    picture = tmp_path / "roof.svg"
    draw(bench, picture)
    text = picture.read_text(encoding="utf-8")
    for row in bench.timings[0].rows[:3]:
        assert row.device_ns is not None
        assert f"{row.name}: {OPERATIONS / row.device_ns.median:.0f}" in text
