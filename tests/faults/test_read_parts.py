"""Multi-part files, as Blender and Nuke write them: held to the same limits as those of one part."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.errors import CltaaError, DataError, ResourceError
from cltaa.inputs.open import open_input
from cltaa.io.exr_read import read_any_header, read_planes
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.manifest import file_sha256
from cltaa.io.sequence import open_sequence
from tests.faults.exr_surgery import Anatomy, as_part, assembled_parts, channel, window
from tests.faults.reading_process import damage
from tests.io.test_bad_input import refusal
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_frame

LARGE = 2**31 - 1


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    write_frame(tmp_path / "sound.exr", make_frame())
    return tmp_path / "sound.exr"


def two(sound: Path) -> list[Anatomy]:
    return [as_part(sound, "left"), as_part(sound, "right")]


def written(folder: Path, parts: list[Anatomy]) -> Path:
    path = folder / "parts.exr"
    path.write_bytes(assembled_parts(parts))
    return path


def test_parts_are_read_as_openexr_reads_them(tmp_path: Path, sound: Path) -> None:
    path = written(tmp_path, two(sound))
    planes = read_planes(path)
    assert set(planes) == {f"{part}.{name}" for part in ("left", "right") for name in "RGBZ"}
    assert read_any_header(path).layout.channels == dict.fromkeys(planes, "float")
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, plane in part.channels.items():
            np.testing.assert_array_equal(bits(planes[f"{part.name()}.{name}"]), bits(plane.pixels))
    np.testing.assert_array_equal(bits(planes["right.R"]), bits(make_frame().colour[..., 0]))


def test_recorded_hash_is_held_against_parts_too(tmp_path: Path, sound: Path) -> None:
    path = written(tmp_path, two(sound))
    read_planes(path, sha256=file_sha256(path))
    with pytest.raises(DataError, match="not what was recorded"):
        read_planes(path, sha256="0" * 64)


def test_parts_cut_off_anywhere(tmp_path: Path) -> None:
    small = tmp_path / "small.exr"
    write_frame(small, make_frame(width=5, height=17))
    path = written(tmp_path, two(small))
    for length in reversed(range(0, path.stat().st_size, 5)):
        os.truncate(path, length)
        with pytest.raises(DataError, match=r"parts\.exr: .*(truncated|cut off|empty|not an EXR)"):
            read_planes(path)


def test_damaged_parts(tmp_path: Path, sound: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Hundreds of them, in this process: the reader that they reach is the one that survives thousands elsewhere."""
    path = written(tmp_path, two(sound))
    content, digest = path.read_bytes(), file_sha256(path)
    counts: Counter[str] = Counter()
    for number in range(0, 8000, 32):
        damaged = damage(content, 12, number)
        if damaged == content:
            continue
        path.write_bytes(damaged)
        try:
            read_planes(path)
            counts["read"] += 1
        except CltaaError:
            counts["refused"] += 1
        with pytest.raises(CltaaError):
            read_planes(path, sha256=digest)
    assert sum(counts.values()) > 245
    assert counts["refused"] > 125
    assert capfd.readouterr().out == ""


def change(name: bytes, value: bytes) -> Callable[[list[Anatomy]], object]:
    return lambda parts: parts[1].set(name, value)


def resized(name: bytes, columns: int, rows: int) -> Callable[[list[Anatomy]], object]:
    """Colour of one size and, say, depth or motion of another."""
    return change(name, window(0, 0, columns - 1, rows - 1))


def huge(parts: list[Anatomy]) -> None:
    """Each part is 16384 x 16384 of 500 channels in PIZ, for which a chunk may be of any size."""
    for part in parts:
        for name in (b"dataWindow", b"displayWindow"):
            part.set(name, window(0, 0, 16383, 16383))
        part.set(b"compression", b"\4")
        part.set(b"channels", b"".join(channel(b"c%d" % n) for n in range(500)) + b"\0")
        part.chunks = [struct.pack("<ii", row, 64) + bytes(64) for row in range(0, 16384, 32)]
        part.set(b"chunkCount", struct.pack("<i", 512))


