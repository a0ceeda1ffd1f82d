"""Channels that go from 0 to 1 and are beyond, and colour of bytes: told from Python and by each command that reads
pixels."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.frame_checks import MeaninglessNumbers
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Frame
from cltaa.inputs.open import open_input
from cltaa.io.exr_write import write_frame
from cltaa.io.pixel_statistics import meaningless
from cltaa.lab.judge.metrics import measure
from tests.sequence_factory import make_frame

# What a frame holds: the changes, the line from Python, and that of a command.
WRONG: dict[str, tuple[str, str]] = {
    "alpha": (
        r"^alpha is beyond its range .expected 0 to 1, found \d+.*; counts as 0 or 1 there; divide bytes by 255$",
        "frames 0-2: alpha is beyond 0 to 1 in up to",
    ),
    "reactive": (r"^reactive is beyond its range .expected 0 to 1", "frames 0-2: reactive is beyond 0 to 1 in"),
    "colour": (
        r"^colour is whole numbers up to 255 .expected linear light.; bytes of a picture have to be decoded",
        "frames 0-2: colour is whole numbers up to 255 in all 851 pixels",
    ),
}


def wrong(name: str, index: int) -> Frame:
    """A frame whose channel ``name`` is in bytes."""
    frame = make_frame(index, alpha=True, reactive=True)
    plane: Any = getattr(frame, name)
    return replace(frame, **{name: np.rint(plane / plane.max() * 255).astype(np.float32)})


@pytest.mark.parametrize("name", WRONG)
def test_bytes_are_told(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from_python, of_command = WRONG[name]
    with pytest.warns(MeaninglessNumbers, match=from_python) as told:
        Resolver("fast", "numpy").resolve(wrong(name, 0))
    assert len(told) == 1
    (tmp_path / "in").mkdir()
    for index in range(3):
        write_frame(tmp_path / "in" / f"x.{index:04d}.exr", wrong(name, index))
    capfd.readouterr()
    for line in ("resolve {} -o {}/out --device numpy", "inspect --pixels {}", "check {}"):
        main([word.format(tmp_path / "in") for word in line.replace("{}/out", f"{tmp_path}/out").split()])
        said = capfd.readouterr()
        assert " ".join(said.out.split()).count(of_command) == 1, line


FAR, NOWHERE = (np.full((23, 37, 2), number, np.float32) for number in (1e9, np.nan))
FROM_PYTHON: list[tuple[dict[str, Any], str]] = [
    (
        {"colour": -np.ones((23, 37, 3), np.float32)},
        "^colour is negative everywhere .expected linear light.; light adds",
    ),
    (
        {"reactive": np.full((23, 37), np.nan, np.float32)},
        "^reactive is NaN everywhere .expected 0 to 1.; counts as 0; ",
    ),
    ({"motion": FAR}, "^motion is longer than the picture everywhere, so there is no history; it is in pixels to the"),
    (
        {"motion": NOWHERE, "depth": None},
        "^motion is NaN everywhere, and no camera and depth stand in for it; leave it",
    ),
]


@pytest.mark.parametrize(("changes", "line"), FROM_PYTHON)
def test_numbers_that_mean_nothing_are_told(changes: dict[str, Any], line: str, tmp_path: Path) -> None:
    with pytest.warns(MeaninglessNumbers, match=line) as told:
        Resolver("fast", "numpy").resolve(replace(make_frame(0), **changes))
    assert len(told) == 1
    if "depth" not in changes:  # which files have
        write_frame(tmp_path / "x.0000.exr", replace(make_frame(0), **changes))
        (said,) = meaningless(open_input(tmp_path).frame(0), first=False)
        assert said.pixels == 23 * 37


def test_bytes_are_told_where_they_are_judged() -> None:
    with pytest.warns(UserWarning, match="^the reference is whole numbers up to 255 .expected linear light.; bytes of"):
        measure(np.ones((16, 16, 3), np.float32), np.arange(768, dtype=np.float32).reshape(16, 16, 3) % 256, "mse")


def test_halves_are_not_asked_for_beside_an_array_of_floats() -> None:
    frame = make_frame(0)
    with pytest.raises(UsageError, match="half=True, but out holds float32; leave half out: the type of out counts"):
        Resolver("fast", "numpy").resolve(frame, half=True, out=np.empty_like(frame.colour))  # type: ignore[call-overload]


def test_what_a_filter_left_beyond_is_not_told() -> None:
    frame = make_frame(0, alpha=True, reactive=True)
    assert frame.alpha is not None
    rings = replace(frame, alpha=frame.alpha * np.float32(1.4) - np.float32(0.2), colour=np.ones_like(frame.colour))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Resolver("fast", "numpy").resolve(rings)
