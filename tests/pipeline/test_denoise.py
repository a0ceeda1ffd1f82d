"""A denoiser before the resolve: what it is given, what it leaves, and what is said where it is not installed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cltaa
from cltaa.cli import main
from cltaa.core.presets import load_preset, override
from cltaa.errors import DataError, UsageError
from cltaa.frame import Effect
from cltaa.io.denoiser_guides import guides_of
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.lab.inspect.plan import plan
from cltaa.pipeline.denoise import denoiser
from cltaa.pipeline.folder import DENOISED, DENOISED_RING, for_denoised
from tests.sequence_factory import make_frame, write_frames


def install(monkeypatch: pytest.MonkeyPatch, denoise: Callable[..., Any]) -> None:
    """Let ``denoise`` stand for the denoiser's own."""
    monkeypatch.setitem(sys.modules, "pyoidn", SimpleNamespace(denoise=denoise))


def denoised(tmp_path: Path, *options: str) -> list[str]:
    """The command that denoises and resolves ``in`` into ``out``."""
    places = [str(tmp_path / "in"), "-o", str(tmp_path / "out")]
    return ["resolve", *places, "--device", "numpy", "--denoise", "oidn", *options]


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

    install(monkeypatch, halve)
    write_frames(tmp_path / "in", (make_frame(index, normal=True) for index in range(2)), "a")
    # What is denoised is not filtered again, needs less evidence of changing light, and has no noise.
    as_denoised = [part for key, value in DENOISED.items() for part in ("--set", f"{key}={value}")]
    assert {*DENOISED} >= {"current_filter", "illumination_t"}
    for name, options in (("plain", as_denoised), ("clean", ["--denoise", "oidn"])):
        command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / name), "--device", "numpy", *options]
        assert main([*command, "--effects", "find", "--set", "weighting=none"]) == 0
    plain, clean = (read_image(tmp_path / name / "a.0000.exr")[0]["G"] for name in ("plain", "clean"))
    np.testing.assert_array_equal(clean, plain / 2)
    # What is set is kept.
    command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "filtered"), "--device", "numpy"]
    assert main([*command, "--denoise", "oidn", "--set", "current_filter=gaussian"]) == 0
    told = {name: (tmp_path / name / "resolve.json").read_text() for name in ("clean", "filtered")}
    assert ['"gaussian"' in text for text in told.values()] == [False, True]
    assert "denoised with: no albedo; normal N.X N.Y N.Z" in capsys.readouterr().err.splitlines()
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


