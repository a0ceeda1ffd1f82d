"""Of other tools' files those channels are kept that play a role or are asked for, whatever the file is made of."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.cli import main
from cltaa.errors import DataError
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_read import read_image, read_planes
from cltaa.lab.inspect.findings import inspect_input
from tests.inputs.foreign import read, write_parts
from tests.sequence_factory import bits

HEIGHT, WIDTH = 41, 23


def planes() -> dict[str, Pixels]:
    """A picture with depth and vectors among what nobody asks for, of every type."""
    random = np.random.default_rng(3)
    names = ["R", "G", "B", "A", "Z", "backward.u", "backward.v", "N.X", "diffuse.R", "emission.R"]
    made: dict[str, Pixels] = {name: random.random((HEIGHT, WIDTH), np.float32) for name in names}
    made["diffuse.R"] = made["diffuse.R"].astype(np.float16)
    return made | {"id": random.integers(0, 2**32, (HEIGHT, WIDTH), np.uint32)}


def lines(path: Path) -> None:
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes()).write(str(path))


def tiles(path: Path) -> None:
    tile = OpenEXR.TileDescription()
    tile.xSize, tile.ySize = 16, 8
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tile}
    OpenEXR.File(header, planes()).write(str(path))


def parts(path: Path) -> None:
    """One for the picture, one for each other pass."""
    of_part: dict[str, dict[str, Pixels]] = {}
    for name, plane in planes().items():
        of_part.setdefault(name.split(".")[0] if "." in name else "rgba" if name in "RGBA" else "data", {})[name] = (
            plane
        )
    write_parts(path, of_part, {})


FILES = pytest.mark.parametrize("write", [lines, tiles, parts])


ROLES = ["A", "B", "G", "R", "Z", "backward.u", "backward.v"]


def asked(write: Callable[[Path], None]) -> list[str]:
    """What says which channels are the colour, where names alone do not."""
    return ["colour.channels=rgba.R rgba.G rgba.B", "depth.channels=data.Z"] if write is parts else []


@pytest.fixture
def read_of(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the channels that are kept of the files that are read, in turn."""
    names = list[str]()

    def told(*arguments: Any, **more: Any) -> dict[str, Pixels]:
        found = read_planes(*arguments, **more)
        names.extend(name.split(".", 1)[1] if name.startswith(("rgba.", "data.")) else name for name in found)
        return found

    monkeypatch.setattr("cltaa.inputs.foreign.read_planes", told)
    return names


@FILES
def test_a_frame_keeps_what_plays_a_role(write: Callable[[Path], None], tmp_path: Path, read_of: list[str]) -> None:
    write(tmp_path / "a.0001.exr")
    (frame,) = read(tmp_path, *asked(write))
    assert sorted(read_of) == ROLES
    assert frame.motion is not None
    assert frame.alpha is not None
    found = [*np.moveaxis(frame.colour, -1, 0), frame.depth, *np.moveaxis(frame.motion, -1, 0), frame.alpha]
    for name, plane in zip(("R", "G", "B", "Z", "backward.u", "backward.v", "A"), found, strict=True):
        np.testing.assert_array_equal(plane, planes()[name], err_msg=name)


@FILES
def test_a_picture_to_be_judged_keeps_its_colour(
    write: Callable[[Path], None], tmp_path: Path, read_of: list[str]
) -> None:
    write(tmp_path / "a.0001.exr")
    sequence = open_input(tmp_path, assignments=asked(write))
    assert isinstance(sequence, ForeignSequence)
    assert sequence.colour(1).shape == (HEIGHT, WIDTH, 3)
    assert sorted(read_of) == ["B", "G", "R"]


@FILES
def test_a_result_keeps_the_layers_that_were_read_with_its_frame(
    write: Callable[[Path], None], tmp_path: Path, read_of: list[str]
) -> None:
    (tmp_path / "in").mkdir()
    write(tmp_path / "in" / "a.0001.exr")
    options = [word for each in asked(write) for word in ("--input", each)] + [
        "--layers",
        "*diffuse.R,*id",
        "--effects",
        "all",
    ]
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy", *options]) == 0
    assert sorted(read_of) == sorted([*ROLES, "diffuse.R", "id"])
    kept = read_image(tmp_path / "out" / "a.0001.exr")[0]
    for name in ("diffuse.R", "id"):
        (found,) = [plane for channel, plane in kept.items() if channel.endswith(name)]
        assert found.dtype == planes()[name].dtype
        np.testing.assert_array_equal(found, planes()[name])


@FILES
def test_channels_are_read_by_their_names(write: Callable[[Path], None], tmp_path: Path) -> None:
    write(tmp_path / "a.exr")
    every = read_planes(tmp_path / "a.exr")
    assert len(every) == len(planes())
    for name, plane in every.items():
        expected = next(its for own, its in planes().items() if name in (own, f"rgba.{own}", f"data.{own}"))
        assert plane.dtype == expected.dtype
        np.testing.assert_array_equal(bits(plane), bits(expected), err_msg=name)
    few = read_planes(tmp_path / "a.exr", {"Z", "data.Z", "nothing"})
    assert [name.split(".")[-1] for name in few] == ["Z"]


def test_a_missing_channel_is_reported_with_the_existing_ones(tmp_path: Path) -> None:
    lines(tmp_path / "a.0001.exr")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    there = {name: plane for name, plane in planes().items() if name not in ("A", "id")}
    OpenEXR.File(header, there).write(str(tmp_path / "a.0002.exr"))
    said = (
        r"a\.0002\.exr channel A: channel is missing \(found B G N\.X R Z backward\.u backward\.v diffuse\.R "
        r"emission\.R\); render it again, or do without: --input colour\.alpha='none'"
    )
    with pytest.raises(DataError, match=said):
        open_input(tmp_path)  # before anything is resolved
    assert any(re.search(said, line) for line in inspect_input(tmp_path).problems)
    assert [frame.index for frame in open_input(tmp_path, frames=(1, 1))] == [1]


def test_whole_numbers_in_a_later_frame_are_no_depth(tmp_path: Path) -> None:
    lines(tmp_path / "a.0001.exr")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes() | {"Z": planes()["id"]}).write(str(tmp_path / "a.0002.exr"))
    with pytest.raises(
        DataError, match=r"a\.0002\.exr channel Z: wrong channel type \(expected half or float, found uint"
    ) as error:
        open_input(tmp_path)
    option = str(error.value).partition("do without: --input ")[2]
    assert len(open_input(tmp_path, assignments=shlex.split(option))) == 2
    assert len(inspect_input(tmp_path).problems) == 1


@pytest.mark.parametrize("damage", [lambda whole: whole[:-99], lambda whole: whole.replace(b"\0Z\0\2", b"\0Y\0\2")])
def test_a_pass_of_its_own_is_looked_at_before_anything_is_resolved(
    damage: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    for name, channels in (("beauty", "RGB"), ("depth", "Z")):
        (tmp_path / name).mkdir()
        for number in (1, 2, 3):
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            path = tmp_path / name / f"x.{number:04d}.exr"
            OpenEXR.File(header, {each: planes()[each] for each in channels}).write(str(path))
    assert open_input(tmp_path).frame(3).has_depth
    damaged = tmp_path / "depth" / "x.0003.exr"
    whole = damaged.read_bytes()
    damaged.write_bytes(damage(whole))
    assert damaged.read_bytes() != whole
    with pytest.raises(DataError, match=r"depth/x\.0003\.exr"):
        open_input(tmp_path)
