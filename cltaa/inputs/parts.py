"""Every channel of an EXR file under one name, whether the file has one part or many."""

from __future__ import annotations

import struct
from pathlib import Path

from cltaa.errors import DataError
from cltaa.exr.channels import Pixels
from cltaa.exr.header import MULTI_PART
from cltaa.exr.layout import Layout, shared_window
from cltaa.exr.openexr import OpenEXR
from cltaa.exr.outline import parse_parts, read_outline
from cltaa.exr.read import ImageHeader, attributes_of, open_content, read_header, read_image
from cltaa.files.content import check_memory, file_size, open_regular, read_all


def read_any_header(path: Path, *, chunks: bool = True) -> ImageHeader:
    """Read the header of an EXR of one part, or of many: layout over all of them, attributes of the first.

    ``chunks`` as ``read_header``. Raises InputMissing or DataError.
    """
    return _many_header(path, chunks) if _is_multi_part(path) else read_header(path, chunks=chunks)


def read_planes(path: Path, *, sha256: str | None = None) -> tuple[dict[str, Pixels], dict[str, object]]:
    """Read every channel [H, W] of all parts, cropped to the picture, and the attributes of the first part."""
    if not _is_multi_part(path):
        return read_image(path, sha256=sha256)
    header, planes = _many_planes(path, sha256)
    return planes, header.attributes


def _is_multi_part(path: Path) -> bool:
    with open_regular(path) as file:
        start = file.read(8)
    return len(start) == 8 and bool(struct.unpack("<I", start[4:])[0] & MULTI_PART)


def _many_header(path: Path, chunks: bool) -> ImageHeader:
    with open_regular(path) as file:
        layouts = parse_parts(path, file) if chunks else read_outline(path, file).parts
        return _described(layouts, open_content(path, file, header_only=True))


def _many_planes(path: Path, sha256: str | None) -> tuple[ImageHeader, dict[str, Pixels]]:
    with open_regular(path) as file:
        outline, size = read_outline(path, file), file_size(file)
        layouts = outline.parts
        check_memory(path, size)
        content = read_all(path, file, sha256, outline.check_chunks)
    with content:
        check_memory(path, size + 2 * sum(layout.decoded_bytes for layout in layouts))
        decoded = open_content(path, content, header_only=False)
    header, planes = _described(layouts, decoded), dict[str, Pixels]()
    for layout, part in zip(layouts, decoded.parts, strict=True):
        part_of_picture = layout.part_of(header.layout.data_window)
        for channel in layout.channels:
            pixels = part.channels[channel].pixels
            if pixels.shape != (layout.height, layout.width):
                raise DataError("the part does not cover the picture", path=path, channel=channel, found=pixels.shape)
            planes[full_name(part.name(), channel)] = pixels[part_of_picture]
    return header, planes


def _described(layouts: tuple[Layout, ...], file: OpenEXR.File) -> ImageHeader:
    """Layout over all parts, and the attributes of the first."""
    first = layouts[0]
    if len(file.parts) != len(layouts):
        expected, found, cure = f"{len(layouts)} parts", f"{len(file.parts)} that can be read", "write the file again"
        raise DataError("a part is damaged", path=first.path, expected=expected, found=found, cure=cure)
    channels = {
        full_name(layout.part or "", name): kind for layout in layouts for name, kind in layout.channels.items()
    }
    layout = Layout(first.path, channels, shared_window(layouts), first.display_window, first.compression)
    return ImageHeader(layout, attributes_of(file))


def full_name(part: str, channel: str) -> str:
    """``part.channel``, unless the writer put the part's name into the channel's already."""
    return channel if not part or channel == part or channel.startswith(f"{part}.") else f"{part}.{channel}"
