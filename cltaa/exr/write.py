"""Frames and images into EXR files, each complete or not there (``cltaa.files.atomic``)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cltaa.errors import DataError, StorageError, UsageError
from cltaa.exr.attributes import STRUCTURAL, Single, frame_attributes
from cltaa.exr.channels import Pixels, frame_planes
from cltaa.exr.layout import COMPRESSION_NUMBERS, Windows, check_lossless
from cltaa.exr.openexr import OpenEXR
from cltaa.exr.outline import read_layout
from cltaa.exr.zip import ROWS_A_CHUNK, fast_deflate, write_zip
from cltaa.files.atomic import atomic_path
from cltaa.frames import Frame

# Attributes that OpenEXR wants as float; other Python floats are written as doubles, so that none is rounded.
_STANDARD_FLOATS = frozenset({"pixelAspectRatio", "screenWindowWidth", "whiteLuminance", "xDensity", "expTime"})


def write_frame(path: Path, frame: Frame, *, compression: str = "zip") -> None:
    """Write one frame as a multi-channel EXR of float32 channels (``id`` uint32), atomically.

    Raises DataError for a frame whose arrays, matrices or numbers are wrong, OutputError and StorageError for disks.
    """
    write_image(path, frame_planes(frame, path), frame_attributes(frame), compression=compression)


def write_image(
    path: Path,
    channels: Mapping[str, Pixels],
    attributes: Mapping[str, object] | None = None,
    *,
    compression: str = "zip",
    windows: Windows | None = None,
) -> None:
    """Write channels ``[H, W]`` (float16, float32 or uint32, as given) and attributes as one EXR, atomically.

    ``compression`` is one that loses nothing; ``windows`` are those of data and display, else both begin at (0, 0).
    Python floats become doubles, but ``attributes.Single``; arrays keep their precision. Empty lists are left out.
    Raises UsageError for arguments that mean nothing, OutputError and StorageError for disks.
    """
    check_lossless(compression, path)
    shapes = {pixels.shape for pixels in channels.values()}
    types = {pixels.dtype.name for pixels in channels.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2 or not types <= {"float16", "float32", "uint32"}:
        expected = "channels of one shape [H, W], float16, float32 or uint32"
        raise UsageError("channels do not make an image", path=path, expected=expected, found=(shapes, types))
    given = {name: value for name, value in (attributes or {}).items() if name not in STRUCTURAL}
    # OpenEXR reads an empty list, but cannot tell what would be in it, and writes none.
    header = {name: _attribute(name, value) for name, value in given.items() if not _is_empty_list(value)}
    header["compression"] = OpenEXR.Compression(COMPRESSION_NUMBERS[compression])
    header["type"] = OpenEXR.scanlineimage
    for name, window in zip(("dataWindow", "displayWindow"), windows or (), strict=False):
        corners = np.array(window, np.int32).reshape(2, 2)
        header[name] = (corners[0], corners[1])
    # OpenEXR writes wrong pixels, silently, from an array that is not contiguous.
    contiguous = {name: np.ascontiguousarray(pixels) for name, pixels in channels.items()}
    with atomic_path(path) as temporary:
        try:
            deflate = fast_deflate()
            if deflate is not None and compression in ROWS_A_CHUNK:
                write_zip(temporary, header, contiguous, compression, deflate)
            else:
                # As bytes: a str that came from a name in another encoding than UTF-8 cannot be handed over.
                OpenEXR.File(header, contiguous).write(os.fsencode(temporary))
                # A write that fails when OpenEXR closes the file goes unsaid; then the table of chunks is not whole.
                read_layout(temporary)
        except (RuntimeError, ValueError, TypeError, DataError) as error:
            raise StorageError(
                f"OpenEXR could not write it: {error}", path=path, cure="check the free space"
            ) from error


def _attribute(name: str, value: object) -> object:
    if isinstance(value, float) and not isinstance(value, Single) and name not in _STANDARD_FLOATS:
        return np.array([value], dtype=np.float64)  # a bare float would be rounded to float32
    return value


def _is_empty_list(value: object) -> bool:
    return isinstance(value, list) and not value
