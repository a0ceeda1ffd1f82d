"""EXR files in: frames with everything a resolve needs, plain images, and single channels of multi-part files.

Reading checks the file (``cltaa.io.exr_header``) before OpenEXR sees it, its SHA-256 (``cltaa.io.content``) where one
is known, and the header (``cltaa.io.exr_frame``) before a number is used, so that wrong input ends in one DataError or
InputMissing.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np

from cltaa.core.planes import empty_haloed
from cltaa.errors import DataError
from cltaa.frame import Frame, Image
from cltaa.io.content import FileCopy, check_memory, copied, file_size, open_regular
from cltaa.io.exr_frame import (
    COLOUR,
    GROUPS,
    STRUCTURAL,
    Pixels,
    Single,
    check_float_channels,
    check_frame_channels,
    frame_outline,
)
from cltaa.io.exr_header import UNKNOWN, Outline, checked_outline, read_at, read_outline
from cltaa.io.exr_layout import OUTSIDE, PIXEL_BYTES, Layout, placed, shared_window
from cltaa.io.openexr import OpenEXR, muted_output

NOTHING_ASKED: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """A file's layout and its attributes by name, as from ``attributes_of``, read without its pixels.

    Of several parts ``attributes`` are those of all, the first part's before the others'. ``views`` are those of
    channels by the attribute ``view`` of their part, ``faults`` the errors of unreadable parts by name, ``own`` the
    attributes of the part of each channel.
    """

    layout: Layout
    attributes: dict[str, object]
    views: Mapping[str, str] = field(default_factory=dict)
    faults: Mapping[str, DataError] = field(default_factory=dict)
    own: Mapping[str, dict[str, object]] = field(default_factory=dict)

    def of_channel(self, name: str) -> dict[str, object]:
        """Return the attributes of a channel's part, such as the camera of its view, before those of other parts."""
        return self.attributes | self.own.get(name, {})


class FrameFile(NamedTuple):
    """The header of a frame's file, and other channels [H, W] that were decoded with the frame."""

    header: ImageHeader
    planes: Mapping[str, Pixels] | None = None


def read_frame_and_header(
    path: Path, *, sha256: str | None = None, picture: Layout | None = None
) -> tuple[Frame, ImageHeader]:
    """Read one frame and its header; channels [H, W, 3] and others are views of planes with a halo.

    Half-precision channels are widened exactly, but half depth is refused. Channels with other names are ignored.
    ``sha256`` is the required hash of the file's content, in hexadecimal; ``picture`` is the layout found on
    opening, whose data window replaces that of the file. Raises InputMissing, DataError, StorageError and
    ResourceError.
    """
    layout, pixels, attributes = _read(path, sha256, picture, check_frame_channels)
    size = (layout.height, layout.width)
    # Each group in a block of its own, so that freed blocks fit the next frame.
    groups = {group: empty_haloed(len(group), *size) for group in GROUPS if group[0] in pixels}
    for group, stack in groups.items():
        for name, plane in zip(group, stack, strict=True):
            plane[...] = pixels.pop(name)
    parts = {group[0]: np.moveaxis(stack, 0, -1) for group, stack in groups.items()}
    frame = replace(
        frame_outline(path, attributes, layout),
        colour=parts["R"],
        depth=cast(Image, pixels["Z"]),  # no device reads it in place: it stays where it was decoded
        motion=parts.get("backward.u"),
        alpha=parts["A"][..., 0] if "A" in parts else None,
        reactive=parts["reactive"][..., 0] if "reactive" in parts else None,
        object_id=cast(Image | None, pixels.get("id")),  # uint32: float32 would merge neighbours above 2^24
        normal=parts.get("N.X"),
    )
    return frame, ImageHeader(layout, attributes)


def read_image(
    path: Path, *, sha256: str | None = None, picture: Layout | None = None
) -> tuple[dict[str, Pixels], dict[str, object]]:
    """Read every channel ``[H, W]`` in its own type, and the attributes that describe the picture; errors as above."""
    _, pixels, attributes = _read(path, sha256, picture)
    return pixels, {name: value for name, value in attributes.items() if name not in STRUCTURAL}


def read_header(path: Path) -> ImageHeader:
    """Read the layout and attributes of a file of one part without decoding pixels; refuses several parts."""
    return read_any_header(path, one=True)


