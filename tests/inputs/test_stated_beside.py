"""What the headers of files beside the colour say counts where that says nothing, if the files are read at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.inputs.intake import open_intake
from cltaa.io.exr_write import write_image
from tests.inputs.foreign import frames, read, write_colour

Header = dict[str, object]


def header(frame: Frame, **others: object) -> Header:
    stated: Header = {
        "cltaa:worldToView": np.ascontiguousarray(frame.camera.world_to_view.T),
        "cltaa:viewToClip": np.ascontiguousarray(frame.camera.view_to_clip.T),
        "cltaa:jitterPx": np.array(frame.jitter_px),
        "cltaa:exposure": 0.5,
        "cltaa:cut": int(frame.index == 1),
    }
    return stated | others


def write_shot(folder: Path, **spoilt: object) -> list[Frame]:
    """Frames whose colour says nothing; files of depth beside them say everything."""
    made = frames()
    write_colour(folder / "beauty", made)
    for frame in made:
        path = folder / "depth" / f"z.{frame.index:04d}.exr"
        path.parent.mkdir(exist_ok=True)
        write_image(path, {"Z": frame.depth}, header(frame, **spoilt))
    return made


def test_what_only_the_files_of_depth_say_is_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = write_shot(tmp_path)
    for ours, theirs in zip(made, read(tmp_path), strict=True):
        np.testing.assert_array_equal(theirs.camera.world_to_view, ours.camera.world_to_view)
        np.testing.assert_array_equal(theirs.camera.view_to_clip, ours.camera.view_to_clip)
        assert (theirs.jitter_px, theirs.exposure, theirs.cut) == (ours.jitter_px, 0.5, ours.index == 1)
    assert main(["inspect", str(tmp_path)]) == 0
    told = "matrices and jitter: from depth/z.0000.exr and those after it, for the colour's files have none"
    assert told in " ".join(capsys.readouterr().out.split())


def test_what_the_colour_says_comes_first(tmp_path: Path) -> None:
    made = write_shot(tmp_path)
    for frame in made:
        colour = {channel: frame.colour[..., place] for place, channel in enumerate("RGB")}
        write_image(tmp_path / "beauty" / f"picture.{frame.index:04d}.exr", colour, header(made[2]))
    for theirs in read(tmp_path):
        np.testing.assert_array_equal(theirs.camera.world_to_view, made[2].camera.world_to_view)
        assert (theirs.jitter_px, theirs.cut) == (made[2].jitter_px, False)
    assert not any("for the colour's files have none" in note for note in open_intake(tmp_path).notes)


@pytest.mark.parametrize("name", ["cltaa:worldToView", "cltaa:jitterPx", "cltaa:exposure", "cltaa:cut"])
def test_a_fault_names_the_file_that_it_is_in(name: str, tmp_path: Path) -> None:
    write_shot(tmp_path, **{name: "text"})
    with pytest.raises(DataError, match=rf"depth/z\.0000\.exr.*attribute {name} is "):
        read(tmp_path)


@pytest.mark.parametrize(("channel", "chosen"), [("M", "cltaa"), ("Z", "blender")])
def test_only_files_that_are_read_choose_the_profile(channel: str, chosen: str, tmp_path: Path) -> None:
    write_colour(tmp_path / "beauty", frames())
    (tmp_path / "beside").mkdir()
    for number in range(3):
        stated = {"Software": "Blender 5.0.1"}
        write_image(tmp_path / "beside" / f"x.{number:04d}.exr", {channel: np.ones((48, 64), np.float32)}, stated)
    assert open_intake(tmp_path).profile.name == chosen
