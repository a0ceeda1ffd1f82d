"""Files appear whole or not at all, and what killed writers left behind is found."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cltaa.errors import OutputError
from cltaa.io.atomic import atomic_path, make_folder, remove_stale_temporaries


def test_order_of_the_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """File flushed, then renamed, then folder flushed: any other order can lose the file when the machine stops."""
    steps = []
    real_fsync, real_replace = os.fsync, Path.replace

    def fsync(descriptor: int) -> None:
        steps.append("flush " + Path(f"/proc/self/fd/{descriptor}").resolve().name)
        real_fsync(descriptor)

    def replace(self: Path, target: Path) -> Path:
        steps.append("rename")
        return real_replace(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    with atomic_path(tmp_path / "a.txt") as temporary:
        assert temporary.parent == tmp_path
        temporary.write_text("whole")
        assert not (tmp_path / "a.txt").exists()
    assert steps == [f"flush {temporary.name}", "rename", f"flush {tmp_path.name}"]
    assert (tmp_path / "a.txt").read_text() == "whole"


def test_exception_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_disk_errors(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="this is a folder"), atomic_path(tmp_path / "folder"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be created"):
        make_folder(tmp_path / "file" / "below")
    assert make_folder(tmp_path / "a" / "b").is_dir()


KILLED = """
import sys, time
from pathlib import Path
from cltaa.io.atomic import atomic_path
with atomic_path(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("half", flush=True)
    time.sleep(600)
"""


def test_killed_writer_leaves_no_torn_file_and_its_rest_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    root = Path(__file__).parents[2]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], cwd=root, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "half\n"
        assert remove_stale_temporaries(tmp_path) == 0  # its writer is alive
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    (tmp_path / f".b.txt.tmp.{os.getpid()}").touch()
    (tmp_path / ".hidden").touch()
    deadline = time.monotonic() + 300
    while not remove_stale_temporaries(tmp_path):
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [f".b.txt.tmp.{os.getpid()}", ".hidden"]


@pytest.mark.parametrize(("answer", "stale"), [(ProcessLookupError, 1), (PermissionError, 0)])
def test_a_running_process_of_somebody_else_keeps_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: type[OSError], stale: int
) -> None:
    def kill(process: int, number: int) -> None:
        assert (process, number) == (7, 0)  # 0 asks, and ends nothing
        raise answer

    monkeypatch.setattr(os, "kill", kill)
    (tmp_path / ".a.txt.tmp.7").touch()
    assert remove_stale_temporaries(tmp_path) == stale
    assert remove_stale_temporaries(tmp_path, owned=True) == 1 - stale
    assert list(tmp_path.iterdir()) == []
