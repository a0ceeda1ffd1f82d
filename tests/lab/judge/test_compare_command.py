"""``cltaa compare`` from the outside: what it prints, writes and refuses."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa import __version__
from cltaa.cli import main
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.judge.metrics import equal_quality_samples, light_mse, mean, measure
from cltaa.lab.judge.video_scores import VideoScores
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, write_images, write_sequence


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Any:
    assert main(["compare", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys: pytest.CaptureFixture[str], code: int, *arguments: str | Path) -> str:
    assert main(["compare", *map(str, arguments)]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("cltaa: error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_json_holds_what_the_functions_say(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    result = run_json(capsys, resolved, capture)
    truth, images, sequence = open_images(capture / "reference"), open_images(resolved), open_sequence(capture)
    rows = [measure(images.image(n), truth.image(n)) for n in range(4)]
    singles = [measure(sequence.frame(n).colour, truth.image(n)) for n in range(4)]
    assert [frame["frame"] for frame in result["frames"]] == [0, 1, 2, 3]
    for frame, row, single in zip(result["frames"], rows, singles, strict=True):
        assert frame["metrics"] == pytest.approx(row, rel=1e-12)
        assert frame["one_sample"] == pytest.approx(single, rel=1e-12)
    assert result["mean"] == pytest.approx(mean(rows), rel=1e-12)
    expected = equal_quality_samples(mean(rows)["mse"], mean(singles)["mse"])
    found = {"samples": pytest.approx(expected), "method": "n^-1.5 law", "bound": None}
    assert result["equal_quality_samples"] == found
    packages = {"numpy", "scikit-image", "flip-evaluator"}
    assert result["versions"] == {"cltaa": __version__} | {package: version(package) for package in packages}


def test_a_capture_is_compared_with_its_own_truth(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    result = run_json(capsys, capture, "--metrics", "psnr", "--frames", "1-2")
    assert [frame["frame"] for frame in result["frames"]] == [1, 2]
    assert set(result["mean"]) == {"psnr", "mse"}
    assert result["versions"].keys() == {"cltaa", "numpy"}
    assert "mean_one_sample" not in result


def test_identical_images_give_null_and_no_samples(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    truth = capture / "reference"
    result = run_json(capsys, truth, truth, "--metrics", "psnr,mse")
    assert result["mean"] == {"psnr": None, "mse": 0.0}


def test_single_files_of_different_numbers_are_compared(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    one, other = (capture / "reference" / f"synthetic.000{number}.exr" for number in (0, 1))
    result = run_json(capsys, one, other, "--metrics", "mse")
    expected = light_mse(np.full((1, 1, 3), 0.25, np.float32), np.full((1, 1, 3), 0.26, np.float32))
    assert result["frames"][0]["metrics"]["mse"] == pytest.approx(expected, rel=1e-6)


def test_stops_change_the_exposure_before_the_comparison(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    dark = run_json(capsys, resolved, capture, "--metrics", "mse", "--stops", "-32")
    # Colours up to 4 come out on the straight part of the display transform, whose slope is 12.92.
    assert dark["mean"]["mse"] <= (12.92 * 4 * 2.0**-32) ** 2


def test_the_table_has_the_metrics_that_are_asked_for(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    assert main(["compare", str(resolved), str(capture), "--metrics", "psnr,ssim"]) == 0
    captured = capsys.readouterr()
    for word in ("psnr ↑", "ssim ↑", "mean", "one sample", "equal-quality samples", "n^-1.5 law"):
        assert word in captured.out
    assert "mse" not in captured.out
    assert "comparing: 4 of 4 frames" in captured.err


def test_a_result_equal_to_an_exact_truth_has_no_samples_and_says_so(
    capsys: pytest.CaptureFixture[str], capture: Path
) -> None:
    command = ["compare", str(capture / "reference"), str(capture), "--metrics", "mse"]
    assert main(command) == 0
    assert "equal-quality samples: no number, for A equals its truth up to white\n" in capsys.readouterr().out
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["equal_quality_samples"]["samples"] is None


@pytest.mark.parametrize("metrics", ["psnr", "psnr,flip"])
def test_heat_maps_are_written_and_change_no_score(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path, metrics: str
) -> None:
    plain = run_json(capsys, resolved, capture, "--metrics", metrics)
    heated = run_json(capsys, resolved, capture, "--metrics", metrics, "--heatmap", tmp_path / "new" / "heat")
    assert heated == plain
    names = sorted(path.name for path in (tmp_path / "new" / "heat").iterdir())
    assert names == [f"synthetic.{number:04d}.png" for number in range(4)]
    with Pillow.open(tmp_path / "new" / "heat" / names[0]) as picture:
        assert picture.size == (WIDTH, HEIGHT)
        assert len(np.unique(np.asarray(picture))) > 10


def test_heat_maps_of_other_frames_are_named(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    heat = tmp_path / "heat"
    command = ["compare", *map(str, (resolved, capture)), "--metrics", "mse", "--json", "--heatmap", str(heat)]
    assert main(command) == 0
    assert "warning" not in capsys.readouterr().err
    for name in ("other.0003.png", "synthetic.png"):
        (heat / name).touch()
    assert main([*command, "--frames", "1-1"]) == 0
    captured = capsys.readouterr()
    stays = f"{heat}: maps of frames that are not judged now stay there: 0, 2-3"
    assert f"cltaa: warning: {stays}\n" in captured.err
    assert json.loads(captured.out)["warnings"] == [stays]


def test_video_scores_are_those_of_the_functions(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    result = run_json(capsys, resolved, capture, "--metrics", "mse", "--video")
    sequence, images = open_sequence(capture), open_images(resolved)
    scores = VideoScores(2)
    assert sequence.reference is not None
    for frame, truth, image in zip(sequence, sequence.reference, images, strict=True):
        scores.add(frame, truth, [image, frame.colour])
    for name, sums in zip(("video", "video_one_sample"), scores.totals, strict=True):
        found = {key: np.nan if value is None else value for key, value in result[name].items()}
        assert found == pytest.approx(sums.scores(), rel=1e-9, nan_ok=True)
    assert not np.isnan(scores.totals[0].scores()["aliasing"])
    names = {"ghosting", "flicker", "blur", "aliasing"}
    assert names == set(result["frames"][1]["video"])
    assert names <= set(result["definitions"])
    alone = run_json(capsys, capture, "--metrics", "mse", "--video")
    assert alone["video"]["aliasing"] == pytest.approx(result["video_one_sample"]["aliasing"], rel=1e-9)
    assert "video_one_sample" not in alone
    assert main(["compare", str(resolved), str(capture), "--metrics", "mse", "--video"]) == 0
    assert "as moving pictures" in capsys.readouterr().out


def test_wrong_comparisons_are_refused(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    assert "no folder reference/" in refusal(capsys, 64, resolved)
    truth = capture / "reference"
    assert "--video needs the capture" in refusal(capsys, 64, resolved, truth, "--video")
    short = write_images(tmp_path / "short", [make_frame().colour] * 2, name="synthetic")
    assert "frame 2: no reference for this frame" in refusal(capsys, 66, resolved, short)
    assert main(["compare", str(resolved), str(short), "--frames", "0-1", "--metrics", "mse"]) == 0
    capsys.readouterr()
    small = write_images(tmp_path / "small", [make_frame(width=WIDTH - 1).colour] * 4)
    assert f"expected {WIDTH} x {HEIGHT}, found {WIDTH - 1} x {HEIGHT}" in refusal(capsys, 65, resolved, small)
    frame = resolved / "synthetic.0002.exr"
    frame.write_bytes(frame.read_bytes()[:-5])
    assert "synthetic.0002.exr: the file is truncated" in refusal(capsys, 65, resolved, capture)


def test_nan_in_an_image_is_named(capsys: pytest.CaptureFixture[str], capture: Path, tmp_path: Path) -> None:
    images = [frame.colour.copy() for frame in open_sequence(capture)]
    images[1][3, 4, 2] = np.nan
    folder = write_images(tmp_path / "bad", images)
    assert main(["compare", str(folder), str(capture)]) == 65
    error = capsys.readouterr().err.splitlines()[-1]
    assert "image.0001.exr frame 1: NaN or infinity in 1 value of the image" in error
    images[1][3, 4, :2] = np.nan
    write_images(folder, images)
    write_images(tmp_path / "good", [np.zeros_like(image) for image in images])
    assert main(["compare", str(tmp_path / "good"), str(folder)]) == 65
    error = capsys.readouterr().err.splitlines()[-1]
    assert f"{folder / 'image.0001.exr'} frame 1: NaN or infinity in 3 values of the reference" in error


def test_a_result_says_of_what_it_is(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    """One that is named twice is one."""
    found = run_json(capsys, resolved, resolved, capture, "--metrics", "mse", "--stops", "1.5")
    facts = found["test"], found["reference"], found["stops"]
    assert facts == (str(resolved), str(capture / "reference"), 1.5)
    truth = capture / "reference"
    assert run_json(capsys, resolved, truth, "--metrics", "mse")["reference"] == str(truth)


def test_where_one_sample_is_right_no_number_of_samples_is(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    write_images(capture / "reference", [frame.colour for frame in open_sequence(capture)], name="synthetic")
    found = run_json(capsys, resolved, capture, "--metrics", "mse")
    assert (found["mean"]["mse"] > 0, found["mean_one_sample"]["mse"]) == (True, 0)
    assert "equal_quality_samples" not in found


def test_frames_two_apart_are_not_followed_without_their_step(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for number in (0, 2, 4, 6):
        write_sequence(tmp_path, 1, first=number)
        write_images(tmp_path / "reference", [make_frame(number, seed=1).colour], name="synthetic", first=number)
    assert "say --step 2 if each continues the last" in refusal(capsys, 64, tmp_path, "--video")
    assert run_json(capsys, tmp_path, "--metrics", "mse", "--video", "--step", "2")["video"]["flicker"] > 0


def test_maps_do_not_replace_pictures_by_whatever_way_their_folder_is_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for name, level in (("a", 100), ("b", 110)):
        (tmp_path / name).mkdir()
        Pillow.fromarray(np.full((HEIGHT, WIDTH, 3), level, np.uint8)).save(tmp_path / name / "x.0001.png")
        (tmp_path / f"to-{name}").symlink_to(tmp_path / name)
    before = [(tmp_path / name / "x.0001.png").read_bytes() for name in "ab"]
    for name in "ab":
        command = ["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--heatmap", str(tmp_path / f"to-{name}")]
        assert main(command) == 64
        said = capsys.readouterr().err.splitlines()
        assert [line[:3] for line in said[:2]] == ["A: ", "B: "]  # how each is read
        assert "maps have the names of the pictures there" in said[-1]
    assert [(tmp_path / name / "x.0001.png").read_bytes() for name in "ab"] == before
