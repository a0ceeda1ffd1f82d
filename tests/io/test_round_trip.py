"""What is written comes back: every bit of every channel, every attribute, in the layout other readers expect."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.core.planes import Layout, around
from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera, Frame
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_header import read_layout
from cltaa.io.exr_layout import COMPRESSION_NUMBERS, COMPRESSIONS, LOSSLESS
from cltaa.io.exr_read import read_header, read_image
from cltaa.io.exr_write import write_frame, write_image
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_camera, make_frame, read_frame, special_values

ARRAYS = ("colour", "depth", "motion", "alpha", "reactive", "object_id", "normal")


def round_trip(folder: Path, frame: Frame) -> Frame:
    path = folder / "synthetic.0007.exr"
    write_frame(path, frame)
    return read_frame(path)


def full_frame(**changes: Any) -> Frame:
    frame = make_frame(7, motion=True, alpha=True, reactive=True, object_id=True, normal=True)
    return replace(frame, **changes)


def assert_same_arrays(one: Frame, other: Frame) -> None:
    for name in ARRAYS:
        first, second = getattr(one, name), getattr(other, name)
        assert (first is None) == (second is None), name
        if first is not None:
            np.testing.assert_array_equal(bits(first), bits(second), err_msg=name)


def test_every_channel_and_attribute_comes_back(tmp_path: Path) -> None:
    frame = full_frame(cut=True, exposure=1 / 3, scene="größe", jitter_px=(1 / 3, -1 / 7))
    back = round_trip(tmp_path, frame)
    assert_same_arrays(frame, back)
    np.testing.assert_array_equal(back.camera.world_to_view, frame.camera.world_to_view)
    np.testing.assert_array_equal(back.camera.view_to_clip, frame.camera.view_to_clip)
    for name in ("index", "jitter_px", "cut", "exposure", "scene", "effects"):
        assert getattr(back, name) == getattr(frame, name), name
    assert back.path == tmp_path / "synthetic.0007.exr"


def test_absent_channel_stays_absent(tmp_path: Path) -> None:
    for absent in ["motion", "alpha", "reactive", "object_id", "normal"]:
        frame = full_frame(**{absent: None})
        assert_same_arrays(frame, round_trip(tmp_path, frame))


@pytest.mark.parametrize("effects", [None, frozenset()])
def test_no_declaration_differs_from_declaring_no_effect(tmp_path: Path, effects: frozenset[Any] | None) -> None:
    assert round_trip(tmp_path, full_frame(effects=effects)).effects == effects


def test_special_values_keep_every_bit(tmp_path: Path) -> None:
    special = special_values()
    frame = full_frame(colour=np.stack([special] * 3, axis=-1), depth=special, motion=np.stack([special] * 2, axis=-1))
    for compression in sorted(LOSSLESS):
        write_frame(tmp_path / "special.exr", frame, compression=compression)
        assert_same_arrays(frame, read_frame(tmp_path / "special.exr"))


@pytest.mark.parametrize("layout", ["flipped", "mirrored", "fortran", "strided", "sliced"])
def test_arrays_that_are_not_contiguous_are_written_right(tmp_path: Path, layout: str) -> None:
    big = np.random.default_rng(1).random((2 * HEIGHT, 2 * WIDTH, 4), dtype=np.float32)
    colour = {
        "flipped": big[HEIGHT - 1 :: -1, :WIDTH, :3],
        "mirrored": big[:HEIGHT, WIDTH - 1 :: -1, :3],
        "fortran": np.asfortranarray(big[:HEIGHT, :WIDTH, :3]),
        "strided": big[::2, ::2, :3],
        "sliced": big[:HEIGHT, :WIDTH, 1:],
    }[layout]
    assert not colour.flags.c_contiguous
    frame = full_frame(colour=colour, depth=colour[..., 0])
    assert_same_arrays(frame, round_trip(tmp_path, frame))


def test_channels_lie_in_planes_with_a_halo(tmp_path: Path) -> None:
    back = round_trip(tmp_path, full_frame())
    layout = Layout(back.width, back.height)
    assert back.motion is not None
    assert back.alpha is not None
    for planes in (np.moveaxis(back.colour, -1, 0), np.moveaxis(back.motion, -1, 0), back.alpha[None]):
        whole = around(planes, layout)
        assert whole is not None
        assert whole.shape == (len(planes), layout.rows, layout.stride)
        assert whole.flags.c_contiguous
        assert np.shares_memory(whole, planes)
    assert back.depth.flags.c_contiguous


@pytest.mark.parametrize("kind", [np.float16, np.float64, ">f4"])
def test_any_floats_that_are_resolved_are_written(kind: Any, tmp_path: Path) -> None:
    frame = make_frame()
    colour: Any = frame.colour.astype(np.float16).astype(kind)
    write_frame(tmp_path / "a.0000.exr", replace(frame, colour=colour))
    assert np.array_equal(read_frame(tmp_path / "a.0000.exr").colour, colour)


def test_standard_matrices_say_what_their_definition_says(tmp_path: Path) -> None:
    """Read as the EXR standard says (row vectors, left-handed camera, NDC from the upper left), without our reader."""
    frame = full_frame(camera=make_camera((1.0, 2.0, 5.0)))
    write_frame(tmp_path / "a.exr", frame)
    header = OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).header()
    assert header["worldToCamera"].dtype == header["worldToNDC"].dtype == np.float32
    # 2 right of, 1 above and 4 in front of a camera that looks along -z.
    point = np.array([1.0 + 2, 2.0 + 1, 5.0 - 4, 1.0])
    np.testing.assert_array_equal(point @ header["worldToCamera"], [2, 1, 4, 1])
    x, y, z, w = point @ header["worldToNDC"]
    clip = frame.camera.view_to_clip @ [2, 1, -4, 1]
    expected = (0.5 + clip[0] / clip[3] / 2, 0.5 - clip[1] / clip[3] / 2, 0.5 + clip[2] / clip[3] / 2)
    # Six float32 products and sums of magnitude below 10: 6 * 10 * 2^-24.
    np.testing.assert_allclose((x / w, y / w, z / w), expected, rtol=0, atol=6 * 10 * 2.0**-24)
    # Own matrices lie in the file as the standard ones do, in double precision.
    np.testing.assert_array_equal(header["cltaa:worldToView"], frame.camera.world_to_view.T)
    np.testing.assert_array_equal(header["cltaa:viewToClip"], frame.camera.view_to_clip.T)


def test_attribute_types_on_disk(tmp_path: Path) -> None:
    write_frame(tmp_path / "a.exr", full_frame(exposure=0.1))
    content = (tmp_path / "a.exr").read_bytes()
    expected = {
        "worldToCamera": "m44f",
        "worldToNDC": "m44f",
        "cltaa:worldToView": "m44d",
        "cltaa:viewToClip": "m44d",
        "cltaa:jitterPx": "v2d",
        "cltaa:frame": "int",
        "cltaa:cut": "int",
        "cltaa:exposure": "double",
        "cltaa:scene": "string",
        "cltaa:effects": "string",
    }
    for name, kind in expected.items():
        assert f"{name}\0{kind}\0".encode() in content


def test_an_orthographic_camera_survives_the_file(tmp_path: Path) -> None:
    camera = Camera(np.eye(4), np.diag([0.5, 0.25, -0.02, 1.0]))
    back = round_trip(tmp_path, full_frame(camera=camera)).camera
    assert back.orthographic
    np.testing.assert_array_equal(back.view_to_clip, camera.view_to_clip)


def test_image_of_mixed_types_and_attributes(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    channels: dict[str, Pixels] = {
        "R": random.random((5, 9)).astype(np.float16),
        "weight": random.random((5, 9), dtype=np.float32),
        "count": random.integers(0, 2**32, (5, 9), dtype=np.uint32),
    }
    attributes = {
        "framesPerSecond": Fraction(24, 1),
        "cltaa:preset": "plain",
        "cltaa:alpha": 0.1,
        "cltaa:frame": 3,
        "pixelAspectRatio": 2.0,
        "cltaa:matrix": np.arange(16.0).reshape(4, 4) / 3,
    }
    write_image(tmp_path / "image.exr", channels, attributes)
    pixels, back = read_image(tmp_path / "image.exr")
    for name, wanted in channels.items():
        assert pixels[name].dtype == wanted.dtype
        np.testing.assert_array_equal(pixels[name], wanted)
    for name, value in attributes.items():
        np.testing.assert_array_equal(back[name], value)
    assert read_header(tmp_path / "image.exr").layout.channels == {"R": "half", "count": "uint", "weight": "float"}


def test_table_of_compressions_is_that_of_the_library(tmp_path: Path) -> None:
    """In a file that OpenEXR wrote, the first entry of the chunk table points right behind the table's last."""
    height = 1024
    for name, rows in COMPRESSIONS:
        codec = OpenEXR.Compression(COMPRESSION_NUMBERS[name])
        assert codec.name == ("NO" if name == "none" else name.upper()) + "_COMPRESSION", name
        OpenEXR.File({"compression": codec}, {"Y": np.zeros((height, 2), np.float16)}).write(str(tmp_path / "a.exr"))
        assert read_layout(tmp_path / "a.exr").compression == name, name
        content = (tmp_path / "a.exr").read_bytes()
        table_size = 8 * height // rows
        entries = (int.from_bytes(content[place : place + 8], "little") - place for place in range(len(content)))
        assert table_size in entries, name


