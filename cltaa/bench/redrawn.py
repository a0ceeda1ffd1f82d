"""A capture's frames drawn once more, with the samples at other places: what single samples are worth by chance."""

from __future__ import annotations

from cltaa.sequences.numbered import check_same_size
from cltaa.sequences.sources import ImageSequence, Sequence, open_images

REDRAWN = "again"  # folder of such a capture, inside the sequence's


def redrawn_of(sequence: Sequence) -> ImageSequence | None:
    """The frames of ``sequence`` drawn again, or None where there is no such folder.

    Raises InputMissing and DataError where it is there but does not fit.
    """
    folder = sequence.folder / REDRAWN
    if not folder.is_dir():
        return None
    again = open_images(folder, verify=sequence.verify)
    check_same_size(sequence, again)
    return again.select(sequence.first, sequence.last)
