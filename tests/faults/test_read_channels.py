"""Channels that are missing, of a wrong type, or named otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.frame import Frame
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame, write_image
from tests.io.test_bad_input import refusal
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_frame, read_frame

REQUIRED = ("R", "G", "B", "Z")
GROUPS = (("backward.u", "backward.v"), ("N.X", "N.Y", "N.Z"))
ALONE = ("A", "reactive", "id")
FLOATS = (*REQUIRED, *GROUPS[0], *GROUPS[1], "A", "reactive")


def full_frame() -> Frame:
    return make_frame(motion=True, alpha=True, reactive=True, object_id=True, normal=True)


def changed(folder: Path, **channels: Pixels | None) -> Path:
    """A frame with every channel there is, of which some are put in another way, or left out for None."""
    path = folder / "a.exr"
    write_frame(path, full_frame())
    sound, header = read_image(path)
    put = {name: plane for name, plane in (sound | channels).items() if plane is not None}
    write_image(path, put, header)
    return path


def filled(kind: type) -> Pixels:
    return np.ones((HEIGHT, WIDTH), kind)


def test_missing_channel_is_named_beside_those_that_exist(tmp_path: Path) -> None:
    for name in [*REQUIRED, *GROUPS[0], *GROUPS[1]]:
        message = refusal(changed(tmp_path, **{name: None}))
        assert f"channel {name}: channel is missing" in message, name
        assert f"found {' '.join(sorted({*FLOATS, 'id'} - {name}))}" in message, name


def test_one_component_of_a_vector_is_refused(tmp_path: Path) -> None:
    for name in [name for group in GROUPS for name in group]:
        others = dict.fromkeys(other for group in GROUPS if name in group for other in group if other != name)
        assert "channel is missing" in refusal(changed(tmp_path, **others)), name


def test_whole_numbers_are_no_light(tmp_path: Path) -> None:
    for name in FLOATS:
        message = refusal(changed(tmp_path, **{name: filled(np.uint32)}))
        assert f"channel {name}: wrong channel type (expected float, found uint)" in message, name


@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_object_numbers_are_whole(tmp_path: Path, kind: type) -> None:
    message = refusal(changed(tmp_path, id=filled(kind)))
    assert "channel id: wrong channel type (expected uint, found" in message


def test_half_depth_is_refused(tmp_path: Path) -> None:
    assert "channel Z: half-precision depth is refused" in refusal(changed(tmp_path, Z=filled(np.float16)))


@pytest.mark.parametrize(
    "renamed",
    [("r", "g", "b"), ("beauty.R", "beauty.G", "beauty.B"), ("red", "green", "blue"), ("left.R", "left.G", "left.B")],
    ids=" ".join,
)
def test_colour_of_another_name_is_no_colour(tmp_path: Path, renamed: tuple[str, ...]) -> None:
    new = dict.fromkeys("RGB") | dict.fromkeys(renamed, filled(np.float32))
    message = refusal(changed(tmp_path, **new))
    assert "channel R: channel is missing" in message
    assert all(name in message for name in renamed)


def test_extra_layers_are_left_alone(tmp_path: Path) -> None:
    for name in ["RGB", "diffuse.R", "R.R", "Z.front", "depth.Z", "AOV: ünïcode", "right.Z", "velocity.X"]:
        frame = read_frame(changed(tmp_path, **{name: filled(np.float32)}))
        np.testing.assert_array_equal(bits(frame.colour), bits(full_frame().colour))


@pytest.mark.parametrize("name", ALONE)
def test_channels_that_need_not_be_there(tmp_path: Path, name: str) -> None:
    frame = read_frame(changed(tmp_path, **{name: None}))
    assert {"A": frame.alpha, "reactive": frame.reactive, "id": frame.object_id}[name] is None


def test_half_colour_is_widened_exactly(tmp_path: Path) -> None:
    half = np.linspace(-4, 4, HEIGHT * WIDTH).astype(np.float16).reshape(HEIGHT, WIDTH)
    np.testing.assert_array_equal(read_frame(changed(tmp_path, R=half)).colour[..., 0], half.astype(np.float32))
