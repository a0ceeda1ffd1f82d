"""What the tests of faults share: short sequences, runs of the command line, and the invariants after any fault."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from cltaa.cli import main
from cltaa.exr import read_image
from cltaa.manifest import Manifest, file_sha256
from tests.sequence_factory import write_sequence

FRAMES = 7  # with a checkpoint every 2 frames both slots are written and overwritten
CHECKPOINT = 2


def arguments(folder: Path, output: Path, *more: str) -> list[str]:
    """The command line of one run."""
    return ["resolve", str(folder), "-o", str(output), "--checkpoint", str(CHECKPOINT), "--device", "numpy", *more]


def prepare(top: Path, count: int = FRAMES) -> tuple[Path, dict[str, str]]:
    """A small sequence in ``top`` and the hashes of its frames, resolved without a fault."""
    folder = write_sequence(top / "in", count, width=9, height=7, motion=True)
    assert main(arguments(folder, top / "whole")) == 0
    return folder, digests(top / "whole")


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every image under its final name."""
    return {path.name: file_sha256(path) for path in sorted(folder.glob("*.exr")) if path.name[0] != "."}


def check_after_fault(output: Path, whole: dict[str, str]) -> int:
    """I1, I2: what has a final name is complete and right, and what the manifest lists is there; returns the count."""
    if not output.is_dir():
        return 0
    found = digests(output)
    assert found.items() <= whole.items()
    for name in found:
        read_image(output / name)
    try:
        listed = {name: entry.sha256 for name, entry in Manifest(output).entries.items()}
    except FileNotFoundError:
        listed = {}
    assert listed.items() <= found.items()
    return len(found)


def check_finished(output: Path, whole: dict[str, str]) -> None:
    """I3, I4: every frame is there with the bits of a run without faults, and nothing temporary is left."""
    assert digests(output) == whole
    assert {name: entry.sha256 for name, entry in Manifest(output).entries.items()} == whole
    assert sorted(path.name for path in output.iterdir()) == sorted([*whole, "manifest.jsonl", "resolve.json"])


def start(command: list[str], **variables: str) -> subprocess.Popen[str]:
    """Start ``cltaa`` with ``command`` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "cltaa.cli", *command],
        env={**os.environ, **variables}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
