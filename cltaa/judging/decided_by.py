"""What a measurement over a sequence depends on beside the code, to know one that is kept from one of other frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

import msgspec

from cltaa.files.manifest import file_sha256, recorded_hashes
from cltaa.sequences.numbered import NumberedFiles
from cltaa.sequences.sources import Sequence


def content_sha256(sequence: Sequence, others: Iterable[NumberedFiles] = ()) -> str:
    """One SHA-256 over the frames, the truth and others, from what their capture recorded, else from the files.

    Of another tool's files it is also over how they are read; of cltaa's own that is the step alone, which is left out.
    """
    recorded: dict[str, str] = {}
    paths: list[Path] = []
    for images in _with_truth(sequence, others):
        paths += images.paths
        place = _name(images.folder, sequence)
        below = "" if images.folder == sequence.folder else f"{place}/"
        recorded |= {f"{below}{name}": found for name, found in recorded_hashes(images.folder).items()}
    digest = hashlib.sha256()
    for path in paths:
        name = _name(path, sequence)
        digest.update(f"{name} {recorded.get(name) or file_sha256(path)}\n".encode())
    for number in sequence.numbers:
        if (beside := sequence.beside_sha256(number)) is not None:
            digest.update(f"{number} {beside}\n".encode())
    if sequence.reading.keys() - {"step"}:
        digest.update(msgspec.json.encode(sequence.reading))
    return digest.hexdigest()


def stamps(sequence: Sequence) -> str:
    """One SHA-256 over place, size and time of every file of the frames and the truth, and over how they are read.

    Quicker than ``content_sha256``; a file that was copied or touched counts as another.
    """
    paths = [*sequence.files, *(path for images in _with_truth(sequence)[1:] for path in images.paths)]
    files = [(str(path.resolve()), path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    return hashlib.sha256(msgspec.json.encode([files, sequence.reading, sequence.told])).hexdigest()


def _with_truth(sequence: Sequence, others: Iterable[NumberedFiles] = ()) -> list[NumberedFiles]:
    truth = [] if sequence.reference is None else [sequence.reference]
    return [sequence, *truth, *others]


def _name(path: Path, sequence: Sequence) -> str:
    """A path as it lies in the sequence's folder, where it does."""
    inside = path.is_relative_to(sequence.folder)
    return (path.relative_to(sequence.folder) if inside else path).as_posix()
