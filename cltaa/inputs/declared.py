"""What each frame of another tool declares: matrices, jitter, exposure and cut, from its header or a side file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
EXPOSURE, CUT = "cltaa:exposure", "cltaa:cut"


class Stated(NamedTuple):
    """What the header of one of a frame's files says."""

    path: Path
    attributes: Attributes


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


def stated_names(profile: Profile) -> frozenset[str]:
    """Return the attributes that declare something of a frame."""
    return frozenset({profile.camera.view, profile.camera.projection, profile.jitter.attribute, EXPOSURE, CUT})


def _first(files: Sequence[Stated], *names: str) -> Stated:
    """Return the first of a frame's files whose header has all these attributes, else the first."""
    return next((file for file in files if file.attributes.keys() >= {*names}), files[0])


def declared_frames(
    profile: Profile,
    files: Mapping[int, Sequence[Stated]],
    side: Mapping[int, Side],
    side_file: Path | None,
    layouts: Mapping[int, Layout],
    step: int,
) -> dict[int, Declared]:
    """Return the declared values of every frame number; numbers are ``step`` apart, ``layouts`` are of the pictures.
    Of the ``files`` of a frame the first counts that says something, the colour's before the others. Raises DataError
    for an invalid jitter, and for matrices that cannot be converted."""
    jitters: dict[int, Offset | None] = dict.fromkeys(files)
    matrices: dict[int, tuple[Matrix, Matrix] | None] = dict.fromkeys(files)

    def source(number: int, delay: int, keys: tuple[str, ...], kind: str, *names: str) -> Source:
        number = number + delay * step if number + delay * step in files else number
        if side_file is not None and number in side and getattr(side[number], keys[0]) is not None:
            return Source(side_file, keys)
        return Source(_first(files[number], *names).path, tuple(f"{kind} {name}" for name in names))

    rule, keys, jitter = profile.camera, ("world_to_view", "view_to_clip"), profile.jitter
    both = "matrix", rule.view, rule.projection
    own = {number: source(number, 0, keys, *both) for number in files}
    matrices_from = {number: source(number, rule.delay, keys, *both) for number in files}
    jitter_from = {n: source(n, jitter.delay, ("jitter_px",), "attribute", jitter.attribute) for n in files}
    for number, its in files.items():
        if profile.jitter.source == "declared":
            jitters[number] = _jitter(profile, _first(its, jitter.attribute), side.get(number), number)
        if profile.camera.source != "none":
            with _converted(own[number].path, number):
                matrices[number] = _matrices(rule, _first(its, rule.view, rule.projection), side.get(number))

    def jitter_of(number: int) -> Offset | None:
        # At the ends of the sequence the delayed frame may not exist; the frame's own values are the best guess.
        raw = jitters.get(number + profile.jitter.delay * step, jitters[number])
        return None if raw is None else jitter_px(raw, profile.jitter)

    cameras: dict[int, Camera] = {}
    for number in files:
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
    for number, its in files.items():
        camera = of_region(cameras[number], layouts[number]) if number in cameras else None
        exposure_and_cut = _exposure_and_cut(its, side.get(number), number)
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


def _exposure_and_cut(files: Sequence[Stated], side: Side | None, number: int) -> tuple[float | None, bool]:
    exposure, cut = (None, None) if side is None else (side.exposure, side.cut)
    path, attributes = _first(files, EXPOSURE)
    if exposure is None and EXPOSURE in attributes:
        exposure = read_number(attributes, EXPOSURE, path, default=1.0)
        check_numbers((0.0, 0.0), exposure, path=path, frame=number)
    path, attributes = _first(files, CUT)
    return exposure, read_cut(attributes, path) if cut is None else cut


def _jitter(profile: Profile, stated: Stated, side: Side | None, number: int) -> Offset | None:
    if side is not None and side.jitter_px is not None:
        return side.jitter_px
    value = stated.attributes.get(profile.jitter.attribute)
    if value is None:
        return None
    with suppress(ValueError, TypeError):
        x, y, *_ = np.asarray(value, np.float64).tolist()  # engines keep longer vectors; of a matrix x is a list
        if np.isfinite((x, y)).all():
            return float(x), float(y)
    what = f"attribute {profile.jitter.attribute} is no jitter"
    cure = "write both, or do without by --input jitter.source=none"
    raise DataError(what, path=stated.path, frame=number, expected="two numbers", cure=cure)


def _matrices(rule: Cameras, stated: Stated, side: Side | None) -> tuple[Matrix, Matrix] | None:
    if side is not None and side.world_to_view is not None and side.view_to_clip is not None:
        return side.world_to_view, side.view_to_clip
    view, projection = (_matrix(stated, name) for name in (rule.view, rule.projection))
    if view is None or projection is None:
        return None
    return standard_camera(view, projection, rule.near) if rule.standard else (view, projection)


def _matrix(stated: Stated, name: str) -> Matrix | None:
    """Return a matrix attribute as a NumPy matrix for column vectors (Imath: row vectors), or None if missing."""
    value = stated.attributes.get(name)
    if value is not None and (not isinstance(value, np.ndarray) or value.shape != (4, 4)):
        cure = "write it so, or do without by --input camera.source=none"
        raise wrong_attribute(name, stated.path, "M44d or M44f", value, cure)
    return None if value is None else np.ascontiguousarray(value.T, np.float64)
