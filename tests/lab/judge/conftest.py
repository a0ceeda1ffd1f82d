"""A capture with its truth, and what a resolve might have made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.io.sequence import open_sequence
from tests.sequence_factory import write_images, write_sequence


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "capture", 4, reference=True)


@pytest.fixture
def resolved(tmp_path: Path, capture: Path) -> Path:
    """Halfway between single sample and truth."""
    sequence = open_sequence(capture)
    assert sequence.reference is not None
    images = [
        (truth + frame.colour) * np.float32(0.5) for truth, frame in zip(sequence.reference, sequence, strict=True)
    ]
    return write_images(tmp_path / "resolved", images, name="synthetic")
