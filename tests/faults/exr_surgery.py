"""Take an EXR file apart, change a part, and put it together again: what no writer would write."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

VERSION = 2


@dataclass
class Anatomy:
    """A single-part file: ``attributes`` as (name, type, value), then its chunks; ``table`` None is the right one."""

    attributes: list[tuple[bytes, bytes, bytes]]
    chunks: list[bytes]
    version: int = VERSION
    table: list[int] | None = None
    sizes: dict[bytes, int] = field(default_factory=dict)  # by attribute: what to say instead of the real size

    def get(self, name: bytes) -> bytes:
        return next(value for other, _, value in self.attributes if other == name)

    def set(self, name: bytes, value: bytes, kind: bytes | None = None) -> None:
        self.attributes = [
            (other, (kind or old_kind) if other == name else old_kind, value if other == name else old)
            for other, old_kind, old in self.attributes
        ]

    def drop(self, name: bytes) -> None:
        self.attributes = [entry for entry in self.attributes if entry[0] != name]

    def add(self, name: bytes, kind: bytes, value: bytes) -> None:
        self.attributes.append((name, kind, value))

    def header(self) -> bytes:
        parts = [struct.pack("<II", 20000630, self.version)]
        for name, kind, value in self.attributes:
            parts.append(name + b"\0" + kind + b"\0" + struct.pack("<i", self.sizes.get(name, len(value))) + value)
        return b"".join([*parts, b"\0"])

    def assembled(self) -> bytes:
        header = self.header()
        count = len(self.chunks) if self.table is None else len(self.table)
        place, offsets = len(header) + 8 * count, []
        for chunk in self.chunks:
            offsets.append(place)
            place += len(chunk)
        table = offsets if self.table is None else self.table
        return b"".join([header, struct.pack(f"<{count}Q", *table), *self.chunks])


def dissect(path: Path) -> Anatomy:
    """Take apart a single-part file of scan lines."""
    content = path.read_bytes()
    attributes, place = [], 8
    while content[place]:
        name_end = content.index(b"\0", place)
        kind_end = content.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<i", content, kind_end + 1)
        start = kind_end + 5
        attributes.append((content[place:name_end], content[name_end + 1 : kind_end], content[start : start + size]))
        place = start + size
    (first,) = struct.unpack_from("<Q", content, place + 1)
    count = (first - place - 1) // 8
    offsets = [*struct.unpack_from(f"<{count}Q", content, place + 1), len(content)]
    chunks = [content[one:other] for one, other in pairwise(offsets)]
    return Anatomy(attributes, chunks)


def window(left: int, top: int, right: int, bottom: int) -> bytes:
    """A box2i: the first and the last pixel, both included."""
    return struct.pack("<4i", left, top, right, bottom)


def channel(name: bytes, kind: int = 2, x_sampling: int = 1, y_sampling: int = 1) -> bytes:
    """One entry of a channel list; kinds are 0 uint, 1 half, 2 float."""
    return name + b"\0" + struct.pack("<4i", kind, 0, x_sampling, y_sampling)


def assembled_parts(parts: list[Anatomy]) -> bytes:
    """Put scan-line parts together into a multi-part file; each needs attributes ``name`` and ``type``."""
    headers = b"".join(part.header()[8:] for part in parts)
    start = struct.pack("<II", 20000630, VERSION | 1 << 12) + headers + b"\0"
    place = len(start) + 8 * sum(len(part.chunks) for part in parts)
    offsets, chunks = [], []
    for number, part in enumerate(parts):
        for chunk in part.chunks:
            offsets.append(place)
            chunks.append(struct.pack("<i", number) + chunk)
            place += 4 + len(chunk)
    return b"".join([start, struct.pack(f"<{len(offsets)}Q", *offsets), *chunks])


def as_part(sound: Path, name: str) -> Anatomy:
    """The image of a single-part file as a part of that name."""
    part = dissect(sound)
    part.drop(b"type")
    part.add(b"name", b"string", name.encode())
    part.add(b"type", b"string", b"scanlineimage")
    part.add(b"chunkCount", b"int", struct.pack("<i", len(part.chunks)))
    return part
