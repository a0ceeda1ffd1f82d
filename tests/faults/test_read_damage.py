"""Damaged files: cut off at every byte, and thousands with random bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.io.exr_read import read_header
from cltaa.io.exr_write import write_frame
from tests.faults import reading_process
from tests.sequence_factory import make_frame, read_frame


def smooth_frame(width: int, height: int) -> Frame:
    """A frame that compresses, so that ZIP stores no chunk raw, without its checksum."""
    frame = make_frame(width=width, height=height)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    frame.colour[...] = np.floor(4 * np.sin(x / 9) * np.cos(y / 7) + 4)[..., None]
    frame.depth[...] = np.floor(x / 4) + 1
    return frame


OTHER_CHANNELS = (("motion", "alpha"), ("object_id", "normal", "reactive"))


def with_channels(width: int, height: int, channels: tuple[str, ...]) -> Frame:
    return make_frame(width=width, height=height, **dict.fromkeys(channels, True))  # type: ignore[arg-type]


COMPRESSIONS = pytest.mark.parametrize("compression", ["zip", "zips", "none", "piz"])
CHANNELS = pytest.mark.parametrize(
    "channels", [(), *(pytest.param(names, marks=pytest.mark.big) for names in OTHER_CHANNELS)], ids="-".join
)


@CHANNELS
@COMPRESSIONS
def test_cut_off_at_every_byte(
    tmp_path: Path, compression: str, channels: tuple[str, ...], capfd: pytest.CaptureFixture[str]
) -> None:
    """No cut is read, and OpenEXR's own words never reach the terminal."""
    path = tmp_path / "a.exr"
    write_frame(path, with_channels(5, 17, channels), compression=compression)
    stride = 1 if channels or compression == "zip" else 7  # of the others only the chunks are other bytes
    for length in reversed(range(0, path.stat().st_size, stride)):
        os.truncate(path, length)
        with pytest.raises(DataError, match=r"a\.exr: .*(truncated|cut off|empty|not an EXR)"):
            read_frame(path)
    assert capfd.readouterr() == ("", "")


@CHANNELS
@COMPRESSIONS
def test_larger_file_cut_off(tmp_path: Path, compression: str, channels: tuple[str, ...]) -> None:
    path = tmp_path / "a.exr"
    write_frame(path, with_channels(64, 52, channels), compression=compression)
    size = path.stat().st_size
    assert size > 40_000
    for length in np.linspace(size - 1, 0, 300).astype(int):
        os.truncate(path, length)
        for read in (read_frame, read_header):
            with pytest.raises(DataError, match=r"a\.exr"):
                read(path)


def read_damaged(folder: Path, compression: str, count: int, stride: int) -> Counter[str]:
    """Read every ``stride``-th of ``count`` damaged copies in a process of its own; count what came of them."""
    path = folder / "sound.exr"
    write_frame(path, smooth_frame(48, 32), compression=compression)
    totals: Counter[str] = Counter()
    first = 0
    while first < count:
        job = {"path": str(path), "seed": 11, "numbers": [first, count, stride]}
        command = [sys.executable, reading_process.__file__]
        child = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True, check=False)
        lines = child.stdout.splitlines()
        if child.returncode == 0:
            answer = json.loads(lines[-1])
            assert answer["peak"] < 2 * answer["usual"], "memory"
            return totals + Counter(answer["counts"])
        hung = child.returncode == -signal.SIGPROF or "Timeout" in child.stderr
        totals["hangs" if hung else "crashes"] += 1
        first = int(lines[-1]) + stride
    return totals


@pytest.mark.parametrize(("count", "stride"), [(8000, 10), pytest.param(336_000, 1, marks=pytest.mark.big)])
@pytest.mark.parametrize("compression", ["zip", "piz", "none"])
def test_damaged_files(tmp_path: Path, compression: str, count: int, stride: int) -> None:
    """Every tenth of the ways of ``reading_process.damage``, or each: windows along the whole file, its first bytes."""
    counts, tries = read_damaged(tmp_path, compression, count, stride), count // stride
    print(compression, dict(counts))
    assert counts["crashes"] == counts["hangs"] == 0
    # With a recorded hash nothing passes, in whatever way it was damaged.
    assert counts["passed its hash"] == 0
    assert counts["stopped by its hash"] == tries - counts["not damaged"] > 0.99 * tries
    # Without one, ZIP has a sum for each chunk; PIZ has none, and uncompressed pixels have nothing to check. The sum is
    # Adler-32, for which bytes one more and one less in turn cancel out, as in the smooth picture: one of 8,000 seen.
    # What ISA-L writes depends on the processor, so elsewhere other files pass; without the sum half of all would.
    if compression == "zip":
        assert counts["other pixels"] <= tries // 100
