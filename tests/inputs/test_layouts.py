"""Every layout that an EXR may have and tools write, with each tool's names, through every command."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.cli import main
from cltaa.errors import DataError, InputMissing
from cltaa.inputs.intake import open_intake
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_layout import Window
from cltaa.io.exr_read import full_name, read_any_header, read_image, read_planes
from cltaa.io.exr_write import write_image
from cltaa.io.openexr import OpenEXR
from cltaa.io.sequence import open_images, open_sequence
from tests.faults.exr_surgery import Anatomy, as_part, assembled_parts, channel, window
from tests.sequence_factory import read_frame, write_sequence

WIDTH, HEIGHT, COUNT = 28, 20, 3
DISPLAY: Window = (5, 3, 5 + WIDTH - 1, 3 + HEIGHT - 1)  # whose origin is not 0
MARGIN = 4  # of overscan
REGION: Window = (9, 6, 24, 18)
Planes = dict[str, NDArray[np.float32]]  # of layer.channel, over the display window and the margin around it


def drawn(number: int) -> Planes:
    """Light, depth and a matte with the margin, all of them everywhere other than 0."""
    random = np.random.default_rng(number)
    shape = HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN
    planes: Planes = {f"light.{c}": random.random(shape, np.float32) for c in "RGBA"}
    return planes | {"depth.Z": 2 + random.random(shape, np.float32), "matte.mask": np.ones(shape, np.float32)}


def of(plane: NDArray[np.float32], window: Window) -> NDArray[np.float32]:
    """What of a plane lies in a window, which is not beyond the margin."""
    left, top = DISPLAY[0] - MARGIN, DISPLAY[1] - MARGIN
    return np.ascontiguousarray(plane[window[1] - top : window[3] - top + 1, window[0] - left : window[2] - left + 1])


# What the layers, and the channels of light and depth, are called; attributes that name the tool.
Tool = tuple[dict[str, str], dict[str, str], dict[str, object]]
TOOLS: dict[str, Tool] = {
    "plain": ({"light": "rgba", "depth": "depth", "matte": "matte"}, {}, {}),
    "nuke": ({"light": "rgba.main", "depth": "depth.main", "matte": "matte.main"}, {}, {"nuke/version": "13.1v2"}),
    "nuke, full names": (
        {"light": "rgba", "depth": "depth", "matte": "matte"},
        dict(zip("RGBA", ("red", "green", "blue", "alpha"), strict=True)),
        {"nuke/version": "15.0v1"},
    ),
    "blender": (
        {"light": "View Layer.Combined", "depth": "View Layer.Depth", "matte": "View Layer.Matte"},
        {},
        {"Software": "Blender 4.2"},
    ),
    "arnold": ({"light": "RGBA", "depth": "Z", "matte": "matte"}, {}, {"arnold/version": "7"}),
    "unreal": (
        {"light": "FinalImage", "depth": "FinalImageWorldDepth", "matte": "Matte"},
        {"Z": "R"},
        {"unreal/engineVersion": "5.4"},
    ),
    "nuke, one part": ({"light": "", "depth": "depth", "matte": "matte"}, {}, {"nuke/version": "13.1v2"}),
    "a tool that calls its layers as others do": (
        {"light": "colour", "depth": "depth", "matte": "matte"},
        {},
        {"arnold/version": "7"},
    ),
}

TILE = OpenEXR.TileDescription()
TILE.xSize, TILE.ySize = 16, 8


def box(window: Window) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return np.array(window[:2], np.int32), np.array(window[2:], np.int32)


def header(tool: Tool, window: Window, *, tiled: bool) -> dict[str, object]:
    kind = {"type": OpenEXR.tiledimage, "tiles": TILE} if tiled else {"type": OpenEXR.scanlineimage}
    windows = {"dataWindow": box(window), "displayWindow": box(DISPLAY)}
    return kind | windows | {"compression": OpenEXR.ZIP_COMPRESSION} | tool[2]


def write_parts(path: Path, tool: Tool, planes: Planes, windows: dict[str, Window], *, tiled: bool = False) -> None:
    """A part for each layer that has a window, in the order of the windows."""
    layers, channels, _ = tool
    made = []
    for layer, data in windows.items():
        its = {name.split(".")[1]: of(plane, data) for name, plane in planes.items() if name.split(".")[0] == layer}
        names = {channels.get(name, name): plane for name, plane in its.items()}
        view = {"view": "main"} if ".main" in layers[layer] else {}
        made.append(OpenEXR.Part(header(tool, data, tiled=tiled) | view | {"name": layers[layer]}, names))
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File(made).write(str(path))


def write_one(path: Path, tool: Tool, planes: Planes, data: Window, *, tiled: bool = False) -> None:
    """All layers in one part, whose channels have their names before them."""
    layers, channels, _ = tool
    names = {}
    for name, plane in planes.items():
        layer, last = name.split(".")
        names[f"{layers[layer]}.{channels.get(last, last)}".lstrip(".")] = of(plane, data)
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File(header(tool, data, tiled=tiled), names).write(str(path))


OVERSCAN: Window = (DISPLAY[0] - MARGIN, DISPLAY[1] - MARGIN, DISPLAY[2] + MARGIN, DISPLAY[3] + MARGIN)
ALL = ("light", "depth", "matte")


def wandering(number: int) -> Window:
    """As autocrop makes it: another in every frame, partly beyond the display window."""
    return DISPLAY[0] - 3 + 2 * number, DISPLAY[1] + 2, DISPLAY[2] - 6 + 3 * number, DISPLAY[3] - number


# The data windows of light, depth and matte in each frame, and the picture that a resolve makes of them.
WINDOWS: dict[str, tuple[Callable[[int], tuple[Window, Window, Window]], Window]] = {
    "alike": (lambda _: (DISPLAY,) * 3, DISPLAY),
    "region": (lambda _: (REGION,) * 3, REGION),
    "overscan": (lambda _: (OVERSCAN,) * 3, OVERSCAN),
    "matte wanders": (lambda number: (DISPLAY, DISPLAY, wandering(number)), DISPLAY),
    "depth is cropped": (lambda number: (DISPLAY, wandering(number), REGION), DISPLAY),
    "depth has overscan": (lambda _: (DISPLAY, OVERSCAN, REGION), DISPLAY),
    "colour is a region": (lambda _: (REGION, DISPLAY, OVERSCAN), REGION),
    "all wander": (lambda number: (wandering(number),) * 3, DISPLAY),
    "one frame shows nothing": (
        lambda number: ((1, 1, 1, 1) if number == 1 else DISPLAY, DISPLAY, DISPLAY),
        DISPLAY,
    ),
}


def expected(plane: NDArray[np.float32], data: Window, picture: Window, outside: float) -> NDArray[np.float32]:
    """A plane in the picture, by the definition: outside of its data window there is nothing."""
    left, top = DISPLAY[0] - MARGIN, DISPLAY[1] - MARGIN
    y, x = np.mgrid[: plane.shape[0], : plane.shape[1]]
    inside = (x + left >= data[0]) & (x + left <= data[2]) & (y + top >= data[1]) & (y + top <= data[3])
    return of(np.where(inside, plane, np.float32(outside)), picture)


CASES = [
    *((tool, "alike", "parts") for tool, its in TOOLS.items() if its[0]["light"]),
    *((tool, "alike", "one") for tool in TOOLS if tool != "nuke"),
    ("plain", "alike", "tiled parts"),
    ("blender", "alike", "tiles"),
    *(("plain", windows, "parts") for windows in WINDOWS),
    *(("nuke", windows, "parts") for windows in ("depth is cropped", "all wander", "one frame shows nothing")),
    *(("blender", windows, "one") for windows in ("region", "overscan")),
    ("blender", "all wander", "tiles"),
]


@pytest.mark.parametrize(("tool", "windows", "kind"), dict.fromkeys(CASES))
def test_every_layout_is_read_by_every_command(
    tool: str, windows: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, (window_of, picture) = tmp_path / "in", WINDOWS[windows]
    for number in range(COUNT):
        path, its = folder / f"shot.{number:04d}.exr", dict(zip(ALL, window_of(number), strict=True))
        tiled = kind.startswith("tile")
        if kind in ("parts", "tiled parts"):
            write_parts(path, TOOLS[tool], drawn(number), its, tiled=tiled)
        else:
            write_one(path, TOOLS[tool], drawn(number), its["light"], tiled=tiled)
    sequence = open_input(folder, assignments=["depth.kind=planar"])
    for number, frame in zip(range(COUNT), sequence, strict=True):
        planes, (light, depth, _) = drawn(number), window_of(number)
        for place, name in enumerate("RGB"):
            wanted = expected(planes[f"light.{name}"], light, picture, 0.0)
            np.testing.assert_array_equal(frame.colour[..., place], wanted)
        assert frame.alpha is not None
        np.testing.assert_array_equal(frame.alpha, expected(planes["light.A"], light, picture, 0.0))
        np.testing.assert_array_equal(frame.depth, expected(planes["depth.Z"], depth, picture, np.inf))
    asked = ["--input", "depth.kind=planar"]
    assert main(["inspect", str(folder), *asked, "--pixels", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["frames"], told["width"], told["height"]) == (COUNT, *reversed(sequence.frame(0).colour.shape[:2]))
    assert any("data windows differ" in note for note in told["notes"]) is (windows in ("all wander", WANDERS))
    main(["check", str(folder), *asked, "--json"])
    damaged = [f["name"] for f in json.loads(capsys.readouterr().out)["findings"] if f["what"].endswith("is damaged")]
    assert not damaged  # what lies outside of a window is not
    out = tmp_path / "out"
    assert main(["resolve", str(folder), *asked, "-o", str(out), "--device", "numpy", "--preset", "basic"]) == 0
    capsys.readouterr()
    assert main(["compare", str(out), str(folder), *asked, "--metrics", "mse", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["frames"]) == COUNT
    for number in range(COUNT):
        resolved = read_any_header(out / f"shot.{number:04d}.exr").layout
        assert (resolved.data_window, resolved.display_window) == (picture, DISPLAY)
        (mask,) = [name for name in resolved.channels if name.endswith("mask")]
        kept = read_image(out / f"shot.{number:04d}.exr")[0][mask]
        data = window_of(number)[2 if "parts" in kind else 0]
        np.testing.assert_array_equal(kept, expected(drawn(number)["matte.mask"], data, picture, 0.0))


WANDERS = "one frame shows nothing"


def test_a_picture_may_be_in_parts_of_its_views(tmp_path: Path) -> None:
    layers: dict[str, Tool] = {
        view: ({"light": f"rgba.{view}", "depth": f"depth.{view}"}, {}, {}) for view in ("left", "right")
    }
    path = tmp_path / "shot.0001.exr"
    parts = []
    for number, (view, (names, _, _)) in enumerate(layers.items()):
        for layer, name in names.items():
            its = {n.split(".")[1]: of(p, DISPLAY) for n, p in drawn(number).items() if n.startswith(layer)}
            tool: Tool = (names, {}, {"nuke/version": "13"})
            parts.append(OpenEXR.Part(header(tool, DISPLAY, tiled=False) | {"view": view, "name": name}, its))
    OpenEXR.File(parts).write(str(path))
    for number, view in enumerate(layers):
        (frame,) = open_input(tmp_path, assignments=[f"colour.view={view}", "depth.kind=planar"])
        np.testing.assert_array_equal(frame.depth, of(drawn(number)["depth.Z"], DISPLAY))
        np.testing.assert_array_equal(frame.colour[..., 0], of(drawn(number)["light.R"], DISPLAY))


def of_two(folder: Path, spoil: Callable[[Anatomy], object], *, first: bool) -> Path:
    """A file of two parts, one of which is spoilt."""
    folder.mkdir(exist_ok=True)
    sound = folder / "sound.exr"
    write_image(sound, {name: of(plane, DISPLAY) for name, plane in zip("RGB", drawn(0).values(), strict=False)})
    parts = [as_part(sound, "rgba"), as_part(sound, "other")]
    sound.unlink()
    spoil(parts[1])
    (folder / "shot.0001.exr").write_bytes(assembled_parts(parts[::-1] if first else parts))
    return folder


def put(name: bytes, value: bytes) -> Callable[[Anatomy], object]:
    return lambda part: part.set(name, value)


def tiles_of_levels(part: Anatomy) -> None:
    part.set(b"type", b"tiledimage")
    part.add(b"tiles", b"tiledesc", b"\x10\0\0\0\x10\0\0\0\1")


UNREAD = {
    "deep": (put(b"type", b"deepscanline"), "deep images are not read"),
    "of an unknown type": (put(b"type", b"volume"), "unknown type of part"),
    "of an unknown codec": (put(b"compression", b"\x7f"), "unknown compression"),
    "sub-sampled": (put(b"channels", channel(b"BY", 2, 2, 2) + b"\0"), "sub-sampled channels are not read"),
    "of many levels": (tiles_of_levels, "mip-mapped images are not read"),
    "of too many channels": (
        put(b"channels", b"".join(channel(b"c%04d" % n) for n in range(1203)) + b"\0"),
        "too many channels",
    ),
    "of another picture": (put(b"displayWindow", window(0, 0, 3, 3)), "do not make one picture"),
}


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("kind", UNREAD)
def test_a_part_that_nobody_reads_decides_nothing(
    kind: str, first: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, words = UNREAD[kind]
    first = first and kind != "of another picture"  # which the first says
    folder = of_two(tmp_path / "in", spoil, first=first)
    (frame,) = open_input(folder)
    np.testing.assert_array_equal(frame.colour[..., 0], of(drawn(0)["light.R"], DISPLAY))
    assert any(words in note and "part other" in note for note in open_intake(folder).notes)
    for command in (["inspect"], ["resolve", "-o", str(tmp_path / "out"), "--device", "numpy"]):
        assert main([*command, str(folder)]) == 0
    assert words in capsys.readouterr().err
    with pytest.raises(DataError, match=words):
        read_planes(folder / "shot.0001.exr")


def test_a_part_that_nobody_reads_may_be_damaged(tmp_path: Path) -> None:
    """Its pixels, that is: a file that was cut off is refused."""

    def spoil(part: Anatomy) -> None:
        part.chunks = [
            chunk[:4] + (len(chunk) - 9).to_bytes(4, "little") + b"\xff" * (len(chunk) - 9) for chunk in part.chunks
        ]

    folder = of_two(tmp_path, spoil, first=False)
    (frame,) = open_input(folder)
    assert frame.colour[0, 0, 0] == drawn(0)["light.R"][MARGIN, MARGIN]
    with pytest.raises(DataError, match="shot"):
        open_input(folder, assignments=["colour.channels=other.R other.G other.B"]).frame(1)


def test_a_truth_and_results_may_be_cropped(tmp_path: Path) -> None:
    for number in range(COUNT):
        planes = {c: of(drawn(number)[f"light.{c}"], wandering(number)) for c in "RGB"}
        write_image(tmp_path / f"a.{number:04d}.exr", planes, windows=(wandering(number), DISPLAY))
    images = open_images(tmp_path)
    for number, image in zip(range(COUNT), images, strict=True):
        wanted = expected(drawn(number)["light.G"], wandering(number), DISPLAY, 0.0)
        np.testing.assert_array_equal(image[..., 1], wanted)
    np.testing.assert_array_equal(images.select(1, 1).image(1), images.image(1))  # one frame shows what it does of all


def test_own_frames_that_were_cropped_share_a_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 3)
    whole = read_frame(folder / "synthetic.0001.exr")
    planes, attributes = read_image(folder / "synthetic.0001.exr")
    size = (0, 0, whole.width - 1, whole.height - 1)
    cropped: dict[str, Pixels] = {name: plane[2:, 3:].copy() for name, plane in planes.items()}
    write_image(folder / "synthetic.0001.exr", cropped, attributes, windows=((3, 2, *size[2:]), size))
    frame = open_input(folder).frame(1)
    np.testing.assert_array_equal(frame.colour[2:, 3:], whole.colour[2:, 3:])
    np.testing.assert_array_equal(frame.camera.view_to_clip, whole.camera.view_to_clip)
    assert not frame.colour[:2].any()
    assert np.isinf(frame.depth[:, :3]).all()
    main(["inspect", str(folder), "--pixels", "--json"])
    assert not [line for line in json.loads(capsys.readouterr().out)["problems"] if "size" in line]
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    assert read_any_header(tmp_path / "out" / "synthetic.0001.exr").layout.data_window == size


def test_a_picture_beside_its_display_window_is_refused(tmp_path: Path) -> None:
    for number in range(2):
        planes = {c: of(drawn(number)[f"light.{c}"], REGION) for c in "RGB"}
        write_image(tmp_path / f"a.{number:04d}.exr", planes, windows=(REGION, (0, 0, 4, 4)))
    for opened in (open_images, open_input):
        with pytest.raises(DataError, match="lies outside of the display window"):
            opened(tmp_path)


def test_a_channel_has_the_name_of_its_part_once() -> None:
    for part, own, wanted in [
        ("rgba", "R", "rgba.R"),
        ("Z", "Z", "Z"),
        ("View Layer.Combined", "View Layer.Combined.R", "View Layer.Combined.R"),
        ("View Layer", "View Layer.Combined.R", "View Layer.Combined.R"),
        ("depth.left", "depth.Z", "depth.left.Z"),
        ("left.depth", "depth.Z", "left.depth.Z"),
        ("rgba_left", "R", "rgba_left.R"),
        ("motion", "backward.u", "motion.backward.u"),
        ("", "A.B", "A.B"),
    ]:
        assert full_name(part, own) == wanted, part


def test_a_lone_layer_without_colour_is_reported(tmp_path: Path) -> None:
    for name in ("albedo", "matte", "beauty"):
        (tmp_path / name).mkdir()
        planes = {f"{name}.{c}": of(drawn(0)[f"light.{c}"], DISPLAY) for c in "RGB"}
        write_image(tmp_path / name / "a.0001.exr", planes)
        told = [note for note in open_intake(tmp_path / name).notes if "by its name no picture" in note]
        assert bool(told) is (name != "beauty")
    with pytest.raises(InputMissing):
        open_intake(tmp_path / "nothing")


@pytest.mark.parametrize("kind", ["parts", "one", "plain"])
def test_own_readers_name_the_way_in_for_other_tools(kind: str, tmp_path: Path) -> None:
    path, tool = tmp_path / "a.0001.exr", TOOLS["plain"]
    if kind == "parts":
        write_parts(path, tool, drawn(0), dict.fromkeys(ALL, DISPLAY))
    elif kind == "one":
        write_one(path, tool, drawn(0), DISPLAY)
    else:
        write_image(path, dict.fromkeys("RGBZ", of(drawn(0)["depth.Z"], DISPLAY)))
    with pytest.raises(DataError, match=r"another tool's files: .* in Python cltaa\.open\(\.\.\., profile='parts'\)"):
        open_sequence(tmp_path).frame(1)
    assert open_input(tmp_path).frame(1).colour.shape == (HEIGHT, WIDTH, 3)