def deep_of_no_count(parts: list[Anatomy]) -> None:
    """Where the chunks of the other part are nobody can tell."""
    parts[1].set(b"type", b"deepscanline")
    parts[1].set(b"chunkCount", struct.pack("<i", -1))


CASES: list[tuple[Callable[[list[Anatomy]], object], type[CltaaError], str]] = [
    (change(b"name", b"left"), DataError, "damaged"),
    (change(b"name", b"\xff"), DataError, "a name in the EXR header is not UTF-8"),
    (change(b"name", b"\x1b[2J"), DataError, "damaged"),
    (change(b"type", b"deepscanline"), DataError, "deep images are not read"),
    (change(b"type", b"tiledimage"), DataError, "damaged"),
    (change(b"type", b"nonsense"), DataError, "unknown type of part"),
    (change(b"chunkCount", struct.pack("<i", LARGE)), DataError, "damaged"),
    (change(b"chunkCount", struct.pack("<i", -1)), DataError, "damaged"),
    (change(b"dataWindow", window(0, 0, LARGE - 1, 0)), DataError, "impossible data window"),
    (change(b"displayWindow", window(0, 0, WIDTH - 2, HEIGHT - 2)), DataError, "do not make one picture"),
    (resized(b"dataWindow", WIDTH - 1, HEIGHT), DataError, "a part is damaged (expected 2 parts, found 1 "),
    (resized(b"dataWindow", WIDTH, HEIGHT + 1), DataError, "a part is damaged (expected 2 parts, found 1 "),
    (resized(b"displayWindow", WIDTH + 1, HEIGHT), DataError, "do not make one picture"),
    (resized(b"displayWindow", 1, 1), DataError, "do not make one picture"),
    (change(b"compression", b"\xff"), DataError, "unknown compression"),
    (change(b"channels", channel(b"G", 2, 2, 2) + b"\0"), DataError, "sub-sampled"),
    (lambda parts: parts[1].drop(b"name"), DataError, "damaged"),
    (lambda parts: parts[1].drop(b"type"), DataError, "damaged"),
    (lambda parts: parts[1].drop(b"chunkCount"), DataError, ""),
    (lambda parts: parts.extend([parts[1]] * 300), DataError, "too many parts"),
    (lambda parts: parts.clear(), DataError, "damaged"),
    (lambda parts: parts[0].add(b"film", b"keycode", bytes(28)), DataError, "OpenEXR cannot read it: "),
    (deep_of_no_count, DataError, "the file is truncated inside its table of chunks"),
    (huge, ResourceError, "does not fit into memory"),
]


def test_parts_that_cannot_be(tmp_path: Path, sound: Path) -> None:
    for row, (spoil, error, words) in enumerate(CASES):
        parts = two(sound)
        spoil(parts)
        assert words in refusal(written(tmp_path, parts), read_planes, error), row


def test_frames_of_ones_own_are_of_one_part(tmp_path: Path, sound: Path) -> None:
    """Told when they are opened, and not when one is read."""
    (tmp_path / "in").mkdir()
    written(tmp_path, two(sound)).rename(tmp_path / "in" / "parts.0000.exr")
    with pytest.raises(DataError, match="multi-part images are not read"):
        open_sequence(tmp_path / "in")


def test_where_the_colour_cannot_be_read_the_first_such_part_is_reported(tmp_path: Path, sound: Path) -> None:
    write_image(tmp_path / "depth.exr", {"Z": make_frame().depth}, {})
    parts = [as_part(sound, "beauty"), as_part(sound, "more"), as_part(tmp_path / "depth.exr", "depth")]
    parts[0].set(b"type", b"deepscanline")
    parts[1].set(b"type", b"nonsense")
    with pytest.raises(DataError, match=r"parts\.exr: deep images are not read"):
        open_input(written(tmp_path, parts))
