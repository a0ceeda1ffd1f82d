"""``cltaa compare``: which frames of A and B are judged, and which lack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import InputMissing
from cltaa.io.display import to_display, to_picture, write_png
from cltaa.io.exr_write import write_image
from cltaa.io.numbered import ranges
from cltaa.io.sequence import open_sequence
from tests.inputs.foreign import write_blender
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import make_frame, write_images, write_sequence


def without_truth(capture: Path, *numbers: int) -> None:
    for number in numbers:
        (capture / "reference" / f"synthetic.{number:04d}.exr").unlink()


@pytest.mark.parametrize("missing", [0, 1, 3])
def test_frames_that_have_a_truth_are_judged_where_others_have_none(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, missing: int
) -> None:
    without_truth(capture, missing)
    there = [number for number in range(4) if number != missing]
    line = f"B has a truth for 3 of the 4 frames of A: frames {ranges(there)} are judged, the other is not"
    for paths in ((resolved, capture), (capture,)):
        for options in ((), ("--video",)):
            assert main(["compare", *map(str, paths), "--metrics", "mse", *options]) == 0
            assert capsys.readouterr().err.count(f"cltaa: warning: {line}\n") == 1
            judged = run_json(capsys, *paths, "--metrics", "mse", *options)
            assert [row["frame"] for row in judged["frames"]] == there
            assert (judged["warnings"], judged["not_judged"]) == ([line], [missing])
    for frames in ("0-3", "4"):
        said = refusal(capsys, 66, resolved, capture, "--frames", frames)
        assert f"frame {missing}: no reference for this frame" in said
        assert "choose frames that both have with --frames" in said
    judged = run_json(capsys, resolved, capture, "--frames", "2-2", "--metrics", "mse", "--video")
    assert [row["frame"] for row in judged["frames"]] == [2]
    assert judged["equal_quality_samples"]["method"] == "n^-1.5 law"
    assert (judged["warnings"], judged["not_judged"]) == ([], [])
    with pytest.raises(InputMissing, match=r"the reference of this frame is missing \(found .*\); capture it again"):
        _ = open_sequence(capture).reference


def test_each_run_of_frames_with_a_truth_is_followed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Like that run alone; nothing is followed across the frames between."""
    capture = write_sequence(tmp_path / "capture", 9, reference=True, motion=True)
    without_truth(capture, 0, 4, 8)
    judged = run_json(capsys, capture, "--metrics", "mse", "--video")
    runs = [run_json(capsys, capture, "--metrics", "mse", "--video", "--frames", run) for run in ("1-3", "5-7")]
    assert judged["frames"] == [row for run in runs for row in run["frames"]]
    assert [row["video"]["flicker"] for row in judged["frames"]][::3] == [None, None]
    assert judged["video"]["flicker"] > 0
    assert judged["not_judged"] == [0, 4, 8]
    assert "frames 1-3, 5-7 are judged, the 3 others are not" in judged["warnings"][0]


