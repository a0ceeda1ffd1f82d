"""Numbers that halves cannot hold: they saturate, and that is counted. docs/numerics.md, A4."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.build import Storage
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.pipeline.output import limit_halves, saturated_pixels
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
    given += ["--set", "disocclusion_blur=0", "--set", "current_filter=none"]
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
    for value in (65504.0, -1e9):
        image[2, 4, 3] = value
        assert saturated_pixels(image) == 1
    image[1, 2, :3] = 65504.0
    assert saturated_pixels(image) == 2


@pytest.mark.parametrize(("bright", "limited"), [(np.inf, 65504.0), (-np.inf, -65504.0)])
def test_a4_infinite_halves_are_limited_and_each_pixel_counted_once(bright: float, limited: float) -> None:
    image = np.random.default_rng(3).normal(0.0, 100.0, (3, 5, 7)).astype(np.float16)
    image[0, 1, 2], image[0, 1, 3] = 65504.0, -65504.0  # as floats they were less
    seen = np.moveaxis(image, 0, -1)  # as results lie in memory
    before = image.copy()
    assert limit_halves(seen) == 0
    assert image.tobytes() == before.tobytes()
    image[:2, 2, 3], image[2, 4, 6] = bright, bright
    before[:2, 2, 3], before[2, 4, 6] = limited, limited
    assert limit_halves(seen) == 2
    assert image.tobytes() == before.tobytes()