def test_denoised_frames_have_no_noise_where_it_is_declared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else thresholds for noise and those for denoised frames would be multiplied."""
    install(monkeypatch, lambda colour, **_: colour)
    declared = frozenset({Effect.ILLUMINATION, Effect.NOISE})
    clean = denoiser("oidn")
    assert clean is not None
    assert clean(replace(make_frame(0), effects=declared), {}).effects == frozenset({Effect.ILLUMINATION})
    assert clean(replace(make_frame(0), effects=None), {}).effects is None
    write_frames(tmp_path, (make_frame(index) for index in range(2)), "a")
    plans = [
        plan(cltaa.open(tmp_path), "default", effects=effects, denoise="oidn", device="numpy", rounds=0)
        for effects in (declared, frozenset({Effect.ILLUMINATION}))
    ]
    assert plans[0].sections == plans[1].sections


PASSES = {"beauty": "RGB", "albedo": "RGB", "normal": "XYZ"}


def write_passes(folder: Path, name: str, count: int) -> None:
    """A file of 8 x 6 pixels for each pass and frame, of one value each; ``name`` is that of a pass's files."""
    for at, (part, axes) in enumerate(PASSES.items()):
        for number in range(count):
            path = folder / f"{name.format(part)}.{number:04d}.exr"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_image(path, {axis: np.full((6, 8), (at + 1) / 4, np.float32) for axis in axes})


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The guides that a denoiser, which does nothing, was given with each frame."""
    given: list[dict[str, Any]] = []

    def look(colour: Any, *, hdr: bool, **guides: Any) -> Any:
        del hdr
        given.append(guides)
        return colour.copy()

    install(monkeypatch, look)
    return given


@pytest.mark.parametrize("name", ["{}", "{}/x", "passes/{}", "shot_{}"])
def test_guides_are_found_in_files_beside_the_colour(
    name: str, tmp_path: Path, seen: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    write_passes(tmp_path / "in", name, 2)
    assert main(denoised(tmp_path)) == 0
    assert [{role: (image.shape, image.flat[0]) for role, image in each.items()} for each in seen] == [
        {"albedo": ((6, 8, 3), 0.5), "normal": ((6, 8, 3), 0.75)}
    ] * 2
    assert "denoised with: albedo " in capsys.readouterr().err


@pytest.mark.parametrize("jobs", [[], ["--jobs", "2", "--preset", "gather-8"], ["--follow", "--idle", "0.1"]])
def test_changed_guide_files_refuse_to_resume(
    jobs: list[str], tmp_path: Path, seen: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    write_passes(tmp_path / "in", "{}", 3)
    assert main(denoised(tmp_path, *jobs)) == 0
    assert {*map(len, seen)} == {2}
    assert len({path.name for path in (tmp_path / "out").glob("*.exr")}) == 3
    write_image(tmp_path / "in" / "albedo.0001.exr", dict.fromkeys("RGB", np.zeros((6, 8), np.float32)))
    assert main(denoised(tmp_path, *jobs)) != 0
    assert "its other files, matrices, jitter or exposure are not those" in capsys.readouterr().err


def test_guides_that_a_frame_lacks_guide_none(
    tmp_path: Path, seen: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    """No file, no channel, whole numbers, another picture: the line says what, and the other guide stays."""
    write_passes(tmp_path / "in", "{}", 3)
    normal, albedo = (tmp_path / "in" / f"{name}.0002.exr" for name in ("normal", "albedo"))
    grey = np.zeros((6, 8), np.float32)
    breaks: list[tuple[Callable[[], object], str]] = [
        (lambda: write_image(normal, {"Y": grey}), "channel is missing"),
        (lambda: write_image(normal, dict.fromkeys("XYZ", grey.astype(np.uint32))), "wrong channel type"),
        (lambda: write_image(normal, dict.fromkeys("XYZ", grey[:3])), "shows another picture than the colour"),
        (lambda: normal.unlink(), "the frame is missing"),
    ]
    for broken, told in breaks:
        broken()
        seen.clear()
        assert main(denoised(tmp_path, "--restart")) == 0
        assert f"no normal ({normal}: {told})" in capsys.readouterr().err
        assert [sorted(each) for each in seen] == [["albedo"]] * 3
    albedo.unlink()
    assert main(denoised(tmp_path, "--restart")) == 0
    assert {*map(len, seen[3:])} == {0}


@pytest.mark.parametrize("view", ["left", "right"])
def test_guides_in_files_beside_are_those_of_the_colours_view(
    view: str, tmp_path: Path, seen: list[dict[str, Any]]
) -> None:
    values = {"": 0.2, "right.": 0.8}
    (tmp_path / "in").mkdir()
    for name in ("beauty", "albedo"):
        planes = {f"{layer}{c}": np.full((6, 8), at, np.float32) for layer, at in values.items() for c in "RGB"}
        write_image(tmp_path / "in" / f"{name}.0001.exr", planes, {"multiView": ["left", "right"]})
    assert main(denoised(tmp_path, "--input", f"colour.view={view}")) == 0
    assert seen[0]["albedo"].flat[0] == np.float32(values["" if view == "left" else "right."])


@pytest.mark.parametrize(("place", "value"), [("left", 0.1), ("right", 0.6)])
def test_guides_and_depth_come_from_the_colours_folder(
    place: str, value: float, tmp_path: Path, seen: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Where names are alike in two folders, each is called by both, and the option that is told works."""
    for folder, level in (("left", 0.1), ("right", 0.6)):
        (tmp_path / "in" / folder).mkdir(parents=True)
        for name, axes in (("beauty", "RGB"), ("albedo", "RGB"), ("depth", "Z")):
            planes = {axis: np.full((6, 8), level, np.float32) for axis in axes}
            write_image(tmp_path / "in" / folder / f"{name}.0001.exr", planes)
    assert main(denoised(tmp_path)) != 0
    option = "colour.channels='left.beauty.R left.beauty.G left.beauty.B'"
    assert f"--input {option}" in capsys.readouterr().err
    assert main(denoised(tmp_path, "--input", option.replace("left", place).replace("'", ""))) == 0
    assert seen[0]["albedo"].flat[0] == np.float32(value)
    assert f"depth {place}.depth.Z" in capsys.readouterr().err


def test_what_guides_is_all_that_is_read_for_it(
    tmp_path: Path, seen: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    from cltaa.io import exr_read

    write_passes(tmp_path / "in", "{}", 1)
    opened, loaded = list[str](), exr_read.loaded_parts

    def counted(path: Path, *given: Any, **named: Any) -> Any:
        opened.append(path.name)
        return loaded(path, *given, **named)

    monkeypatch.setattr(exr_read, "loaded_parts", counted)
    assert main(denoised(tmp_path, "--effects", "all")) == 0
    assert sorted(opened) == ["albedo.0000.exr", "beauty.0000.exr", "normal.0000.exr"]
    assert len(seen) == 1


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


@pytest.mark.parametrize(
    ("name", "adapted"),
    [
        ("default", DENOISED),
        ("accumulate", DENOISED),
        ("fast", DENOISED | {"illumination": "test"}),
        ("gather-8", DENOISED_RING),
        ("karis", {}),
    ],
)
def test_a_preset_is_adapted_to_what_a_denoiser_has_filtered(name: str, adapted: dict[str, object]) -> None:
    preset = load_preset(name)
    assert for_denoised(preset) == override(preset, adapted)


def test_a_denoiser_that_fails_names_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("out of memory")

    install(monkeypatch, fail)
    denoise = denoiser("oidn")
    assert denoise is not None
    with pytest.raises(DataError, match="frame 7: the denoiser failed: out of memory"):
        denoise(make_frame(7), {})
