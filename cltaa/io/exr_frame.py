"""A frame as an EXR file: its channels, and its header as attributes.

Matrices in a file have Imath's layout, standard and own alike: a row vector times the matrix, the translation in the
last row. In memory they are NumPy's row-major matrices for column vectors, so each is transposed once on writing and
once on reading.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import chain
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.core.frame_checks import check_camera, check_numbers
from cltaa.core.planes import as_floats
from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera, Effect, Frame, Matrix, format_effects, parse_effects
from cltaa.io.exr_layout import OTHER_TOOLS, Layout, of_region
from cltaa.io.names import number_of
from cltaa.printable import written

Pixels = NDArray[np.float16] | NDArray[np.float32] | NDArray[np.uint32]

COLOUR = ("R", "G", "B")
OF_RESULTS = (*COLOUR, "A")
MOTION = ("backward.u", "backward.v")
NORMAL = ("N.X", "N.Y", "N.Z")
# Channels that are adjacent in a frame's memory.
GROUPS = (COLOUR, MOTION, ("A",), ("reactive",), NORMAL)
OF_FRAMES = frozenset({"Z", "id"}.union(*GROUPS))
# The channel whose presence shows that a frame has this part.
CHANNEL_OF = {"motion": "backward.u", "alpha": "A", "reactive": "reactive"}
NO_PIXELS = np.empty((0, 0), np.float32)


def frame_planes(frame: Frame, path: Path) -> dict[str, Pixels]:
    """Return the channels [H, W] of a frame by their names in a file; raises DataError for arrays that do not fit."""
    height, width = frame.colour.shape[:2]
    given = {COLOUR: frame.colour, ("A",): frame.alpha, ("Z",): frame.depth, MOTION: frame.motion}
    given |= {("reactive",): frame.reactive, NORMAL: frame.normal}
    channels: dict[str, Pixels] = {}
    for names, array in given.items():
        if array is None:
            continue
        shape = [height, width, len(names)][: 2 if len(names) == 1 else 3]
        if [*array.shape] != shape or array.dtype.kind != "f":
            what, expected, found = "array is wrong", f"floats {shape}", f"{array.dtype} {[*array.shape]}"
            raise DataError(what, path=path, frame=frame.index, channel=names[0], expected=expected, found=found)
        planes = as_floats(array).reshape(height, width, -1)  # the type that a resolve takes
        channels |= {name: planes[..., position] for position, name in enumerate(names)}
    if frame.object_id is not None:
        channels["id"] = _whole_numbers(frame, path)
    return channels


def check_float_channels(layout: Layout, names: Iterable[str]) -> None:
    """Raise DataError unless every named channel exists and holds half or float numbers."""
    for name in names:
        kind = layout.channels.get(name)
        if kind is None:
            found = written(sorted(layout.channels)) or "none"
            cure = f"capture the file with this channel; {OTHER_TOOLS}"
            raise DataError("channel is missing", path=layout.path, channel=name, found=found, cure=cure)
        if kind == "uint":
            raise DataError("wrong channel type", path=layout.path, channel=name, expected="float", found=kind)


def check_frame_channels(layout: Layout) -> None:
    """Raise DataError unless a file has the channels of a frame, each of its type."""
    optional = (group for group in GROUPS if any(name in layout.channels for name in group))
    check_float_channels(layout, dict.fromkeys((*COLOUR, "Z", *chain(*optional))))
    if layout.channels["Z"] == "half":
        what = "half-precision depth is refused: it is wrong by metres at a kilometre"
        cure = "write depth as 32-bit float"
        raise DataError(what, path=layout.path, channel="Z", expected="float", found="half", cure=cure)
    if layout.channels.get("id", "uint") != "uint":
        found = layout.channels["id"]
        raise DataError("wrong channel type", path=layout.path, channel="id", expected="uint", found=found)


def _whole_numbers(frame: Frame, path: Path) -> NDArray[np.uint32]:
    given = np.asarray(frame.object_id)
    with np.errstate(invalid="ignore"):
        numbers = given.astype(np.uint32)
    if given.shape != frame.depth.shape or not np.array_equal(numbers, given):
        expected = f"whole numbers from 0 to 2^32-1, {list(frame.depth.shape)}"
        raise DataError("array is wrong", path=path, frame=frame.index, channel="id", expected=expected)
    return numbers


# The EXR standard's world to camera is left-handed and looks along +z; OpenGL looks along -z.
_FLIP_Z = np.diag([1.0, 1.0, -1.0, 1.0])
# Clip space (x right, y up, -1..1) to the standard's NDC: (0, 0) upper left, (1, 1) lower right, depth 0..1.
_CLIP_TO_NDC = np.array([[0.5, 0, 0, 0.5], [0, -0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1.0]])
# The attributes that hold matrices, all for the whole display window.
MATRICES = frozenset({"worldToCamera", "worldToNDC", "cltaa:worldToView", "cltaa:viewToClip"})
# Attributes that describe the file, not the picture: OpenEXR writes them itself.
STRUCTURAL = frozenset({"channels", "compression", "dataWindow", "displayWindow", "lineOrder", "tiles", "type"})


class Single(float):
    """The value of an attribute that is a float in its file, not a double, and is written as one again."""


def frame_attributes(frame: Frame) -> dict[str, object]:
    """Return the attributes of a frame's header; raises DataError for invalid matrices or numbers."""
    view, clip = frame.camera.world_to_view, frame.camera.view_to_clip
    check_camera(frame.camera, path=frame.path, frame=frame.index)
    check_numbers(frame.jitter_px, frame.exposure, path=frame.path, frame=frame.index)
    standard = {"worldToCamera": _FLIP_Z @ view, "worldToNDC": _CLIP_TO_NDC @ clip @ view}
    if max(float(np.abs(matrix).max()) for matrix in standard.values()) > np.finfo(np.float32).max:
        cure = "move the scene nearer to the origin"
        raise DataError("matrix does not fit float32", path=frame.path, frame=frame.index, cure=cure)
    if not -(2**31) <= frame.index < 2**31:
        raise DataError("index does not fit attribute cltaa:frame, an int", path=frame.path, found=frame.index)
    attributes: dict[str, object] = {
        **{name: np.ascontiguousarray(matrix.T, dtype=np.float32) for name, matrix in standard.items()},
        "cltaa:worldToView": np.ascontiguousarray(view.T, dtype=np.float64),
        "cltaa:viewToClip": np.ascontiguousarray(clip.T, dtype=np.float64),
        "cltaa:jitterPx": np.array(frame.jitter_px, dtype=np.float64),
        "cltaa:frame": int(frame.index),
        "cltaa:cut": int(frame.cut),
        "cltaa:exposure": float(frame.exposure),
        "cltaa:scene": frame.scene,
    }
    if frame.effects is not None:
        attributes["cltaa:effects"] = format_effects(frame.effects)
    return attributes