@pytest.mark.parametrize("compression", ["dwaa", "pxr24", "best"])
def test_lossy_or_unknown_compression_is_refused(tmp_path: Path, compression: str) -> None:
    with pytest.raises(UsageError, match="lossy"):
        write_frame(tmp_path / "a.exr", full_frame(), compression=compression)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth": np.ones((HEIGHT, WIDTH + 1), np.float32)}, "channel Z: array is wrong"),
        ({"alpha": np.ones((HEIGHT, WIDTH), np.int64)}, "channel A: array is wrong"),
        (
            {"motion": np.ones((HEIGHT, WIDTH, 3), np.float32)},
            r"backward.u: array is wrong .*found float32 \[23, 37, 3\]",
        ),
        ({"object_id": np.full((HEIGHT, WIDTH), 0.5, np.float32)}, "channel id: array is wrong"),
        ({"camera": Camera(np.full((4, 4), np.nan), np.eye(4))}, r"frame 7: camera\.world_to_view holds NaN"),
        ({"index": 1.5}, "index is wrong .*a whole number"),
        ({"effects": ["nonsense"]}, "effects are no set"),
        ({"effects": {"nonsense"}}, "unknown effect nonsense"),
        ({"colour": np.ones((0, WIDTH, 3), np.float32)}, "colour has the wrong shape .*at least one pixel"),
        ({"colour": np.zeros((HEIGHT, WIDTH, 4), np.uint8)}, "found uint8.*no linear light: decode them first"),
        ({"colour": [[1.0]]}, "colour is no array .expected one of the host, of numbers, found list"),
    ],
)
def test_wrong_arrays_are_not_written(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        write_frame(tmp_path / "a.exr", full_frame(**change))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["x0007_beauty.exr", "a10_x0007_b.exr", "x0007left.exr", "v2_beauty.exr", "beauty.exr"]
)
def test_a_frame_comes_back_from_any_name(tmp_path: Path, name: str) -> None:
    """By itself; a number that its folder may take for the frame's has to be that."""
    write_frame(tmp_path / name, make_frame(7))
    (frame,) = open_input(tmp_path / name)
    assert np.array_equal(frame.colour, make_frame(7).colour)
    if "0007" in name:
        with pytest.raises(DataError, match=r"has another number than the frame .expected 3, found 7"):
            write_frame(tmp_path / name, make_frame(3))


def test_frames_with_their_numbers_amid_their_names_come_back(tmp_path: Path) -> None:
    for number in (7, 8):
        write_frame(tmp_path / f"x{number:04d}_beauty.exr", make_frame(number))
    assert [frame.index for frame in open_input(tmp_path)] == [7, 8]
