"""Each frame in which samples are missing, or depths and vectors say nothing, is named once by what reads pixels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from tests.inputs.foreign import frames as sound_frames
from tests.inputs.foreign import write_blender, write_own
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, write_frames

BLOCK = f"36 of {WIDTH * HEIGHT} pixels are without a usable sample: x 5 to 10, y 4 to 9"
WHOLE = f"frame 3: all {WIDTH * HEIGHT} pixels are without a usable sample"


@pytest.mark.parametrize("command", ["resolve {} -o {}/out --device numpy", "inspect --pixels {}", "check {}"])
def test_each_frame_with_missing_samples_is_named_once(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alpha = np.ones((4, HEIGHT, WIDTH), np.float32)
    alpha[1:3, 7:10, 5:11] = np.nan
    frames = [replace(make_frame(index, effects=None), alpha=alpha[index]) for index in range(4)]
    for frame in frames[1:3]:
        frame.colour[4:7, 5:11] = np.nan
    frames[3].colour[:] = np.nan
    write_frames(tmp_path / "in", frames, "a")
    main(command.format(tmp_path / "in", tmp_path).split())
    said = " ".join(capsys.readouterr().out.split())
    assert [said.count(line) for line in (f"frames 1-2: {BLOCK}", BLOCK, WHOLE)] == [1, 1, 1]


@pytest.mark.parametrize("command", ["resolve {} -o {}/out --device numpy", "inspect --pixels {}"])
@pytest.mark.parametrize(
    ("channel", "value", "line", "own_too"),
    [
        ("depth", np.nan, f"frames 1-2: depth is NaN in all {WIDTH * HEIGHT} pixels: counts as the sky", True),
        ("motion", np.inf, f"frames 1-2: motion is infinite in all {WIDTH * HEIGHT} pixels: history is dropped", True),
        ("motion", np.nan, f"frames 1-2: motion is NaN in all {WIDTH * HEIGHT} pixels: taken to stand still", False),
    ],
)
@pytest.mark.parametrize("own", [True, False])
def test_depths_and_vectors_that_say_nothing_are_named_once(
    channel: str,
    value: float,
    line: str,
    own_too: bool,
    own: bool,
    command: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    frames = sound_frames(4)
    if channel == "motion":
        getattr(frames[0], channel)[:] = value  # they lead nowhere
    for frame in frames[1:3]:
        getattr(frame, channel)[:] = value
    (write_own if own else write_blender)(tmp_path / "in", frames)
    main(command.format(tmp_path / "in", tmp_path).split())
    told = capsys.readouterr()
    said = " ".join(told.out.split())
    assert (said.count(line), said.count(f": {channel} is")) == (1, 1) if own_too or not own else (0, 0)
    assert "everywhere" not in told.err
    assert "in places" not in told.err
