"""Signals that end a run, of a resolve and of a capture, at each step and at any call."""

from __future__ import annotations

import signal
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tests.faults.runs import FRAMES, trials_of

PATIENCE = 7200.0
KILLED, INTERRUPTED = -signal.SIGKILL, 130


def forked(top: Path, shim: Path, work: str, how: str, number: signal.Signals, count: int) -> list[dict[str, Any]]:
    """What ``forked.py`` says about each run; it has checked the invariants."""
    variables = {"LD_PRELOAD": str(shim), "OPENBLAS_NUM_THREADS": "1"}
    runs = trials_of("forked", top, shim, work, how, int(number), count, patience=PATIENCE, **variables)
    print(f"{number.name}: {len(runs)} runs, {dict(Counter(run['code'] for run in runs))}")
    return runs


@pytest.mark.parametrize(
    ("work", "frames", "stride"), [("short resolve", 3, 5), pytest.param("resolve", FRAMES, 1, marks=pytest.mark.big)]
)
def test_killed_at_each_step(tmp_path: Path, shim: Path, work: str, frames: int, stride: int) -> None:
    """SIGKILL at the n-th open, write, flush or rename: the steps of the protocol, one after another."""
    runs = forked(tmp_path, shim, work, "steps", signal.SIGKILL, stride)
    assert {run["code"] for run in runs} == {KILLED}
    assert {run["kept"] for run in runs} == set(range(frames + 1))


@pytest.mark.parametrize("stride", [24, pytest.param(1, marks=pytest.mark.big)])  # a capture takes seconds to begin
def test_capture_killed_at_each_step(tmp_path: Path, shim: Path, stride: int) -> None:
    runs = forked(tmp_path, shim, "capture", "steps", signal.SIGKILL, stride)
    # Threads write, in a few steps more or less from run to run: a run may end before the last that were counted.
    assert {run["code"] for run in runs[:-1]} == {KILLED}
    assert len({run["kept"] for run in runs}) > 2


@pytest.mark.big
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_capture_interrupted_at_any_call(tmp_path: Path, shim: Path, number: signal.Signals) -> None:
    runs = forked(tmp_path, shim, "capture", "calls", number, 12)
    assert sum(run["code"] == INTERRUPTED for run in runs) == 12


@pytest.mark.parametrize("count", [16, pytest.param(2000, marks=pytest.mark.big)])
def test_killed_at_any_call(tmp_path: Path, shim: Path, count: int) -> None:
    """Before the first frame is kept or between frames: ``test_killed_at_each_step`` sees every count of them."""
    runs = forked(tmp_path, shim, "resolve", "calls", signal.SIGKILL, count)
    kept = [run["kept"] for run in runs if run["code"] == KILLED]
    assert len(kept) == count
    assert len(set(kept)) > 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("count", [6, pytest.param(250, marks=pytest.mark.big)])
def test_interrupted_at_any_call(tmp_path: Path, shim: Path, number: signal.Signals, count: int) -> None:
    """The frame in work is finished or dropped, the state is saved, and the code is 130, or 0 where all was done."""
    runs = forked(tmp_path, shim, "resolve", "calls", number, count)
    assert sum(run["code"] == INTERRUPTED for run in runs) == count
    assert all(run["code"] == INTERRUPTED or run["kept"] == FRAMES for run in runs)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("stride", [60, pytest.param(1, marks=pytest.mark.big)])
def test_interrupted_at_each_step(tmp_path: Path, shim: Path, number: signal.Signals, stride: int) -> None:
    runs = forked(tmp_path, shim, "resolve", "steps", number, stride)
    assert runs[0]["code"] == INTERRUPTED
    assert all(run["code"] == INTERRUPTED or run["kept"] == FRAMES for run in runs)