def check_number(path: Path, attributes: Mapping[str, object], number: int) -> None:
    """Raise DataError where attribute ``cltaa:frame`` is not the ``number`` in the name of the file."""
    stated = attributes.get("cltaa:frame", number)
    if stated != number:
        what, cure = "the file name and attribute cltaa:frame disagree", "give the file its own number again"
        raise DataError(what, path=path, expected=number, found=stated, cure=cure)


def frame_outline(path: Path, attributes: Mapping[str, object], layout: Layout) -> Frame:
    """Return a frame of which only the header was read: its channels exist, and are empty.

    ``attributes`` are those of ``ImageHeader``; every problem is a DataError that names the attribute. The camera is
    that of the data window, which may be a region of the display window.
    """
    index = read_number(attributes, "cltaa:frame", path, default=number_of(path) or 0, expected="a whole number")
    if not index.is_integer():
        raise wrong_attribute("cltaa:frame", path, "a whole number", index)
    cut = read_cut(attributes, path)
    jitter = _numbers(attributes, "cltaa:jitterPx", path, (2,))
    jitter_px = float(jitter[0]), float(jitter[1])
    exposure = read_number(attributes, "cltaa:exposure", path, default=1.0)
    check_numbers(jitter_px, exposure, path=path, frame=int(index))
    view, clip = (_numbers(attributes, f"cltaa:{name}", path, (4, 4)).T for name in ("worldToView", "viewToClip"))
    whole = Camera(np.ascontiguousarray(view), np.ascontiguousarray(clip))
    check_camera(whole, path=path, frame=int(index))
    empty: dict[str, Any] = {part: NO_PIXELS for part, name in CHANNEL_OF.items() if name in layout.channels}
    return Frame(
        index=int(index),
        colour=NO_PIXELS,
        depth=NO_PIXELS,
        camera=of_region(whole, layout),
        jitter_px=jitter_px,
        cut=cut,
        exposure=exposure,
        scene=_text(attributes, "cltaa:scene", path) or "",
        effects=_effects(attributes, path),
        path=path,
        **empty,
    )


