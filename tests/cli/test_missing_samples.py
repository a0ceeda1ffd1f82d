"""Each frame in which samples are missing is named once, with how many and where, by what reads the pixels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.io.exr_write import write_frame
from tests.sequence_factory import HEIGHT, WIDTH, make_frame

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
    (tmp_path / "in").mkdir()
    for frame in frames:
        write_frame(tmp_path / "in" / f"a.{frame.index:04d}.exr", frame)
    main(command.format(tmp_path / "in", tmp_path).split())
    said = " ".join(capsys.readouterr().out.split())
    assert [said.count(line) for line in (f"frames 1-2: {BLOCK}", BLOCK, WHOLE)] == [1, 1, 1]
