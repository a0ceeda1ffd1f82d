"""Attributes of a frame in every type that stands for a number, a vector or a matrix, through reading and a resolve."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.io.exr_read import read_frame
from cltaa.io.sequence import open_sequence
from cltaa.pipeline.run import resolve_sequence
from tests.sequence_factory import write_sequence

Change = Callable[[Any], object]
AS: dict[str, list[Change]] = {
    "cltaa:exposure": [lambda _: 2.0, lambda _: np.array([2.0]), lambda _: 2],
    "cltaa:frame": [int, float, lambda value: np.array([float(value)])],
    "cltaa:cut": [int, float],
    "cltaa:jitterPx": [lambda value: value.astype(np.float32), lambda _: np.zeros(2, np.int32)],
    "cltaa:worldToView": [lambda value: value.astype(np.float32)],
    "cltaa:viewToClip": [lambda value: value.astype(np.float32)],
}
CASES = [(name, change) for name, changes in AS.items() for change in changes]


def rewrite(path: Path, name: str, change: Change) -> None:
    """Write a file again with one attribute changed."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = dict(file.header()), {n: np.array(c.pixels) for n, c in file.channels().items()}
    header[name] = change(header.get(name, 0))
    del header["channels"]
    OpenEXR.File(header, channels).write(str(path))


@pytest.mark.parametrize(("name", "change"), CASES)
def test_a_number_of_any_type_is_read_and_goes_through_a_resolve_and_its_checkpoints(
    name: str, change: Change, tmp_path: Path
) -> None:
    folder = write_sequence(tmp_path / "seq", 3)
    for path in sorted(folder.glob("*.exr")):
        rewrite(path, name, change)
    sequence = open_sequence(folder, verify=False)
    frame = sequence.frame(1)
    assert (type(frame.exposure), type(frame.index), frame.index) == (float, int, 1)
    assert frame.camera.view_to_clip.dtype == np.float64
    if name == "cltaa:exposure":
        assert frame.exposure == 2.0
    outcome = resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy"), checkpoint_every=1, progress=False)
    assert outcome.frames == 3


@pytest.mark.parametrize(
    ("name", "change"),
    [("cltaa:exposure", lambda _: "two"), ("cltaa:frame", lambda _: 1.5), ("cltaa:jitterPx", lambda _: "0 0")],
)
def test_what_stands_for_no_number_is_refused_by_name(name: str, change: Change, tmp_path: Path) -> None:
    path = sorted(write_sequence(tmp_path / "seq", 1).glob("*.exr"))[0]
    rewrite(path, name, change)
    with pytest.raises(DataError, match=f"attribute {name} is wrong"):
        read_frame(path)
