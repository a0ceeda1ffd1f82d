"""Every channel of an EXR file under one name, whether the file has one part or many."""

from __future__ import annotations

import struct
from collections.abc import Container, Iterable, Iterator, Mapping, Sized
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from cltaa.errors import DataError
from cltaa.io.content import FileCopy, check_memory, file_size, open_regular
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_header import MULTI_PART, Outline, read_at, read_outline
from cltaa.io.exr_layout import PIXEL_BYTES, Layout, Window, placed, shared_window
from cltaa.io.exr_read import (
    ImageHeader,
    attributes_of,
    decode_all,
    loaded_parts,
    open_content,
    read_header,
)

NOTHING_ASKED: Mapping[str, float] = MappingProxyType({})


def read_any_header(path: Path, *, chunks: bool = True) -> ImageHeader:
    """Read the header of an EXR of one part, or of many: layout over all of them, attributes of the first.

    Parts of a kind that is not read are left out, and among its ``faults``. ``chunks`` as ``read_header``. Raises
    InputMissing or DataError.
    """
    if _is_multi_part(path):
        return _many_header(path, chunks)
    header = read_header(path, chunks=chunks)
    return replace(header, views=_views((header.layout,), [header.attributes]))


def read_planes(
    path: Path,
    wanted: Container[str] | None = None,
    *,
    sha256: str | None = None,
    picture: Window | None = None,
    outside: Mapping[str, float] = NOTHING_ASKED,
) -> dict[str, Pixels]:
    """Read the channels [H, W] that are ``wanted``, or all, each in its own type, as they lie in the ``picture``.

    By itself the picture is the data window of all parts, or the display window where they have several. Outside of its
    part's data window a channel is 0, or what ``outside`` says of it. Names that no channel has are left out, and a
    part of which nothing is wanted is not decoded.
    Raises InputMissing, DataError, StorageError and ResourceError.
    """
    with loaded_parts(path, sha256) as (outline, content):
        parts, window = outline.parts, picture or shared_window(outline.parts)
        if wanted is None:
            outline.refuse_faults()
        places = {
            full_name(part.part or "", name): (at, name) for at, part in enumerate(parts) for name in part.channels
        }
        places = {name: place for name, place in places.items() if wanted is None or name in wanted}
        kinds = [parts[at].channels[channel] for at, channel in places.values()]
        area = (window[2] - window[0] + 1) * (window[3] - window[1] + 1)
        check_memory(path, content.size + area * sum(PIXEL_BYTES[kind] for kind in kinds))
        decoded = _decoded(outline, content, sorted({at for at, _ in places.values()}))
    return {
        name: placed(decoded[at][channel], parts[at].data_window, window, outside.get(name, 0.0))
        for name, (at, channel) in places.items()
    }


def _decoded(outline: Outline, content: FileCopy, kept: list[int]) -> dict[int, dict[str, Pixels]]:
    """Every channel of some of the parts: OpenEXR's module cannot decode a few of them."""
    path, parts = outline.path, [outline.parts[at] for at in kept]
    check_memory(path, content.size + 2 * sum(part.decoded_bytes for part in parts))
    if not parts:
        return {}
    if parts[0].part is None:
        return {0: decode_all(parts[0], content)[0]}
    with _only(outline, content, kept) as file:
        decoded = open_content(path, file, header_only=False).parts
    _check_count(path, parts, decoded)
    made = {}
    for at, part, found in zip(kept, parts, decoded, strict=True):
        made[at] = {name: found.channels[name].pixels for name in part.channels}
        for channel, plane in made[at].items():
            if plane.shape != (part.height, part.width):
                raise DataError("the file changed while it was read", path=path, channel=channel, found=plane.shape)
    return made


@contextmanager
def _only(outline: Outline, content: FileCopy, kept: list[int]) -> Iterator[FileCopy]:
    """The content of a file, or a copy of it without the parts that are not ``kept``."""
    if len(kept) == len(outline.parts) + len(outline.faults):
        yield content
        return
    with FileCopy() as copy, content.bytes() as everything:
        copy.hold(outline.extract(lambda place, size: bytes(everything[place : place + size]), kept))
        yield copy


def _is_multi_part(path: Path) -> bool:
    with open_regular(path) as file:
        start = file.read(8)
    return len(start) == 8 and bool(struct.unpack("<I", start[4:])[0] & MULTI_PART)


def _many_header(path: Path, chunks: bool) -> ImageHeader:
    with open_regular(path) as file:
        outline = read_outline(path, file)
        if chunks:
            outline.check_chunks(partial(read_at, file), file_size(file))
        if not outline.faults:
            return _described(outline, file)
        with FileCopy() as copy:
            copy.hold(outline.extract(partial(read_at, file), range(len(outline.parts)), pixels=False))
            return _described(outline, copy)


def _described(outline: Outline, content: BinaryIO | FileCopy) -> ImageHeader:
    """Layout over all parts that can be read, and the attributes of the first."""
    file, layouts = open_content(outline.path, content, header_only=True), outline.parts
    first = layouts[0]
    _check_count(first.path, layouts, file.parts)
    channels, windows = dict[str, str](), dict[str, Window]()
    for part in layouts:
        channels |= {full_name(part.part or "", name): kind for name, kind in part.channels.items()}
        windows |= {full_name(part.part or "", name): part.data_window for name in part.channels}
    window = shared_window(layouts)
    layout = Layout(first.path, channels, window, first.display_window, first.compression, windows=windows)
    return ImageHeader(
        layout, attributes_of(file), _views(layouts, [part.header for part in file.parts]), outline.faults
    )


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
    """``part.channel``, without what of the part's name the writer put into the channel's already.

    So channel ``depth.Z`` of a part ``depth.left`` is ``depth.left.Z``.
    """
    if not part or channel == part or channel.startswith(f"{part}."):
        return channel
    layer, dot, last = channel.rpartition(".")
    return (
        f"{part}.{last}"
        if dot and (part.startswith(f"{layer}.") or part.endswith(f".{layer}"))
        else f"{part}.{channel}"
    )
