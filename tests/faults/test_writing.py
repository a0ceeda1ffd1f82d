"""Whatever fails on the way to the disk: one line, a code, whole frames, and a second run that finishes the rest."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.runs import arguments, check_after_fault, check_finished, prepare, start

HERE = Path(__file__).parent
KILL = "3"  # of shim.c
PATIENCE = 300.0


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fault injector, built with the compiler that PoCL needs anyway."""
    library = tmp_path_factory.mktemp("shim") / "shim.so"
    flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Werror"]
    subprocess.run(["gcc", *flags, "-o", str(library), str(HERE / "shim.c"), "-ldl"], check=True)
    return library


@pytest.mark.parametrize("stride", [5, pytest.param(1, marks=pytest.mark.big)])
@pytest.mark.parametrize("action", ["once", "from then on"])
def test_every_call_that_can_fail(tmp_path: Path, shim: Path, action: str, stride: int) -> None:
    """The n-th open, write, flush or rename in the output folder fails, for every n (see ``failing.py``)."""
    command = [sys.executable, "-m", "tests.faults.failing", str(tmp_path), str(shim), action, str(stride)]
    child = subprocess.run(
        command, cwd=HERE.parents[1], env={**os.environ, "LD_PRELOAD": str(shim)},
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stderr[-3000:]
    trials = [json.loads(line) for line in child.stdout.splitlines()]
    failed = [trial for trial in trials if trial["code"]]
    assert not trials[-1]["reached"]
    # Only what is read when a run begins may fail without harm: the slots of a checkpoint, say.
    assert len(failed) > 0.85 * (len(trials) - 1)
    assert {trial["kept"] for trial in trials} == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("stride", [37, pytest.param(1, marks=pytest.mark.big)])
def test_killed_at_each_step(tmp_path: Path, shim: Path, stride: int) -> None:
    """SIGKILL at the n-th open, write, flush or rename: the steps of the protocol, one after another."""
    folder, whole = prepare(tmp_path)
    at, ended = 3, -9
    while ended == -9:
        output = tmp_path / f"out{at}"
        variables = {"LD_PRELOAD": str(shim), "FAULT_FOLDER": str(output), "FAULT_AT": str(at), "FAULT_ACTION": KILL}
        process = start(arguments(folder, output), **variables)
        process.communicate(timeout=PATIENCE)
        ended = process.returncode
        check_after_fault(output, whole)
        process = start(arguments(folder, output))
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, said
        check_finished(output, whole)
        at += stride
    print(f"{(at - 3) // stride - 1} kills")
    assert ended == 0
    assert at > 3 * stride
