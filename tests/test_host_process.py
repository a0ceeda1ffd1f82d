"""A program that uses the library keeps its process as it was: only the command line sets it up for itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cltaa.errors import CltaaError
from cltaa.process import run_cltaa
from tests.sequence_factory import write_sequence

# What the host had before cltaa was imported is compared with what it has while a file is decoded, while a frame is
# resolved, and at the end. Other packages are imported first: what they change of a process is theirs.
HOST = """
import ctypes, json, os, signal, sys, warnings
import numpy, OpenEXR, pyopencl
pyopencl.get_platforms()
folder, output = sys.argv[1:]


def state():
    return {
        "environment": dict(os.environ),
        "signals": [str(signal.getsignal(number)) for number in signal.valid_signals()],
        "streams": [str(getattr(sys, name)) for name in ("stdin", "stdout", "stderr", "excepthook")],
        "descriptors": [list(os.fstat(number)[:3]) for number in range(3)],
        "stderr of C": ctypes.c_void_p.in_dll(ctypes.CDLL(None), "stderr").value,
        "threads of OpenEXR": OpenEXR.global_thread_count(),
        "largest image": str(OpenEXR.getMaxImageSize()),
        "warnings": str(warnings.filters),
        "folder": os.getcwd(),
    }


def see(beside=()):
    now = state()
    changed.update(name for name in now if now[name] != before[name] and name not in beside)


before, changed, seen = state(), set(), {"decoded": 0, "resolved": 0}

import cltaa

see()
from cltaa.pipeline.run import resolve_sequence

File = OpenEXR.File


def decoded(*arguments, **more):
    seen["decoded"] += 1
    see(beside=["warnings"])  # a thread: while another builds a kernel, Python's filters leave out the driver's remarks
    return File(*arguments, **more)


class Looking(cltaa.Resolver):
    def resolve(self, frame, **more):
        seen["resolved"] += 1
        see()
        return super().resolve(frame, **more)


def look(output):
    OpenEXR.File = decoded
    resolve_sequence(cltaa.open(folder), output, Looking("fast"))
    OpenEXR.File = File
    see()
    print(json.dumps({"changed": sorted(changed), "seen": seen}))


look(output)
from cltaa.process import configure

configure()
look(output + " of the command line")
"""


def test_only_the_command_line_changes_its_process(tmp_path: Path) -> None:
    """The same look sees what the command line does change, in the same process then."""
    folder = write_sequence(tmp_path / "in", 3, width=40, height=24)
    unset = ("POCL_CACHE_DIR", "PYOPENCL_NO_CACHE", "OMP_WAIT_POLICY", "OPENBLAS_NUM_THREADS")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    child = subprocess.run(
        [sys.executable, "-c", HOST, str(folder), str(tmp_path / "out")],
        env=environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    library, command_line = map(json.loads, child.stdout.splitlines())
    assert library["changed"] == []
    assert library["seen"]["resolved"] == 3
    assert library["seen"]["decoded"] >= 3
    assert command_line["changed"] == ["environment", "largest image", "stderr of C", "streams", "threads of OpenEXR"]
    assert len(list(tmp_path.glob("out*/*.exr"))) == 6


def test_the_library_shows_no_progress(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 3)
    script = "import cltaa, sys; cltaa.check(sys.argv[1]); cltaa.plan(sys.argv[1], device='numpy'); "
    script += "[cltaa.resolve(sys.argv[1], sys.argv[2], device='numpy') for _ in range(2)]"
    command = [sys.executable, "-c", script, str(folder), str(tmp_path / "out")]
    child = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (child.stdout, child.stderr) == ("", "")


def test_a_command_in_another_process_ends_with_its_own_exit_code(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(CltaaError, match=r"cltaa kernels --show 'a b' failed \(found exit code 64\)") as caught:
        run_cltaa(["kernels", "--show", "a b"])
    assert caught.value.exit_code == 64
    assert "a b" in capfd.readouterr().err
