"""What a resolved file carries over from the one that it was made of: layers, attributes, windows, compression."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import UsageError
from cltaa.exr.attributes import MATRICES
from cltaa.exr.channels import Pixels
from cltaa.exr.layout import LOSSLESS, Layout, Windows
from cltaa.exr.read import FrameFile
from cltaa.inputs.parts import read_any_header, read_planes
from cltaa.sequences.sources import Sequence

# Attributes that describe how the input's file was made up, and not what is to be seen in it.
_OF_THE_FILE = frozenset({"name", "type", "chunkCount", "version", "multiView", "view", "cltaa:samples"})

ALL = ("*",)  # layers


class CarriedOver(NamedTuple):
    """Channels by name, attributes and the windows of an input."""

    channels: dict[str, Pixels]
    attributes: dict[str, object]
    windows: Windows


def kept_channels(layout: Layout, layers: tuple[str, ...], replaced: frozenset[str] = frozenset()) -> frozenset[str]:
    """The channels of a file that are carried over: those whose names match one of ``layers``.

    Where ``layers`` are all, those that the resolve ``replaced`` are none of them: who opens the result would take the
    colour that it was made of for it.
    """
    left_out = replaced if layers == ALL else frozenset[str]()
    kept = (name for name in layout.channels if any(fnmatchcase(name, pattern) for pattern in layers))
    return frozenset(kept) - left_out


def chosen_layers(names: tuple[str, ...] | None, sequence: Sequence) -> tuple[str, ...]:
    """Layers by what ``--layers`` says: names, ``all`` or ``none``; by itself all of another tool's files."""
    if names is None:
        names = ("all",) if sequence.notes else ("none",)
    return () if names == ("none",) else ALL if names == ("all",) else names


def kept_kinds(sequence: Sequence, layers: tuple[str, ...]) -> dict[str, str]:
    """The channels that any file of ``sequence`` has carried over -> "uint", "half" or "float"; nothing is read."""
    kept: dict[str, str] = {}
    for layout in sequence.layouts.values():
        names = kept_channels(layout, layers, sequence.replaced)
        kept |= {name: layout.channels[name] for name in names}
    return kept


def carried_over(path: Path, kept: frozenset[str], file: FrameFile | None = None) -> CarriedOver:
    """Read what is carried over from ``path``: every attribute, and the ``kept`` channels.

    ``file`` is what is known of it already. Raises what reading raises.
    """
    header = file.header if file else read_any_header(path, chunks=False)  # the frame is read beside it
    attributes = {name: value for name, value in header.attributes.items() if name not in _OF_THE_FILE}
    channels: dict[str, Pixels] = {}
    if kept:
        planes = file.planes if file and file.planes is not None else read_planes(path, kept)
        channels = {name: plane for name, plane in planes.items() if name in kept}
    return CarriedOver(channels, attributes, (header.layout.data_window, header.layout.display_window))


def merged(carried: CarriedOver, attributes: Mapping[str, object], undeclared: frozenset[str]) -> dict[str, object]:
    """The attributes of a result over what is carried over; those that the input did not declare are not made up.

    Matrices of a file speak of its display window, and those of a frame of its picture: of a region the file's stay.
    """
    if carried.windows[0] != carried.windows[1]:
        undeclared = undeclared | MATRICES
    return carried.attributes | {name: value for name, value in attributes.items() if name not in undeclared}


def check_layers(sequence: Sequence, layers: tuple[str, ...]) -> None:
    """Raise UsageError for a name among ``layers`` that no channel of the first frame matches: it is a slip."""
    channels = sequence.layouts[sequence.first].channels
    for layer in layers:
        if not any(fnmatchcase(name, layer) for name in channels):
            raise UsageError("--layers: no such channel", expected=" ".join(sorted(channels)), found=layer)


def carried_compression(sequence: Sequence) -> str:
    """The compression of the input if it loses nothing, else ZIP."""
    compression = sequence.layouts[sequence.first].compression
    return compression if compression in LOSSLESS else "zip"
