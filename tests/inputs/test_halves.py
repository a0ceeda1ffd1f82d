"""Half of what belongs together: one component of a vector, two of a colour, one of the two matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.io.exr_frame import frame_attributes
from cltaa.io.exr_write import write_image
from tests.sequence_factory import make_frame

PLANE = np.ones((5, 7), np.float32)
VECTORS = [
    ("mvec.X", "beside mvec.X is no mvec.Y: write both"),
    ("velocity.y", "beside velocity.y is no velocity.x: write both"),
    ("backward.v", "beside backward.v is no backward.u: write both"),
    ("Vector.R", "beside Vector.R is no Vector.G: write both"),
    ("motion_u", "beside motion_u is no motion_v: write both"),
    ("mvec.X mvec.Y", "to take those in mvec.X mvec.Y: --input motion.channels='mvec.X mvec.Y', which cltaa check"),
]
COLOURS = [
    ("R Z", "beside R is no G B: write all"),
    ("beauty.R beauty.G", "beside beauty.R beauty.G is no beauty.B: write all"),
    ("Red Green", "beside Red Green is no Blue: write all"),
    ("mvec.X Z", "none of them is a picture: write R G B beside; beside mvec.X is no mvec.Y: write all"),
    ("Z", "none of them is a picture: write R G B beside"),
]


def written(folder: Path, channels: str) -> Path:
    write_image(folder / "x.0000.exr", dict.fromkeys(channels.split(), PLANE))
    return folder


@pytest.mark.parametrize(("channels", "line"), VECTORS)
def test_a_component_that_vectors_lack_is_named(channels: str, line: str, tmp_path: Path) -> None:
    lines = intake_lines(open_intake(written(tmp_path, f"R G B {channels}")))
    assert [line in each for each in lines if each.startswith("no motion vectors: ")] == [True]


@pytest.mark.parametrize(("channels", "line"), COLOURS)
def test_a_component_that_a_colour_lacks_is_named(channels: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(DataError) as told:
        open_intake(written(tmp_path, channels))
    assert str(told.value).partition("); ")[2] == line


def test_a_matrix_without_the_other_is_named(tmp_path: Path) -> None:
    for name, other in (("worldToView", "viewToClip"), ("viewToClip", "worldToView")):
        kept = {f"cltaa:{name}": frame_attributes(make_frame(0))[f"cltaa:{name}"]}
        write_image(tmp_path / "x.0000.exr", dict.fromkeys("RGB", PLANE), kept)
        lines = [*intake_lines(open_intake(tmp_path, profile="parts"))]
        assert any(f"; beside attribute cltaa:{name} is no cltaa:{other}: write both" in line for line in lines)