def test_frames_with_a_truth_of_which_none_follows_another_are_not_scored_over_time(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    without_truth(capture, 1, 3)
    for paths in ((resolved, capture), (capture,)):
        said = refusal(capsys, 66, *paths, "--video")
        assert "--video follows each frame to the next, but no two consecutive frames have a truth (found 0, 2)" in said
        assert [row["frame"] for row in run_json(capsys, *paths, "--metrics", "mse")["frames"]] == [0, 2]
    without_truth(capture, 2)
    assert "have a truth (found 0)" in refusal(capsys, 66, resolved, capture, "--video")


@pytest.mark.parametrize("name", ["blender", "encoded", "png"])
def test_pictures_of_any_kind_are_judged_where_they_have_a_truth(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, capture: Path
) -> None:
    """Those of another tool, those that are decoded, and PNGs."""
    without_truth(capture, 1)
    frames, mine = [make_frame(number) for number in range(4)], tmp_path / "mine"
    if name == "blender":
        write_blender(mine, frames)
    elif name == "encoded":
        write_images(mine, [frame.colour for frame in frames])
    else:
        mine.mkdir()
        for frame in frames:
            write_png(mine / f"x.{frame.index:04d}.png", to_picture(frame.colour))
    asked = ("--input", "colour.encoding=srgb") if name == "encoded" else ()
    judged = run_json(capsys, mine, capture, "--metrics", "mse", "--video", *asked)
    alone = run_json(capsys, mine, capture, "--metrics", "mse", "--video", "--frames", "2-3", *asked)
    assert [row["frame"] for row in judged["frames"]] == [0, 2, 3]
    assert judged["frames"][1:] == alone["frames"]
    assert judged["not_judged"] == [1]


def test_a_frame_that_the_capture_never_had_is_refused(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    """It is no frame without a truth: A shows something else, or is numbered otherwise."""
    write_images(resolved, [make_frame().colour], name="synthetic", first=4)
    without_truth(capture, 0)
    assert "frame 4: no single samples for this frame" in refusal(capsys, 66, resolved, capture, "--video")


@pytest.mark.parametrize("name", ["plain", "passes", "png"])
def test_a_count_is_judged_like_the_range_that_it_means(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Where later frames lack a truth, or are lost."""
    images = [make_frame(number).colour for number in range(5)]
    truth = write_images(tmp_path / "truth", images[:2], name="x", first=3)
    folder = tmp_path / name
    folder.mkdir()
    for number, image in enumerate(images, 3):
        layer = "beauty." if name == "passes" else ""
        channels = {f"{layer}{c}": np.ascontiguousarray(image[..., place]) for place, c in enumerate("RGB")}
        if name == "png":
            write_png(folder / f"x.{number:04d}.png", to_picture(image))
        else:
            write_image(folder / f"x.{number:04d}.exr", channels)
    sorted(folder.iterdir())[3].unlink()
    counted, ranged = (run_json(capsys, folder, truth, "--metrics", "mse", "--frames", n) for n in ("2", "3-4"))
    assert counted == ranged
    assert [row["frame"] for row in counted["frames"]] == [3, 4]
    assert "frame 5: no reference for this frame" in refusal(capsys, 66, folder, truth, "--frames", "3")


def cut_short(resolved: Path, kept: int) -> None:
    for path in sorted(resolved.glob("*.exr"))[kept:]:
        path.unlink()


def test_frames_that_a_resolve_did_not_finish_are_reported(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    other = write_images(tmp_path / "other", [make_frame(number).colour for number in range(2)], name="synthetic")
    cut_short(resolved, 2)
    line = "A has 2 of the 4 frames of B: frames 2-3 are not judged; finish A, or choose frames with --frames"
    for truth in (capture, capture / "reference"):
        assert main(["compare", str(resolved), str(truth), "--metrics", "mse"]) == 0
        assert capsys.readouterr().err.count(f"cltaa: warning: {line}\n") == 1
        result = run_json(capsys, resolved, truth, "--metrics", "mse")
        assert result["warnings"] == [line]
        assert result["not_judged"] == [2, 3]
    several = run_json(capsys, resolved, other, capture, "--metrics", "mse")["compared"]
    assert [line in one["warnings"] for one in several] == [True, True]
    cut_short(resolved, 1)
    line = "A has 1 of the 4 frames of B: frames 1-3 are not judged; finish A, or choose frames with --frames"
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["warnings"] == [line]


def test_frames_that_nobody_asked_for_are_not_told_to_lack(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path
) -> None:
    """Those outside --frames, those beside a single file, and those without a truth."""
    files = sorted(resolved.glob("*.exr"))
    for paths in ((resolved, capture, "--frames", "1-2"), (files[1], capture), (files[1], capture / "reference")):
        result = run_json(capsys, *paths, "--metrics", "mse")
        assert (result["warnings"], result["not_judged"]) == ([], [])
    cut_short(resolved, 2)
    for path in sorted((capture / "reference").glob("*.exr"))[2:]:
        path.unlink()
    assert run_json(capsys, resolved, capture, "--metrics", "mse")["warnings"] == []


def test_missing_frames_within_the_range_are_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Numbers may lie evenly apart, as where every second frame is resolved."""
    capture = write_sequence(tmp_path / "capture", 5, reference=True)
    resolved = write_images(tmp_path / "resolved", [make_frame().colour] * 5, name="synthetic")
    for number in (1, 3):
        (resolved / f"synthetic.{number:04d}.exr").unlink()
    result = run_json(capsys, resolved, capture, "--metrics", "mse", "--frames", "0-2")
    assert result["not_judged"] == [1]
    line = "A has 2 of the 3 frames of B: frame 1 is not judged; finish A, or choose frames with --frames"
    assert result["warnings"] == [line]


def test_sequences_without_a_common_frame_are_refused(
    capsys: pytest.CaptureFixture[str], resolved: Path, tmp_path: Path
) -> None:
    other = write_images(tmp_path / "other", [make_frame().colour] * 2, first=10)
    assert "no frame number in common: number them alike" in refusal(capsys, 66, resolved, other)


def write_alpha(folder: Path, alpha: float, *, layer: str = "") -> Path:
    """Two frames that are black, with alpha in a corner: over black nobody sees it."""
    folder.mkdir()
    for number in range(2):
        mask = np.zeros((16, 16), np.float32)
        mask[:8, :8] = alpha
        planes = {f"{layer}{name}": np.zeros((16, 16), np.float32) for name in "RGB"} | {f"{layer}A": mask}
        write_image(folder / f"a.{number:04d}.exr", planes)
    return folder


@pytest.mark.parametrize("layer", ["", "beauty."])
def test_alpha_that_stays_behind_is_seen(capsys: pytest.CaptureFixture[str], tmp_path: Path, layer: str) -> None:
    ghost, truth = write_alpha(tmp_path / "ghost", 0.6, layer=layer), write_alpha(tmp_path / "truth", 0.0)
    found = run_json(capsys, ghost, truth, "--metrics", "mse")
    assert found["mean"]["mse"] == 0.0  # over black
    assert found["alpha"]["mse"] == pytest.approx(0.36 / 4, rel=1e-6)
    assert found["alpha"]["worst"] == pytest.approx(0.6)
    assert found["frames"][1]["alpha"] == found["alpha"]
    # White through 0.6 of a quarter: 1 against sRGB of 0.4; grey against sRGB of 0.4 x 0.18.
    apart = {name: to_display(np.full((1, 1, 3), 0.4 * v)) - to_display(np.full((1, 1, 3), v)) for name, v in GROUNDS}
    for name, difference in apart.items():
        expected = -10 * np.log10(float(np.mean(difference**2)) / 4)
        assert found["alpha"][f"psnr-{name}"] == pytest.approx(expected, abs=1e-3)
    assert main(["compare", str(ghost), str(truth)]) == 0
    assert "alpha: mse 0.09, worst 0.6; PSNR over white " in capsys.readouterr().out
    again = run_json(capsys, truth, truth, "--metrics", "mse")["alpha"]
    assert (again["worst"], again["psnr-white"]) == (0.0, None)
    plain = write_images(tmp_path / "plain", [np.zeros((16, 16, 3), np.float32)] * 2)
    assert "alpha" not in run_json(capsys, ghost, plain, "--metrics", "mse")


@pytest.mark.parametrize("missing", [0, 1])
def test_alpha_is_judged_in_the_frames_that_have_it(
    missing: int, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    ghost, truth = write_alpha(tmp_path / "ghost", 0.6), write_alpha(tmp_path / "truth", 0.0)
    write_images(ghost, [np.zeros((16, 16, 3), np.float32)], name="a", first=missing)
    found = run_json(capsys, ghost, truth, "--metrics", "mse")
    assert ["alpha" in row for row in found["frames"]] == [number != missing for number in range(2)]
    assert found["alpha"]["worst"] == pytest.approx(0.6)


GROUNDS = (("white", 1.0), ("grey", 0.18))
