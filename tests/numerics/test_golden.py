"""The golden vectors: neither twins nor strict kernels have moved since they were written."""

from __future__ import annotations

import pytest

from cltaa.core.backend import Launcher
from cltaa.core.build import Build
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.stage_chain import ALL_STEPS, STAGES, WRITES, differing, run_stage
from tests.numerics.golden import FOLDER, LAYOUT, read_table, read_work


@pytest.mark.optimised
@pytest.mark.parametrize("launcher", [NumpyLauncher, DeviceLauncher])
def test_stages_give_the_golden_vectors(launcher: type[NumpyLauncher] | type[DeviceLauncher]) -> None:
    on: Launcher = launcher()
    work = read_work()
    build = Build(steps=ALL_STEPS, strict=True, lanes=8, rows=4)
    for kernel in WRITES:
        golden = read_table(FOLDER / f"{kernel}.csv")
        assert {name: len(planes) for name, planes in golden.items()} == WRITES[kernel]
        assert differing(work, run_stage(kernel, build, work, on), golden) == 0, kernel
        if kernel in STAGES:
            work.planes.update(golden)


def test_golden_vectors_take_both_ways() -> None:
    history = LAYOUT.inside(read_table(FOLDER / "sample_history.csv")["history_at"])
    change = LAYOUT.inside(read_table(FOLDER / "rectify_history.csv")["change_out"])
    usable = history[7] == 1
    assert 5 <= usable.sum() < usable.size
    assert 0 < change[:3, usable].any(axis=0).sum() < usable.sum()
    assert (history[5][usable] > 0).any()
    gathered = LAYOUT.inside(read_table(FOLDER / "gather.csv")["output_count"])
    assert 0 < (gathered <= 1).sum() < gathered.size
