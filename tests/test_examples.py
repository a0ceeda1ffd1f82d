"""Each example runs, at a tiny size; they use public names alone and fit on a screen."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cltaa
from cltaa.opencl.cache import cache_folder
from tests.sequence_factory import write_sequence

EXAMPLES = Path(__file__).parents[1] / "examples"
MOST_LINES = 60
# Arguments that make each small, what it prints, and a package that not every machine has.
RUNS = {
    "opengl.py": (["64", "36", "4"], r"4 frames; they differ by 0\.\d*[1-9]\d* from what was drawn last\n", "moderngl"),
    "ray_caster.py": (["64", "8", "12"], r"drawn: 1\d\.\d dB\nresolved: 2\d\.\d dB\n", ""),
    "torch_loop.py": (["64", "36", "4"], r"4 frames, the last one 0\.\d*[1-9]\d* from what was drawn\n", "torch"),
    "watch_folder.py": ([], r"6 frames resolved into \S+resolved\n", ""),
}


def test_every_example_is_run() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == {*RUNS}


@pytest.mark.parametrize("name", RUNS)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    arguments, printed, package = RUNS[name]
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    assert re.fullmatch(printed, said(name, tmp_path, *arguments))


def test_a_folder_that_is_named_is_watched(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "shot", 2)
    for output, arguments in ((folder / "resolved", [folder]), (tmp_path / "out", [folder, tmp_path / "out"])):
        assert said("watch_folder.py", tmp_path, *map(str, arguments)) == f"2 frames resolved into {output}\n"


def test_a_size_without_a_count_of_frames_is_not_ignored(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="not enough values to unpack"):
        said("ray_caster.py", tmp_path, "64", "36")


def said(name: str, tmp_path: Path, *arguments: str) -> str:
    """What an example prints."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments]
    path = {"PYTHONPATH": str(EXAMPLES.parent), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "TMPDIR": str(tmp_path)}
    # Of kernels that are built already, as they are built.
    options = os.environ.get("PYOPENCL_BUILD_OPTIONS", "")
    path |= {"POCL_CACHE_DIR": str(cache_folder()), "PYOPENCL_BUILD_OPTIONS": options}
    done = subprocess.run(command, env=path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", RUNS)
def test_an_example_is_short_and_names_public_names_alone(name: str) -> None:
    code = (EXAMPLES / name).read_text(encoding="utf-8")
    assert len(code.splitlines()) <= MOST_LINES
    assert set(re.findall(r"\bcltaa\.(\w+)", code)) <= {*cltaa.__all__}
    assert "from cltaa" not in code
