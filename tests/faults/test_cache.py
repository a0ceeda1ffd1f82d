"""PoCL's kernel cache: missing, full, cold for many processes at once, and for one that is killed while it builds."""

from __future__ import annotations

import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.errors import ResourceError
from cltaa.opencl import cache as kernel_cache
from cltaa.process import configure
from tests.faults.runs import (
    PATIENCE,
    check_after_fault,
    check_finished,
    may_mount,
    run,
    small_disk,
    start,
    trials_of,
    unprivileged,
)
from tests.faults.runs import on_first_device as arguments

PROCESSES = 8
ROUNDS = 5


def test_a_cache_that_cannot_be_written_exits_with_69(tmp_path: Path, on_device: tuple[Path, dict[str, str]]) -> None:
    (tmp_path / "file").touch()
    cache = tmp_path / "file" / "cache"
    code, said = run(arguments(on_device[0], tmp_path / "out"), POCL_CACHE_DIR=str(cache))
    assert code == 69, said
    assert f"{cache}: the kernel cache cannot be written: Not a directory" in said


@pytest.mark.parametrize("variable", ["POCL_CACHE_DIR", "XDG_CACHE_HOME"])
def test_a_cache_that_names_no_place_is_the_users_own(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POCL_CACHE_DIR")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv(variable, "" if variable == "POCL_CACHE_DIR" else "relative")
    configure()
    assert os.environ["POCL_CACHE_DIR"] == str(Path.home() / ".cache" / "cltaa" / "pocl")


@pytest.mark.parametrize("theirs", ["cache", "cache/locks"])
def test_a_cache_of_another_owner_exits_with_69(
    theirs: str, tmp_path: Path, on_device: tuple[Path, dict[str, str]]
) -> None:
    (tmp_path / theirs).mkdir(parents=True)
    (tmp_path / theirs).chmod(0o555)
    code, said = unprivileged(arguments(on_device[0], tmp_path / "out"), POCL_CACHE_DIR=str(tmp_path / "cache"))
    assert code == 69, said
    assert f"{tmp_path / 'cache'}: the kernel cache cannot be written: Permission denied; free some space there" in said


def test_kernels_of_another_owner_are_named_as_the_cause(
    tmp_path: Path, on_device: tuple[Path, dict[str, str]]
) -> None:
    """The compiler fails without a word where it cannot make the folder of a kernel."""
    for name in map("".join, product("ABCDEFGHIJKLMNOP", repeat=2)):  # PoCL's way to write a byte
        (tmp_path / "cache" / name).mkdir(parents=True)
        (tmp_path / "cache" / name).chmod(0o555)
    code, said = unprivileged(arguments(on_device[0], tmp_path / "out"), POCL_CACHE_DIR=str(tmp_path / "cache"))
    assert code == 70, said
    assert "does not build: the compiler gave no reason; " in said
    assert (
        f"if parts of the kernel cache {tmp_path / 'cache'} are another user's, set POCL_CACHE_DIR to a folder" in said
    )


def test_a_limit_on_the_size_of_files_is_seen_before_the_compiler_aborts(
    tmp_path: Path, on_device: tuple[Path, dict[str, str]]
) -> None:
    """In blocks of 512 or 1024 bytes, as the shell has it: room for a frame, and none for the text of a kernel."""
    command = shlex.join([sys.executable, "-m", "cltaa", *arguments(on_device[0], tmp_path / "out")])
    done = subprocess.run(
        ["sh", "-c", f"ulimit -f 1000; exec {command}"],
        env=os.environ | {"POCL_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 75, done.stderr
    assert "files may not grow large enough for built kernels (expected 4.2 MB, found at most " in done.stderr
    assert "the shell limits the size of a file: ulimit -f unlimited" in done.stderr


def test_full_cache_is_seen_before_the_compiler_aborts(
    tmp_path: Path,
    on_device: tuple[Path, dict[str, str]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    usage = shutil.disk_usage(tmp_path)
    free = kernel_cache.LEAST_FREE - 1
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=free))
    assert main(arguments(on_device[0], tmp_path / "out")) == 75
    assert "too little room for built kernels (expected 67 MB, found 67 MB free)" in capsys.readouterr().err
    monkeypatch.undo()
    assert main(arguments(on_device[0], tmp_path / "out")) == 0
    check_finished(tmp_path / "out", on_device[1])


@pytest.mark.skipif(not may_mount(), reason="only who may mount has a small disk; the test above says that it is small")
def test_cache_on_a_disk_that_is_full(tmp_path: Path, on_device: tuple[Path, dict[str, str]]) -> None:
    """PoCL's compiler would end the process; the next command, with room, finishes."""
    cache, output = tmp_path / "cache", tmp_path / "out"
    with small_disk(cache, 200):
        code, said = run(arguments(on_device[0], output), POCL_CACHE_DIR=str(cache))
        assert code == 75, said
        assert f"{cache}: too little room for built kernels (expected 67 MB, found 1 MB free)" in said
    assert run(arguments(on_device[0], output), POCL_CACHE_DIR=str(kernel_cache.cache_folder()))[0] == 0
    check_finished(output, on_device[1])


@pytest.mark.parametrize("rounds", [1, pytest.param(ROUNDS, marks=pytest.mark.big)])
def test_processes_on_one_cold_cache_all_succeed(tmp_path: Path, rounds: int) -> None:
    trials = trials_of("cold_cache", tmp_path, rounds, OPENBLAS_NUM_THREADS="1")
    assert [trial["codes"] for trial in trials] == [[0] * PROCESSES] * rounds


@pytest.mark.big
def test_whole_processes_on_one_cold_cache(tmp_path: Path, on_device: tuple[Path, dict[str, str]]) -> None:
    folder, expected = on_device
    for turn in range(ROUNDS):
        top = tmp_path / str(turn)
        top.mkdir()
        cache = {"POCL_CACHE_DIR": str(top / "cache")}
        processes = [start(arguments(folder, top / str(number)), **cache) for number in range(PROCESSES)]
        said = [process.communicate(timeout=PATIENCE)[1] for process in processes]
        assert [process.returncode for process in processes] == [0] * PROCESSES, said
        for number in range(PROCESSES):
            check_finished(top / str(number), expected)


@pytest.mark.big
def test_a_kill_while_kernels_are_built_harms_no_later_run(
    tmp_path: Path, on_device: tuple[Path, dict[str, str]]
) -> None:
    """SIGKILL at random times of runs that begin without a cache: what one leaves serves the next, or does no harm."""
    chance, killed = random.Random(0), 0
    begin = time.monotonic()
    assert run(arguments(on_device[0], tmp_path / "timed"), POCL_CACHE_DIR=str(tmp_path / "timed cache"))[0] == 0
    longest = time.monotonic() - begin
    for turn in range(12):
        cache, output = tmp_path / f"cache{turn}", tmp_path / f"out{turn}"
        for _ in range(3):
            process = start(arguments(on_device[0], output), POCL_CACHE_DIR=str(cache))
            try:
                process.communicate(timeout=chance.uniform(0.1 * longest, 0.9 * longest))
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
            killed += process.returncode < 0
            check_after_fault(output, on_device[1])
        code, said = run(arguments(on_device[0], output), POCL_CACHE_DIR=str(cache))
        assert code == 0, said
        check_finished(output, on_device[1])
    print(f"{killed} kills")
    assert killed > 6  # fewer where runs are faster than the one timed


def test_lock_of_the_cache_is_taken_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that has it may take it again; nothing is left when it fails."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    with kernel_cache.filling("a"), kernel_cache.filling("a"):
        pass
    with pytest.raises(ResourceError), kernel_cache.filling("a"):
        raise ResourceError("planted")
    with kernel_cache.filling("a"):
        pass


def test_a_build_after_an_aborted_compiler_prints_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A compiler that aborts gives no cure itself; an error of ours is no abort, nor does it clear one."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    with pytest.raises(ResourceError), kernel_cache.filling("a"):
        raise ResourceError("planted")
    with kernel_cache.filling("a"):
        pass
    assert capfd.readouterr().err == ""
    aborting = "import os; from cltaa.opencl.cache import filling\nwith filling('a'): os.abort()"
    command = [sys.executable, "-c", aborting]
    assert subprocess.run(command, check=False, cwd=Path(__file__).parents[2]).returncode == -signal.SIGABRT
    with kernel_cache.filling("b"):
        pass
    assert capfd.readouterr().err == ""
    with pytest.raises(ResourceError), kernel_cache.filling("a"):
        raise ResourceError("planted")
    said = []
    for _ in range(2):
        with kernel_cache.filling("a"):
            pass
        said.append(capfd.readouterr().err.splitlines())
    assert said == [[kernel_cache.NEVER_ENDED] * 2, []]
