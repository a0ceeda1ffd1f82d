"""Numbers that halves cannot hold, NUMERICS A4: they saturate, and that is counted. See docs/numerics.md."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.build import Storage
from cltaa.cli import main
from cltaa.device_launcher import DeviceLauncher
from cltaa.exr_read import read_image
from cltaa.exr_write import write_frame
from cltaa.halves import image_channels, saturated_pixels
from tests.numerics.still_frames import accumulator, grey, still_frame
from tests.sequence_factory import make_frame


@pytest.mark.parametrize("storage", [Storage.HALF, Storage.HALF_STOCHASTIC])
def test_a4_half_history_saturates(launcher: DeviceLauncher, storage: Storage) -> None:
    values = np.array([[65504.0, 65519.0, 65520.0, 1e6, 1e15, 1e30, -65520.0, -1e6, 1.0]], np.float32)
    resolver = accumulator(launcher, 0.1, storage)
    for index in range(4):
        resolved = resolver.resolve(still_frame(index, grey(values)))
        assert np.isfinite(resolved).all()
        # 1e30 is outside the domain: it becomes the mean of 1e15 and -65520, which saturates as well.
        assert resolved[0, :6, 0].tolist() == [65504.0] * 6
        assert resolved[0, 6:, 0].tolist() == [-65504.0, -65504.0, 1.0]


@pytest.mark.parametrize(
    ("options", "counted"),
    [([], 0), (["--half"], 2 * 4), (["--storage", "half"], 2 * 4), (["--storage", "half-stochastic", "--half"], 2 * 4)],
)
def test_a4_what_saturated_is_counted(
    tmp_path: Path, options: list[str], counted: int, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "in").mkdir()
    for index in range(2):
        frame = make_frame(index, camera=make_frame(0).camera)
        colour = frame.colour.copy()
        colour[4, 2:14:2, 1] = [65472.0, 65504.0, 65520.0, 1e15, -65520.0, 1e30]  # the last is repaired instead
        write_frame(tmp_path / "in" / f"a.{index:04d}.exr", replace(frame, colour=colour, cut=True))
    given = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]
    given += ["--set", "fresh_blur=0", "--set", "current_filter=none"]
    assert main([*given, *options, "--json"]) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert (outcome["saturated"], outcome["repaired"]) == (counted, 2)
    assert json.loads((tmp_path / "out" / "resolve.json").read_text())["outcome"]["saturated"] == counted
    green = read_image(tmp_path / "out" / "a.0001.exr")[0]["G"][4, 2:14:2].astype(np.float32)
    assert np.isfinite(green).all()
    if counted:
        assert green[1:5].tolist() == [65504.0, 65504.0, 65504.0, -65504.0]
    assert main([*given, *options, "--restart"]) == 0
    assert (f"{counted} pixels saturated at 65504" in capsys.readouterr().out) == bool(counted)


def test_a4_a_pixel_is_counted_once_and_alpha_with_it() -> None:
    image = np.ones((3, 5, 4), np.float32)
    assert saturated_pixels(image) == 0
    image[1, 2, :3] = 65504.0
    image[2, 4, 3] = -1e9
    assert saturated_pixels(image) == 2


@pytest.mark.parametrize("bright", [65503.99, -65503.99, 65520.0, -1e9])
def test_a4_limiting_is_left_out_only_where_it_changes_no_bit(bright: float) -> None:
    image = np.random.default_rng(3).normal(0.0, 100.0, (5, 7, 3)).astype(np.float32)
    image[2, 3, 1] = bright
    within = not saturated_pixels(image)
    assert within == (abs(bright) < 65504)
    found, limited = image_channels(image, half=True, within=within), image_channels(image, half=True)
    assert {name: plane.tobytes() for name, plane in found.items()} == {
        n: plane.tobytes() for n, plane in limited.items()
    }
