"""Any bit pattern as a pixel: the result is finite, and pixels far away do not change by a bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from cltaa.io.exr_write import write_frame
from tests.sequence_factory import EVERY_CHANNEL, bits, make_camera, make_frame, read_frame

CELL = 40  # pixels between two harmed ones
HEIGHT, WIDTH, FRAMES = 2 * CELL, 3 * CELL, 4
# What such frames are told of.
pytestmark = pytest.mark.filterwarnings("ignore::cltaa.core.frame_checks.MeaninglessNumbers")

# What can carry harm in one frame: the repair and the 3x3 around a pixel (2), the dilation of depth and motion (1),
# half a pixel of motion (1) and two texels of the history filter (2).
REACH_A_FRAME = 6

POINTS = {
    "quiet NaN": 0x7FC00000,
    "signalling NaN": 0x7F800001,
    "negative NaN": 0xFFC0BEEF,
    "infinity": 0x7F800000,
    "-infinity": 0xFF800000,
    "-0": 0x80000000,
    "denormal": 0x00000001,
    "-denormal": 0x807FFFFF,
    "largest": 0x7F7FFFFF,
    "-largest": 0xFF7FFFFF,
    **{
        f"{value:g}": int(np.float32(value).view(np.uint32))
        for value in (65504.0, 65520.0, -1.0, 1e3, 1e6, 1e10, 1e20, 1e30)
    },
}
PLANES = ("all black", "all one", "checker of +1 and -1")
CHANNELS = ("R", "Z", "A", "backward.u", "backward.v", "reactive")
PLACES = {name: (CELL // 2 + CELL * (n // 3), CELL // 2 + CELL * (n % 3)) for n, name in enumerate(CHANNELS)}


def sequence() -> list[Frame]:
    effects = frozenset({Effect.MOTION, Effect.ALPHA, Effect.REACTIVE})
    kept: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "camera": make_camera(aspect=WIDTH / HEIGHT)}
    return [make_frame(index, effects=effects, **kept, **EVERY_CHANNEL) for index in range(FRAMES)]


def plane(frame: Frame, channel: str) -> Image:
    """The plane of a channel, as a view."""
    assert frame.motion is not None
    assert frame.alpha is not None
    assert frame.reactive is not None
    return {
        "R": frame.colour[..., 0],
        "Z": frame.depth,
        "A": frame.alpha,
        "backward.u": frame.motion[..., 0],
        "backward.v": frame.motion[..., 1],
        "reactive": frame.reactive,
    }[channel]


@pytest.fixture(scope="module")
def resolver() -> Resolver:
    return Resolver()


def resolved(resolver: Resolver, frames: list[Frame]) -> list[Image]:
    resolver.reset()
    return [resolver.resolve(frame) for frame in frames]


@pytest.fixture(scope="module")
def undisturbed(resolver: Resolver) -> list[Image]:
    return resolved(resolver, sequence())


@pytest.mark.parametrize("value", POINTS)
def test_one_pixel_of_any_value(resolver: Resolver, undisturbed: list[Image], value: str) -> None:
    """One of each channel, so far apart that none reaches another's neighbourhood."""
    frames = sequence()
    for channel, place in PLACES.items():
        plane(frames[1], channel)[place] = np.uint32(POINTS[value]).view(np.float32)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    distance = np.min([np.maximum(abs(y - row), abs(x - column)) for row, column in PLACES.values()], axis=0)
    for index, (image, expected) in enumerate(zip(resolved(resolver, frames), undisturbed, strict=True)):
        assert np.isfinite(image).all()
        far = distance > REACH_A_FRAME * index
        assert far.any()
        np.testing.assert_array_equal(bits(image)[far], bits(expected)[far])


@pytest.mark.parametrize("value", PLANES)
def test_a_whole_plane(resolver: Resolver, value: str) -> None:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    content = {"all black": 0.0, "all one": 1.0, "checker of +1 and -1": 1.0 - 2.0 * ((y + x) % 2)}[value]
    for channel in CHANNELS:
        frames = sequence()
        for frame in frames:
            plane(frame, channel)[...] = content
        assert all(np.isfinite(image).all() for image in resolved(resolver, frames)), channel


@pytest.mark.parametrize("value", ["quiet NaN", "infinity", "largest"])
def test_a_frame_without_any_number_shows_the_history(resolver: Resolver, value: str) -> None:
    """Whatever fills it, it is one of missing samples, of sky, opaque and at rest, to the bit, then and later."""
    frames, lost = sequence(), sequence()
    for channel in CHANNELS:
        plane(frames[1], channel)[...] = np.uint32(POINTS[value]).view(np.float32)
    frames[1].colour[...] = frames[1].colour[..., :1]
    for channel, rest in {"Z": np.inf, "A": 1.0, "backward.u": np.nan, "backward.v": np.nan, "reactive": 0.0}.items():
        plane(lost[1], channel)[...] = rest
    lost[1].colour[...] = np.nan
    for image, expected in zip(resolved(resolver, frames), resolved(resolver, lost), strict=True):
        assert np.isfinite(image).all()
        assert (image[..., :3] > 0).mean() > 0.9
        np.testing.assert_array_equal(bits(image), bits(expected))


def test_every_value_survives_the_file(tmp_path: Path) -> None:
    """The reader hands on what the file holds, bit for bit; what to make of it is the resolve's affair."""
    patterns = np.array([*POINTS.values()], np.uint32).view(np.float32)
    frame = sequence()[0]
    for channel in CHANNELS:
        plane(frame, channel)[...] = np.resize(patterns, (HEIGHT, WIDTH))
    write_frame(tmp_path / "a.0000.exr", frame)
    back = read_frame(tmp_path / "a.0000.exr")
    for channel in CHANNELS:
        np.testing.assert_array_equal(bits(plane(back, channel)), bits(plane(frame, channel)))


@pytest.mark.parametrize("value", ["signalling NaN", "-infinity", "1e+20", "65504"])
def test_what_was_repaired_is_counted(tmp_path: Path, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    """In the outcome of a resolve: pixels, not channels, and none that is a usable number."""
    frame = sequence()[0]
    frame.colour[3, 4:6] = np.uint32(POINTS[value]).view(np.float32)
    frame.colour[7, 8, 1] = np.uint32(POINTS[value]).view(np.float32)
    (tmp_path / "in").mkdir()
    write_frame(tmp_path / "in" / "a.0000.exr", frame)
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy", "--json"]) == 0
    usable = abs(np.uint32(POINTS[value]).view(np.float32)) <= 2.0**50
    assert json.loads(capsys.readouterr().out)["repaired"] == (0 if usable else 3)
