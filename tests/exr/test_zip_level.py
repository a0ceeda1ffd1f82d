"""OpenEXR packs ZIP at the level that was asked for, and the level changes no pixel."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.exr.read import read_image
from cltaa.exr.write import write_image
from cltaa.exr.zip_level import FASTEST, OPENEXRS_OWN, TIGHTEST, set_zip_level


@pytest.fixture(autouse=True)
def openexr_packs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As where there is no other packer; and the level of every other test afterwards."""
    monkeypatch.setattr("cltaa.exr.write.fast_deflate", lambda: None)
    yield
    set_zip_level(FASTEST)


def size_at(level: int, folder: Path) -> int:
    wave = np.sin(np.mgrid[0:128, 0:128].sum(axis=0) / np.float32(9)).astype(np.float32)
    path = folder / f"{level}.exr"
    assert set_zip_level(level)
    write_image(path, {"Y": wave})
    assert np.array_equal(read_image(path)[0]["Y"], wave)
    return path.stat().st_size


def test_a_level_is_heeded_and_changes_no_pixel(tmp_path: Path) -> None:
    fastest, own, tightest = (size_at(level, tmp_path) for level in (FASTEST, OPENEXRS_OWN, TIGHTEST))
    assert tightest <= own < fastest


def test_openexr_packs_at_the_fastest_level(tmp_path: Path) -> None:
    fastest = size_at(FASTEST, tmp_path)
    code = (
        "import sys; from pathlib import Path; from cltaa.exr import read as exr_read, write as exr_write; "
        "a, b = map(Path, sys.argv[1:]); "
    )
    code += "exr_write.fast_deflate = lambda: None; "
    code += "exr_write.write_image(b, exr_read.read_image(a)[0])"
    again = tmp_path / "again.exr"
    subprocess.run([sys.executable, "-c", code, tmp_path / f"{FASTEST}.exr", again], check=True)
    assert again.stat().st_size == fastest


def test_a_build_without_the_function_keeps_its_own_level(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(OpenEXR, "OPENEXR_VERSION", "99.0.0")
    assert not set_zip_level(FASTEST)


@pytest.mark.parametrize("level", [0, 10])
def test_no_such_level(level: int) -> None:
    with pytest.raises(ValueError, match="level must be from 1 to 9"):
        set_zip_level(level)
