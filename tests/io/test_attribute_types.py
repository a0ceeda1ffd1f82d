"""Attributes of a frame in every type that stands for a number, a vector or a matrix, through reading and a resolve."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.core.resolver import Resolver
from cltaa.inputs.open import open_input
from cltaa.io.exr_read import read_any_header, read_planes
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


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("rational", struct.pack("<iI", 24, 0)),
        ("string", "Größe".encode("latin-1")),
        ("stringvector", struct.pack("<I", 2) + b"ab" + struct.pack("<I", 5) + "Größe".encode("latin-1")),
        ("deepImageState", b"\0"),
    ],
)
def test_a_value_that_openexr_cannot_represent_is_read_and_written_as_it_is(
    kind: str, value: bytes, parts: int, tmp_path: Path
) -> None:
    path, stands_in = tmp_path / "x.0001.exr", b"n" * 14 + b"\0string\0" + struct.pack("<i", len(value))
    planes = {name: np.full((2, 3), 0.5, np.float32) for name in "RGB"}
    header = {"type": OpenEXR.scanlineimage, "n" * 14: "-" * len(value)}
    OpenEXR.File([OpenEXR.Part(header | {"name": f"p{n}"}, planes) for n in range(parts)]).write(str(path))
    there = b"n" * (20 - len(kind)) + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
    content = path.read_bytes()
    assert content.count(stands_in) == parts
    path.write_bytes(content.replace(stands_in + b"-" * len(value), there))
    assert all(name.endswith(tuple("RGB")) for name in read_any_header(path).layout.channels)
    found = read_planes(path, {"p0.R", "R"})
    assert [plane.tolist() for plane in found.values()] == [[[0.5] * 3] * 2]
    resolve_sequence(open_input(tmp_path), tmp_path / "out", Resolver(device="numpy"), progress=False)
    assert there in (tmp_path / "out" / path.name).read_bytes()  # a result has it as it was
