"""What several tests of faults share."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.opencl import device
from tests.faults.runs import on_first_device
from tests.sequence_factory import digests, write_sequence

OPENED, BUILT = device.context_of, device.program_of  # before tests/conftest.py lets launchers share them


@pytest.fixture(autouse=True)
def contexts_and_programs_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Open and build as users do: what is shared would hide a fault of it."""
    monkeypatch.setattr(device, "context_of", OPENED)
    monkeypatch.setattr(device, "program_of", BUILT)


@pytest.fixture(scope="session")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fault injector, built with the compiler that PoCL needs anyway."""
    library = tmp_path_factory.mktemp("shim") / "shim.so"
    flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Werror"]
    source = Path(__file__).with_name("shim.c")
    subprocess.run(["gcc", *flags, "-o", str(library), str(source), "-ldl"], check=True)
    return library


@pytest.fixture(scope="session")
def on_device(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A sequence and the hashes of its frames, resolved without a fault on the machine's first device."""
    top = tmp_path_factory.mktemp("device")
    folder = write_sequence(top / "in", 5, motion=True)
    assert main(on_first_device(folder, top / "whole")) == 0
    return folder, digests(top / "whole")
