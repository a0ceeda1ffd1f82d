"""One frame of a sequence in memory: its channels, its camera and its jitter.

``docs/conventions.md`` defines every word here.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError, UsageError, known, public
from cltaa.renamed import EFFECTS, RenamedMembers, current

Image = NDArray[np.float32]
Matrix = NDArray[np.float64]


class Effect(StrEnum, metaclass=RenamedMembers):
    """A property of a sequence for which the resolve has a step of its own.

    A sequence that declares its effects (EXR attribute ``cltaa:effects``, comma separated) promises that nothing else
    happens in it; one without that attribute gets every step that its channels and cameras call for.
    """

    CAMERA = "camera"  # the camera moves, turns or zooms
    MOTION = "motion"  # something other than the camera moves: channels backward.u, backward.v
    DISOCCLUSION = "disocclusion"  # something that was hidden becomes visible
    THIN = "thin"  # features narrower than a pixel
    HDR = "hdr"  # values far above 1
    ILLUMINATION = "illumination"  # colour changes without motion: moving shadow, flashing light, glints
    REACTIVE = "reactive"  # see-through or unmodelled motion: channel reactive
    EXPOSURE = "exposure"  # attribute cltaa:exposure changes
    CUT = "cut"  # attribute cltaa:cut is set on some frame
    ALPHA = "alpha"  # channel A
    SKY = "sky"  # directions at infinity: depth +inf
    NOISE = "noise"  # samples of one surface point vary, as a path tracer's do

    @classmethod
    def _missing_(cls, value: object) -> Effect:
        """Accept the word of an earlier version; raises UsageError for any other."""
        word = current(str(value), EFFECTS, cls._value2member_map_, "effect")
        if word not in cls._value2member_map_:
            raise UsageError(f"unknown effect {word}", cure=known(word, cls, "effects"))
        return cls(word)


# The effects to plan for: declared, else found; found, whatever is declared; every one; or this set.
Asked = frozenset[Effect] | Literal["auto", "find", "all"]
ASKED: tuple[Literal["auto", "find", "all"], ...] = ("auto", "find", "all")


def parse_effects(text: str) -> frozenset[Effect]:
    """Read the comma-separated list of an EXR header or a command line; raises UsageError for an unknown name.

    Words of earlier versions are read without a warning: files hold them.
    """
    names = (name.strip() for name in text.split(","))
    known = Effect._value2member_map_
    return frozenset(Effect(name if name in known else EFFECTS.get(name, name)) for name in names if name)


def format_effects(effects: Iterable[Effect]) -> str:
    """Write effects as the sorted, comma-separated list that ``parse_effects`` reads."""
    return ",".join(sorted(effects))


def name_effects(effects: frozenset[Effect] | None) -> str:
    """Return the name of declared effects in messages; None means that nothing is declared."""
    return "nothing declared" if effects is None else format_effects(effects) or "no effect"


@dataclass(frozen=True, eq=False, slots=True)
class Camera:
    """Un-jittered camera, float64, row-major, column vectors: ``clip = view_to_clip @ world_to_view @ p``.

    It copies both matrices: a program may change its own in place for the next frame.
    """

    world_to_view: Matrix  # [4, 4]
    view_to_clip: Matrix  # [4, 4], OpenGL clip space: x right, y up, z in [-1, 1]

    def __post_init__(self) -> None:
        """Copy the matrices, masked numbers as NaN; what is no array of numbers stays as it is, for the check of a
        frame."""
        for name in ("world_to_view", "view_to_clip"):
            given: Any = getattr(self, name)
            if isinstance(given, np.ndarray) and given.dtype.kind in "fiu":
                object.__setattr__(self, name, np.asarray(np.ma.filled(given.astype(np.float64), np.nan)))

    @property
    def orthographic(self) -> bool:
        """True when w does not depend on depth (last row of the projection is 0 0 0 1)."""
        return bool(self.view_to_clip[3, 2] == 0.0)


# A dataclass makes its constructor itself.
Camera.__init__ = public("Camera", "give world_to_view and view_to_clip")(Camera.__init__)  # type: ignore[method-assign]
# Camera of a frame that was given none. It never moves, so it causes no motion.
NO_CAMERA = Camera(np.eye(4), np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, -1.0, -0.2], [0, 0, -1.0, 0]]))
# The depth of a frame that was given none, one number in memory.
SKY = np.array(np.inf, np.float32)
PLANES = ("colour", "depth", "motion", "alpha", "reactive", "object_id", "normal")


class HostArray(Protocol):
    """An array of another library in the host's memory: torch, JAX and others."""

    def __dlpack__(self) -> Any:
        """Export the memory, as DLPack defines it."""

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return the type and number of the device, as DLPack defines them."""


class DeviceArray(Protocol):
    """A ``pyopencl.array.Array``: memory of a device, and the queue on which it is filled."""

    shape: Any
    strides: Any
    dtype: Any
    offset: int
    base_data: Any
    queue: Any


Array = NDArray[Any] | HostArray | DeviceArray


def on_device(array: object) -> bool:
    """True for a ``pyopencl.array.Array``."""
    return hasattr(array, "base_data")


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One frame: arrays ``[H, W]`` or ``[H, W, C]``, row 0 at the top, linear scene-referred floats. Only colour is
    required.

    ``index``    its number, one more each frame (``step`` more where that is given)
    ``colour``   [H, W, 3], premultiplied where ``alpha`` exists
    ``depth``    [H, W], planar distance along the view axis in scene units, sky is +inf; None: history is not rejected
                 by depth, and the motion of the camera is reprojected as rotation only
    ``camera``   un-jittered matrices; None: it does not move
    ``jitter_px`` (x, y): pixel (x, y) was sampled at (x + 0.5 + jx, y + 0.5 + jy); x right, y down
    ``motion``   [H, W, 2] backward.u, backward.v in pixels, ``prev_px = px + motion``; NaN means "use the depth";
                 None where nothing but the camera moves
    ``alpha``, ``reactive``, ``object_id``  [H, W] or None
    ``effects``  the declared effects, or None where the sequence declares nothing
    ``step``     difference between ``index`` and the number of the previous frame
    ``found``    where nothing is declared: the effects found in the sequence, no promise (``cltaa.inputs.found``)

    Arrays are NumPy's, other libraries' in host memory (``__dlpack__``), which are not copied, or
    ``pyopencl.array.Array``. Frames and cameras compare by identity: compare arrays by NumPy. Raises DataError for an
    array that cannot be shared.
    """

    index: int
    colour: Image
    depth: Image
    camera: Camera
    jitter_px: tuple[float, float]
    motion: Image | None
    alpha: Image | None
    reactive: Image | None
    object_id: Image | None
    normal: Image | None
    cut: bool
    exposure: float
    scene: str
    effects: frozenset[Effect] | None
    step: int
    path: Path | None
    found: frozenset[Effect] | None

    @public("Frame")
    def __init__(
        self,
        index: int,
        colour: Array,
        depth: Array | None = None,
        camera: Camera | None = None,
        jitter_px: tuple[float, float] = (0.0, 0.0),
        motion: Array | None = None,
        alpha: Array | None = None,
        reactive: Array | None = None,
        object_id: Array | None = None,
        normal: Array | None = None,
        cut: bool = False,
        exposure: float = 1.0,
        scene: str = "",
        effects: frozenset[Effect] | None = None,
        step: int = 1,
        path: Path | None = None,
        found: frozenset[Effect] | None = None,
    ) -> None:
        """Store the arrays without copying them."""
        given = {name: value for name, value in locals().items() if name in self.__dataclass_fields__}
        given |= {name: shared(name, given[name]) for name in PLANES}
        # NumPy's narrow integers would overflow when a step is added.
        given |= {name: int(given[name]) for name in ("index", "step") if isinstance(given[name], np.integer)}
        if depth is None:
            given["depth"] = np.broadcast_to(SKY, getattr(given["colour"], "shape", ())[:2])
        given["camera"] = NO_CAMERA if camera is None else camera
        given["jitter_px"] = _pair(jitter_px)
        for name, value in given.items():
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[type[Frame], tuple[Any, ...]]:
        """Pickle and copy only what was given: the stand-ins for a missing depth or camera do not survive a copy."""
        depth, camera = self.depth if self.has_depth else None, self.camera if self.has_camera else None
        given = {each.name: getattr(self, each.name) for each in fields(self)} | {"depth": depth, "camera": camera}
        return type(self), tuple(given.values())

    @property
    def has_depth(self) -> bool:
        """False where no depth was given; ``depth`` then repeats that of the sky, one number in memory."""
        return any(getattr(self.depth, "strides", ())) or getattr(self.depth, "base", None) is not SKY

    @property
    def arrays(self) -> list[Image]:
        """The given arrays that the resolve reads."""
        given = (self.colour, self.depth if self.has_depth else None, self.motion, self.alpha, self.reactive)
        return [array for array in given if array is not None]

    @property
    def has_camera(self) -> bool:
        """False where no camera was given."""
        return self.camera is not NO_CAMERA

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.colour.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.colour.shape[1])

    def __repr__(self) -> str:
        """Show size and channels, not their numbers."""
        there = " ".join(
            name for name in PLANES if getattr(self, name) is not None and getattr(self, f"has_{name}", True)
        )
        size = " x ".join(map(str, reversed(getattr(self.colour, "shape", ())[:2]))) or "no image"
        return f"Frame({self.index}: {size}, {there}{', cut' if self.cut else ''})"


