"""What a process takes beside the planes: told by the process itself, since other OpenCL drivers may be loaded too."""

from __future__ import annotations

import mmap
from pathlib import Path

import pytest

from cltaa.io.sequence import open_sequence
from cltaa.lab.inspect.plan import plan
from cltaa.pipeline import memory
from cltaa.pipeline.memory import PROGRAM, program_bytes
from tests.sequence_factory import write_sequence

DRIVER = 32 * 2**20  # bytes


def test_files_that_a_driver_maps_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "driver"
    path.write_bytes(bytes(DRIVER))
    before = program_bytes()
    assert before > memory.ALLOCATED
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        assert sum(mapped[:: mmap.PAGESIZE]) == 0  # each page of it is touched
        assert program_bytes() - before == pytest.approx(DRIVER, rel=0.1)


def test_what_building_kernels_maps_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The plan builds what it times, and a resolve after it builds nothing."""
    path, kept = tmp_path / "compiler", []
    path.write_bytes(bytes(DRIVER))

    def built(*_: object) -> None:
        with path.open("rb") as file:
            kept.append(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        assert sum(kept[-1][:: mmap.PAGESIZE]) == 0

    monkeypatch.setattr("cltaa.lab.inspect.plan._time", built)
    sequence = open_sequence(write_sequence(tmp_path / "in", 2))
    before = plan(sequence, device="numpy", rounds=0).memory.program
    assert plan(sequence, device="numpy").memory.program - before < DRIVER / 10
    assert kept
    kept[-1].close()


def test_a_system_that_does_not_tell_gets_what_was_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(memory, "STATUS", tmp_path / "none")
    assert program_bytes() == PROGRAM
