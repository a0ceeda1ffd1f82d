"""A report of ``cltaa bench accuracy`` small enough for every run of the tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cltaa.cli import main
from tests.sequence_factory import write_images, write_sequence

PRESET = "basic"  # whose kernels are built in a third of the time of the default's


def write_report(folder: Path) -> Path:
    """Write a report on four tiny frames, ``seq``, and three variants beside what they depart from."""
    sequence = write_sequence(folder / "seq", 4, reference=True, motion=True)
    truth = [np.full((23, 37, 3), 0.3, np.float32) for _ in range(4)]
    write_images(sequence / "reference-4", truth, name="synthetic")
    output = folder / "report"
    arguments = ["bench", "accuracy", str(sequence), "-o", str(output), "--preset", PRESET, "--rounds", "3"]
    for variant in ("arithmetic: double", "build: strict", "build: fast-relaxed"):
        arguments += ["--only", variant]
    arguments += ["--patience", "0", "--pixels", "1", "--rounding-frames", "2", "--metrics", "mse,flip"]
    assert main(arguments) == 0
    return output
