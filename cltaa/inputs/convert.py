"""Convert colour, jitter, motion vectors, depth and matrices as a profile says, and correct profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.frame import Camera, Image, Matrix
from cltaa.inputs.profile import Cameras, Depth, DepthKind, Encoding, Jitter, Motion, Profile, Units, convert_profile
from cltaa.io.display import decoded

# Camera keys that go back to their default when the same correction comes again.
TURNED = ("layout", "view_layout", "projection_layout", "sense")


def correct(profile: Profile, fix: Mapping[str, Mapping[str, Any]]) -> Profile:
    """Apply a correction of ``cltaa check`` to the converted numbers: multiply factors, toggle flags, set the rest."""
    values = msgspec.to_builtins(profile)
    for section, keys in fix.items():
        if "sense" in keys:  # the inverse of F V M, with flips F and M, is M inv(V) F
            held = values[section]
            held["flip_z"], held["mirrored"] = held["mirrored"], held["flip_z"]
        if section == "jitter" and "scale" in keys:  # the offset is added last, so the factors change it too
            values[section]["offset"] = _multiplied(values[section]["offset"], keys)
        for name, change in keys.items():
            before = values[section][name]
            if name == "scale" and isinstance(before, list | tuple):
                values[section][name] = _multiplied(before, keys)
            elif name == "scale":
                values[section][name] = before * change
            elif name == "source" and section == "jitter":  # scale, offset, swap and delay belonged to the old source
                plain = msgspec.to_builtins(Jitter())
                values[section] |= {key: plain[key] for key in ("scale", "offset", "swap", "delay")} | {name: change}
            elif name in ("offset", "delay") and section == "jitter":
                values[section][name] = (
                    before + change if name == "delay" else [a + b for a, b in zip(before, change, strict=True)]
                )
            elif name == "jittered" and section == "motion":  # may cancel what the profile removes
                values[section][name] = max(-1, min(1, before + change))
            elif isinstance(change, bool):
                values[section][name] = before != change
            elif before == change and name in TURNED:
                values[section][name] = getattr(Cameras(), name)
            else:
                values[section][name] = change
    return convert_profile(values, "correction")


def _multiplied(pair: Sequence[float], keys: Mapping[str, Any]) -> list[float]:
    """Return a pair of the profile times the factors of a correction; swapped axes also swap the pair."""
    first = list(pair)[::-1] if keys.get("swap") else list(pair)
    return [a * b for a, b in zip(first, keys["scale"], strict=True)]


Offset = tuple[float, float]

FLIP_Y, FLIP_Z = np.diag([1.0, -1.0, 1.0, 1.0]), np.diag([1.0, 1.0, -1.0, 1.0])


def linear_colour(colour: Image, encoding: Encoding) -> Image:
    """Return colour [H, W, 3] in linear light; extends the sRGB curve above 1."""
    if encoding is Encoding.LINEAR:
        return colour
    return decoded(np.maximum(colour.astype(np.float64), 0.0)).astype(np.float32)


def jitter_px(declared: Offset, rule: Jitter) -> Offset:
    """Convert declared jitter to pixels, x right, y down."""
    if rule.source == "none":
        return 0.0, 0.0
    x, y = declared[::-1] if rule.swap else declared
    return x * rule.scale[0] + rule.offset[0], y * rule.scale[1] + rule.offset[1]


def unit_px(units: Units, size: tuple[int, int]) -> tuple[float, float]:
    """Return the pixels of a unit of vectors, across and down, for a display of ``size``, width and height."""
    width, height = size
    return {Units.PIXELS: (1.0, 1.0), Units.UV: (width, height), Units.NDC: (width / 2, -height / 2)}[units]


def motion_px(
    stored: Image,
    rule: Motion,
    now: Offset,
    before: Offset,
    size: tuple[int, int],
    undrawn: NDArray[np.bool_] | bool = False,
) -> Image:
    """Convert motion [H, W, 2] to pixels, y down, to the previous frame, without the jitter of both frames.

    NaN leaves the motion to depth and matrices, as do zeros where pixels [H, W] are ``undrawn``. Width and height of
    the display, ``size``, scale vectors in UV or NDC.
    """
    unit = unit_px(rule.units, size)
    vectors = stored.astype(np.float64) - rule.offset
    vectors[(vectors == 0.0).all(-1) & (undrawn if rule.zero == "still" else True)] = np.nan
    vectors = (vectors[..., ::-1] if rule.swap else vectors) * rule.scale * unit
    vectors = vectors - rule.jittered * np.subtract(now, before)
    return np.asarray(vectors, np.float32)


def check_depth(rule: Depth, camera: Camera, path: Path, frame: int) -> None:
    """Raise DataError for device depth of an orthographic camera, because only the perspective formula is known."""
    if camera.orthographic and rule.kind in (DepthKind.DEVICE, DepthKind.DEVICE_REVERSED):
        what, cure = "device depth of an orthographic camera is not read", "write distances"
        raise DataError(what, path=path, frame=frame, expected="depth.kind planar", found=rule.kind, cure=cure)


def planar_depth(stored: Image, rule: Depth, camera: Camera, jitter: Offset) -> Image:
    """Convert depth [H, W] to planar depth in scene units, sky +inf."""
    wide = stored.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        if rule.kind is DepthKind.INVERSE:
            planar = 1.0 / wide
        elif rule.kind in (DepthKind.DEVICE, DepthKind.DEVICE_REVERSED):
            near, far = device_planes(rule, camera)  # inverse depth is linear in device depth
            planar = 1.0 / (far + (wide if rule.kind is DepthKind.DEVICE_REVERSED else 1.0 - wide) * (near - far))
        else:
            planar = wide / ray_length(wide.shape, camera, jitter) if rule.kind is DepthKind.RAY else wide
        planar = np.asarray(planar * rule.scale, np.float64)
    # Zero and negative depths stay: the resolve treats them as sky, and cltaa check must see them.
    sky = np.isnan(planar)
    if rule.sky is not None:
        sky |= _is_sky(wide, rule, np.float32(rule.sky))
    return np.where(sky, np.inf, planar).astype(np.float32)


def _is_sky(stored: NDArray[np.float64], rule: Depth, sky: np.float32) -> NDArray[np.bool_]:
    if rule.kind in (DepthKind.INVERSE, DepthKind.DEVICE_REVERSED):  # all surfaces are above the value of the sky
        return np.asarray(stored == sky)
    return np.asarray(stored <= sky if rule.scale < 0.0 and sky < 0.0 else stored >= sky)


def mended_camera(view: Matrix, projection: Matrix, rule: Cameras, jitter: Offset, width: int, height: int) -> Camera:
    """Return the camera in the conventions of docs/conventions.md, from matrices in NumPy layout (transposed)."""
    both = rule.layout == "column"
    view = view.T if both != (rule.view_layout == "column") else view
    projection = projection.T if both != (rule.projection_layout == "column") else projection
    if rule.sense == "camera-to-world":
        view = np.asarray(np.linalg.inv(view), np.float64)
    if rule.flip_z:
        view = FLIP_Z @ view
    if rule.mirrored:
        view = view @ FLIP_Z
    if rule.flip_projection_z:
        projection = projection @ FLIP_Z
    if rule.flip_y:
        projection = FLIP_Y @ projection
    if rule.jittered:
        back = np.eye(4)
        back[0, 3], back[1, 3] = 2 * jitter[0] / width, -2 * jitter[1] / height
        projection = back @ projection
    return Camera(np.ascontiguousarray(view, np.float64), np.ascontiguousarray(projection, np.float64))


def without_jitter(cameras: Sequence[Camera], sizes: Sequence[tuple[int, int]]) -> tuple[list[Camera], list[Offset]]:
    """Move the projection centres to their mean; return the cameras and the jitter that each had in its picture."""
    columns = [3 if camera.orthographic else 2 for camera in cameras]  # matrix column with w and the centre times w
    both = list(zip(cameras, columns, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        centres = np.array([camera.view_to_clip[:2, at] / camera.view_to_clip[3, at] for camera, at in both])
    known = np.isfinite(centres).all(1)  # the check of its frame reports a matrix without a centre
    mean = centres[known].mean(0) if known.any() else np.zeros(2)
    steady = []
    for (camera, at), there in zip(both, known, strict=True):
        projection = camera.view_to_clip.copy()
        if there:
            projection[:2, at] = mean * projection[3, at]  # assigned, so that a still camera has one exact matrix
        steady.append(Camera(camera.world_to_view, projection))
    jitter = np.where(known[:, None], (centres - mean) * sizes * (-0.5, 0.5), 0.0)
    return steady, [(float(x), float(y)) for x, y in jitter]


def standard_camera(world_to_camera: Matrix, world_to_ndc: Matrix, near: float) -> tuple[Matrix, Matrix]:
    """Return view and projection from the EXR standard's two matrices, whose writers disagree about range and signs.

    The view is right-handed and looks along -z; the projection has no far plane. Its centre tells the range of NDC.
    """
    view = world_to_camera
    # The standard's camera is left-handed; a right-handed one already looks along -z.
    view = view if np.linalg.det(view[:3, :3]) > 0 else FLIP_Z @ view
    clip = world_to_ndc @ np.linalg.inv(view)
    orthographic = abs(clip[3, 2]) < 1e-6 * abs(clip[3, 3])
    column = 3 if orthographic else 2
    w = clip[3, column]
    if w == 0.0:
        raise np.linalg.LinAlgError  # nothing divides the image plane
    across, up, centre = abs(clip[0, 0] / w), abs(clip[1, 1] / w), clip[:2, column] / w
    if abs(centre[0]) > 0.25 or abs(centre[1]) > 0.25:  # NDC from 0 to 1: the view axis is near (0.5, 0.5)
        across, up, centre = 2 * across, 2 * up, (centre * 2 - 1) * (1.0, -1.0)
    if orthographic:
        return view, np.array([[across, 0, 0, centre[0]], [0, up, 0, centre[1]], [0, 0, -near, 0], [0, 0, 0, 1]])
    projection = np.array([[across, 0, -centre[0], 0], [0, up, -centre[1], 0], [0, 0, -1, -2 * near], [0, 0, -1, 0]])
    return view, projection


def device_planes(rule: Depth, camera: Camera) -> tuple[float, float]:
    """Return the inverse depth of the near and the far plane of device depth."""
    near, far = planes_of(camera.view_to_clip)
    return 1.0 / rule.near if rule.near else near, 1.0 / rule.far if rule.far else far


def planes_of(projection: Matrix, *, from_zero: bool = False) -> tuple[float, float]:
    """Return the inverse depth of the near and the far plane of a perspective projection, 0 for a missing plane.

    NDC z = b / Z - a, with a and b the last two entries of its third row. If z falls with Z (b > 0), z is 1 at the near
    and 0 at the far plane. Else z is 1 at the far plane, and at the near plane -1, or 0 if clip space begins
    ``from_zero``, which the matrix cannot tell.
    """
    a, b = projection[2, 2:].tolist()
    if b == 0.0:
        return 0.0, 0.0
    near, far = (1.0 + a, a) if b > 0.0 else (a - (0.0 if from_zero else 1.0), 1.0 + a)
    return near / b, max(far / b, 0.0)


def ray_length(shape: tuple[int, ...], camera: Camera, jitter: Offset) -> NDArray[np.float64]:
    """Return the length [H, W] of the ray through each sample at planar distance 1; 1 for an orthographic camera."""
    height, width = shape[0], shape[1]
    if camera.orthographic:
        return np.ones((height, width))
    y, x = np.mgrid[:height, :width].astype(np.float64)
    clip = camera.view_to_clip
    ndc = np.stack([(x + 0.5 + jitter[0]) / width * 2 - 1, 1 - (y + 0.5 + jitter[1]) / height * 2])
    ray = np.tensordot(np.linalg.inv(clip[:2, :2]), ndc + clip[:2, 2, None, None], 1)
    return np.asarray(np.sqrt(1.0 + (ray**2).sum(0)))
