"""A denoiser before the resolve: what it is given, what it leaves, and what is said where it is not installed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import cltaa
from cltaa.cli import main
from cltaa.errors import DataError, UsageError
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame
from cltaa.pipeline.denoise import denoiser, guides_of
from tests.sequence_factory import make_frame


@pytest.mark.parametrize(
    ("channels", "found"),
    [
        (
            "R G B Z V.Denoising_Albedo.R V.Denoising_Albedo.G V.Denoising_Albedo.B albedo.R albedo.G albedo.B",
            {"albedo": ("V.Denoising_Albedo.R", "V.Denoising_Albedo.G", "V.Denoising_Albedo.B")},
        ),
        ("R G B N.X N.Y N.Z sh_normal.X", {"normal": ("N.X", "N.Y", "N.Z")}),
        ("R G B Column.R Column.G Column.B normal.X normal.Y", {}),
        ("R G B N.X N.Y N.Z left.N.X left.N.Y left.N.Z", {"normal": ("N.X", "N.Y", "N.Z")}),
    ],
)
def test_guides_are_found_by_their_names(channels: str, found: dict[str, tuple[str, ...]]) -> None:
    assert guides_of(channels.split()) == found


@pytest.mark.parametrize("colour", ["Trees.right.R", "Trees.Combined.right.R"])
def test_guides_are_those_of_the_colours_layer_and_view(colour: str) -> None:
    layers = [f"{layer}.Normal{view}" for layer in ("Rocks", "Trees") for view in ("", ".left", ".right")]
    channels = [f"{layer}.{axis}" for layer in layers for axis in "XYZ"]
    assert guides_of(channels, [colour]) == {"normal": tuple(f"Trees.Normal.right.{axis}" for axis in "XYZ")}


def test_a_view_with_a_picture_of_its_own_guides_no_other() -> None:
    channels = ["right.R", "right.G", "right.B", "left.R", "left.G", "left.B", "left.N.X", "left.N.Y", "left.N.Z"]
    assert guides_of(channels, ["right.R"]) == {}
    assert guides_of(channels, ["left.R"]) == {"normal": ("left.N.X", "left.N.Y", "left.N.Z")}


def test_each_frame_is_denoised_before_the_resolve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given: list[dict[str, Any]] = []

    def halve(colour: Any, *, hdr: bool, **guides: Any) -> Any:
        given.append({"hdr": hdr, **guides})
        assert np.isfinite(colour).all()
        return colour / 2

    stub = ModuleType("pyoidn")
    monkeypatch.setattr(stub, "denoise", halve, raising=False)
    monkeypatch.setitem(sys.modules, "pyoidn", stub)
    (tmp_path / "in").mkdir()
    for index in range(2):
        write_frame(tmp_path / "in" / f"a.{index:04d}.exr", make_frame(index, normal=True))
    # What is denoised is not filtered again, and has no noise.
    for name, options in (("plain", ["--set", "current_filter=none"]), ("clean", ["--denoise", "oidn"])):
        command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / name), "--device", "numpy", *options]
        assert main([*command, "--effects", "find", "--set", "weighting=none"]) == 0
    plain, clean = (read_image(tmp_path / name / "a.0000.exr")[0]["G"] for name in ("plain", "clean"))
    np.testing.assert_array_equal(clean, plain / 2)
    # What is set is kept.
    command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "filtered"), "--device", "numpy"]
    assert main([*command, "--denoise", "oidn", "--set", "current_filter=gaussian"]) == 0
    told = {name: (tmp_path / name / "resolve.json").read_text() for name in ("clean", "filtered")}
    assert ['"gaussian"' in text for text in told.values()] == [False, True]
    assert "denoised with: no albedo in the colour's file; normal N.X N.Y N.Z" in capsys.readouterr().err.splitlines()
    outcome = json.loads((tmp_path / "clean" / "resolve.json").read_text())["outcome"]
    command = ["inspect", "--plan", str(tmp_path / "in"), "--denoise", "oidn", "--effects", "find", "--device", "numpy"]
    assert main([*command, "--json"]) == 0
    for told in (outcome, json.loads(capsys.readouterr().out)):
        assert "each frame is denoised first" in [each["why"] for each in told["found"]["evidence"]]
    assert [sorted(each) for each in given] == [["hdr", "normal"]] * 4
    # What is missing stays so, and its history stands in.
    frame = make_frame(0)
    frame.colour[4, 5], frame.colour[2, 3, 1] = np.nan, 1e30
    clean_frame = denoiser("oidn")
    assert clean_frame is not None
    missing = np.isnan(clean_frame(frame, {}).colour).all(-1)
    assert np.argwhere(missing).tolist() == [[2, 3], [4, 5]]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("oidn", r"--denoise oidn needs pyoidn.*pip install 'cltaa\[denoise\]'"),
        ("optix", r"no such denoiser \(expected none, oidn, found 'optix'\)"),
    ],
)
def test_a_denoiser_that_is_not_there_is_refused_before_the_work(
    name: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(UsageError, match=line):
        cltaa.resolve(tmp_path, tmp_path / "out", denoise=name)  # of a folder without a frame


def test_a_denoiser_that_fails_names_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("out of memory")

    stub = ModuleType("pyoidn")
    monkeypatch.setattr(stub, "denoise", fail, raising=False)
    monkeypatch.setitem(sys.modules, "pyoidn", stub)
    denoise = denoiser("oidn")
    assert denoise is not None
    with pytest.raises(DataError, match="frame 7: the denoiser failed: out of memory"):
        denoise(make_frame(7), {})
