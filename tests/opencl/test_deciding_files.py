"""One number for what decides a result beside preset and device: it changes with that, and with nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from cltaa.core import build
from cltaa.core.constants import CONSTANTS


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the kernels, which takes their place."""
    copy = tmp_path / "kernels"
    shutil.copytree(build.kernel_folder(), copy)
    monkeypatch.setattr(build, "kernel_folder", lambda: copy)
    return copy


def number() -> str:
    return build.code_sha256.__wrapped__()


def test_kernels_are_found_where_a_link_leads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cltaa").symlink_to(Path(build.__file__).parents[1])
    monkeypatch.setattr(build, "__file__", str(tmp_path / "cltaa" / "core" / "build.py"))
    assert build.kernel_folder.__wrapped__() == build.kernel_folder()


def test_it_does_not_depend_on_where_the_kernels_lie(kernels: Path) -> None:
    assert kernels.is_dir()
    assert number() == build.code_sha256()


@pytest.mark.parametrize("pattern", ["*.cl", "*.h"])
def test_every_kernel_and_header_counts(pattern: str, kernels: Path) -> None:
    files, numbers = sorted(kernels.rglob(pattern)), {number()}
    assert files
    for file in files:
        file.write_text(file.read_text() + "\n")
        numbers.add(number())
    files[0].rename(files[0].with_name(f"other_{files[0].name}"))
    assert len(numbers | {number()}) == 1 + len(files) + 1


def test_constants_and_the_format_count(monkeypatch: pytest.MonkeyPatch) -> None:
    before = number()
    monkeypatch.setattr(build, "FORMAT", build.FORMAT + 1)
    after = number()
    monkeypatch.setitem(CONSTANTS, "TINY", CONSTANTS["TINY"]._replace(value=0.0))
    assert len({before, after, number()}) == 3


def test_words_about_a_constant_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    before = number()
    monkeypatch.setitem(CONSTANTS, "TINY", CONSTANTS["TINY"]._replace(source="other words"))
    assert number() == before
