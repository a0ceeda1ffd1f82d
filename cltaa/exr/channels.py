"""The channels of a frame: their names in a file, which of them must be there, and of which type."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.exr.layout import Layout
from cltaa.frames import Frame, Image

Pixels = NDArray[np.float16] | NDArray[np.float32] | NDArray[np.uint32]

COLOUR = ("R", "G", "B")
MOTION = ("backward.u", "backward.v")
NORMAL = ("N.X", "N.Y", "N.Z")
# Those that lie beside each other in a frame.
GROUPS = (COLOUR, MOTION, ("A",), ("reactive",), NORMAL)
OF_FRAMES = frozenset({"Z", "id"}.union(*GROUPS))


def frame_planes(frame: Frame, path: Path) -> dict[str, Pixels]:
    """Return the channels [H, W] of a frame by their names in a file; raises DataError for arrays that do not fit."""
    height, width = frame.colour.shape[:2]
    planes: dict[str, Pixels | None] = {
        **_split(COLOUR, frame.colour), "A": frame.alpha, "Z": frame.depth,
        **_split(MOTION, frame.motion), "reactive": frame.reactive, **_split(NORMAL, frame.normal),
    }  # fmt: skip
    channels: dict[str, Pixels] = {}
    for name, plane in planes.items():
        if plane is None:
            continue
        if plane.shape != (height, width) or plane.dtype != np.float32:
            expected, found = f"float32 [{height}, {width}]", f"{plane.dtype} {list(plane.shape)}"
            raise DataError(
                "array is wrong", path=path, frame=frame.index, channel=name, expected=expected, found=found
            )
        channels[name] = plane
    if frame.object_id is not None:
        channels["id"] = _whole_numbers(frame, path)
    return channels


def check_float_channels(layout: Layout, names: Iterable[str]) -> None:
    """Raise DataError unless every named channel is there and holds half or float numbers."""
    for name in names:
        kind = layout.channels.get(name)
        if kind is None:
            found = " ".join(sorted(layout.channels)) or "none"
            cure = "capture or convert the file with this channel"
            raise DataError("channel is missing", path=layout.path, channel=name, found=found, cure=cure)
        if kind == "uint":
            raise DataError("wrong channel type", path=layout.path, channel=name, expected="float", found=kind)


def frame_channels(layout: Layout) -> list[str]:
    """Channels of a frame in the order of its planar block, checked."""
    names = list(COLOUR)
    names += [name for name in ("A",) if name in layout.channels]
    names += ["Z"]
    for group in (MOTION, ("reactive",), NORMAL):
        if any(name in layout.channels for name in group):
            names += group
    check_float_channels(layout, names)
    if layout.channels["Z"] == "half":
        raise DataError(
            "half-precision depth is refused: it is wrong by metres at a kilometre", path=layout.path, channel="Z",
            expected="float", found="half", cure="write depth as 32-bit float",
        )  # fmt: skip
    if layout.channels.get("id", "uint") != "uint":
        found = layout.channels["id"]
        raise DataError("wrong channel type", path=layout.path, channel="id", expected="uint", found=found)
    return names


def _split(names: Sequence[str], array: Image | None) -> dict[str, Pixels | None]:
    if array is None:
        return dict.fromkeys(names)
    if array.ndim != 3 or array.shape[2] != len(names):
        raise DataError("array has a wrong number of channels", expected=len(names), found=list(array.shape))
    return {name: array[..., position] for position, name in enumerate(names)}


def _whole_numbers(frame: Frame, path: Path) -> NDArray[np.uint32]:
    given = np.asarray(frame.object_id)
    numbers = given.astype(np.uint32)
    if given.shape != frame.depth.shape or not np.array_equal(numbers, given):
        expected = f"whole numbers from 0 to 2^32-1, {list(frame.depth.shape)}"
        raise DataError("array is wrong", path=path, frame=frame.index, channel="id", expected=expected)
    return numbers