def _numbers(attributes: Mapping[str, object], name: str, path: Path, shape: tuple[int, ...]) -> Matrix:
    """Return a vector or matrix of any precision as float64."""
    value = attributes.get(name)
    kind = "V2d" if shape == (2,) else "M44d"
    if value is None:
        cure = f"capture it with cltaa, or add the attribute; {OTHER_TOOLS}"
        raise DataError("attribute is missing", path=path, expected=f"{name} ({kind})", cure=cure)
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype.kind not in "iuf":
        raise wrong_attribute(name, path, kind, value)
    return value.astype(np.float64)


def _text(attributes: Mapping[str, object], name: str, path: Path) -> str | None:
    value = attributes.get(name)
    if value is not None and not isinstance(value, str):
        raise wrong_attribute(name, path, "a string", value)
    return value


def _effects(attributes: Mapping[str, object], path: Path) -> frozenset[Effect] | None:
    text = _text(attributes, "cltaa:effects", path)
    try:
        return None if text is None else parse_effects(text)
    except UsageError as error:
        raise wrong_attribute("cltaa:effects", path, f"names out of {', '.join(Effect)}", text) from error


def read_number(
    attributes: Mapping[str, object], name: str, path: Path, *, default: float, expected: str = "a number"
) -> float:
    """Return a number of any type that writers use: int, float, double, or a rational; DataError for anything else."""
    value = attributes.get(name, default)
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "iuf":
        return float(value.reshape(()))
    if isinstance(value, bool | str) or not isinstance(value, Real | np.generic):
        n, d = getattr(value, "n", None), getattr(value, "d", None)  # OpenEXR's rational
        if not isinstance(n, int) or not isinstance(d, int) or d == 0:
            raise wrong_attribute(name, path, expected, value)
        return n / d
    return float(value)


def read_cut(attributes: Mapping[str, object], path: Path) -> bool:
    """True where a frame begins a shot; raises DataError for anything but 0 and 1."""
    cut = read_number(attributes, "cltaa:cut", path, default=0, expected="0 or 1")
    if cut not in (0, 1):
        raise wrong_attribute("cltaa:cut", path, "0 or 1", attributes["cltaa:cut"])
    return bool(cut)


def wrong_attribute(name: str, path: Path, expected: str, value: object, cure: str | None = None) -> DataError:
    """Return the error for an attribute of a wrong type or value."""
    if isinstance(value, np.ndarray):
        found = f"{value.dtype}{list(value.shape)}"
    else:  # an attribute of a type unknown to OpenEXR can fail even to print itself
        found = repr(value) if isinstance(value, (str, int, float)) else type(value).__name__
    return DataError(f"attribute {name} is wrong", path=path, expected=expected, found=found, cure=cure)
