"""Checks of a frame before any computation, whether a file's reader or a program made it."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.core.constants import PAD_X, PAD_Y, value
from cltaa.core.planes import Layout
from cltaa.errors import DataError, UsageError, known
from cltaa.frame import PLANES, Camera, Effect, Frame, on_device

# Kernels count the texels of a plane in 32 bits, and steps from one to another in 31.
MOST_TEXELS = 2**31 - 1
OPTIONAL = ("motion", "alpha", "reactive")  # channels that a frame need not have
SHARES = ("alpha", "reactive")  # channels that go from 0 to 1
SHARE_SLACK = 0.5  # how far beyond 0 and 1 filters with negative lobes may take them, generously
MANY = 4  # widths of a picture that no vector is long
NO_LIGHT = {
    "negative everywhere": "light adds up from 0",
    "whole numbers up to 255": "bytes of a picture have to be decoded first",
}
WHITE_BYTE, LEAST_BYTES = 255.0, 16  # colour of whole numbers up to the one, and of at least that many, is of bytes
INVERSE_TOLERANCE = 1e-6  # largest |M inv(M) - I|; a sound camera 10^6 m from the origin stays below 1e-9
LARGEST_SCALE = 1e100  # largest determinant, or inverse of one: cameras divide by it, and float64 ends at 1e308
MATRICES_KEPT = 128  # cached sound ones: of a frame, and of all that are read, resolved and written beside it
LARGEST_JITTER = 2.0  # pixels; from it on no sample lies within a filter's reach, so the number has another unit
EXPOSURE_STOPS = 32.0  # largest |log2(exposure)|; from starlight to the sun's disc is about 30 stops
LARGEST_EXPOSURE = 2.0**EXPOSURE_STOPS
RIGID_WITHIN = 1e7  # sum of the coordinates of a rigid view; |M inv(M) - I| stays below 1e-8
IDENTITY = np.eye(4)
VIEW_ROWS = ([0, 0, 0, 1],)  # the last row of a sound matrix: of a view, and of a projection of either kind
CLIP_ROWS = ([0, 0, -1, 0], [0, 0, 0, 1])
AWAY = np.array([1.0, 1.0, -1.0, 1.0])  # maps the row of a camera along +z to that of one along -z
WHOLE, CUT = "a whole number from 1 on", "True or False"
# Names in messages: attributes of our files, or arguments of a program.
MATRICES = "matrix cltaa:worldToView", "matrix cltaa:viewToClip"
MATRIX_ARGUMENTS = "camera.world_to_view", "camera.view_to_clip"
NUMBERS = "attribute cltaa:jitterPx", "attribute cltaa:exposure"
NUMBER_ARGUMENTS = "jitter_px", "exposure"
LOOKED_AT = 100  # most rows and columns that are searched for meaningless numbers
READ_ON_DEVICE = np.dtype(np.float32), np.dtype(np.float16)  # types that kernels read
LIMIT = np.float64(value("DOMAIN_LIMIT"))  # in double precision, for halves end below it
_EFFECTS = frozenset(Effect)


class MeaninglessNumbers(UserWarning):
    """Depth, vectors or colour of a frame say nothing; what resolves files reports their frames instead."""


def check_frame(frame: Frame, told: bool = False) -> bool:
    """Raise DataError for a frame that cannot be resolved: channels, camera, jitter, exposure, effects, numbers.

    Warns of the first frame without a usable sample; returns whether it, or an earlier one, which ``told`` says, was.
    """
    if not isinstance(frame, Frame):
        raise DataError("no frame", expected="a cltaa.Frame", found=_kind(frame))
    check_channels(frame)
    _check_types(frame)
    check_camera(frame.camera, path=frame.path, frame=frame.index)
    check_numbers(frame.jitter_px, frame.exposure, path=frame.path, frame=frame.index)
    _check_effects(frame)
    if frame.step < 1:
        raise _wrong(frame, "step", WHOLE)
    if nothing := _check_depth(frame):
        warnings.warn(
            f"depth is {nothing} everywhere and counts as the sky; leave it out where there is none",
            MeaninglessNumbers,
            stacklevel=4,
        )
    _warn_of_motion(frame)
    _warn_of_ranges(frame)
    if told or not _without_samples(frame):
        return told
    what = f"frame {frame.index} has no usable sample: its colour, or alpha, is masked, NaN, infinite or beyond 2^50"
    warnings.warn(f"{what} everywhere; its image is the history's, or black", MeaninglessNumbers, stacklevel=4)
    return True


def each_frame(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Iterate ``frames``, unchecked; raises UsageError for what holds none."""
    if not isinstance(frames, Iterable):
        raise UsageError("no frames", expected="several cltaa.Frame, as an open sequence", found=repr(frames))
    return iter(frames)


