"""Files that are packed here are those that OpenEXR would have written, but for how their chunks are deflated."""

from __future__ import annotations

import subprocess
import sys
import time
import zlib
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cltaa.errors import StorageError
from cltaa.io import exr_write as exr_zip
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_header import read_headers
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image

ZIPS = pytest.mark.parametrize("compression", ["zip", "zips"])


@pytest.fixture(params=["isal", "zlib"])
def packer(request: pytest.FixtureRequest) -> Any:
    if request.param == "zlib":
        return zlib
    return pytest.importorskip("isal.isal_zlib")


def planes(height: int, width: int) -> dict[str, Pixels]:
    """Numbers of every type, some that pack well and some that do not."""
    rng = np.random.default_rng(height * width)
    ramp = np.linspace(-3, 90, height * width, dtype=np.float32).reshape(height, width)
    return {
        "R": ramp,
        "b": ramp.astype(np.float16),
        "id": (ramp > 2).astype(np.uint32),
        "Noise": rng.integers(0, 2**32, (height, width), dtype=np.uint32),
        "äußere.Z": np.full_like(ramp, np.nan),
    }


def written(path: Path, channels: dict[str, Pixels], packer: Any, **more: object) -> tuple[bytes, Path]:
    """The file's header, and the file, from ``write_image`` with that packer (None: OpenEXR's)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exr_zip, "isal_zlib", packer)
        write_image(path, channels, **more)  # type: ignore[arg-type]
    content = path.read_bytes()
    *_, end = read_headers(path, BytesIO(content))
    return content[:end], path


@ZIPS
def test_only_how_chunks_are_deflated_differs(compression: str, packer: Any, tmp_path: Path) -> None:
    for height, width in [(1, 1), (16, 5), (17, 31), (50, 64), (260, 3)]:
        channels = planes(height, width)
        attributes: dict[str, object] = {"comments": "dataWindow\0box2i\0", "double": 0.1, "owner": "ä"}
        windows = ((-7, 5, width - 8, height + 4), (-9, -2, width + 8, height + 40))
        header, path = written(
            tmp_path / "a.exr", channels, packer, attributes=attributes, compression=compression, windows=windows
        )
        same, _ = written(
            tmp_path / "b.exr", channels, None, attributes=attributes, compression=compression, windows=windows
        )
        assert header == same, (height, width)
        found, told = read_image(path)
        assert found.keys() == channels.keys(), (height, width)
        for name, plane in channels.items():
            assert found[name].dtype == plane.dtype, (height, width)
            assert found[name].tobytes() == plane.tobytes(), (height, width)
        assert repr(told) == repr(read_image(tmp_path / "b.exr")[1]), (height, width)


@pytest.mark.parametrize("packs_here", [False, True])
def test_what_openexr_refuses_is_reported_in_a_line(packs_here: bool, packer: Any, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"OpenEXR could not write it: .*; check the free space"):
        written(tmp_path / "a.exr", planes(4, 5), packer if packs_here else None, attributes={"pixelAspectRatio": -1.0})
    assert not [*tmp_path.iterdir()]


def test_a_picture_without_a_window(packer: Any, tmp_path: Path) -> None:
    channels = planes(20, 9)
    assert written(tmp_path / "a.exr", channels, packer)[0] == written(tmp_path / "b.exr", channels, None)[0]


@ZIPS
def test_what_deflates_to_more_is_written_as_it_is(compression: str, packer: Any, tmp_path: Path) -> None:
    noise: dict[str, Pixels] = {"Y": np.random.default_rng(0).integers(0, 2**32, (32, 40), dtype=np.uint32)}
    header, path = written(tmp_path / "a.exr", noise, packer, compression=compression)
    chunks = 32 // exr_zip.ROWS_A_CHUNK[compression]
    assert path.stat().st_size == len(header) + chunks * (8 + 8) + noise["Y"].nbytes
    assert np.array_equal(read_image(path)[0]["Y"], noise["Y"])


def test_without_the_packer_openexr_packs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr_zip, "isal_zlib", None)
    write_image(tmp_path / "a.exr", planes(20, 9))
    assert read_image(tmp_path / "a.exr")[0]["R"].shape == (20, 9)


def test_a_failure_to_pack_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> bytes:
        raise MemoryError

    monkeypatch.setattr(exr_zip, "isal_zlib", SimpleNamespace(compress=fails))
    with pytest.raises(MemoryError):
        write_image(tmp_path / "a.exr", planes(50, 9))
    assert list(tmp_path.iterdir()) == []


def test_packed_rows_wait_in_bounded_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr_zip, "BEGUN", 4)
    begun: list[int] = []

    def pack(row: int) -> exr_zip.Packed:
        begun.append(row)
        return exr_zip.Packed([1], bytes([row]))

    packed = exr_zip._in_threads(pack, range(50))
    for row in range(50):
        assert next(packed).content == bytes([row])
        time.sleep(0.002)
        assert len(begun) <= row + 4
    assert list(packed) == []


FORKS = """
import os, sys, threading
import numpy as np
from pathlib import Path
from cltaa.io.exr_write import write_image
folder, planes = Path(sys.argv[1]), {"R": np.zeros((40, 30), np.float32)}
write_image(folder / "before.exr", planes)
child = os.fork()
if not child:
    write_image(folder / "in fork.exr", planes)
    os._exit(0)
threading.Timer(20.0, os.kill, (child, 9)).start()
os._exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0)
"""


def test_a_fork_of_a_program_packs_with_threads_of_its_own(tmp_path: Path) -> None:
    """It has none of its parent's, so that a file would wait for them for ever."""
    subprocess.run([sys.executable, "-W", "ignore", "-c", FORKS, str(tmp_path)], check=True)
    assert (tmp_path / "in fork.exr").read_bytes() == (tmp_path / "before.exr").read_bytes()


AT_THE_END = """
import atexit, sys
from pathlib import Path
import numpy as np
from cltaa.io.exr_write import write_image
picture = np.arange(20_000, dtype=np.float32).reshape(200, 100)
atexit.register(write_image, Path(sys.argv[1]), {"Y": picture})  # called when threads take no more work
"""


def test_an_ending_program_packs_without_threads(tmp_path: Path) -> None:
    path = tmp_path / "last.exr"
    subprocess.run([sys.executable, "-c", AT_THE_END, str(path)], check=True, cwd=Path(__file__).parents[2])
    assert np.array_equal(read_image(path)[0]["Y"], np.arange(20_000, dtype=np.float32).reshape(200, 100))
