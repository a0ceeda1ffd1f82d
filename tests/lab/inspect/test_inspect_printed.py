"""What ``cltaa inspect`` prints for a reader, line by line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.frame import Effect
from tests.inputs.foreign import write_own
from tests.lab.inspect.test_inspect_command import sound
from tests.sequence_factory import HEIGHT, WIDTH, write_frames, write_images


def rows_of(capsys: pytest.CaptureFixture[str], folder: Path, *options: str, code: int = 0) -> dict[str, list[str]]:
    """What is printed, by the first cell of each line; cells lie two blanks or a rule apart."""
    assert main(["inspect", str(folder), *options]) == code
    lines = capsys.readouterr().out.splitlines()
    cells = [[cell for cell in re.split(r"\s{2,}|\s*│\s*", line.strip()) if cell] for line in lines]
    return {first: rest for first, *rest in filter(None, cells)}


def test_each_fact_has_a_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Of jitter that never changes, and of a truth of one sample."""
    effects = frozenset({Effect.CAMERA, Effect.CUT, Effect.EXPOSURE})
    frames = [sound(index, jitter_px=(0.25, -0.125), cut=index == 2, exposure=1.0 + index) for index in range(3)]
    write_frames(tmp_path, (replace(frame, effects=effects) for frame in frames))
    write_images(tmp_path / "reference", [frame.colour for frame in frames], name="synthetic", samples=1)
    rows = rows_of(capsys, tmp_path, code=65)
    assert rows["jitter"] == [
        "always the same, mean (0.25, -0.125) px (not centred: the image is shifted by it), at most 0.250 px"
    ]
    assert rows["reference"] == ["3 frames of 1 sample a pixel"]
    assert (rows["exposure"], rows["cuts"], rows["effects"]) == (["1 to 3"], ["2"], ["camera, cut, exposure"])
    assert rows["channels"] == ["B G R Z (float)"]
    assert rows["camera"] == ["moves, perspective"]


def test_a_mean_of_next_to_nothing_has_no_sign(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(index, jitter_px=(0.25 - 0.50001 * index, 0.0)) for index in range(2)])
    rows = rows_of(capsys, tmp_path)
    assert rows["jitter"][0].startswith("no repetition, mean (0, 0) px, ")
    assert (rows["exposure"], rows["reference"]) == (["1"], ["none"])


def test_the_name_of_a_channel_is_printed_to_the_letter(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """What rich would take for markup."""
    name = "[bold]x"
    write_own(tmp_path, [sound(0)], channels={name: np.full((HEIGHT, WIDTH), 2.5, np.float32)})
    assert rows_of(capsys, tmp_path, "--pixels")[name] == ["2.5", "2.5", "0", "0"]


def test_each_number_of_the_pixels_stands_under_its_heading(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    frame = sound(0, jitter_px=(0.0, 0.0))
    frame.colour[4, 5] = np.nan, 7.5, -np.inf
    frame.colour[4, 6, 0] = np.nan
    frame.colour[4, 7, 1] = -1.5
    frame.depth[:] = np.inf
    write_frames(tmp_path, [frame])
    rows = rows_of(capsys, tmp_path, "--pixels", code=65)
    assert rows["G"] == ["-1.5", "7.5", "0", "0"]
    assert [rows[name][2:] for name in "RB"] == [["2", "0"], ["0", "1"]]
    assert rows["Z"] == ["–", "–", "0", str(WIDTH * HEIGHT)]


def test_what_is_declared_and_never_shows_is_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    made = [sound(index, effects=frozenset({Effect.CAMERA, Effect.ALPHA})) for index in range(3)]
    write_frames(tmp_path, (replace(frame, alpha=np.ones_like(frame.depth)) for frame in made))
    assert main(["inspect", str(tmp_path), "--pixels"]) == 0
    assert "! effect alpha is declared, " in capsys.readouterr().out


def test_an_option_of_reading_tells_how_a_resolve_would_read(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Also files of cltaa's own; and headers alone are no reason to say that nothing is wrong."""
    write_frames(tmp_path / "in", [sound(index) for index in range(0, 6, 2)])
    side = tmp_path / "camera.csv"
    side.write_text("frame,exposure\n" + "".join(f"{number},2\n" for number in range(0, 6, 2)))
    for option in (["--input", "depth.scale=2"], ["--camera", str(side)]):
        rows = rows_of(capsys, tmp_path / "in", "--step", "2", *option)
        assert rows["profile"][0].startswith("cltaa: ")
        assert not any("no problem" in line for line in rows)
    assert "sequence" in rows_of(capsys, tmp_path / "in", "--step", "2")
    assert any("frames missing: 1, 3" in line for line in rows_of(capsys, tmp_path / "in", code=65))
