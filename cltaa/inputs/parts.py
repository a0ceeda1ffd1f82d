"""Every channel of an EXR file under one name, whether the file has one part or many."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from cltaa.errors import DataError
from cltaa.exr import read_header, read_image
from cltaa.exr_channels import Pixels
from cltaa.exr_layout import COMPRESSIONS, MULTI_PART, Layout
from cltaa.file_content import open_regular
from cltaa.quiet import muted_output

_TYPES = {"float32": "float", "float16": "half", "uint32": "uint"}


@dataclass(frozen=True, slots=True)
class FileHeader:
    """What a file says before its pixels are read: layout over all parts, and the attributes of the first part."""

    layout: Layout
    attributes: dict[str, object]


def read_any_header(path: Path) -> FileHeader:
    """Read the header of a single-part or multi-part EXR; raises InputMissing or DataError."""
    if not _is_multi_part(path):
        header = read_header(path)
        return FileHeader(header.layout, header.attributes)
    return _many(path, header_only=True)[0]


def read_planes(path: Path) -> tuple[dict[str, Pixels], dict[str, object]]:
    """Read every channel [H, W] of all parts, cropped to the display window, and the attributes of the first part."""
    if not _is_multi_part(path):
        return read_image(path)
    header, planes = _many(path, header_only=False)
    return planes, header.attributes


def _is_multi_part(path: Path) -> bool:
    with open_regular(path) as file:
        start = file.read(8)
    return len(start) == 8 and bool(struct.unpack("<I", start[4:])[0] & MULTI_PART)


def _many(path: Path, *, header_only: bool) -> tuple[FileHeader, dict[str, Pixels]]:
    try:
        with muted_output():
            file = OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError, TypeError) as error:
        raise DataError(f"OpenEXR cannot read it: {error}", path=path, cure="write the file again") from error
    if not file.parts:  # the module's way of saying that decoding failed
        raise DataError("the pixels are damaged", path=path, cure="write the file again")
    attributes: dict[str, Any] = dict(file.parts[0].header)
    display = _window(attributes["displayWindow"])
    layout = Layout(path, {}, display, display, COMPRESSIONS[int(attributes["compression"].value)][0])
    planes: dict[str, Pixels] = {}
    for part in file.parts:
        if "deep" in str(part.header["type"]).lower():
            raise DataError("deep parts are not read", path=path, found=part.name(), cure="flatten it")
        data = _window(part.header["dataWindow"])
        crop = Layout(path, {}, data, display, layout.compression).crop
        for channel in part.header["channels"]:
            name = full_name(part.name(), channel.name)
            layout.channels[name] = "?"  # the module tells the type only of decoded pixels
            if not header_only:
                planes[name] = part.channels[channel.name].pixels[crop]
                layout.channels[name] = _TYPES.get(planes[name].dtype.name, "?")
                if planes[name].shape != (layout.height, layout.width):
                    raise DataError("the part does not cover the picture", path=path, channel=name, found=data)
    return FileHeader(layout, attributes), planes


def full_name(part: str, channel: str) -> str:
    """``part.channel``, unless the writer put the part's name into the channel's already."""
    return channel if not part or channel == part or channel.startswith(f"{part}.") else f"{part}.{channel}"


def _window(value: Any) -> tuple[int, int, int, int]:
    (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in value)
    return left, top, right, bottom
