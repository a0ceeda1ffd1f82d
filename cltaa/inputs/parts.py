"""Every channel of an EXR file under one name, whether the file has one part or many."""

from __future__ import annotations

import struct
from collections.abc import Container, Iterable, Mapping, Sized
from dataclasses import replace
from pathlib import Path

from cltaa.errors import DataError
from cltaa.io.content import FileCopy, check_memory, open_regular
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_header import MULTI_PART, Outline, parse_parts, read_outline
from cltaa.io.exr_layout import Layout, shared_window
from cltaa.io.exr_read import (
    ImageHeader,
    attributes_of,
    decode_all,
    loaded_parts,
    open_content,
    read_header,
)
from cltaa.io.openexr import OpenEXR


def read_any_header(path: Path, *, chunks: bool = True) -> ImageHeader:
    """Read the header of an EXR of one part, or of many: layout over all of them, attributes of the first.

    ``chunks`` as ``read_header``. Raises InputMissing or DataError.
    """
    if _is_multi_part(path):
        return _many_header(path, chunks)
    header = read_header(path, chunks=chunks)
    return replace(header, views=_views((header.layout,), [header.attributes]))


def read_planes(path: Path, wanted: Container[str] | None = None, *, sha256: str | None = None) -> dict[str, Pixels]:
    """Read the channels [H, W] that are ``wanted``, or all, each in its own type, cropped to the picture.

    Names that no channel has are left out. Raises InputMissing, DataError, StorageError and ResourceError.
    """
    with loaded_parts(path, sha256) as (outline, content):
        parts = outline.parts
        places = {
            full_name(part.part or "", name): (at, name) for at, part in enumerate(parts) for name in part.channels
        }
        places = {name: place for name, place in places.items() if wanted is None or name in wanted}
        decoded = _all_decoded(outline, content)
    shown = [part.part_of(shared_window(parts)) for part in parts]
    return {name: decoded[at][channel][shown[at]] for name, (at, channel) in places.items()}


def _all_decoded(outline: Outline, content: FileCopy) -> list[dict[str, Pixels]]:
    """Every channel of every part: OpenEXR's module cannot decode a few of them."""
    path, parts = outline.path, outline.parts
    check_memory(path, content.size + 2 * sum(part.decoded_bytes for part in parts))
    if parts[0].part is None:
        return [decode_all(parts[0], content)[0]]
    decoded = open_content(path, content, header_only=False).parts
    _check_count(path, parts, decoded)
    made = [
        {name: found.channels[name].pixels for name in part.channels}
        for part, found in zip(parts, decoded, strict=True)
    ]
    for part, planes in zip(parts, made, strict=True):
        for channel, plane in planes.items():
            if plane.shape != (part.height, part.width):
                raise DataError("the part does not cover the picture", path=path, channel=channel, found=plane.shape)
    return made


def _is_multi_part(path: Path) -> bool:
    with open_regular(path) as file:
        start = file.read(8)
    return len(start) == 8 and bool(struct.unpack("<I", start[4:])[0] & MULTI_PART)


def _many_header(path: Path, chunks: bool) -> ImageHeader:
    with open_regular(path) as file:
        layouts = parse_parts(path, file) if chunks else read_outline(path, file).parts
        return _described(layouts, open_content(path, file, header_only=True))


def _described(layouts: tuple[Layout, ...], file: OpenEXR.File) -> ImageHeader:
    """Layout over all parts, and the attributes of the first."""
    first = layouts[0]
    _check_count(first.path, layouts, file.parts)
    channels = {
        full_name(layout.part or "", name): kind for layout in layouts for name, kind in layout.channels.items()
    }
    layout = Layout(first.path, channels, shared_window(layouts), first.display_window, first.compression)
    return ImageHeader(layout, attributes_of(file), _views(layouts, [part.header for part in file.parts]))


def _views(layouts: Iterable[Layout], attributes: Iterable[Mapping[str, object]]) -> dict[str, str]:
    """The views of channels by their full names, as attribute ``view`` of their part has it."""
    found = [(layout, its.get("view")) for layout, its in zip(layouts, attributes, strict=True)]
    return {
        full_name(layout.part or "", name): view
        for layout, view in found
        if isinstance(view, str) and view
        for name in layout.channels
    }


def _check_count(path: Path, layouts: Sized, found: Sized) -> None:
    """Raise DataError unless OpenEXR finds as many parts as there are."""
    if len(found) != len(layouts):
        raise DataError(
            "a part is damaged",
            path=path,
            expected=f"{len(layouts)} parts",
            found=f"{len(found)} that can be read",
            cure="write the file again",
        )


def full_name(part: str, channel: str) -> str:
    """``part.channel``, unless the writer put the part's name into the channel's already."""
    return channel if not part or channel == part or channel.startswith(f"{part}.") else f"{part}.{channel}"
