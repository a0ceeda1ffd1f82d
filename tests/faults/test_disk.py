"""A disk that is full after k pages, files that may not grow, a folder that goes away: nothing finished is lost."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from cltaa.cli import main
from cltaa.pipeline.run import DiskSpace
from tests.faults.runs import (
    PATIENCE,
    arguments,
    check_after_fault,
    check_finished,
    may_mount,
    prepare,
    small_disk,
    start_held,
    trials_of,
)

FRAMES = 4
STEPS = 16


@pytest.mark.skipif(not may_mount(), reason="only who may mount has a small disk; others inject the same errors")
def test_disk_that_is_full_after_k_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Disks from one page on, of every fifth size, until everything has room."""
    folder, whole = prepare(tmp_path, FRAMES, width=64, height=36)
    output, code, pages = tmp_path / "disk" / "out", 74, -4
    while code:
        pages += 5
        with small_disk(tmp_path / "disk", pages):
            capsys.readouterr()
            code = main(arguments(folder, output))
            said = capsys.readouterr().err
            check_after_fault(output, whole)
            assert code == 0 or (code in (73, 74) and str(output) in said), said
            subprocess.run(["mount", "-o", "remount,size=16m", str(tmp_path / "disk")], check=True)
            assert main(arguments(folder, output)) == 0
            check_finished(output, whole)
    print(f"{pages // 5} sizes of a disk that was too small")
    assert pages > 64


def test_files_that_may_not_grow_beyond_k_bytes(tmp_path: Path) -> None:
    trials = trials_of("small_files", tmp_path, STEPS)
    assert len(trials) == STEPS
    assert {trial["code"] for trial in trials} >= {0, 74}


def test_a_limit_on_the_size_of_files_that_reading_meets_is_named(tmp_path: Path) -> None:
    """What is read is copied into a file in memory, to which the limit applies too."""
    folder, _ = prepare(tmp_path, 1, width=64, height=36)
    command = f"ulimit -f 1; exec {sys.executable} -m cltaa compare {tmp_path / 'whole'} {folder} --metrics mse"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 74
    assert [line for line in done.stderr.splitlines() if "warning" not in line] == done.stderr.splitlines()[-1:]
    assert "reading failed: File too large; the shell limits the size of a file, and of a copy in memory" in done.stderr


def test_folder_that_is_deleted_during_the_run(tmp_path: Path) -> None:
    folder, whole = prepare(tmp_path, 20)
    output = tmp_path / "out"
    process = start_held(folder, output, tmp_path / "go", 3)
    output.rename(tmp_path / "elsewhere")  # at once, so that the run cannot fill it again meanwhile
    shutil.rmtree(tmp_path / "elsewhere")
    (tmp_path / "go").touch()
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode in (73, 74), said
    assert str(output) in said
    assert not output.exists()
    assert main(arguments(folder, output)) == 0
    check_finished(output, whole)


@pytest.mark.parametrize(("free", "told"), [(1000, True), (10**9, False)])
def test_too_little_disk_space_is_reported_before_the_disk_is_full(
    free: int, told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once, as soon as some files show how large they are; and the run goes on, for it is a guess."""
    folder, whole = prepare(tmp_path, 12, width=64, height=36)
    capsys.readouterr()
    monkeypatch.setattr("cltaa.pipeline.run.shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    assert main(arguments(folder, tmp_path / "out")) == 0
    said = capsys.readouterr().err
    assert said.count("frames left will take about") == told
    if told:
        size = (tmp_path / "out").rglob("*.exr").__next__().stat().st_size
        found = re.search(r"([0-9]+) frames left will take about ([0-9.]+) kB, 1.0 kB are free", said)
        assert found is not None
        assert float(found[2]) * 1e3 == pytest.approx(int(found[1]) * size, rel=0.1)
    check_finished(tmp_path / "out", whole)


def test_a_folder_that_is_gone_is_told_by_what_is_written_into_it(tmp_path: Path) -> None:
    DiskSpace(tmp_path / "gone", 9).look([1, 1])
