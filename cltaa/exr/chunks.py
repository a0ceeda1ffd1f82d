"""The chunks that the pixels of an EXR file stand in: whether each is inside the file and can hold its pixels."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cltaa.errors import DataError
from cltaa.exr.tiles import Counts
from cltaa.files.content import Look

# How many times larger than its chunk in the file a block of pixels can be, where the method has such a limit:
# deflate copies at most 258 bytes for 2 bits, and run lengths repeat a byte 128 times in 2 bytes.
LARGEST_RATIO = {"none": 1, "rle": 64, "zips": 1032, "zip": 1032}


class Table(NamedTuple):
    """A part's table of chunks: where it stands and what it has to say."""

    path: Path
    place: int
    pixels: Counts  # of each chunk
    bytes_a_pixel: int
    compression: str
    leader: int  # bytes that each chunk begins with
    behind: int  # where the first chunk can be: behind all tables


def check_chunks(table: Table, look: Look, length: int) -> None:
    """Check that every chunk begins behind all tables, ends inside the file and can hold its pixels.

    The size of a chunk ends its ``leader`` bytes. One that is smaller than its compression allows cannot be decoded.
    ``look`` reads bytes of the file, which has ``length`` of them. Raises DataError, and struct.error or ValueError
    where bytes are missing.
    """
    path, place, pixels, bytes_a_pixel, compression, leader, behind = table
    if behind > length:
        raise DataError("the file is truncated inside its table of chunks", path=path, cure="write it again")
    offsets = np.frombuffer(look(place, 8 * len(pixels)), dtype="<u8")
    fits = bool((offsets >= behind).all() and (offsets <= length - leader).all())
    if fits:
        ends = (int(offset) + leader for offset in offsets)
        sizes = np.array([struct.unpack_from("<i", look(end - 4, 4))[0] for end in ends])
        fits = bool((sizes >= 0).all() and (offsets + sizes.astype("<u8") <= length - leader).all())
    if not fits:
        raise DataError("the file is truncated or was never finished", path=path, cure="write it again")
    ratio = LARGEST_RATIO.get(compression)
    if ratio is not None and (sizes * ratio < pixels * bytes_a_pixel).any():
        raise DataError("a chunk is too small for its pixels", path=path, cure="write it again")