def read_any_header(path: Path, *, chunks: bool = True, one: bool = False) -> ImageHeader:
    """As ``read_header``, of one part or several: layout and attributes over all of them.

    Checks that every chunk lies inside the file, unless ``chunks`` is False. Parts of an unsupported kind are left out,
    and listed in ``faults``. Raises InputMissing or DataError.
    """
    with open_regular(path) as file:
        outline = (checked_outline if chunks else read_outline)(path, file, one=one)
        if not outline.faults and not outline.odd:
            return _described(outline, file)
        with FileCopy() as heads, FileCopy() as readable:
            heads.hold([read_at(file, 0, outline.end), bytes(outline.behind - outline.end)])
            heads.overwrite(outline.odd, UNKNOWN)
            if not outline.faults:
                return _described(outline, heads)
            readable.hold(outline.extract(heads.read_at, outline.tables, pixels=False))
            return _described(outline, readable)


def _described(outline: Outline, content: BinaryIO | FileCopy) -> ImageHeader:
    """Return the layout and the attributes over all readable parts."""
    parts, layout = outline.parts, outline.parts[0]
    found = [*map(attributes_of, open_content(outline.path, content, len(parts), header_only=True))]
    pairs = zip(parts, found, strict=True)
    every = {full_name(part.part or "", name): (part, name, its) for part, its in pairs for name in part.channels}
    if layout.part is not None:
        channels = {name: part.channels[short] for name, (part, short, _) in every.items()}
        windows = {name: part.data_window for name, (part, *_) in every.items()}
        window = shared_window(parts)
        layout = Layout(layout.path, channels, window, layout.display_window, layout.compression, windows=windows)
    own = {name: its for name, (*_, its) in every.items()}
    views = {name: view for name, its in own.items() if isinstance(view := its.get("view"), str) and view}
    attributes = {name: value for its in reversed(found) for name, value in its.items()}
    return ImageHeader(layout, attributes, views, outline.faults, own)


def read_colour(path: Path, *, sha256: str | None = None, picture: Layout | None = None, alpha: bool = False) -> Image:
    """Read R G B, and with ``alpha`` A where it exists, as a [H, W, 3 or 4] float32 view of a planar block; errors and
    other options as ``read_frame_and_header``."""
    layout, pixels, _ = _read(path, sha256, picture, lambda layout: check_float_channels(layout, COLOUR))
    names = (*COLOUR, "A") if alpha and layout.channels.get("A", "uint") != "uint" else COLOUR
    return np.moveaxis(np.stack([pixels[name] for name in names]).astype(np.float32, copy=False), 0, -1)


@contextmanager
def loaded_parts(path: Path, sha256: str | None, *, one: bool = False) -> Iterator[tuple[Outline, FileCopy]]:
    """Check the headers, read the whole file, of ``one`` part if asked, and check in memory what is decoded there.

    The content is freed at the end of the block: a large picture hardly fits into memory twice.
    """
    with open_regular(path) as file:
        outline = read_outline(path, file, one=one)
        check_memory(path, file_size(file))
        content = copied(path, file)
    with content:
        outline.check_chunks(content.read_at, content.size)
        if sha256 is not None:
            content.check_sha256(path, sha256)
        content.overwrite(outline.odd, UNKNOWN)
        yield outline, content


def _read(
    path: Path, sha256: str | None, picture: Layout | None, check: Callable[[Layout], object] = lambda _: None
) -> tuple[Layout, dict[str, Pixels], dict[str, object]]:
    """Return layout, channels and attributes of the ``picture`` of a file of one part that passes ``check``."""
    with loaded_parts(path, sha256, one=True) as (outline, content):
        (layout,) = outline.parts
        # Beside the pixels memory holds the packed file first, and then the one channel that is being moved into the
        # frame.
        check_memory(path, layout.decoded_bytes + max(content.size, 4 * layout.width * layout.height))
        check(layout)
        if picture is None:
            layout.refuse_outside()
        else:
            picture.check_unchanged(layout)
        shown = layout if picture is None else layout.showing(picture.data_window)
        if shown != layout:
            check_memory(path, layout.decoded_bytes + content.size + shown.decoded_bytes)
        (pixels,), attributes = _decoded(path, [layout], content)
    windows = layout.data_window, shown.data_window
    made = {name: placed(plane, *windows, OUTSIDE.get(name, 0.0)) for name, plane in pixels.items()}
    return shown, made, attributes


def _decoded(
    path: Path, parts: Sequence[Layout], content: BinaryIO | FileCopy
) -> tuple[list[dict[str, Pixels]], dict[str, object]]:
    """Decode every channel of these parts, because OpenEXR's module cannot decode a few; and the first's attributes."""
    found = open_content(path, content, len(parts), header_only=False)
    decoded = [{name: channel.pixels for name, channel in part.channels.items()} for part in found]
    for part, planes in zip(parts, decoded, strict=True):
        shapes = {plane.shape for plane in planes.values()}
        if planes.keys() != part.channels.keys() or not shapes <= {(part.height, part.width)}:
            raise DataError("the file changed while it was read", path=path, cure="run again")
    return decoded, attributes_of(found[0])


