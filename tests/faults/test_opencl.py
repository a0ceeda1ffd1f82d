"""No device, no compiler, no cache, no memory, a device that goes: a code, one line, and frames that stay right."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pyopencl as cl
import pytest

from cltaa import device, kernel_cache, launch, program
from cltaa.cli import main
from cltaa.errors import DeviceLost, DeviceMissing, InternalError, ResourceError
from cltaa.resolve import Resolver
from tests.faults.runs import check_after_fault, check_finished, digests
from tests.sequence_factory import make_frame, write_sequence

FRAMES = 5
PROCESSES = 8
OUT_OF_RESOURCES = cl.status_code.OUT_OF_RESOURCES


def arguments(folder: Path, output: Path) -> list[str]:
    return ["resolve", str(folder), "-o", str(output), "--checkpoint", "2"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    top = tmp_path_factory.mktemp("opencl")
    folder = write_sequence(top / "in", FRAMES, motion=True)
    assert main(arguments(folder, top / "whole")) == 0
    return folder, digests(top / "whole")


def planted(kind: type[cl.Error], routine: str, code: int) -> cl.Error:
    """An error as pyopencl makes it from what a driver returns."""
    return kind(cl._cl._ErrorRecord(routine, code, "planted"))


def run(command: list[str], **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "cltaa.cli", *command], env=os.environ | variables, capture_output=True, text=True,
        check=False, timeout=300,
    )  # fmt: skip


def test_no_device(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    done = run(arguments(whole[0], tmp_path / "out"), OCL_ICD_VENDORS="/nonexistent", OCL_ICD_FILENAMES="")
    assert done.returncode == 69, done.stderr
    assert done.stderr.startswith("cltaa: error: no OpenCL device found; install one with: pip install")
    numpy = [*arguments(whole[0], tmp_path / "out"), "--device", "numpy"]
    assert run(numpy, OCL_ICD_VENDORS="/nonexistent").returncode == 0


def test_kernel_that_does_not_build(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = program.source
    broken = '#error "planted"\n'
    monkeypatch.setattr(program, "source", lambda name, build: broken + real(name, build))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(InternalError, match=r"kernel resolve does not build: .*planted.*kernel cache") as caught:
        Resolver().resolve(make_frame())
    assert caught.value.exit_code == 70
    (log,) = tmp_path.glob("cltaa-resolve-*.log")
    assert str(log) in str(caught.value)
    assert "planted" in log.read_text()
    assert "__kernel void resolve_kernel" in log.read_text()


def test_cache_that_cannot_be_written(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    (tmp_path / "file").touch()
    cache = str(tmp_path / "file" / "cache")
    done = run(arguments(whole[0], tmp_path / "out"), POCL_CACHE_DIR=cache)
    assert done.returncode == 69, done.stderr
    assert f"{cache}: the kernel cache cannot be written: Not a directory" in done.stderr


def test_full_cache_is_seen_before_the_compiler_aborts(
    tmp_path: Path,
    whole: tuple[Path, dict[str, str]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    usage = shutil.disk_usage(tmp_path)
    free = kernel_cache.LEAST_FREE - 1
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=free))
    assert main(arguments(whole[0], tmp_path / "out")) == 75
    assert "too little room for built kernels (expected 67 MB, found 67 MB free)" in capsys.readouterr().err
    monkeypatch.undo()
    assert main(arguments(whole[0], tmp_path / "out")) == 0
    check_finished(tmp_path / "out", whole[1])


@pytest.mark.parametrize("rounds", [1, pytest.param(5, marks=pytest.mark.big)])
def test_processes_on_one_cold_cache(tmp_path: Path, whole: tuple[Path, dict[str, str]], rounds: int) -> None:
    folder, expected = whole
    for turn in range(rounds):
        top = tmp_path / str(turn)
        top.mkdir()
        processes = [
            subprocess.Popen(
                [sys.executable, "-m", "cltaa.cli", *arguments(folder, top / str(number))],
                env=os.environ | {"POCL_CACHE_DIR": str(top / "cache")}, stderr=subprocess.PIPE, text=True,
            )
            for number in range(PROCESSES)
        ]  # fmt: skip
        said = [process.communicate(timeout=300)[1] for process in processes]
        assert [process.returncode for process in processes] == [0] * PROCESSES, said
        for number in range(PROCESSES):
            check_finished(top / str(number), expected)


class Failing:
    """Calls of a function, of which the ``at``-th (and with ``always`` every later one) raises."""

    def __init__(self, function: Any, at: int, error: Exception, *, always: bool = False) -> None:
        self.function, self.at, self.error, self.always, self.calls = function, at, error, always, 0

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.calls += 1
        if self.calls == self.at or (self.always and self.calls > self.at):
            raise self.error
        return self.function(*arguments, **named)


@pytest.mark.parametrize("error", [cl.RuntimeError, cl.MemoryError])
@pytest.mark.parametrize("name", ["enqueue_nd_range_kernel", "enqueue_map_buffer"])
@pytest.mark.parametrize("stride", [5, pytest.param(1, marks=pytest.mark.big)])
def test_device_lost_at_the_nth_call(
    tmp_path: Path, whole: tuple[Path, dict[str, str]], name: str, error: type[cl.Error], stride: int,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Once: the device is opened again and the run ends with the same bits. From then on: 75, and a rerun finishes."""
    folder, expected = whole
    real, at, calls = getattr(cl, name), 1, 0
    while at == 1 or calls >= at:
        for always in (False, True):
            output = tmp_path / f"{at}{always}"
            failing = Failing(real, at, planted(error, f"cl{name}", OUT_OF_RESOURCES), always=always)
            monkeypatch.setattr(cl, name, failing)
            code = main(arguments(folder, output))
            monkeypatch.setattr(cl, name, real)
            said = capsys.readouterr().err
            if always and failing.calls >= at:
                assert (code, "stopped working" in said) == (75, True), said
                check_after_fault(output, expected)
                assert main(arguments(folder, output)) == 0
            assert always or code == 0, said
            check_finished(output, expected)
            calls = failing.calls
        at += stride
    assert at > FRAMES


