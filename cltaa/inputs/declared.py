"""Matrices, jitter, exposure and cuts of every frame, from attributes or a side file, mended as the profile says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cltaa.cameras import of_region
from cltaa.errors import DataError
from cltaa.exr.layout import Layout
from cltaa.frames import Camera, Matrix
from cltaa.inputs.convert import Offset, jitter_px, mended_camera, standard_camera
from cltaa.inputs.profile import Cameras, Profile
from cltaa.inputs.side_file import Side

Attributes = Mapping[str, object]


class Declared(NamedTuple):
    """What is known of one frame besides its pixels; None where nothing is declared."""

    camera: Camera | None
    jitter_px: Offset | None
    exposure: float | None
    cut: bool


def declared_frames(
    profile: Profile,
    attributes: Mapping[int, Attributes],
    side: Mapping[int, Side],
    layouts: Mapping[int, Layout],
    step: int = 1,
) -> dict[int, Declared]:
    """Jitter and camera of every frame number; numbers are ``step`` apart, ``layouts`` are of the files.

    Raises DataError for a jitter that is none, and for matrices that cannot be converted.
    """
    jitters: dict[int, Offset | None] = dict.fromkeys(attributes)
    matrices: dict[int, tuple[Matrix, Matrix] | None] = dict.fromkeys(attributes)
    for number, given in attributes.items():
        if profile.jitter.source != "none":
            jitters[number] = _jitter(profile, given, side.get(number), layouts[number].path, number)
        if profile.camera.source != "none":
            with _converted(layouts[number].path, number):
                matrices[number] = _matrices(profile.camera, given, side.get(number))
    frames = {}
    for number in attributes:
        # At the ends of the sequence there may be no frame of that delay: the frame's own number is the best guess.
        raw = jitters.get(number + profile.jitter.delay * step, jitters[number])
        jitter = None if raw is None else jitter_px(raw, profile.jitter)
        pair = matrices.get(number + profile.camera.delay * step, matrices[number])
        camera = None
        if pair is not None:
            layout = layouts[number]
            with _converted(layout.path, number):
                whole = mended_camera(*pair, profile.camera, jitter or (0.0, 0.0), *layout.display_size)
            camera = of_region(whole, layout)
        frames[number] = Declared(camera, jitter, *_exposure_and_cut(attributes[number], side.get(number)))
    return frames


@contextmanager
def _converted(path: Path, number: int) -> Iterator[None]:
    """Raise DataError for a matrix without an inverse; what else is wrong with one is found when a frame is made."""
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            yield
    except np.linalg.LinAlgError:
        cure = "write the camera's own, or do without by --input camera.source=none"
        raise DataError("a matrix of the camera has no inverse", path=path, frame=number, cure=cure) from None


def _exposure_and_cut(attributes: Attributes, side: Side | None) -> tuple[float | None, bool]:
    exposure, cut = (None, None) if side is None else (side.exposure, side.cut)
    if exposure is None:
        value = attributes.get("cltaa:exposure")
        exposure = float(value) if isinstance(value, int | float) else None
    return exposure, attributes.get("cltaa:cut") == 1 if cut is None else cut


def _jitter(profile: Profile, attributes: Attributes, side: Side | None, path: Path, number: int) -> Offset | None:
    if side is not None and side.jitter_px is not None:
        return side.jitter_px
    value = attributes.get(profile.jitter.attribute)
    if value is None:
        return None
    try:
        x, y = np.asarray(value, np.float64).ravel()[:2].tolist()
    except (ValueError, TypeError):
        raise DataError(
            f"attribute {profile.jitter.attribute} is no jitter", path=path, frame=number, expected="two numbers",
            cure="write both, or do without by --input jitter.source=none",
        ) from None  # fmt: skip
    return x, y


def _matrices(rule: Cameras, attributes: Attributes, side: Side | None) -> tuple[Matrix, Matrix] | None:
    if side is not None and side.world_to_view is not None and side.view_to_clip is not None:
        return side.world_to_view, side.view_to_clip
    view, projection = _matrix(attributes.get(rule.view)), _matrix(attributes.get(rule.projection))
    if view is None or projection is None:
        return None
    return standard_camera(view, projection, rule.near) if rule.standard else (view, projection)


def _matrix(value: object) -> Matrix | None:
    """A matrix attribute as NumPy's for column vectors (Imath: row vectors), or None."""
    if not isinstance(value, np.ndarray) or value.shape != (4, 4):
        return None
    return np.ascontiguousarray(value.T, np.float64)
