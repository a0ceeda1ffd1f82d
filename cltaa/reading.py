"""The frames of a sequence with all that a resolve has to know of their files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cltaa.frames import Frame
from cltaa.kept import Kept, kept_of
from cltaa.manifest import file_sha256
from cltaa.output import Source
from cltaa.pixel_statistics import unusable_pixels
from cltaa.sources import Sequence


class Read(NamedTuple):
    """A frame, what vouches for its input, its unusable pixels, and what its output keeps of it."""

    frame: Frame
    source: Source
    unusable: int
    kept: Kept


def read_frames(sequence: Sequence, before: int | None, layers: tuple[str, ...]) -> Iterator[Read]:
    """Each frame of a sequence; ``before`` is the frame that the first one continues."""
    for number in sequence.numbers:
        frame = sequence.frame(number)
        # What was verified while it was read need not be hashed again.
        digest = sequence.sha256(number) or file_sha256(sequence.path(number))
        yield Read(frame, Source(digest, before), unusable_pixels(frame.colour), kept_of(sequence.path(number), layers))
        del frame  # before the next one is read: large ones do not fit into memory twice
        before = number
