"""``cltaa compare`` of several results with one truth: a line each, and the numbers that each has alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.cli import main
from cltaa.io import sequence as images
from cltaa.io import sequence as sources
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.sequence import open_images
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import HEIGHT, WIDTH, read_frame, write_images, write_sequence


def test_each_is_judged_as_it_is_alone(capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path) -> None:
    truth = capture / "reference"
    options = ("--metrics", "mse,psnr", "--video")
    alone = [run_json(capsys, path, capture, *options) for path in (resolved, truth)]
    assert run_json(capsys, resolved, truth, capture, *options)["compared"] == alone
    assert main(["compare", str(resolved), str(truth), str(capture), str(capture), *options]) == 0
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
    assert rows[str(capture)] == [*rows["one sample"][:-1], "–"]  # as one of several
    assert len(rows[str(resolved)]) == 2 + 4 + 1


def test_a_broken_single_sample_does_not_keep_its_resolve_from_being_judged(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    """What is not finite in the capture is black, as for the benches: a resolve mends it."""
    found = {}
    for value in (0.0, np.nan, np.inf):
        folder = write_sequence(tmp_path / str(value), 4)
        (folder / "reference").symlink_to(capture / "reference")
        path = folder / "synthetic.0002.exr"
        frame = read_frame(path)
        frame.colour[3, 4] = value
        write_frame(path, frame)
        found[value] = run_json(capsys, resolved, folder, "--metrics", "mse", "--video")
        assert main(["compare", str(folder), "--metrics", "mse"]) == (0 if value == 0 else 65)
        capsys.readouterr()
        found[value].pop("reference")
    first, *others = found.values()
    assert others == [first, first]


def test_several_must_be_of_the_same_frames(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    some = open_images(resolved)
    fewer = write_images(tmp_path / "fewer", [some.image(n) for n in (0, 1)])
    said = refusal(capsys, 64, resolved, fewer, capture)
    assert "other frames than those of" in said
    assert "(expected 0-3, found 0-1); choose frames that all have with --frames" in said
    assert len(run_json(capsys, resolved, fewer, capture, "--frames", "0-1", "--metrics", "mse")["compared"]) == 2
    assert "one A at a time" in refusal(
        capsys, 64, resolved, capture / "reference", capture, "--heatmap", tmp_path / "m"
    )


@pytest.fixture
def large(tmp_path: Path) -> list[Path]:
    """Three sequences of noise about a truth, and the capture of it, of whole tiles, with yardsticks."""
    capture = write_sequence(tmp_path / "large", 3, reference=True, width=70, height=40)
    chance = np.random.default_rng(5)
    truth = [chance.random((40, 70, 3), np.float32) for _ in range(3)]

    def noisy(folder: Path, sigma: float) -> Path:
        noise = [chance.standard_normal(image.shape).astype(np.float32) for image in truth]
        return write_images(
            folder, [image + np.float32(sigma) * n for image, n in zip(truth, noise, strict=True)], name="synthetic"
        )

    noisy(capture / "reference", 0.0)
    for samples, sigma in ((4, 0.06), (16, 0.03)):
        noisy(capture / f"reference-{samples}", sigma)
    return [*(noisy(tmp_path / f"noise{sigma}", sigma) for sigma in (0.1, 0.04, 0.2)), capture]


def test_the_numbers_are_those_of_each_alone_to_the_last_digit(
    capsys: pytest.CaptureFixture[str], large: list[Path]
) -> None:
    """The capture among them too, which alone is all that is judged: a product of matrices would round otherwise."""
    options = ("--metrics", "mse,psnr,ssim", "--video")
    alone = [run_json(capsys, test, large[-1], *options) for test in large]
    assert all(result["video"]["aliasing"] > 0 for result in alone)
    assert [result["equal_quality_samples"]["method"] for result in alone[:-1]] == ["measured"] * 3
    assert run_json(capsys, *large, large[-1], *options)["compared"] == alone


def test_each_file_is_decoded_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, large: list[Path]
) -> None:
    decoded: Counter[str] = Counter()
    for module, name in ((images, "read_colour"), (sources, "read_frame_and_header")):
        read = getattr(module, name)

        def counted(path: Path, *, read: Any = read, **given: Any) -> Any:
            decoded[path.parent.name] += 1
            return read(path, **given)

        monkeypatch.setattr(module, name, counted)
    assert main(["compare", *map(str, large), "--metrics", "mse", "--video"]) == 0
    folders = ("noise0.1", "noise0.04", "noise0.2", "large", "reference", "reference-4", "reference-16")
    assert decoded == dict.fromkeys(folders, 3)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith("comparing: 3 of 3 frames")


def test_a_warning_says_of_which_and_how_b_is_read_is_said_once(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    grey = {name: np.full((HEIGHT, WIDTH), 0.5, np.float32) for name in "RGB"}
    folders = []
    for scene in ("here", "there"):
        folders.append(tmp_path / scene)
        folders[-1].mkdir()
        write_image(folders[-1] / "a.0001.exr", grey, {"cltaa:scene": scene})
    assert main(["compare", *map(str, (*folders, folders[0])), "--metrics", "mse"]) == 0
    assert f"cltaa: warning: {folders[1]}: A shows scene there and B scene here" in capsys.readouterr().err
    truth = tmp_path / "png"
    truth.mkdir()
    Pillow.fromarray(np.full((HEIGHT, WIDTH, 3), 128, np.uint8)).save(truth / "a.0001.png")
    assert main(["compare", *map(str, (*folders, truth)), "--metrics", "mse"]) == 0
    assert [line[:2] for line in capsys.readouterr().err.splitlines()].count("B:") == 1