@pytest.mark.parametrize("at", range(1, 9))
def test_no_memory_for_the_nth_buffer(
    tmp_path: Path, whole: tuple[Path, dict[str, str]], at: int, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Buffers are touched when they are made: a lack of memory shows before the first frame, with the bytes needed."""
    failure = planted(cl.MemoryError, "clEnqueueFillBuffer", cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE)
    failing = Failing(cl.enqueue_fill, at, failure)
    monkeypatch.setattr(cl, "enqueue_fill", failing)
    assert main(arguments(whole[0], tmp_path / "out")) == 75
    said = capsys.readouterr().err
    assert "not enough memory on" in said
    assert "bytes in one buffer, found largest buffer" in said
    assert digests(tmp_path / "out") == {}
    assert main(arguments(whole[0], tmp_path / "out")) == 0
    check_finished(tmp_path / "out", whole[1])


def test_memory_limit_of_the_driver() -> None:
    """POCL_MEMORY_LIMIT=1 (GiB) and frames that need more: 75 before the first frame."""
    code = (
        "import numpy as np\nfrom cltaa.launch import DeviceLauncher\nlauncher = DeviceLauncher()\n"
        "launcher.allocate((3, 20000, 20000))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"POCL_MEMORY_LIMIT": "1"}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert "ResourceError: not enough memory on" in done.stderr
    assert "expected 4800000000 bytes in one buffer" in done.stderr


def test_wrong_call_is_no_lost_device() -> None:
    lost = device.Device()
    for error, raised in (
        (planted(cl.LogicError, "clSetKernelArg", cl.status_code.INVALID_ARG_SIZE), InternalError),
        (planted(cl.LogicError, "clEnqueue", cl.status_code.INVALID_COMMAND_QUEUE), DeviceLost),
        (planted(cl.RuntimeError, "clFinish", OUT_OF_RESOURCES), DeviceLost),
    ):
        with pytest.raises(raised), device.device_errors(lost):
            raise error


def test_context_that_cannot_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    error = planted(cl.RuntimeError, "clCreateContext", cl.status_code.DEVICE_NOT_AVAILABLE)
    monkeypatch.setattr(cl, "Context", Failing(cl.Context, 1, error))
    with pytest.raises(DeviceMissing, match=r"cannot be opened: .*planted"):
        launch.DeviceLauncher()


def test_lock_of_the_cache_is_taken_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that has it may take it again; nothing is left when it fails."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    with kernel_cache.filling("a"), kernel_cache.filling("a"):
        pass
    with pytest.raises(ResourceError), kernel_cache.filling("a"):
        raise ResourceError("planted")
    with kernel_cache.filling("a"):
        pass
