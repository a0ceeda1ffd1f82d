"""Header bombs: each refused by name, at once, with little memory, by a process that survives."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cltaa.io.exr_layout import COMPRESSIONS
from cltaa.io.exr_write import write_frame
from tests.faults import reading_process
from tests.faults.exr_surgery import VERSION, Anatomy, channel, dissect, window
from tests.faults.runs import PATIENCE
from tests.sequence_factory import HEIGHT, WIDTH, make_frame

LONGEST = 1.0  # seconds of processor time for one file
MOST_MEMORY = 200_000  # kB that the process ever holds, Python, NumPy and OpenEXR included
LARGE = 2**31 - 1
TILED, DEEP, MULTI_PART = 1 << 9, 1 << 11, 1 << 12
CODECS = {"none": 0, "rle": 1, "zips": 2, "zip": 3, "piz": 4, "htj2k256": 10}
ROWS = {"none": 1, "rle": 1, "zips": 1, "zip": 16, "piz": 32, "htj2k256": 256}

Change = Callable[[Anatomy], object]


def sized(left: int, top: int, right: int, bottom: int, *, only: bytes | None = None) -> Change:
    def change(file: Anatomy) -> None:
        for name in (b"dataWindow", b"displayWindow") if only is None else (only,):
            file.set(name, window(left, top, right, bottom))

    return change


def moved(x: int, y: int) -> Change:
    def change(file: Anatomy) -> None:
        sized(x, y, x + WIDTH - 1, y + HEIGHT - 1)(file)
        file.chunks = [struct.pack("<i", struct.unpack_from("<i", c)[0] + y) + c[4:] for c in file.chunks]

    return change


def largest_picture(codec: str, chunk: int = 64) -> Change:
    """16384 x 16384 pixels, all its chunks there, each of a few bytes."""

    def change(file: Anatomy) -> None:
        sized(0, 0, 16383, 16383)(file)
        file.set(b"compression", bytes([CODECS[codec]]))
        rows = range(0, 16384, ROWS[codec])
        file.chunks = [struct.pack("<ii", row, chunk) + bytes(chunk) for row in rows]

    return change


def channels(*entries: bytes) -> Change:
    return lambda file: file.set(b"channels", b"".join([*entries, b"\0"]))


def flags(bits: int) -> Change:
    return lambda file: setattr(file, "version", VERSION | bits)


def many(*changes: Change) -> Change:
    return lambda file: [change(file) for change in changes]


def added(name: bytes, kind: bytes, value: bytes, size: int | None = None) -> Change:
    def change(file: Anatomy) -> None:
        file.add(name, kind, value)
        if size is not None:
            file.sizes[name] = size

    return change


def put(name: bytes, value: bytes, kind: bytes | None = None) -> Change:
    return lambda file: file.set(name, value, kind)


def dropped(name: bytes) -> Change:
    return lambda file: file.drop(name)


def tiles(width: int, height: int, mode: int = 0) -> Change:
    return many(flags(TILED), added(b"tiles", b"tiledesc", struct.pack("<IIB", width, height, mode)))


def table(*offsets: int) -> Change:
    return lambda file: setattr(file, "table", list(offsets))


def first_chunk_says(size: int) -> Change:
    def change(file: Anatomy) -> None:
        file.chunks[0] = file.chunks[0][:4] + struct.pack("<i", size) + file.chunks[0][8:]

    return change


RGBZ = tuple(channel(name) for name in (b"B", b"G", b"R", b"Z"))
WRONG, SIZE, CHUNKS = (
    "header is damaged or cut off; write the file again",
    "impossible data window",
    "truncated or was never finished",
)

# name -> change, exit code, and words of the message; code 0 is a file that is unusual and sound
CASES: dict[str, tuple[Change, int, str]] = {
    "width 2^31 - 1": (sized(0, 0, LARGE - 1, HEIGHT - 1), 65, SIZE),
    "height 2^31 - 1": (sized(0, 0, WIDTH - 1, LARGE - 1), 65, SIZE),
    "one column 2^30 tall": (sized(0, 0, 0, 2**30), 65, SIZE),
    "65536 squared": (sized(0, 0, 65535, 65535), 65, f"{SIZE} (expected 1 to 16384 pixels a side, found 65536 x 65536"),
    "one column too many": (sized(0, 0, 16384, HEIGHT - 1), 65, SIZE),
    "the whole plane": (sized(-LARGE - 1, -LARGE - 1, LARGE, LARGE), 65, SIZE),
    "inverted in x": (sized(WIDTH, 0, 0, HEIGHT - 1), 65, SIZE),
    "inverted in y": (sized(0, HEIGHT, WIDTH - 1, 0), 65, SIZE),
    "of no pixel": (sized(0, 0, -1, -1), 65, SIZE),
    "display window inverted": (sized(5, 5, 0, 0, only=b"displayWindow"), 65, "impossible display window"),
    "display window larger": (sized(0, 0, WIDTH, HEIGHT, only=b"displayWindow"), 0, ""),
    "data window that reaches over it": (sized(9, 0, WIDTH + 8, HEIGHT - 1, only=b"dataWindow"), 0, ""),
    "data window beside it": (
        sized(WIDTH, 0, 2 * WIDTH - 1, HEIGHT - 1, only=b"dataWindow"),
        65,
        "outside of the display window",
    ),
    "data window before it": (sized(-WIDTH, 0, -1, HEIGHT - 1, only=b"dataWindow"), 65, "outside of the display"),
    "data window above it": (sized(0, -HEIGHT, WIDTH - 1, -1, only=b"dataWindow"), 65, "outside of the display"),
    "data window below it": (
        sized(0, HEIGHT, WIDTH - 1, 2 * HEIGHT - 1, only=b"dataWindow"),
        65,
        "outside of the display window",
    ),
    "far from the origin": (sized(LARGE - 9, LARGE - 9, LARGE, LARGE), 65, ""),
    "largest, table missing": (sized(0, 0, 16383, 16383), 65, "the file is truncated"),
    "largest, none": (largest_picture("none"), 65, "too small for its pixels"),
    "largest, rle": (largest_picture("rle"), 65, "too small for its pixels"),
    "largest, zips": (largest_picture("zips"), 65, "too small for its pixels"),
    "largest, zip": (largest_picture("zip"), 65, "too small for its pixels"),
    "largest, piz": (largest_picture("piz"), 65, "the pixels are damaged; write the file again"),
    "largest, htj2k": (largest_picture("htj2k256"), 65, "the pixels are damaged"),
    "a million channels": (channels(*(channel(b"c%d" % n) for n in range(10**6))), 65, WRONG),
    "1025 channels": (channels(*RGBZ, *(channel(b"c%d" % n) for n in range(1021))), 65, "too many channels"),
    "1.1 TB of pixels": (
        many(largest_picture("piz"), channels(*RGBZ, *(channel(b"c%d" % n) for n in range(1020)))),
        75,
        "does not fit into memory (expected at most",
    ),
    "no channels": (channels(), 65, "channel R: channel is missing"),
    "channel list without end": (put(b"channels", b"".join(RGBZ)), 65, WRONG),
    "channel list of nothing": (put(b"channels", b""), 65, WRONG),
    "channel twice": (channels(*RGBZ, channel(b"Z")), 65, WRONG),
    "channel of no name": (channels(*RGBZ[:3], b"\0" + RGBZ[3]), 65, ""),
    "channel name of 1 MB": (channels(*RGBZ, channel(b"c" * 2**20)), 65, WRONG),
    "channel name not UTF-8": (
        channels(*RGBZ, channel(b"\xff\xfe")),
        65,
        r"a name in the EXR header is not UTF-8 (found '\xff\xfe'); ren",
    ),
    "channel name clears the screen": (channels(*RGBZ, channel(b"\x1b[2J")), 65, WRONG),
    "pixel type 3": (channels(*RGBZ[:3], channel(b"Z", 3)), 65, WRONG),
    "pixel type -1": (channels(*RGBZ[:3], channel(b"Z", -1)), 65, WRONG),
    "sub-sampled": (channels(RGBZ[0], channel(b"G", 2, 2, 2), *RGBZ[2:]), 65, "channel G: sub-sampled"),
    "sampled never": (channels(RGBZ[0], channel(b"G", 2, 0, 0), *RGBZ[2:]), 65, "channel G: sub-sampled"),
    "sampled backwards": (channels(RGBZ[0], channel(b"G", 2, -1, -1), *RGBZ[2:]), 65, "channel G: sub-sampled"),
    "attribute name of 17 MB": (added(b"n" * (17 << 20), b"int", bytes(4)), 65, WRONG),
    "attribute name of 256 bytes": (added(b"n" * 256, b"int", bytes(4)), 65, WRONG),
    "attribute name rings": (added(b"\x07", b"int", bytes(4)), 65, WRONG),
    "attribute name not UTF-8": (added(b"\xc3\x28", b"int", bytes(4)), 65, "rename the channel, part or attribute"),
    "attribute of 2^31 - 1 bytes": (added(b"note", b"string", b"short", LARGE), 65, WRONG),
    "attribute of -1 bytes": (added(b"note", b"string", b"short", -1), 65, WRONG),
    "attribute of 17 MB": (added(b"note", b"string", bytes(17 << 20)), 65, WRONG),
    "attribute of 1 MB": (added(b"note", b"string", b"a" * (1 << 20)), 0, ""),
    "5000 attributes": (many(*(added(b"n%d" % n, b"int", bytes(4)) for n in range(5000))), 65, "too many attributes"),
    "data window twice": (added(b"dataWindow", b"box2i", window(0, 0, 65535, 65535)), 65, WRONG),
    "camera twice": (added(b"cltaa:jitterPx", b"v2d", bytes(16)), 65, WRONG),
    "preview of 2^31 squared": (added(b"preview", b"preview", struct.pack("<II", LARGE, LARGE) + bytes(8)), 65, ""),
    "string of 2^31 in a list": (added(b"list", b"stringvector", struct.pack("<i", LARGE) + b"ab"), 65, ""),
    "no channel list": (dropped(b"channels"), 65, WRONG),
    "no compression": (dropped(b"compression"), 65, WRONG),
    "no data window": (dropped(b"dataWindow"), 65, WRONG),
    "no display window": (dropped(b"displayWindow"), 65, WRONG),
    "no line order": (dropped(b"lineOrder"), 0, ""),
    "compression after the last": (put(b"compression", bytes([len(COMPRESSIONS)])), 65, "compression (found 14)"),
    "compression 255": (put(b"compression", b"\xff"), 65, "unknown compression"),
    "compression of no byte": (put(b"compression", b""), 65, WRONG),
    "compression is text": (put(b"compression", b"\x03", b"string"), 0, ""),
    "windows of shorts": (put(b"dataWindow", bytes(8)), 65, WRONG),
    "line order 200": (put(b"lineOrder", b"\xc8"), 0, ""),
    "type says deep": (added(b"type", b"string", b"deepscanline"), 65, ""),
    "deep": (flags(DEEP), 65, "deep images are not read; write a flat EXR"),
    "multi-part of one image": (flags(MULTI_PART), 65, WRONG),
    "version 1": (lambda file: setattr(file, "version", 1), 65, ""),
    "flags from the future": (flags(1 << 30), 65, ""),
    "tiled without tiles": (flags(TILED), 65, WRONG),
    "tiles of no size": (tiles(0, 0), 65, WRONG),
    "tiles of 2^32": (tiles(2**32 - 1, 2**32 - 1), 65, WRONG),
    "mip maps without them": (tiles(16, 16, 1), 65, "images are not read; write one level, in tiles or scan lines"),
    "rip maps without them": (tiles(16, 16, 2), 65, "mip-mapped images are not read"),
    "another kind of levels": (tiles(16, 16, 3), 65, WRONG),
    "a quarter of a milliard tiles": (many(sized(0, 0, 16383, 16383), tiles(1, 1)), 65, "the file is truncated"),
    "chunks at 2^64": (table(2**64 - 1, 2**64 - 1), 65, CHUNKS),
    "chunks in the header": (table(8, 8), 65, CHUNKS),
    "chunks at nought": (table(0, 0), 65, CHUNKS),
    "chunk of -1 bytes": (first_chunk_says(-1), 65, CHUNKS),
    "chunk of 2^31 bytes": (first_chunk_says(LARGE), 65, CHUNKS),
    "origin below nought": (moved(-7, -5), 0, ""),
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Read every bomb in one process; that it answers each of them shows that none has killed it."""
    folder = tmp_path_factory.mktemp("bombs")
    sound = folder / "sound.exr"
    write_frame(sound, make_frame())
    jobs = []
    for number, (change, _, _) in enumerate(CASES.values()):
        file = dissect(sound)
        change(file)
        path = folder / f"{number}.exr"
        path.write_bytes(file.assembled())
        jobs.append(json.dumps({"path": str(path)}))
    jobs.append(json.dumps({"path": str(sound)}))
    child = subprocess.run(
        [sys.executable, reading_process.__file__],
        input="\n".join(jobs),
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert child.returncode == 0, child.stderr
    replies = [json.loads(line) for line in child.stdout.splitlines()]
    return dict(zip([*CASES, "sound"], replies, strict=True))


def test_surgery_without_a_change_gives_the_same_file(tmp_path: Path) -> None:
    write_frame(tmp_path / "a.exr", make_frame())
    assert dissect(tmp_path / "a.exr").assembled() == (tmp_path / "a.exr").read_bytes()


def test_bombs(answers: dict[str, dict[str, Any]]) -> None:
    for number, (name, (_, code, words)) in enumerate(CASES.items()):
        answer, told = answers[name], f"{name}: {answers[name]}"
        assert answer["code"] == code, told
        assert words in answer["message"], told
        if code == 0:
            assert answer["pixels"] == answers["sound"]["pixels"], told
        else:
            assert f"{number}.exr" in answer["message"], told
        assert answer["seconds"] < LONGEST, told
        assert answer["peak"] < MOST_MEMORY, told
        assert len(answer["message"]) < 500, told


def test_sparse_file_of_a_terabyte_is_not_read(tmp_path: Path) -> None:
    """A file can say that it is larger than any memory and take no room on the disk."""
    path = tmp_path / "a.exr"
    write_frame(path, make_frame())
    os.truncate(path, 1 << 40)
    job = json.dumps({"path": str(path)})
    child = subprocess.run(
        [sys.executable, reading_process.__file__], input=job, capture_output=True, text=True, check=True
    )
    answer = json.loads(child.stdout)
    assert (answer["code"], "does not fit into memory" in answer["message"]) == (75, True)
    assert answer["peak"] < MOST_MEMORY
