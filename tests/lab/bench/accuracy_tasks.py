"""Tasks of ``cltaa bench accuracy`` on a tiny sequence."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from cltaa.core.presets import load_preset
from cltaa.io.sequence import open_sequence
from cltaa.lab.bench.cells import Judging, Task, task_of
from cltaa.lab.bench.variants import ladder
from tests.sequence_factory import write_images, write_sequence

FRAMES = 4
ERRORS = Judging(metrics=("mse",), rounding_frames=3, pictures=True)


def write_tiny(folder: Path) -> Path:
    """Write four small frames, a truth, and a yardstick of two samples whose time is known."""
    write_sequence(folder, FRAMES, reference=True)
    truth = [np.full((23, 37, 3), 0.3 + number / 100, np.float32) for number in range(FRAMES)]
    write_images(folder / "reference-2", truth, name="synthetic")
    return folder


def task(sequence: Path, place: int = 0, **changes: object) -> Task:
    variant = msgspec.structs.replace(ladder(load_preset())[place], **changes)
    return task_of(open_sequence(sequence), [variant], None, ERRORS)
