"""Samples for the same error: by yardsticks of a capture, by the law beyond them, or not at all."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.judge.comparison import open_yardsticks, truth_of
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, write_images, write_sequence


def test_samples_of_the_truth_limit_the_answer(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    truth = list(open_images(capture / "reference"))
    write_images(capture / "reference", truth, name="synthetic", samples=2)
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]["samples"] <= 2
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")  # the same error
    found = run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": 2, "method": "measured", "bound": "at least"}
    shutil.rmtree(capture / "reference-4")
    write_images(resolved, truth, name="synthetic")
    found = run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": 2, "method": "n^-1.5 law", "bound": "at least"}


@pytest.mark.parametrize("samples", [0, -4])
def test_a_truth_of_no_samples_is_reported(
    samples: int, capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    write_images(capture / "reference", list(open_images(capture / "reference")), name="synthetic", samples=samples)
    assert main(["compare", str(resolved), str(capture), "--metrics", "mse"]) == 65
    wrong = f"attribute cltaa:samples is wrong (expected a positive int, found {samples})"
    assert f"{wrong}; capture the reference again" in capsys.readouterr().err


def test_measured_curve_is_preferred_to_the_law(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    """reference-4/ is made to have exactly the error of the resolved images."""
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")
    result = run_json(capsys, resolved, capture, "--metrics", "mse")
    found = {"samples": pytest.approx(4, rel=1e-12), "method": "measured", "bound": None}
    assert result["equal_quality_samples"] == found


def test_beyond_the_measured_curve_only_a_bound_is_said(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")
    truth = list(open_images(capture / "reference"))
    for name, share, end, bound in (("better", 0.9, 4, "at least"), ("worse", -3.0, 1, "at most")):
        made = [t * share + f.colour * (1 - share) for t, f in zip(truth, open_sequence(capture), strict=True)]
        folder = write_images(tmp_path / name, [image.astype(np.float32) for image in made], name="synthetic")
        found = run_json(capsys, folder, capture, "--metrics", "mse")["equal_quality_samples"]
        assert found == {"samples": pytest.approx(end, rel=1e-12), "method": "measured", "bound": bound}
    assert main(["compare", str(folder), str(capture), "--metrics", "mse"]) == 0
    assert "samples: at most 1.0 a pixel (measured)" in capsys.readouterr().out


def test_a_yardstick_that_measures_nothing_leaves_the_law(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    """As many samples as the truth has are the truth itself; more error than a single sample's is none to read off."""
    shutil.copytree(capture / "reference", capture / "reference-16")
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]["method"] == "n^-1.5 law"
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")
    found = run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": pytest.approx(4, rel=1e-12), "method": "measured", "bound": None}
    worse = [np.full((HEIGHT, WIDTH, 3), 9.0, np.float32)] * 4
    write_images(capture / "reference-4", worse, name="synthetic")
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]["method"] == "n^-1.5 law"


def test_a_yardstick_that_is_no_light_is_named(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    broken = list(open_images(resolved))
    broken[2][3, 4, 1] = np.nan
    write_images(capture / "reference-4", broken, name="synthetic")
    assert main(["compare", str(resolved), str(capture), "--metrics", "mse"]) == 65
    said = capsys.readouterr().err.splitlines()[-1]
    path = capture / "reference-4" / "synthetic.0002.exr"
    assert f"{path} frame 2: NaN or infinity in 1 value of the image; there is no error to state" in said


def test_yardsticks_are_told_by_their_numbers_fewest_first(capture: Path) -> None:
    for name in ("16", "2", "old", "32", "4", "64", "8"):
        shutil.copytree(capture / "reference", capture / f"reference-{name}")
    assert [*open_yardsticks(open_sequence(capture))] == [2, 4, 8, 16, 32, 64]


def test_a_folder_of_one_sample_is_no_second_yardstick_of_one(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    """The capture is the samples of one already: a curve with two points there does not fall, so that it was left."""
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")
    single = [frame.colour for frame in open_sequence(capture)]
    write_images(capture / "reference-1", single, name="synthetic")
    assert [*open_yardsticks(open_sequence(capture))] == [4]
    found = run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": pytest.approx(4, rel=1e-12), "method": "measured", "bound": None}


def test_a_yardstick_that_lacks_frames_is_reported_before_the_work(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    write_images(capture / "reference-4", list(open_images(resolved)), name="synthetic")
    (capture / "reference-4" / "synthetic.0001.exr").unlink()
    said = "frame 1: no yardstick of 4 samples for this frame (found 0, 2-3); capture it again, or take the folder away"
    assert said in refusal(capsys, 66, resolved, capture)
    assert main(["bench", "accuracy", str(capture), "-o", str(tmp_path / "report"), "--only", "reject"]) == 66
    assert said in capsys.readouterr().err
    found = run_json(capsys, resolved, capture, "--frames", "2-3", "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": pytest.approx(4, rel=1e-12), "method": "measured", "bound": None}


def test_a_truth_of_another_scene_is_told(tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 1)
    for scene in ("synthetic", "other"):
        (tmp_path / scene).mkdir()
        write_frame(tmp_path / scene / "x.0000.exr", replace(make_frame(0), scene=scene))
    sequence, wrong = open_sequence(tmp_path / "in"), open_sequence(tmp_path / "in")
    sequence.truth, wrong.truth = open_images(tmp_path / "synthetic"), open_images(tmp_path / "other")
    truth_of(sequence)  # whose warning would be an error
    with pytest.warns(UserWarning, match="in shows scene synthetic and its truth scene other"):
        truth_of(wrong)
