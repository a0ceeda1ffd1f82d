"""What the tests of faults share: short runs of two commands, and the invariants after any fault."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from cltaa.cli import main
from cltaa.io.exr_read import read_image
from cltaa.io.manifest import recorded_hashes
from tests.sequence_factory import digests, write_sequence

FRAMES = 7  # with a checkpoint every 2 frames both slots are written and overwritten
CHECKPOINT = 2
PATIENCE = 600.0  # seconds that a process may take
CAP_SYS_ADMIN = 21  # capability.h
PAGE = 4096  # bytes, of which a small disk has a few


def on_first_device(folder: Path, output: Path) -> list[str]:
    """The command line of one run on the machine's first device."""
    return ["resolve", str(folder), "-o", str(output), "--checkpoint", str(CHECKPOINT)]


def arguments(folder: Path, output: Path, *more: str) -> list[str]:
    """The command line of one run without OpenCL."""
    return [*on_first_device(folder, output), "--device", "numpy", *more]


def prepare(top: Path, count: int = FRAMES, width: int = 9, height: int = 7) -> tuple[Path, dict[str, str]]:
    """A small sequence in ``top`` and the hashes of its frames, resolved without a fault."""
    folder = write_sequence(top / "in", count, width=width, height=height, motion=True)
    assert main(arguments(folder, top / "whole")) == 0
    return folder, digests(top / "whole")


def prepare_resolve(top: Path) -> None:
    """The sequence that is resolved."""
    write_sequence(top / "in", FRAMES, width=9, height=7, motion=True)


def resolving(top: Path, output: Path) -> list[str]:
    """The command line of a resolve of what lies in ``top``."""
    return arguments(top / "in", output)


def resolving_three(top: Path, output: Path) -> list[str]:
    """The same for its first three frames, with one checkpoint: every step of the protocol, in half the time."""
    return [*resolving(top, output), "--frames", "0-2"]


def capturing(_: Path, output: Path) -> list[str]:
    """The command line of a capture of two frames with their truth and a yardstick."""
    return ["capture", "conveyor", "-o", str(output), "--frames", "2", "--size", "16x9", "--reference", "2"]


class Work(NamedTuple):
    """A command that writes a folder: what it needs, how it is called, and what it leaves beside images."""

    prepare: Callable[[Path], None]
    command: Callable[[Path, Path], list[str]]
    records: tuple[str, ...]


RECORDS = ("manifest.jsonl", "resolve.json")
WORK = {
    "resolve": Work(prepare_resolve, resolving, RECORDS),
    "short resolve": Work(prepare_resolve, resolving_three, RECORDS),
    "capture": Work(lambda _: None, capturing, ("sequence.json",)),
}


def check_after_fault(output: Path, whole: dict[str, str]) -> int:
    """I1, I2: what has a final name is complete and right, and what the records list is there; returns the count."""
    if not output.is_dir():
        return 0
    found = digests(output)
    assert found.items() <= whole.items()
    for name in found:
        read_image(output / name)
    assert recorded_hashes(output).items() <= found.items()
    return len(found)


def check_finished(output: Path, whole: dict[str, str], records: tuple[str, ...] = RECORDS) -> None:
    """I3, I4: every frame is there with the bits of a run without faults, and nothing temporary is left."""
    assert digests(output) == whole
    assert recorded_hashes(output) == whole
    files = (path for path in output.rglob("*") if not path.is_dir())
    assert sorted(path.relative_to(output).as_posix() for path in files) == sorted([*whole, *records])


def start(command: list[str], **variables: str) -> subprocess.Popen[str]:
    """Start ``cltaa`` with ``command`` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "cltaa.cli", *command],
        env={**os.environ, **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


# What a test does in the midst of a run must not depend on who is faster: all frames but the first few wait to be
# recorded until a file is there (or nobody is left to make it).
HELD = """
import itertools, os, sys, time
from pathlib import Path
from cltaa.cli import main
from cltaa.io.manifest import Manifest

append, numbers, parent = Manifest.append, itertools.count(), os.getppid()
go, most = Path(sys.argv[1]), int(sys.argv[2])


def held(*given):
    if next(numbers) >= most:
        while not go.exists() and os.getppid() == parent:
            time.sleep(0.001)
    append(*given)


Manifest.append = held
sys.exit(main(sys.argv[3:]))
"""


def start_held(folder: Path, output: Path, go: Path, frames: int) -> subprocess.Popen[str]:
    """Start a resolve of ``folder``, which waits for the file ``go`` when ``frames`` frames are finished, as now."""
    process = subprocess.Popen(
        [sys.executable, "-c", HELD, str(go), str(frames), *arguments(folder, output)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + PATIENCE
    while process.poll() is None and len(list(output.glob("[!.]*.exr"))) < frames:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    return process


def run(command: list[str], **variables: str) -> tuple[int, str]:
    """Exit code and standard error of ``cltaa`` in a process of its own."""
    process = start(command, **variables)
    said = process.communicate(timeout=PATIENCE)[1]
    return process.returncode, said


def trials_of(module: str, *words: object, patience: float = PATIENCE, **variables: str) -> list[dict[str, Any]]:
    """Run a module of ``tests.faults`` in a process of its own; returns the JSON of each line that it printed."""
    child = subprocess.run(
        [sys.executable, "-m", f"tests.faults.{module}", *map(str, words)],
        cwd=Path(__file__).parents[2],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=patience,
        check=False,
    )
    assert child.returncode == 0, child.stdout[-3000:] + child.stderr[-3000:]
    return [json.loads(line) for line in child.stdout.splitlines()]


def may_mount() -> bool:
    """Whether this process may mount: root may, and in most containers root may not either."""
    rights = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("CapEff:"))
    return bool(int(rights.split()[1], 16) >> CAP_SYS_ADMIN & 1)


@contextmanager
def small_disk(folder: Path, pages: int) -> Iterator[None]:
    """A file system of its own at ``folder``."""
    folder.mkdir(exist_ok=True)
    options = f"size={pages * PAGE}"
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


# Root may read everything; without these two rights (capability.h) it may not. They are given up for what is executed.
UNPRIVILEGED = """
import ctypes, os, sys
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2
for right in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, right, 0, 0, 0)
os.execv(sys.executable, [sys.executable, "-m", "cltaa.cli", *sys.argv[1:]])
"""


def unprivileged(command: list[str], **variables: str) -> tuple[int, str]:
    """Exit code and standard error of ``cltaa`` run by a user whom permissions bind."""
    child = subprocess.run(
        [sys.executable, "-c", UNPRIVILEGED, *command],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )
    return child.returncode, child.stderr
