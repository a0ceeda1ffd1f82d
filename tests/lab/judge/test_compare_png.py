"""``cltaa compare`` of PNGs, which other tools leave: how they are read, and what is told of those that cannot be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.cli import main
from cltaa.inputs.foreign import open_pictures
from cltaa.io.display import to_picture, write_png
from cltaa.io.sequence import open_images
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import write_sequence


def save(path: Path, texels: list[list[tuple[int, ...]]]) -> Path:
    path.parent.mkdir(exist_ok=True)
    Pillow.fromarray(np.array(texels, np.uint8)).save(path)
    return path


def told(capsys: pytest.CaptureFixture[str], code: int, *arguments: str | Path) -> str:
    """The last line of what is said of ``arguments``, behind how they are read."""
    assert main(["compare", *map(str, arguments)]) == code
    return capsys.readouterr().err.splitlines()[-1]


def test_texels_are_decoded_and_premultiplied(tmp_path: Path) -> None:
    path = save(tmp_path / "a.7.png", [[(0, 255, 188, 255), (255, 255, 255, 51)]])
    images = open_pictures(path)
    assert images.numbers == (7,)
    middle = ((188 / 255 + 0.055) / 1.055) ** 2.4
    # Of three float32 operations, one of them a power whose argument is rounded: 2.4 + 2 roundings.
    assert np.abs(images.image(7) - [[[0.0, 1.0, middle], [0.2, 0.2, 0.2]]]).max() <= 5 * 2.0**-24
    opaque = open_pictures(save(tmp_path / "b.png", [[(0, 255, 255)]])).image(0)
    assert opaque.tolist() == [[[0.0, 1.0, 1.0]]]


def test_alpha_of_pngs_is_judged_where_both_have_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    texels = {"half": (0, 0, 0, 51), "whole": (0, 0, 0, 255), "opaque": (0, 0, 0)}
    half, whole, opaque = (save(tmp_path / name / "a.0001.png", [[texel] * 16] * 16) for name, texel in texels.items())
    found = run_json(capsys, half, whole, "--metrics", "mse")
    assert (found["mean"]["mse"], found["alpha"]["worst"]) == (0.0, pytest.approx(0.8))
    assert "alpha" not in run_json(capsys, half, opaque, "--metrics", "mse")


def test_pngs_are_judged_and_judge(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    capture = write_sequence(tmp_path / "capture", 3, reference=True)
    (tmp_path / "png").mkdir()
    truth = open_images(capture / "reference")
    for number in truth.numbers:
        write_png(tmp_path / "png" / f"mine_{number:04d}.png", to_picture(truth.image(number)))
    rounded = 20 * math.log10(2 * 255)  # half a step of 255
    asked = ("--metrics", "mse,psnr")
    by_capture = run_json(capsys, tmp_path / "png", capture, *asked)
    assert by_capture["mean"]["psnr"] >= rounded
    assert by_capture["equal_quality_samples"]["samples"] > 1
    judging = run_json(capsys, capture / "reference", tmp_path / "png", *asked, "--frames", "1-2")
    assert [row["frame"] for row in judging["frames"]] == [1, 2]
    assert judging["mean"]["psnr"] >= rounded
    assert (
        run_json(capsys, tmp_path / "png" / "mine_0001.png", tmp_path / "png", *asked, "--frames", "1-1")["mean"]["mse"]
        == 0
    )
    assert main(["compare", str(tmp_path / "png"), str(capture), *asked]) == 0
    assert "A: PNG, taken for sRGB: what was above white is lost\n" in capsys.readouterr().err
    (tmp_path / "png" / "mine_0001.png").unlink()
    assert "frame 1" in refusal(capsys, 66, tmp_path / "png", capture)


def test_pngs_that_cannot_be_read_are_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    good = save(tmp_path / "good" / "a.0001.png", [[(1, 2, 3)] * 40] * 30)
    deep = tmp_path / "deep.png"
    Pillow.fromarray(np.zeros((30, 40), np.uint16)).save(deep)
    assert "too many bits a channel (expected 8, found 16); write it with 8 bits, or as EXR" in refusal(
        capsys, 65, deep, good
    )
    for name, content, says in (
        ("text", b"text", "is not a PNG"),
        ("cut", good.read_bytes()[:60], "the PNG cannot be read"),
    ):
        (tmp_path / f"{name}.png").write_bytes(content)
        assert says in told(capsys, 65, tmp_path / f"{name}.png", good)
    save(tmp_path / "none" / "beauty.png", [[(1, 2, 3)]])
    assert "number the frames, as in beauty.0001.png" in refusal(capsys, 66, tmp_path / "none", good)
    assert "maps have the names of the pictures" in told(capsys, 64, good, good, "--heatmap", good.parent)
    assert Pillow.open(good).getpixel((0, 0)) == (1, 2, 3)
