"""The frames of a sequence with all that a resolve has to know of their files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

from cltaa.errors import DataError
from cltaa.files.manifest import file_sha256
from cltaa.frames import Frame
from cltaa.resolve.carried_over import CarriedOver, carried_over, kept_channels
from cltaa.resolve.output import Source
from cltaa.sequences.pixel_statistics import is_opaque, unusable_pixels
from cltaa.sequences.sources import Sequence


class Read(NamedTuple):
    """A frame, what vouches for its input, its unusable pixels, whether its alpha is all 1, what its output carries."""

    frame: Frame
    source: Source
    unusable: int
    opaque: bool
    carried: CarriedOver


def reads(sequence: Sequence, before: int | None, layers: tuple[str, ...]) -> Iterator[Callable[[], Read]]:
    """A task for each frame of a sequence, in any thread; ``before`` is the frame that the first one continues."""
    for number in sequence.numbers:
        yield partial(_read, sequence, number, before, layers)
        before = number


def _read(sequence: Sequence, number: int, before: int | None, layers: tuple[str, ...]) -> Read:
    path, kept = sequence.path(number), kept_channels(sequence.layouts[number], layers, sequence.replaced)
    found = _stamps(sequence, number)
    frame, file = sequence.frame_and_file(number, kept)
    # What was verified while it was read need not be hashed again.
    digest = sequence.sha256(number) or file_sha256(path)
    source = Source(digest, before, sequence.beside_sha256(number))
    carried = carried_over(path, kept, file)
    if _stamps(sequence, number) != found:  # else a file of now would vouch for a result of before
        raise DataError("a file changed while it was read", path=path, frame=number, cure="run again")
    return Read(frame, source, unusable_pixels(frame.colour), is_opaque(frame.alpha), carried)


def _stamps(sequence: Sequence, number: int) -> list[tuple[int, ...]]:
    """What tells the files of a frame from others that are written in their place."""
    found = (path.stat() for path in sorted(sequence.files_of(number)) if path.exists())
    return [(status.st_ino, status.st_size, status.st_mtime_ns) for status in found]
