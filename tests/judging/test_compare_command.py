"""``cltaa compare`` from the outside: what it prints, writes and refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.cli import main
from cltaa.errors import InputMissing
from cltaa.exr.write import write_frame, write_image
from cltaa.files.manifest import file_sha256
from cltaa.judging.equal_quality import equal_quality_samples
from cltaa.judging.metrics import light_mse, mean, measure
from cltaa.judging.video_scores import VideoScores
from cltaa.pictures.srgb import encoded
from cltaa.sequences.sources import open_images, open_sequence
from tests.inputs.foreign import frames as foreign_frames
from tests.inputs.foreign import write_blender
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame, write_images, write_sequence


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "capture", 4, reference=True)


@pytest.fixture
def resolved(tmp_path: Path, capture: Path) -> Path:
    """Halfway between single sample and truth."""
    sequence = open_sequence(capture)
    assert sequence.reference is not None
    images = [
        (truth + frame.colour) * np.float32(0.5) for truth, frame in zip(sequence.reference, sequence, strict=True)
    ]
    return write_images(tmp_path / "resolved", images, name="synthetic")


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


def test_capture_against_its_own_truth(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    result = run_json(capsys, capture, "--metrics", "psnr", "--frames", "1-2")
    assert [frame["frame"] for frame in result["frames"]] == [1, 2]
    assert set(result["mean"]) == {"psnr", "mse"}
    assert "mean_one_sample" not in result


def test_samples_of_the_truth_limit_the_answer(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    truth = list(open_images(capture / "reference"))
    write_images(capture / "reference", truth, name="synthetic", samples=2)
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]["samples"] <= 2
    write_images(resolved, truth, name="synthetic")
    found = run_json(capsys, resolved, capture, "--metrics", "mse")["equal_quality_samples"]
    assert found == {"samples": 2, "method": "n^-1.5 law", "bound": "at least"}


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


def test_a_yardstick_that_lacks_frames_is_told_before_the_work(
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


@pytest.mark.parametrize("missing", [0, 1, 3])
def test_frames_that_have_a_truth_are_judged_where_others_have_none(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, missing: int
) -> None:
    (capture / "reference" / f"synthetic.{missing:04d}.exr").unlink()
    said = refusal(capsys, 66, resolved, capture)
    assert f"frame {missing}: no reference for this frame" in said
    assert "choose frames that both have with --frames" in said
    judged = run_json(capsys, resolved, capture, "--frames", "2", "--metrics", "mse", "--video")
    assert [row["frame"] for row in judged["frames"]] == [2]
    assert judged["equal_quality_samples"]["method"] == "n^-1.5 law"
    with pytest.raises(InputMissing, match=r"the reference of this frame is missing \(found .*\); capture it again"):
        _ = open_sequence(capture).reference


def test_no_frame_in_common(capsys: pytest.CaptureFixture[str], resolved: Path, tmp_path: Path) -> None:
    other = write_images(tmp_path / "other", [make_frame().colour] * 2, first=10)
    assert "no frame number in common: number them alike" in refusal(capsys, 66, resolved, other)


def test_identical_images_give_null_and_no_samples(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    truth = capture / "reference"
    result = run_json(capsys, truth, truth, "--metrics", "psnr,mse")
    assert result["mean"] == {"psnr": None, "mse": 0.0}


def test_single_files_of_different_numbers(capsys: pytest.CaptureFixture[str], capture: Path) -> None:
    one, other = (capture / "reference" / f"synthetic.000{number}.exr" for number in (0, 1))
    result = run_json(capsys, one, other, "--metrics", "mse")
    expected = light_mse(np.full((1, 1, 3), 0.25, np.float32), np.full((1, 1, 3), 0.26, np.float32))
    assert result["frames"][0]["metrics"]["mse"] == pytest.approx(expected, rel=1e-6)


def test_exposure(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    dark = run_json(capsys, resolved, capture, "--metrics", "mse", "--stops", "-32")
    # Colours up to 4 come out on the straight part of the display transform, whose slope is 12.92.
    assert dark["mean"]["mse"] <= (12.92 * 4 * 2.0**-32) ** 2


def test_table(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
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
def test_heat_maps(
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


def test_bad_input(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path) -> None:
    assert "no folder reference/" in refusal(capsys, 64, resolved)
    assert "unknown metric lpips; known metrics: mse," in refusal(capsys, 64, resolved, capture, "--metrics", "lpips")
    assert "'2..3' is no range of frames" in refusal(capsys, 2, resolved, capture, "--frames", "2..3")
    assert "no such frame" in refusal(capsys, 64, resolved, capture, "--frames", "2-9")
    assert "file is missing" in refusal(capsys, 66, tmp_path / "nowhere", capture)
    truth = capture / "reference"
    assert "--video needs the capture" in refusal(capsys, 64, resolved, truth, "--video")
    (tmp_path / "file").touch()
    assert "cannot be created" in refusal(capsys, 73, resolved, capture, "--heatmap", tmp_path / "file" / "x")
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


def test_other_tools_files_are_judged_and_judge(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As truth, as what is judged, and as a sequence with its truth beside it, in a part a pass and as one image."""
    made, shot, truth = foreign_frames(3), tmp_path / "shot", tmp_path / "truth"
    write_blender(shot, made)
    write_blender(truth, [replace(frame, colour=frame.colour * np.float32(0.9)) for frame in made])
    plain = write_images(tmp_path / "plain", [frame.colour for frame in made], name="shot")
    assert run_json(capsys, plain, shot, "--metrics", "mse")["mean"]["mse"] == 0
    assert main(["compare", str(plain), str(truth), "--metrics", "mse"]) == 0
    said = capsys.readouterr().err
    told = "profile blender: header attribute Software is Blender 5.0.1; colour ViewLayer.Combined.R"
    assert f"B: {told} ViewLayer.Combined.G ViewLayer.Combined.B\n" in said
    judged = run_json(capsys, plain, truth, "--metrics", "mse", "--frames", "1-2")
    assert [row["frame"] for row in judged["frames"]] == [1, 2]
    assert judged["mean"]["mse"] > 0
    shutil.copytree(truth, shot / "reference")
    with_capture = run_json(capsys, plain, shot, "--metrics", "mse", "--video")
    assert with_capture["mean"] == with_capture["mean_one_sample"]
    assert [row["metrics"] for row in with_capture["frames"]][1:] == [row["metrics"] for row in judged["frames"]]
    assert run_json(capsys, shot, "--metrics", "mse")["mean"] == with_capture["mean"]
    (truth / "shot.0001.exr").unlink()
    assert "frame 1: no reference for this frame (found 0, 2)" in refusal_behind_notes(capsys, plain, truth)
    (shot / "shot.0002.exr").unlink()
    assert "frame 2: no single samples for this frame (found 0-1)" in refusal_behind_notes(capsys, plain, shot)


