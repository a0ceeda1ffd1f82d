"""Sequences that Blender and Mitsuba rendered: recorded ones always, fresh ones where those tools are installed.

``scripts/third-party`` installs both into an environment of their own, renders, and runs all of this.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.cli import main
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.open import open_input
from cltaa.io.sequence import open_images
from cltaa.lab.check.report import check_folder

HERE = Path(__file__).parent
RECORDED = HERE / "recorded"
TOOLS = Path(os.environ.get("CLTAA_THIRD_PARTY", HERE.parents[1] / ".third-party")) / "bin" / "python"

fresh = [
    pytest.mark.big,
    pytest.mark.skipif(not TOOLS.exists(), reason="no Blender and Mitsuba here: run scripts/third-party"),
]


def render(tool: str, folder: Path, *numbers: int) -> Path:
    """Render with a tool in its own environment and process."""
    folder.mkdir()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(TOOLS), str(HERE / f"render_{tool}.py"), str(folder), *map(str, numbers)]
    subprocess.run(command, check=True, env=environment, capture_output=True, timeout=600)
    return folder


def mistakes(folder: Path, *, side: bool = True) -> list[str]:
    report, _ = check_folder(folder, side_file=folder / "camera.json" if side else None)
    return [finding.name for finding in report.mistakes]


def frames(folder: Path) -> ForeignSequence:
    sequence = open_input(folder, side_file=folder / "camera.json")
    assert isinstance(sequence, ForeignSequence)
    return sequence


def error(one: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    return float(np.sqrt(((one - truth) ** 2).mean()))


def test_recorded_blender() -> None:
    folder = RECORDED / "blender"
    lines = list(intake_lines(open_intake(folder, side_file=folder / "camera.json")))
    assert lines[0] == "profile blender: header attribute Software is Blender 5.0.1"
    assert "motion ViewLayer.Vector.X ViewLayer.Vector.Y" in lines[1]
    assert len(lines) == 2
    assert mistakes(folder) == []
    frame = frames(folder).frame(2)
    assert frame.motion is not None
    assert 3.0 < np.median(frame.depth) < 13.0
    assert 1.0 < np.abs(frame.motion).max() < 10.0


def test_recorded_mitsuba() -> None:
    folder = RECORDED / "mitsuba"
    lines = list(intake_lines(open_intake(folder, side_file=folder / "camera.json")))
    assert lines[0].startswith("profile mitsuba: header attribute generatedBy is Mitsuba version 3.9.1")
    assert mistakes(folder) == []
    report, _ = check_folder(folder, side_file=folder / "camera.json", assignments=["depth.kind=planar"])
    assert "depth-ray" in [finding.name for finding in report.mistakes]


@pytest.mark.parametrize("tool", ["blender", "mitsuba"])
def test_wrong_signs_are_found_in_recorded_files(tool: str) -> None:
    folder = RECORDED / tool
    wrong = ["jitter.scale=-1,-1"]
    report, _ = check_folder(folder, side_file=folder / "camera.json", assignments=wrong)
    assert [finding.name for finding in report.mistakes] == ["jitter-negated"]


@pytest.mark.parametrize("tool", [pytest.param(name, marks=fresh) for name in ("blender", "mitsuba")])
def test_fresh_sequences_are_read_right(tool: str, tmp_path: Path) -> None:
    numbers = (8, 160, 90, 1) if tool == "blender" else (8, 160, 90)
    assert mistakes(render(tool, tmp_path / tool, *numbers)) == []


@pytest.mark.parametrize("cameras", [pytest.param(given, marks=fresh) for given in (True, False)])
def test_blender_resolved_is_nearer_the_truth_than_its_input(cameras: bool, tmp_path: Path) -> None:
    rendered = render("blender", tmp_path / "in", 12, 160, 90, 1)
    truth = list(frames(render("blender", tmp_path / "truth", 12, 160, 90, 64)))
    side = ["--camera", str(rendered / "camera.json")] if cameras else []
    assert main(["resolve", str(rendered), *side, "-o", str(tmp_path / "out")]) == 0
    resolved = open_images(tmp_path / "out")
    for given, right in zip(list(frames(rendered))[3:], truth[3:], strict=True):
        # Seen: 0.4 to 0.6 of the input's error, in frames 4 to 16 of a longer render.
        assert error(resolved.image(right.index), right.colour) < 0.7 * error(given.colour, right.colour)
