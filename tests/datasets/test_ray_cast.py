"""Sequences from formulas: depth and vectors are exact, nothing is declared, and runs repeat."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import cltaa
from cltaa.camera import displacement_rows
from cltaa.cli import main
from cltaa_datasets.ray_cast import FAMILIES, frame_of, halton, truth_of
from tests.sequence_factory import digests

SIZE = 48, 27


@pytest.mark.parametrize("family", ["fog", "grain", "cut"])
def test_vectors_of_what_stands_are_those_of_the_camera(family: str) -> None:
    """The motion that a ray's end had, against the one that depth and matrices tell."""
    scene = FAMILIES[family](0)
    before, frame = (frame_of(scene, index, SIZE, halton(index, 64), 0) for index in (11, 12))
    width, height = SIZE
    moved = displacement_rows(frame.camera, before.camera, width, height)
    y, x = np.mgrid[0:height, 0:width]
    px, py = (at + 0.5 + j - side / 2 for at, j, side in zip((x, y), frame.jitter_px, SIZE, strict=True))
    v = np.stack([px, py, 1 / frame.depth.astype(np.float64), np.ones_like(px)], -1)
    dx, dy, dw = (v @ np.array(row) for row in moved[:3])
    assert frame.motion is not None
    told = np.stack([(dx - px * dw) / (1 + dw), (dy - py * dw) / (1 + dw)], -1)
    # float32 vectors of up to 100 pixels, and 1e-4 pixels that count as none.
    assert np.abs(told - frame.motion).max() < 2e-4


def test_a_ball_that_rolls_has_no_slip_where_it_touches() -> None:
    """The lowest point of a ball that rolls stands still for an instant; one that slides moves as a whole."""
    rolls, _, slides = FAMILIES["rolling"](0).bodies[2:]
    for body, speed in ((rolls, 0.0), (slides, 0.06)):
        rotation, centre = body.pose(10.0)
        below = (np.array([0.0, -body.radius, 0.0])) @ rotation
        later, moved = body.pose(10.001)
        velocity = (later @ below + moved - rotation @ below - centre) / 0.001
        assert np.linalg.norm(velocity) == pytest.approx(speed, abs=1e-4)


@pytest.mark.parametrize("period", [1, 2, 64, 93, 256])
def test_jitter_is_centred_and_lies_in_the_pixel(period: int) -> None:
    offsets = np.array([halton(index, period) for index in range(period)])
    assert offsets.min() >= -0.5
    assert offsets.max() < 0.5
    assert np.abs(offsets.mean(0)).max() < 1e-5  # what less than a thousandth of a pixel does to one of 93 offsets


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_every_family_is_drawn_finite_and_again_the_same(family: str) -> None:
    frames = [frame_of(FAMILIES[family](3), 2, SIZE, halton(2, 8), 3) for _ in range(2)]
    for name in ("colour", "depth", "motion"):
        first, second = (getattr(frame, name) for frame in frames)
        assert (first == second).all()
        assert np.isfinite(first).all() or name == "depth"
    assert frames[0].effects is None
    assert np.std(frames[0].colour) > 0.05


def test_samples_lie_about_the_truth() -> None:
    scene = FAMILIES["shadows"](0)
    truth = truth_of(scene, 5, SIZE, 64, 0)
    drawn = [frame_of(scene, 5, SIZE, halton(place, 64), 0).colour for place in range(64)]
    error = np.mean(drawn, 0) - truth
    # 64 samples each: an edge of contrast 1 errs by 1/16 at most in either.
    assert np.abs(error).max() < 0.2
    assert abs(error.mean()) < 2e-3


def test_the_command_writes_a_sequence_with_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "balls"
    options = ["--frames", "3", "--size", "48x27", "--reference", "4"]
    assert main(["raycast", "rolling", "-o", str(folder), *options, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["folder"], told["frames"], told["width"], told["height"]) == (str(folder), 3, 48, 27)
    sequence = cltaa.open(folder)
    assert (len(sequence), sequence.effects, sequence.reference is not None) == (3, None, True)
    assert main(["raycast", "nothing", "-o", str(folder)]) == 2
    for path in folder.glob("*.exr"):
        path.unlink()
    assert main(["raycast", "rolling", "-o", str(folder), "--seed", "1"]) == 64  # the truth is another seed's
    assert "reference: holds EXR files of another origin; choose an empty folder" in capsys.readouterr().err


def test_an_interrupted_run_goes_on_with_the_same_command_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(folder: str, frames: int, *more: str) -> int:
        options = ["--frames", str(frames), "--size", "12x7", "--reference", "4", *more]
        return main(["raycast", "rolling", "-o", str(tmp_path / folder), *options])

    assert run("whole", 3) == run("part", 2) == 0
    (tmp_path / "part" / "reference" / "rolling.0001.exr").unlink()
    (tmp_path / "part" / ".rolling.0002.exr.tmp.1").touch()  # left by a killed process
    first = tmp_path / "part" / "rolling.0000.exr"
    written = first.stat().st_mtime_ns
    for other in (["--seed", "1"], ["--period", "8"], ["--size", "12x8"], ["--reference", "1"]):
        assert run("part", 3, *other) == 64, other
        assert ": holds EXR files of another origin; choose an empty folder" in capsys.readouterr().err
    assert run("part", 3) == 0
    assert digests(tmp_path / "part") == digests(tmp_path / "whole")
    assert first.stat().st_mtime_ns == written
    assert not [*tmp_path.rglob(".*")]


@pytest.mark.parametrize("samples", [2, 3, 8, 60])
def test_a_truth_has_the_samples_that_are_asked_for(
    samples: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those of a square grid: other numbers would be recorded, and a square near them drawn."""
    command = ["raycast", "rolling", "-o", str(tmp_path / "balls"), "--frames", "1", "--size", "4x3"]
    assert main([*command, "--reference", str(samples)]) == 64
    assert "--reference: samples lie on a square grid (expected " in capsys.readouterr().err
    assert not (tmp_path / "balls").exists()