def test_pictures_that_are_encoded_are_decoded(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """What a program of one's own wrote as it shows it: R, G and B too, and beside files of cltaa's own."""
    capture = write_sequence(tmp_path / "capture", 2, reference=True)
    images = [image.copy() for image in open_images(capture / "reference")]
    write_images(capture / "reference", images, name="synthetic", samples=64)
    mine = write_images(tmp_path / "mine", [encoded(image) for image in images])
    assert run_json(capsys, mine, capture, "--metrics", "mse")["mean"]["mse"] > 0.05
    asked = ("--metrics", "mse", "--input", "colour.encoding=srgb")
    assert run_json(capsys, mine, capture, *asked)["mean"]["mse"] < 1e-12  # rounded twice
    assert run_json(capsys, mine, capture, *asked, "--frames", "1")["mean"]["mse"] < 1e-12
    assert run_json(capsys, mine / "image.0001.exr", mine / "image.0001.exr", *asked)["mean"]["mse"] == 0
    assert "unknown profile nonsense" in refusal(capsys, 64, mine, capture, "--profile", "nonsense")
    frames = write_images(tmp_path / "shot", [frame.colour for frame in open_sequence(capture)], name="synthetic")
    write_images(frames / "reference", [encoded(image) for image in images], name="synthetic")
    assert run_json(capsys, mine, frames, *asked)["mean"]["mse"] == 0


def test_pictures_whose_channels_must_be_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grey = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    for folder in ("grey", "shot", "shot/reference"):
        (tmp_path / folder).mkdir()
        write_image(tmp_path / folder / "a.0001.exr", {"Y": grey})
    plain = write_images(tmp_path / "plain", [np.stack([grey] * 3, -1)], first=1)
    assert "--input colour.channels='Y Y Y'" in refusal(capsys, 65, plain, tmp_path / "grey")
    named = ("--metrics", "mse", "--input", "colour.channels=Y Y Y")
    assert run_json(capsys, plain, tmp_path / "grey", *named)["mean"]["mse"] == 0
    assert run_json(capsys, plain, tmp_path / "shot", *named)["mean_one_sample"]["mse"] == 0


def refusal_behind_notes(capsys: pytest.CaptureFixture[str], *arguments: Path) -> str:
    assert main(["compare", *map(str, arguments)]) == 66
    return capsys.readouterr().err


def warnings(capsys: pytest.CaptureFixture[str], *arguments: Path) -> list[str]:
    assert main(["compare", *map(str, arguments), "--metrics", "mse", "--json"]) == 0
    captured = capsys.readouterr()
    said = [line for line in captured.err.splitlines() if "warning: " in line]
    told: list[str] = json.loads(captured.out)["warnings"]
    assert said == [f"cltaa: warning: {warning}" for warning in told]
    return told


def test_other_primaries_are_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grey = make_frame().colour
    rec709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    acescg = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    for name, stated in (("unsaid", None), ("a", rec709), ("rounded", (*rec709[:6], 0.313, 0.329)), ("b", acescg)):
        (tmp_path / name).mkdir()
        attributes = {} if stated is None else {"chromaticities": stated}
        write_image(tmp_path / name / "x.0000.exr", {c: grey[..., i] for i, c in enumerate("RGB")}, attributes)
    assert "different primaries" in warnings(capsys, tmp_path / "a", tmp_path / "b")[0]
    assert warnings(capsys, tmp_path / "a", tmp_path / "rounded") == []
    assert warnings(capsys, tmp_path / "a", tmp_path / "unsaid") == []


def test_another_scene_is_told_by_what_files_say(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """By names, then cameras, then what a result was made from; never by pixels, and nothing where nothing is known."""
    made = write_sequence(tmp_path / "made", 2, reference=True)
    other_seed = write_sequence(tmp_path / "seed", 2, reference=True, seed=1)
    for folder in (made, other_seed):
        files = {path.name: file_sha256(path) for path in sorted(folder.glob("*.exr"))}
        (folder / "sequence.json").write_text(json.dumps({"files": files}))
    frames = [make_frame(index, camera=make_camera((9.0, index, 5.0))) for index in range(2)]
    for name, scene in (("moved", "synthetic"), ("elsewhere", "spinner")):
        (tmp_path / name).mkdir()
        for frame in frames:
            write_frame(tmp_path / name / f"synthetic.{frame.index:04d}.exr", replace(frame, scene=scene))
    assert main(["resolve", str(made), "-o", str(tmp_path / "resolved"), "--device", "numpy"]) == 0
    capsys.readouterr()
    resolved = tmp_path / "resolved"
    assert warnings(capsys, resolved, made) == []
    assert warnings(capsys, made) == []
    assert warnings(capsys, resolved, made / "reference") == []
    assert warnings(capsys, tmp_path / "elsewhere", made) == ["A shows scene spinner and B scene synthetic"]
    assert warnings(capsys, tmp_path / "moved", made) == ["A and B are seen by different cameras in frame 0"]
    assert "resolved from other frames than those of B" in warnings(capsys, resolved, other_seed)[0]


def write_region(folder: Path, images: list[np.ndarray]) -> Path:
    """All but two columns on the left and a row below of ``images``, with their place in the display window."""
    folder.mkdir()
    windows = ((2, 0, WIDTH - 1, HEIGHT - 2), (0, 0, WIDTH - 1, HEIGHT - 1))
    for number, image in enumerate(images):
        planes = {name: np.ascontiguousarray(image[:-1, 2:, place]) for place, name in enumerate("RGB")}
        write_image(folder / f"a.{number:04d}.exr", planes, windows=windows)
    return folder


def test_a_region_is_judged_against_the_same_region_of_a_capture(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    """Beside its single samples and its yardsticks there."""
    sequence, halfway = open_sequence(capture), open_images(resolved)
    assert sequence.reference is not None
    for number, truth in enumerate(sequence.reference):
        for samples, share in ((2, 0.7), (16, 0.1)):
            image = truth + np.float32(share) * (sequence.frame(number).colour - truth)
            image[:, :2] = 7  # beside the region
            planes = {name: np.ascontiguousarray(image[..., place]) for place, name in enumerate("RGB")}
            folder = capture / f"reference-{samples}"
            folder.mkdir(exist_ok=True)
            write_image(folder / f"synthetic.{number:04d}.exr", planes)
    part = write_region(tmp_path / "part", list(halfway))
    found = run_json(capsys, part, capture)
    truths = [image[:-1, 2:] for image in sequence.reference]
    singles = [frame.colour[:-1, 2:] for frame in sequence]
    expected = mean(measure(sample, truth) for sample, truth in zip(singles, truths, strict=True))
    assert found["mean_one_sample"] == pytest.approx(expected, rel=1e-12)
    # Errors fall with the square of the share: half of it lies between 0.7 of two samples and 0.1 of sixteen.
    assert found["equal_quality_samples"]["method"] == "measured"
    assert 2 < found["equal_quality_samples"]["samples"] < 16
    assert "--video judges whole pictures only" in refusal_after_note(capsys, part, capture, "--video")


def refusal_after_note(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The last line on standard error of what is refused."""
    assert main(["compare", *map(str, arguments)]) == 64
    return capsys.readouterr().err.splitlines()[-1]


def test_buffers_of_several_names_in_one_folder_are_read_by_a_profile(
    capsys: pytest.CaptureFixture[str], capture: Path, tmp_path: Path
) -> None:
    dump = tmp_path / "dump"
    dump.mkdir()
    for frame in open_sequence(capture):
        planes = {name: np.ascontiguousarray(frame.colour[..., place]) for place, name in enumerate("RGB")}
        write_image(dump / f"color.{frame.index:04d}.exr", planes)
        write_image(dump / f"depth.{frame.index:04d}.exr", {"R": np.ascontiguousarray(frame.depth)})
    assert main(["compare", str(dump), str(capture), "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert found["mean"] == found["mean_one_sample"]
    assert "colour color.R color.G color.B" in said.err


def test_a_truth_that_a_resolve_wrote_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    capture = write_sequence(tmp_path / "capture", 2)
    assert main(["resolve", str(capture), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    capsys.readouterr()
    shutil.copytree(tmp_path / "out", capture / "reference")
    for arguments in ([capture], [tmp_path / "out", capture]):
        (warning,) = run_json(capsys, *arguments)["warnings"]
        assert "reference, was written by a resolve: capture it again" in warning
    assert run_json(capsys, tmp_path / "out", capture / "reference")["warnings"] == []  # two resolves
