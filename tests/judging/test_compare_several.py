"""``cltaa compare`` of several results with one truth: a line each, and the numbers that each has alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.sequences.sources import open_images
from tests.judging.test_compare_command import refusal, run_json
from tests.sequence_factory import write_images


def test_each_is_judged_as_it_is_alone(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    truth = capture / "reference"
    options = ("--metrics", "mse,psnr", "--video")
    alone = [run_json(capsys, path, capture, *options) for path in (resolved, truth)]
    assert run_json(capsys, resolved, truth, capture, *options)["compared"] == alone
    assert main(["compare", str(resolved), str(truth), str(capture), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {
        cells[1].strip(): [cell.strip() for cell in cells[2:-1]]
        for cells in (line.split("│") for line in lines)
        if cells[1:]
    }
    mean, samples = alone[0]["mean"], alone[0]["equal_quality_samples"]["samples"]
    assert rows[str(resolved)][:2] == [f"{mean['mse']:.4g}", f"{mean['psnr']:.2f}"]
    assert rows[str(resolved)][-1] == f"{samples:.1f}"
    assert rows[str(truth)][1] == "identical"
    assert rows["one sample"][0] == f"{alone[0]['mean_one_sample']['mse']:.4g}"
    assert len(rows[str(resolved)]) == 2 + 4 + 1


def test_single_samples_are_one_of_several(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    assert main(["compare", str(capture), str(resolved), str(capture), "--metrics", "mse"]) == 0
    rows = [line.split("│") for line in capsys.readouterr().out.splitlines() if "│" in line]
    cells = {row[1].strip(): [cell.strip() for cell in row[2:-1]] for row in rows}
    assert cells[str(capture)] == [cells["one sample"][0], "–"]


def test_several_must_be_of_the_same_frames(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    images = open_images(resolved)
    fewer = write_images(tmp_path / "fewer", [images.image(n) for n in (0, 1)])
    said = refusal(capsys, 64, resolved, fewer, capture)
    assert "other frames than those of" in said
    assert "(expected 0-3, found 0-1); choose frames that all have with --frames" in said
    assert len(run_json(capsys, resolved, fewer, capture, "--frames", "0-1", "--metrics", "mse")["compared"]) == 2
    assert "one A at a time" in refusal(
        capsys, 64, resolved, capture / "reference", capture, "--heatmap", tmp_path / "m"
    )