def check_fields(frame: Frame) -> None:
    """Raise DataError for a frame that cannot be written: fields of wrong types, no pixel, unknown effects, depth that
    is negative everywhere."""
    _check_types(frame)
    _check_effects(frame)
    for name in PLANES:
        array = getattr(frame, name)
        if array is None and name != "colour":
            continue
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub":
            raise _error(frame, f"{name} is no array", "one of the host, of numbers", _kind(array))
    _check_floats(frame, "colour")
    _check_colour(frame)
    if frame.depth.shape == frame.colour.shape[:2]:
        _check_depth(frame)


def _looked_at(array: Any) -> NDArray[Any]:
    """Return a sample of an array [H, W, ...], of bounded size: this is on the frame's critical path."""
    return np.asarray(array[_sampled(array)])


def _sampled(array: Any) -> tuple[slice, slice]:
    return slice(None, None, -(-array.shape[0] // LOOKED_AT)), slice(None, None, -(-array.shape[1] // LOOKED_AT))


def _without_samples(frame: Frame) -> bool:
    """True where no pixel of colour and alpha in host memory is a number within the domain."""
    colour, alpha = frame.colour, frame.alpha
    if on_device(colour) or on_device(alpha):
        return False
    y, x = colour.shape[0] // 2, colour.shape[1] // 2
    middle, whole = (slice(y, y + 1), slice(x, x + 1)), (slice(None), slice(None))
    for part in (middle, _sampled(colour), whole):  # all of it only where the rest decides nothing
        usable = (np.abs(colour[part]) <= LIMIT).all(-1)
        if alpha is not None:
            usable &= np.abs(alpha[part]) <= LIMIT
        if usable.any():
            return False
    return True


def _check_depth(frame: Frame) -> str | None:
    """Return what depth is everywhere, apart from the sky, where that says nothing: ``NaN``, ``0`` or ``0 or less``.
    Raise DataError where it holds only negative numbers.

    A frame of sky may be 0 everywhere, and one that a farm lost NaN everywhere.
    """
    if on_device(frame.depth):
        return None
    for depth in (_looked_at(frame.depth), frame.depth):  # all of it only where the sample decides nothing
        depth = depth[depth != np.inf]
        if not depth.size or (np.isfinite(depth) if frame.camera.orthographic else depth > 0).any():
            return None
    if np.isnan(depth).all():
        return "NaN"
    if (depth == 0).any():
        return "0 or less" if (depth < 0).any() else "0"
    expected, found = "positive numbers, np.inf for the sky", f"{np.nanmin(depth):g} to {np.nanmax(depth):g}"
    how = "depth=-depth" if frame.path is None else "cltaa check tells whether an option mends it"
    cure = f"it is positive before the camera: {how}"
    raise _error(frame, "depth is no distance anywhere", expected, found, cure)


def _warn_of_motion(frame: Frame) -> None:
    """Warn of motion that is infinite, longer than the picture everywhere, or NaN where nothing stands in for it."""
    if frame.motion is None or on_device(frame.motion):
        return
    motion, stands_in = _looked_at(frame.motion), frame.has_camera and frame.has_depth
    told = ""
    if np.isinf(motion).any():
        told = "infinite in places, where history is dropped; NaN there means that the camera's motion is all"
    elif is_too_long(motion, frame):
        told = "longer than the picture everywhere, so there is no history; it is in pixels to the previous frame"
    elif not stands_in and np.isnan(motion).all():
        told = "NaN everywhere, and no camera and depth stand in for it; leave it out, or give them"
    if told:
        warnings.warn(f"motion is {told}", MeaninglessNumbers, stacklevel=5)


def _warn_of_ranges(frame: Frame) -> None:
    """Warn of alpha and reactive masks beyond 0 to 1, and of colour that is no light."""
    found: list[str] = []
    for name in SHARES:
        share: Any = getattr(frame, name)
        if share is None or on_device(share):
            continue
        if (beyond := is_no_share(seen := _looked_at(share))).any():
            what = f"{name} is beyond its range (expected 0 to 1, found {float(seen[beyond][0]):g})"
            found.append(f"{what}; counts as 0 or 1 there; divide bytes by 255")
        elif name == "reactive" and np.isnan(seen).all():
            found.append("reactive is NaN everywhere (expected 0 to 1); counts as 0; leave it out where there is none")
    if not on_device(frame.colour) and (why := is_no_light(_looked_at(frame.colour))):
        found.append(f"colour is {why} (expected linear light); {NO_LIGHT[why]}")
    for line in found:
        warnings.warn(line, MeaninglessNumbers, stacklevel=5)


def is_no_share(plane: NDArray[Any]) -> NDArray[np.bool_]:
    """Return where numbers, of samples that are not missing, are so far from 0 to 1 that no filter took them there."""
    return np.asarray(((plane < -SHARE_SLACK) | (plane > 1.0 + SHARE_SLACK)) & (np.abs(plane) <= LIMIT))


def is_too_long(motion: NDArray[Any], frame: Frame) -> bool:
    """True where every vector [..., 2] in pixels that is finite is far longer than the picture of ``frame``."""
    longest = np.abs(motion).max(-1)
    known = longest[np.isfinite(longest)]
    return bool(known.size and (known > MANY * max(frame.width, frame.height)).all())


def is_no_light(colour: NDArray[Any]) -> str:
    """Return why colour [H, W, 3] is no light, by the words of ``NO_LIGHT``; empty where it may be some."""
    row = colour[colour.shape[0] // 2]  # decides nearly always
    if all(((part < 0) & (part >= -LIMIT)).all() for part in (row, colour)):
        return "negative everywhere"
    bytes_of_picture = _are_bytes(row) and _are_bytes(colour) and len(np.unique(colour)) >= LEAST_BYTES
    return "whole numbers up to 255" if bytes_of_picture else ""


def _are_bytes(numbers: NDArray[Any]) -> bool:
    return bool(((numbers >= 0) & (numbers <= WHITE_BYTE)).all()) and bool((numbers == np.rint(numbers)).all())


def _check_types(frame: Frame) -> None:
    """Raise DataError where the camera, a number or a flag has a wrong type."""
    for name, kinds, expected in (
        ("index", (int, np.integer), "a whole number"),
        ("step", (int, np.integer), WHOLE),
        ("camera", Camera, "a cltaa.Camera"),
        ("exposure", (int, float, np.integer, np.floating), "a number"),
        ("cut", (bool, np.bool_, int), CUT),
        ("scene", str, "text"),
        ("path", (str, Path, NoneType), "a path or None"),
    ):
        if not isinstance(getattr(frame, name), kinds):
            raise _wrong(frame, name, expected)
    if frame.cut not in (0, 1):
        raise _wrong(frame, "cut", CUT)


def _wrong(frame: Frame, name: str, expected: str) -> DataError:
    found = getattr(frame, name)
    shown = repr(found) if isinstance(found, str | int | float | complex) else type(found).__name__
    return _error(frame, f"{name} is wrong", expected, shown)


def _error(frame: Frame, what: str, expected: object, found: object, cure: str | None = None) -> DataError:
    number = frame.index if isinstance(frame.index, int | np.integer) else None
    return DataError(what, path=frame.path, frame=number, expected=expected, found=found, cure=cure)


def check_channels(frame: Frame) -> None:
    """Raise DataError where a channel holds no floats, channels differ in size, or a plane is too large to count."""
    _check_floats(frame, "colour", "depth", *OPTIONAL)
    _check_colour(frame)
    size = frame.colour.shape[:2]
    if Layout(size[1], size[0]).plane > MOST_TEXELS:
        most = f"at most {MOST_TEXELS} texels, the halo of {PAD_X} columns and {PAD_Y} rows a side included"
        raise _error(frame, "the image is too large", most, f"{size[1]} x {size[0]}", "resolve it in parts")
    expected = {"depth": size, "motion": (*size, 2), "alpha": size, "reactive": size}
    for name, shape in expected.items():
        array = getattr(frame, name)
        if array is not None and array.shape != shape:
            cure = "all channels of a frame share one size"
            raise _error(frame, f"{name} has the wrong shape", shape, array.shape, cure)


def _check_colour(frame: Frame) -> None:
    shape = frame.colour.shape
    if len(shape) == 3 and shape[2] == 3 and 0 not in shape:
        return
    expected, cure = "[H, W, 3]", None
    if len(shape) == 3 and shape[2] == 4:
        cure = "the fourth is alpha: colour=rgba[..., :3], alpha=rgba[..., 3]"
    elif len(shape) == 3 and shape[0] == 3:
        cure = "put the axis of the channels last: np.moveaxis(colour, 0, -1)"
    elif 0 in shape:
        expected = "at least one pixel"
    raise _error(frame, "colour has the wrong shape", expected, shape, cure)


def _check_floats(frame: Frame, *names: str) -> None:
    for name in names:
        array: Any = getattr(frame, name)
        if array is None and name in OPTIONAL:
            continue
        is_array = isinstance(array, np.ndarray) or on_device(array)
        if not is_array or array.dtype.kind != "f":
            single = isinstance(array, int | float | np.number)
            found = array.dtype if is_array else "one number" if single else type(array).__name__
            cure = None if is_array else f"give an array: np.asarray({name}, np.float32)"
            if is_array and name == "colour" and array.dtype.kind in "iu":
                cure = "bytes of a picture are no linear light: decode them first"
            raise _error(frame, f"{name} is no array of floats", "float32", found, cure)
        if on_device(array) and array.dtype not in READ_ON_DEVICE:
            cure = "convert it there: array.astype(np.float32)"
            raise _error(frame, f"{name} on the device cannot be read", "float32 or float16", array.dtype, cure)


def _check_effects(frame: Frame) -> None:
    for what, effects in (("effects", frame.effects), ("found effects", frame.found)):
        if not isinstance(effects, set | frozenset | None):
            expected = "frozenset of cltaa.Effect, or None"
            raise _error(frame, f"{what} are no set", expected, type(effects).__name__)
    for name in (*(frame.effects or ()), *(frame.found or ())):
        if name in _EFFECTS:
            continue
        cure = known(str(name), Effect, "effects")
        raise DataError(f"unknown effect {name}", path=frame.path, frame=frame.index, cure=cure)


def check_camera(
    camera: Camera, *, path: Path | None = None, frame: int | None = None, names: tuple[str, ...] | None = None
) -> None:
    """Raise DataError unless both matrices, of those ``names``, are finite, invertible, right-handed and look along -z.

    The last row of the projection must give w = distance along the view axis (perspective) or w = 1 (orthographic):
    then w is positive for every point in front. A matrix transposed by mistake fails this.
    """
    for name, matrix, is_view in zip(
        names or (MATRICES if path else MATRIX_ARGUMENTS),
        (camera.world_to_view, camera.view_to_clip),
        (True, False),
        strict=True,
    ):
        if not isinstance(matrix, np.ndarray) or matrix.shape != (4, 4) or matrix.dtype.kind not in "fiu":
            raise DataError(f"{name} is no 4 x 4 matrix", path=path, frame=frame, found=_kind(matrix))
        if is_view and matrix.dtype == float and _is_rigid(*matrix.tolist()):
            continue
        try:
            _check_matrix(name, matrix.tobytes(), matrix.dtype, is_view)
        except DataError as error:
            told: dict[str, Any] = {"expected": error.expected, "found": error.found, "cure": error.cure}
            raise DataError(error.what, path=path, frame=frame, **told) from None


def _is_rigid(right: list[float], up: list[float], back: list[float], last: list[float]) -> bool:
    """True for a view that only turns and moves: it is sound. Nearly all are, and plain Python finds that in a tenth of
    the time of ``_check_matrix``."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = right, up, back
    lengths = a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, g * g + h * h + i * i - 1.0
    angles = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    return (
        sum(map(abs, (*lengths, *angles))) < INVERSE_TOLERANCE  # no maximum, which may pass over a NaN
        and abs(x) + abs(y) + abs(z) < RIGID_WITHIN
        and a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0.0
        and last == VIEW_ROWS[0]
    )


@lru_cache(maxsize=MATRICES_KEPT)
def _check_matrix(name: str, content: bytes, kind: np.dtype[Any], is_view: bool) -> None:
    """Check a matrix, of that type, once: a projection may be that of every frame, and a camera is checked when it is
    read, when it is resolved, and when its result is written."""
    matrix = np.frombuffer(content, kind).reshape(4, 4)
    if not np.isfinite(matrix).all():
        raise DataError(f"{name} holds NaN or infinity", cure="write the frame again")
    error = _inverse_error(matrix)
    if not error < INVERSE_TOLERANCE:
        expected, found = f"|M inv(M) - I| < {INVERSE_TOLERANCE:g}", f"{error:.3g}"
        raise DataError(f"{name} cannot be inverted", expected=expected, found=found, cure="write the frame again")
    _check_row(name, matrix, VIEW_ROWS if is_view else CLIP_ROWS)
    with np.errstate(over="ignore"):
        scale = float(np.linalg.det(matrix[:3, :3] if is_view else matrix[:2, :2]))
    if not 1 / LARGEST_SCALE <= abs(scale) <= LARGEST_SCALE:
        expected, found = f"a determinant from {1 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}", f"{abs(scale):.3g}"
        raise DataError(f"{name} scales beyond use", expected=expected, found=found, cure="use another unit")
    if is_view and scale < 0:
        expected = "right-handed view space, -z forward"
        raise DataError(f"{name} mirrors the world", expected=expected, cure="flip its z row")


def _check_row(name: str, matrix: NDArray[Any], allowed: tuple[list[int], ...]) -> None:
    def right(row: NDArray[Any]) -> bool:
        return any(np.abs(row - expected).max() < INVERSE_TOLERANCE for expected in allowed)

    if right(matrix[3]):
        return
    cure = "check whether it is transposed"
    if allowed is VIEW_ROWS and [*map(abs, matrix[3])] == [0, 0, 1, 0]:
        cure = "it is a projection: are the two matrices swapped?"
    for kind, row in (
        ("transposed", matrix[:, 3]),
        ("of a camera along +z", matrix[3] * AWAY),
        ("transposed, and of a camera along +z", matrix[:, 3] * AWAY),
    ):
        if right(row):
            cure = f"it is {kind}: of files cltaa check names the options that mend it, of arrays see docs/python.md"
            break
    expected = " or ".join(" ".join(map(str, numbers)) for numbers in allowed)
    what, found = f"{name} has a wrong last row", " ".join(f"{number:g}" for number in matrix[3])
    raise DataError(what, expected=expected, found=found, cure=cure)


def _inverse_error(matrix: NDArray[Any]) -> float:
    try:
        return float(np.abs(matrix @ np.linalg.inv(matrix) - IDENTITY).max())
    except np.linalg.LinAlgError:
        return float("inf")


def check_numbers(
    jitter_px: tuple[float, float],
    exposure: float,
    *,
    path: Path | None,
    frame: int | None,
    jitter_name: str | None = None,
) -> None:
    """Raise DataError unless the jitter, of that name, is two numbers of a pixel or so and the exposure is
    plausible."""
    usual_name, exposure_name = NUMBERS if path else NUMBER_ARGUMENTS
    if type(jitter_px) is tuple and [type(number) for number in jitter_px] == [float, float]:  # the usual case, fast
        sound = abs(jitter_px[0]) < LARGEST_JITTER and abs(jitter_px[1]) < LARGEST_JITTER
    else:
        sound = _is_real(jitter_px) and np.shape(jitter_px) == (2,) and np.abs(jitter_px).max() < LARGEST_JITTER
    if not sound:  # also for NaN
        name, expected = jitter_name or usual_name, f"two numbers of less than {LARGEST_JITTER:g} pixels"
        raise DataError(f"{name} is no jitter", path=path, frame=frame, expected=expected, found=str(jitter_px))
    factor = exposure if isinstance(exposure, int) else float(exposure)  # an integer may be beyond every float
    if not 1 / LARGEST_EXPOSURE <= factor <= LARGEST_EXPOSURE:  # bounds beyond the range of a half
        expected = f"a positive factor within {EXPOSURE_STOPS:g} stops of 1"
        raise DataError(f"{exposure_name} is no exposure", path=path, frame=frame, expected=expected, found=exposure)


def _is_real(value: object) -> bool:
    """True for a real number or real numbers, and no other type."""
    try:
        return np.asarray(value).dtype.kind in "fiu"
    except ValueError:  # ragged
        return False


def _kind(value: object) -> object:
    """Return what describes a value in a message: the shape of an array of numbers, its type of others, else the
    type."""
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    return list(value.shape) if _is_real(value) else value.dtype
