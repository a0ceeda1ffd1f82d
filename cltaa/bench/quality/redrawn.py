"""A capture's frames drawn once more, with the samples at other places: what single samples are worth by chance."""

from __future__ import annotations

from cltaa.errors import InputMissing
from cltaa.sequences.frame_numbers import ranges
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.sources import Sequence

REDRAWN = "again"  # folder of such a capture, inside the sequence's


def redrawn_of(sequence: Sequence) -> ImageSequence | None:
    """The frames of ``sequence`` drawn again, or None where there is no such folder.

    Raises InputMissing and DataError where it is there but does not fit.
    """
    folder = sequence.folder / REDRAWN
    if not folder.is_dir():
        return None
    again = sequence.open_supersampled(folder)
    for number in sequence.numbers:
        if number not in again.numbers:
            what, cure = "this frame was not drawn again", "draw them all again, or take the folder away"
            raise InputMissing(what, path=folder, frame=number, found=ranges(again.numbers), cure=cure)
    return again.select(sequence.first, sequence.last)
