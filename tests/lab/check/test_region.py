"""``cltaa check`` on files whose data window is a region of the display window: fractions are of the latter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from cltaa.frame import Frame
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_image
from cltaa.lab.check.report import check_folder
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES

LEFT, TOP, COLUMNS, ROWS = 26, 8, 112, 72  # of 160 x 90


def write_region(folder: Path, frames: Sequence[Frame]) -> Path:
    """Write of each frame the pixels of a region, with the matrices of the whole."""
    folder.mkdir()
    window = LEFT, TOP, LEFT + COLUMNS - 1, TOP + ROWS - 1
    part = slice(TOP, TOP + ROWS), slice(LEFT, LEFT + COLUMNS)
    for frame in frames:
        path = folder / f"a.{frame.index:04d}.exr"
        planes = {name: plane[part] for name, plane in frame_planes(frame, path).items()}
        display = 0, 0, frame.width - 1, frame.height - 1
        write_image(path, planes, frame_attributes(frame), windows=(window, display))
    return folder


@pytest.mark.parametrize("name", ["spinner", "corridor"])
def test_a_correct_region_raises_no_alarm(name: str, scene: Scene, tmp_path: Path) -> None:
    report, _ = check_folder(write_region(tmp_path / "in", scene(name)))
    assert report.mistakes == []


@pytest.mark.parametrize(
    ("mistake", "option"),
    [
        ("motion-units-uv", "motion.units=uv"),
        ("motion-units-ndc", "motion.units=ndc"),
        ("motion-centred-on-half-uv", "motion.units=uv --input motion.offset=0.5,0.5"),
        ("motion-swapped-units-ndc", "motion.units=ndc --input motion.swap=true"),
        ("jitter-units-uv", "jitter.scale=160,90"),
    ],
)
def test_fractions_are_of_the_display_window(mistake: str, option: str, scene: Scene, tmp_path: Path) -> None:
    """Of vectors by their unit, not in pixels: the same profile reads a picture of another size."""
    report, _ = check_folder(write_region(tmp_path / "in", MISTAKES[mistake].plant(scene("spinner"))))
    found = [(finding.name, finding.option) for finding in report.mistakes]
    assert found == [(mistake, f"--input {option}")]


@pytest.mark.parametrize("unit", ["uv", "ndc"])
def test_vectors_of_a_unit_with_y_before_x_are_named(unit: str, scene: Scene, tmp_path: Path) -> None:
    folder = write_region(tmp_path / "in", MISTAKES[f"motion-swapped-units-{unit}"].plant(scene("spinner")))
    report, _ = check_folder(folder, assignments=[f"motion.units={unit}"])
    assert [(each.name, each.option) for each in report.mistakes] == [("motion-swapped", "--input motion.swap=true")]
