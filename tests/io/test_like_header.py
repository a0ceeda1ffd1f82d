"""A header that is made from an earlier one is what OpenEXR writes, to the byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.errors import StorageError
from cltaa.exr import like_header
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_write import write_image

pytest.importorskip("isal")

PLANES: dict[str, Pixels] = {name: np.zeros((5, 4), np.float16) for name in "RGB"}
MATRIX = np.arange(16, dtype=np.float64).reshape(4, 4)
KNOWN: dict[str, object] = {
    "cltaa:worldToView": MATRIX,
    "worldToCamera": MATRIX.astype(np.float32),
    "cltaa:jitterPx": np.array([0.25, -0.5]),
    "cltaa:frame": 3,
    "cltaa:exposure": 1.5,
    "expTime": 0.5,
    "cltaa:scene": "room",
    "owner": "ä",
}


@pytest.fixture(autouse=True)
def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(like_header, "_earlier", None)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What OpenEXR writes, one entry for each header."""
    calls: list[str] = []
    real = OpenEXR.File.write

    def write(self: OpenEXR.File, *to: object) -> None:
        calls.append("header")
        real(self, *to)

    monkeypatch.setattr(OpenEXR.File, "write", write)
    return calls


def content(path: Path, attributes: dict[str, object], **more: Any) -> bytes:
    write_image(path, more.pop("planes", PLANES), attributes, **more)
    return path.read_bytes()


def alone(path: Path, attributes: dict[str, object], **more: Any) -> bytes:
    """The same where no header was before it."""
    earlier, like_header._earlier = like_header._earlier, None
    try:
        return content(path, attributes, **more)
    finally:
        like_header._earlier = earlier


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cltaa:worldToView", -MATRIX),
        ("cltaa:worldToView", np.full((4, 4), np.nan)),
        ("worldToCamera", np.eye(4, dtype=np.float32)),
        ("cltaa:jitterPx", np.array([1e-9, 0.1])),
        ("cltaa:frame", -(2**31)),
        ("cltaa:exposure", 0.1),
        ("cltaa:scene", "hall"),
        ("owner", "ö"),
    ],
)
def test_other_values_are_put_in_their_places(name: str, value: object, made: list[str], tmp_path: Path) -> None:
    first = content(tmp_path / "a.exr", KNOWN)
    expected = alone(tmp_path / "b.exr", KNOWN | {name: value})
    made.clear()
    assert content(tmp_path / "c.exr", KNOWN | {name: value}) == expected != first
    assert content(tmp_path / "d.exr", KNOWN) == first
    assert made == []


@pytest.mark.parametrize(
    ("changes", "more"),
    [
        ({"cltaa:scene": "hallway"}, {}),
        ({"expTime": 0.1}, {}),
        ({"cltaa:frame": 3.0}, {}),
        ({"cltaa:frame": True}, {}),
        ({"more": 1}, {}),
        ({"cltaa:worldToView": MATRIX[:3, :3]}, {}),
        ({"cltaa:worldToView": MATRIX.astype(np.float32)}, {}),
        ({}, {"compression": "zips"}),
        ({}, {"windows": ((2, 3, 5, 7), (0, 0, 9, 9))}),
        ({}, {"planes": {name: np.zeros((6, 4), np.float16) for name in "RGB"}}),
        ({}, {"planes": {name: np.zeros((5, 4), np.float32) for name in "RGB"}}),
        ({}, {"planes": {name: np.zeros((5, 4), np.float16) for name in "RGZ"}}),
    ],
)
def test_what_is_of_another_kind_is_written_anew(
    changes: dict[str, object], more: dict[str, Any], made: list[str], tmp_path: Path
) -> None:
    content(tmp_path / "a.exr", KNOWN)
    expected = alone(tmp_path / "b.exr", KNOWN | changes, **more)
    made.clear()
    assert content(tmp_path / "c.exr", KNOWN | changes, **more) == expected
    assert made == ["header"]


def test_what_nothing_is_known_of_is_written_anew(made: list[str], tmp_path: Path) -> None:
    for word in ("two", "six"):
        assert word.encode() in content(tmp_path / "a.exr", KNOWN | {"list": ["one", word]})
    assert len(made) == 2


def test_a_value_that_stands_otherwise_is_not_replaced() -> None:
    """As one would that OpenEXR writes in another way than is taken for granted."""
    told: list[bytes] = []

    def write(number: bytes) -> bytes:
        told.append(number)
        return bytes(8) + b"n\0int\0" + b"\4\0\0\0" + number + b"\0"

    def like(number: int) -> bytes:
        return like_header.like_earlier({"n": number}, None, lambda: write(number.to_bytes(4, "big")))

    for number in (1, 2, 3):
        assert number.to_bytes(4, "big") in like(number)
    assert len(told) == 3


def test_what_openexr_refuses_is_refused_after_another_too(tmp_path: Path) -> None:
    content(tmp_path / "a.exr", KNOWN | {"pixelAspectRatio": 1.0})
    with pytest.raises(StorageError, match="could not write it"):
        content(tmp_path / "b.exr", KNOWN | {"pixelAspectRatio": -1.0})