def outline(frame: Frame) -> Frame:
    """Return ``frame`` without its pixels: its channels keep their shapes and take no memory."""
    empty: dict[str, Any] = {
        name: np.broadcast_to(np.float32(0), there.shape)
        for name in PLANES
        if (there := getattr(frame, name)) is not None and (name != "depth" or frame.has_depth)
    }
    return replace(frame, **empty)


def _pair(numbers: Any) -> Any:
    """Return a list or array of two as a tuple, and arrays in it of one number as that number; anything else unchanged,
    for the check of a frame."""
    with suppress(ValueError, TypeError, RuntimeError):  # ragged, or on another device
        if isinstance(numbers, tuple):
            return tuple(number.item() if getattr(number, "shape", None) == () else number for number in numbers)
        if np.shape(numbers) == (2,):
            return tuple(np.asarray(shared("jitter_px", numbers)).tolist())
    return numbers


def shared(name: str, array: Any) -> Any:
    """Return ``array`` as NumPy's where another library holds it in host memory, masked floats as NaN; anything else
    unchanged. Raises DataError with its ``name`` where it cannot be shared."""
    if isinstance(array, np.ma.MaskedArray) and array.dtype.kind == "f":
        return array.filled(np.nan)
    if isinstance(array, np.ndarray) or not hasattr(array, "__dlpack__") or on_device(array):
        return array
    try:
        return np.from_dlpack(array)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        cure = "give its copy of floats in the host's memory, without gradients"
        raise DataError(f"{name} cannot be shared: {error}", found=type(array).__name__, cure=cure) from error


def writable(out: Any) -> Any:
    """Return ``out`` as NumPy's where another library holds it in host memory; raises DataError as ``shared`` does."""
    if isinstance(out, np.ndarray) or not hasattr(out, "__dlpack__") or on_device(out):
        return out
    array = shared("out", out)
    # DLPack before 1.0 does not say whether memory is writable, and NumPy then assumes that it is not.
    lent = np.asarray(out) if hasattr(out, "__array__") and not array.flags.writeable else array
    return lent if np.shares_memory(lent, array) else array