def open_content(path: Path, content: BinaryIO | FileCopy, count: int, *, header_only: bool) -> list[OpenEXR.Part]:
    """Let OpenEXR decode an open file, whose layout was checked and which has ``count`` parts; raises DataError."""
    # By the name of the descriptor: the file's own need not be UTF-8, and OpenEXR itself would print it raw. Not as a
    # stream: OpenEXR's threads would acquire the GIL hundreds of times a frame to read from one.
    name = f"/proc/self/fd/{content.fileno()}"
    try:
        # Separate channels: merging R, G and B in the module had memory errors, and loses mixed types.
        with muted_output():
            file = OpenEXR.File(name, separate_channels=True, header_only=header_only)
        if not file.parts:  # so the module reports that decoding failed
            raise DataError("the pixels are damaged", path=path, cure="write the file again")
        parts: list[OpenEXR.Part] = file.parts
        for part in parts:
            part.header  # noqa: B018  which the module converts only now
    except (RuntimeError, ValueError, TypeError, ArithmeticError) as error:
        said = str(error).replace(name, "it")
        raise DataError(f"OpenEXR cannot read it: {said}", path=path, cure="write the file again") from error
    if len(parts) != count:
        found, expected = f"{len(parts)} that can be read", f"{count} parts"
        raise DataError("a part is damaged", path=path, expected=expected, found=found, cure="write the file again")
    return parts


def attributes_of(part: OpenEXR.Part) -> dict[str, object]:
    """Return the attributes of a part by name; a double, which arrives as an array of one, as a float."""

    def scalar(value: Any) -> object:
        if isinstance(value, float):
            return Single(value)
        of_one = isinstance(value, np.ndarray) and value.shape == (1,) and value.dtype == np.float64
        return float(value[0]) if of_one else value

    return {name: scalar(value) for name, value in part.header.items()}


def read_planes(
    path: Path,
    wanted: Container[str] | None = None,
    *,
    sha256: str | None = None,
    picture: Layout | None = None,
    outside: Mapping[str, float] = NOTHING_ASKED,
) -> dict[str, Pixels]:
    """Read the ``wanted`` channels [H, W], or all, each in its own type, in the data window of ``picture``.

    By default the picture is the data window of all parts, or the display window where they have several. Outside of
    its part's data window a channel is 0, or its value in ``outside``. Names that no channel has are ignored. Raises
    InputMissing, DataError, StorageError and ResourceError.
    """
    with loaded_parts(path, sha256) as (outline, content):
        parts, window = outline.parts, shared_window(outline.parts)
        if picture is not None:
            if path == picture.path:
                picture.check_unchanged(replace(parts[0], data_window=window))
            window = picture.data_window
        if wanted is None:
            outline.refuse_faults()
        places = {
            full_name(part.part or "", name): (at, name) for at, part in enumerate(parts) for name in part.channels
        }
        places = {name: place for name, place in places.items() if wanted is None or name in wanted}
        kinds = [parts[at].channels[channel] for at, channel in places.values()]
        area = (window[2] - window[0] + 1) * (window[3] - window[1] + 1)
        check_memory(path, content.size + area * sum(PIXEL_BYTES[kind] for kind in kinds))
        kept = sorted({at for at, _ in places.values()})
        layouts = [parts[at] for at in kept]
        check_memory(path, content.size + 2 * sum(part.decoded_bytes for part in layouts))
        decoded: dict[int, dict[str, Pixels]] = {}
        if kept:
            with _only(outline, content, kept) as file:
                decoded = dict(zip(kept, _decoded(path, layouts, file)[0], strict=True))
    return {
        name: placed(decoded[at][channel], parts[at].data_window, window, outside.get(name, 0.0))
        for name, (at, channel) in places.items()
    }


@contextmanager
def _only(outline: Outline, content: FileCopy, kept: list[int]) -> Iterator[FileCopy]:
    """Yield the content of a file, or a copy of it without the parts that are not ``kept``."""
    if len(kept) == len(outline.parts) + len(outline.faults):
        yield content
        return
    with FileCopy() as copy:
        copy.hold(outline.extract(content.read_at, [outline.tables[part] for part in kept]))
        yield copy


def full_name(part: str, channel: str) -> str:
    """Return ``part.channel``, without what of the part's name the writer has already put into the channel's.

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
