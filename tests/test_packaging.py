"""The wheel and the sdist: what is in them, and that the kernels are found where each puts them."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cltaa import __version__

TOP = Path(__file__).parents[1]


def build(source: Path, target: str, folder: Path) -> Path:
    """Build one distribution with the back end of pyproject.toml and return its path."""
    command = [sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(TOP, "wheel", tmp_path_factory.mktemp("wheel"))


def members(wheel: Path) -> set[str]:
    return {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def tracked(folder: str) -> set[str]:
    done = subprocess.run(["git", "ls-files", folder], cwd=TOP, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines())


@pytest.mark.skipif(not (TOP / ".git").exists(), reason="compares with git's list of files; this is no clone")
def test_the_wheel_holds_every_file_of_the_packages_and_the_kernels(wheel: Path) -> None:
    expected = tracked("cltaa") | {f"cltaa/{name}" for name in tracked("kernels")}
    expected |= {name.removeprefix("capture/") for name in tracked("capture/cltaa_capture")}
    expected |= {name.removeprefix("datasets_gen/") for name in tracked("datasets_gen/cltaa_datasets")}
    assert expected - members(wheel) == set()


def test_the_wheel_holds_the_three_packages_and_nothing_else(wheel: Path) -> None:
    assert {name.split("/")[0] for name in members(wheel)} == {"cltaa", "cltaa_capture", "cltaa_datasets"}


def test_the_wheel_carries_the_version_of_the_code(wheel: Path) -> None:
    assert wheel.name.startswith(f"cltaa-{__version__}-")


def test_the_sdist_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    sdist = build(TOP, "sdist", tmp_path / "sdist")
    subprocess.run(["tar", "-xf", str(sdist), "-C", str(tmp_path)], check=True)
    source = tmp_path / sdist.name.removesuffix(".tar.gz")
    assert members(build(source, "wheel", tmp_path / "wheel")) == members(wheel)


@pytest.mark.parametrize("place", ["wheel", "checkout"])
def test_the_kernels_are_found(place: str, wheel: Path, tmp_path: Path) -> None:
    if place == "wheel":
        zipfile.ZipFile(wheel).extractall(tmp_path)
    package, kernels = (tmp_path, tmp_path / "cltaa/kernels") if place == "wheel" else (TOP, TOP / "kernels")
    code = "from cltaa.core import build; print(build.__file__); print(build.kernel_folder())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == [str(package / "cltaa/core/build.py"), str(kernels)]
