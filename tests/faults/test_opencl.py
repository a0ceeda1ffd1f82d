"""No device, no compiler, no cache, no memory, a device that goes: a code, one line, and frames that stay right."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyopencl as cl
import pytest

from cltaa.cli import main
from cltaa.core.build import source
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DeviceLost, DeviceMissing, InternalError
from cltaa.opencl import device
from cltaa.opencl import launcher as device_launcher
from tests.faults.runs import check_after_fault, check_finished, run
from tests.faults.runs import on_first_device as arguments
from tests.sequence_factory import digests, make_frame

OUT_OF_RESOURCES = cl.status_code.OUT_OF_RESOURCES


def planted(kind: type[cl.Error], routine: str, code: int) -> cl.Error:
    """An error as pyopencl makes it from what a driver returns."""
    return kind(cl._cl._ErrorRecord(routine, code, "planted"))


def test_without_a_device_numpy_still_resolves(tmp_path: Path, on_device: tuple[Path, dict[str, str]]) -> None:
    nowhere = str(tmp_path / "none")
    code, said = run(arguments(on_device[0], tmp_path / "out"), OCL_ICD_VENDORS=nowhere, OCL_ICD_FILENAMES="")
    assert code == 69, said
    assert said.startswith("cltaa: error: no OpenCL device found; install one with: pip install")
    numpy = [*arguments(on_device[0], tmp_path / "out"), "--device", "numpy"]
    assert run(numpy, OCL_ICD_VENDORS=nowhere)[0] == 0


def test_a_kernel_that_does_not_build_leaves_one_log(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = '#error "planted"\n'
    monkeypatch.setattr(device, "source", lambda name, build: broken + source(name, build))
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    for _ in range(2):  # the second time it is told in the same file
        with pytest.raises(InternalError, match=r"kernel unpack does not build: .*planted.*kernel cache") as caught:
            Resolver().resolve(make_frame())
        assert caught.value.exit_code == 70
        (log,) = (tmp_path / "logs").iterdir()
        assert str(log) in str(caught.value)
        assert "planted" in log.read_text()
        assert "__kernel void unpack_kernel" in log.read_text()


def test_a_build_log_that_cannot_be_kept_is_not_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(device, "source", lambda _name, _build: '#error "planted"\n')
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    (tmp_path / "logs").write_text("no folder")
    with pytest.raises(InternalError, match=r"planted\S*; check the driver and its kernel cache") as caught:
        Resolver().resolve(make_frame())
    assert "log" not in str(caught.value)


class Failing:
    """Calls of a function, of which the ``at``-th (and with ``always`` every later one) raises."""

    def __init__(self, function: Any, at: int, error: Exception, *, always: bool = False) -> None:
        self.function, self.at, self.error, self.always, self.calls = function, at, error, always, 0

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.calls += 1
        if self.calls == self.at or (self.always and self.calls > self.at):
            raise self.error
        return self.function(*arguments, **named)


# Where a driver may say that its device is gone: owner and name of the call, and whether data are copied to the host.
CALLS = {
    "run": (cl, "enqueue_nd_range_kernel", False),
    "map": (cl, "enqueue_map_buffer", False),
    "unmap": (cl.MemoryMap, "release", False),
    "wait": (cl.CommandQueue, "finish", False),
    "copy": (cl, "enqueue_copy", True),
    "pin": (cl, "enqueue_map_buffer", True),
}


def copying(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let devices have memory of their own, as GPUs have."""
    monkeypatch.setattr(device.Device, "shares_memory", property(lambda _: False, lambda *_: None), raising=False)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(
    ("stride", "turn"), [(13, 0), pytest.param(1, 0, marks=pytest.mark.big), pytest.param(1, 1, marks=pytest.mark.big)]
)
def test_device_lost_at_the_nth_call(
    tmp_path: Path,
    on_device: tuple[Path, dict[str, str]],
    call: str,
    stride: int,
    turn: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Once: the device is opened again and the run ends with the same bits. From then on: 75, and a rerun finishes.

    What the driver says is a RuntimeError and a MemoryError of pyopencl by turns.
    """
    folder, expected = on_device
    owner, name, copies = CALLS[call]
    if copies:
        copying(monkeypatch)
    real, at, calls, tries = getattr(owner, name), 1, 0, 0
    while at == 1 or calls >= at:
        error = (cl.RuntimeError, cl.MemoryError)[(at + turn) % 2]
        for always in (False, True):
            output = tmp_path / f"{at}{always}"
            failing = Failing(real, at, planted(error, f"cl{name}", OUT_OF_RESOURCES), always=always)
            monkeypatch.setattr(owner, name, lambda *given, failing=failing, **named: failing(*given, **named))
            code = main(arguments(folder, output))
            monkeypatch.setattr(owner, name, real)
            said = capsys.readouterr().err
            if always and failing.calls >= at:
                assert (code, "stopped working" in said) == (75, True), said
                check_after_fault(output, expected)
                assert main(arguments(folder, output)) == 0
            assert always or code == 0, said
            check_finished(output, expected)
            tries += failing.calls >= at
            if not always:
                calls = failing.calls
        at += stride
    print(f"{tries} faults")
    assert at > len(expected)


GATHERING = ["--preset", "gather-8", "--set", "illumination=static"]


@pytest.mark.parametrize("name", ["enqueue_fill", "Buffer"])
@pytest.mark.parametrize(
    "more", [[], ["--band-rows", "5"], GATHERING, None], ids=["whole", "bands", "gathering", "copying"]
)
def test_no_memory_for_the_nth_buffer(
    tmp_path: Path,
    on_device: tuple[Path, dict[str, str]],
    name: str,
    more: list[str] | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Buffers are touched when they are made: a lack of memory shows before the first frame, with the bytes needed.

    Those of the first frame one after another, and every thirteenth of those that each later frame asks for alike.
    """
    copies = more is None
    if more is None:
        copying(monkeypatch)
    gathers, of_the_ring = more == GATHERING, False
    more = [*(more or []), "--frames", "0-2"]
    failure = planted(cl.MemoryError, "clEnqueueFillBuffer", cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE)
    command, real, at, reached = arguments(on_device[0], tmp_path / "out"), getattr(cl, name), 0, True
    assert main([*command, *more]) == 0
    expected = digests(tmp_path / "out")
    assert gathers or expected.items() <= on_device[1].items()
    ring = load_preset("gather-8").settings.history_frames + 1  # and the one in work
    while reached:
        at += 1 if at < 12 else 13
        failing = Failing(real, at, failure)
        monkeypatch.setattr(cl, name, failing)
        code = main([*command, *more, "--restart"])
        monkeypatch.setattr(cl, name, real)
        said, reached = capsys.readouterr().err, failing.calls >= at
        assert code == (75 if reached else 0), said
        if reached:
            assert "not enough memory on" in said
            general = "use a smaller size or another --device, or run again when others have ended"
            assert general in said or "keep fewer with --set history_frames=N" in said
            assert "bytes in one buffer, found largest buffer" in said
            of_the_ring |= f"to keep {ring} frames" in said and "keep fewer with --set history_frames=N" in said
            # What is copied through the host is pinned when it is copied first: the state for the first checkpoint. A
            # channel that is read where it is takes no memory, but a buffer of its own in each frame.
            finished = check_after_fault(tmp_path / "out", expected)
            assert finished <= (2 if copies else 0) or (name == "Buffer" and not copies)
            if not finished:  # and a run from there is one like any other
                continue
            assert main([*command, *more]) == 0
        check_finished(tmp_path / "out", expected)
    assert of_the_ring == gathers
    print(f"up to buffer {at - 1}")
    assert at > 6


def test_memory_limit_of_the_driver() -> None:
    """POCL_MEMORY_LIMIT=1 (GiB) and frames that need more: 75 before the first frame."""
    code = (
        "import numpy as np\nfrom cltaa.opencl.launcher import DeviceLauncher\nlauncher = DeviceLauncher()\n"
        "launcher.allocate((3, 20000, 20000))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"POCL_MEMORY_LIMIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "ResourceError: not enough memory on" in done.stderr
    assert "expected 4800000000 bytes in one buffer" in done.stderr


def test_wrong_call_is_no_lost_device() -> None:
    lost = device.Device()
    for error, raised, said in (
        (planted(cl.LogicError, "clSetKernelArg", cl.status_code.INVALID_ARG_SIZE), InternalError, "refused a call: "),
        (planted(cl.LogicError, "clEnqueue", cl.status_code.INVALID_COMMAND_QUEUE), DeviceLost, "stopped working: "),
        (planted(cl.RuntimeError, "clFinish", OUT_OF_RESOURCES), DeviceLost, "stopped working: "),
    ):
        with pytest.raises(raised, match=said), lost.errors:
            raise error


def test_a_device_without_a_context_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    error = planted(cl.RuntimeError, "clCreateContext", cl.status_code.DEVICE_NOT_AVAILABLE)
    monkeypatch.setattr(cl, "Context", Failing(cl.Context, 1, error))
    with pytest.raises(DeviceMissing, match=r"cannot be opened: .*planted.*; see: cltaa doctor"):
        device_launcher.DeviceLauncher()
