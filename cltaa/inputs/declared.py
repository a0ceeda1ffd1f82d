"""What each frame of another tool declares: matrices, jitter, exposure and cut, from its header or a side file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cltaa.core.frame_checks import check_numbers
from cltaa.errors import DataError
from cltaa.frame import Camera, Matrix
from cltaa.inputs.convert import Offset, jitter_px, mended_camera, standard_camera, without_jitter
from cltaa.inputs.profile import Cameras, Profile
from cltaa.inputs.side_file import Side
from cltaa.io.exr_frame import read_cut, read_number, wrong_attribute
from cltaa.io.exr_layout import Layout, of_region

Attributes = Mapping[str, object]


class Source(NamedTuple):
    """The file that matrices or jitter were read from, and their names there."""

    path: Path
    names: tuple[str, ...]


class Declared(NamedTuple):
    """Declared values of one frame; None for undeclared ones."""

    camera: Camera | None
    jitter_px: Offset | None
    exposure: float | None
    cut: bool
    matrices_from: Source
    jitter_from: Source


def declared_frames(
    profile: Profile,
    attributes: Mapping[int, Attributes],
    side: Mapping[int, Side],
    side_file: Path | None,
    layouts: Mapping[int, Layout],
    step: int,
) -> dict[int, Declared]:
    """Return the declared values of every frame number; numbers are ``step`` apart, ``layouts`` are of the files.
    Raises DataError for an invalid jitter, and for matrices that cannot be converted."""
    jitters: dict[int, Offset | None] = dict.fromkeys(attributes)
    matrices: dict[int, tuple[Matrix, Matrix] | None] = dict.fromkeys(attributes)

    def source(number: int, delay: int, keys: tuple[str, ...], there: tuple[str, ...]) -> Source:
        number = number + delay * step if number + delay * step in attributes else number
        if side_file is not None and number in side and getattr(side[number], keys[0]) is not None:
            return Source(side_file, keys)
        return Source(layouts[number].path, there)

    rule, keys, jitter_key = profile.camera, ("world_to_view", "view_to_clip"), ("jitter_px",)
    in_header, attribute = (f"matrix {rule.view}", f"matrix {rule.projection}"), f"attribute {profile.jitter.attribute}"
    own = {number: source(number, 0, keys, in_header) for number in attributes}
    matrices_from = {number: source(number, rule.delay, keys, in_header) for number in attributes}
    jitter_from = {number: source(number, profile.jitter.delay, jitter_key, (attribute,)) for number in attributes}
    for number, given in attributes.items():
        if profile.jitter.source == "declared":
            jitters[number] = _jitter(profile, given, side.get(number), layouts[number].path, number)
        if profile.camera.source != "none":
            with _converted(own[number].path, number):
                matrices[number] = _matrices(profile.camera, given, side.get(number), layouts[number].path)

    def jitter_of(number: int) -> Offset | None:
        # At the ends of the sequence the delayed frame may not exist; the frame's own values are the best guess.
        raw = jitters.get(number + profile.jitter.delay * step, jitters[number])
        return None if raw is None else jitter_px(raw, profile.jitter)

    cameras: dict[int, Camera] = {}
    for number in attributes:
        pair = matrices.get(number + profile.camera.delay * step, matrices[number])
        if pair is not None:
            size = layouts[number].display_size
            with _converted(matrices_from[number].path, number):
                cameras[number] = mended_camera(*pair, profile.camera, jitter_of(number) or (0.0, 0.0), *size)
    if profile.jitter.source == "projection" and cameras:
        steady, held = without_jitter([*cameras.values()], [layouts[number].display_size for number in cameras])
        jitters |= dict(zip(cameras, held, strict=True))
        for number, (path, (_, projection)) in matrices_from.items():
            jitter_from[number] = Source(path, (f"the jitter in {projection}",))
        cameras = dict(zip(cameras, steady, strict=True))
    frames = {}
    for number in attributes:
        camera = of_region(cameras[number], layouts[number]) if number in cameras else None
        exposure_and_cut = _exposure_and_cut(attributes[number], side.get(number), layouts[number].path, number)
        sources = matrices_from[number], jitter_from[number]
        frames[number] = Declared(camera, jitter_of(number), *exposure_and_cut, *sources)
    return frames


@contextmanager
def _converted(path: Path, number: int) -> Iterator[None]:
    """Raise DataError for a matrix without an inverse; making a frame finds all other errors of matrices."""
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            yield
    except np.linalg.LinAlgError:
        cure = "write the camera's own, or do without by --input camera.source=none"
        raise DataError("a matrix of the camera has no inverse", path=path, frame=number, cure=cure) from None


def _exposure_and_cut(attributes: Attributes, side: Side | None, path: Path, number: int) -> tuple[float | None, bool]:
    exposure, cut = (None, None) if side is None else (side.exposure, side.cut)
    if exposure is None and "cltaa:exposure" in attributes:
        exposure = read_number(attributes, "cltaa:exposure", path, default=1.0)
        check_numbers((0.0, 0.0), exposure, path=path, frame=number)
    return exposure, read_cut(attributes, path) if cut is None else cut


def _jitter(profile: Profile, attributes: Attributes, side: Side | None, path: Path, number: int) -> Offset | None:
    if side is not None and side.jitter_px is not None:
        return side.jitter_px
    value = attributes.get(profile.jitter.attribute)
    if value is None:
        return None
    with suppress(ValueError, TypeError):
        x, y, *_ = np.asarray(value, np.float64).tolist()  # engines keep longer vectors; of a matrix x is a list
        if np.isfinite((x, y)).all():
            return float(x), float(y)
    what = f"attribute {profile.jitter.attribute} is no jitter"
    cure = "write both, or do without by --input jitter.source=none"
    raise DataError(what, path=path, frame=number, expected="two numbers", cure=cure)


def _matrices(rule: Cameras, attributes: Attributes, side: Side | None, path: Path) -> tuple[Matrix, Matrix] | None:
    if side is not None and side.world_to_view is not None and side.view_to_clip is not None:
        return side.world_to_view, side.view_to_clip
    view, projection = (_matrix(attributes, name, path) for name in (rule.view, rule.projection))
    if view is None or projection is None:
        return None
    return standard_camera(view, projection, rule.near) if rule.standard else (view, projection)


def _matrix(attributes: Attributes, name: str, path: Path) -> Matrix | None:
    """Return a matrix attribute as a NumPy matrix for column vectors (Imath: row vectors), or None if missing."""
    value = attributes.get(name)
    if value is not None and (not isinstance(value, np.ndarray) or value.shape != (4, 4)):
        cure = "write it so, or do without by --input camera.source=none"
        raise wrong_attribute(name, path, "M44d or M44f", value, cure)
    return None if value is None else np.ascontiguousarray(value.T, np.float64)
