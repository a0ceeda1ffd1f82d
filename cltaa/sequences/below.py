"""Sequences in the folders below one that holds none: what somebody meant who named the folder above."""

from __future__ import annotations

import os
from pathlib import Path

from cltaa.errors import InputMissing
from cltaa.files.manifest import CAPTURE, REFERENCE
from cltaa.printable import printable

DEEPEST = 3  # folders below the one that was named; a project's folder can hold millions of files
MOST_FOLDERS = 500
MOST_NAMES = 5


def captures_below(folder: Path) -> list[Path]:
    """Folders right below with a record of a capture or a truth of their own, which no part of one sequence has."""
    marks = [*folder.glob(f"*/{CAPTURE}"), *folder.glob("*/reference")]
    return sorted({path.parent for path in marks if not REFERENCE.fullmatch(path.parent.name)})


def sequences_below(folder: Path) -> list[Path]:
    """Folders below that hold EXR files or a ``sequence.json``, in order; truth is none. Few folders are looked at."""
    found: list[Path] = []
    for looked_at, (name, folders, files) in enumerate(os.walk(folder)):
        place = Path(name)
        if looked_at == MOST_FOLDERS:
            break
        if place != folder and (CAPTURE in files or any(file.endswith(".exr") for file in files)):
            found.append(place)
        deep = len(place.relative_to(folder).parts) >= DEEPEST
        folders[:] = [] if deep else sorted(f for f in folders if f[0] != "." and not REFERENCE.fullmatch(f))
    return found


def only_below(folder: Path, found: list[Path]) -> InputMissing:
    """The error for a folder without frames of its own, but with sequences below it."""
    names = [printable(str(path.relative_to(folder))) for path in found[:MOST_NAMES]]
    more = f" and {len(found) - MOST_NAMES} more" if len(found) > MOST_NAMES else ""
    return InputMissing(
        "no frames in the folder itself, but sequences below it", path=folder, found=", ".join(names) + more,
        cure=f"name one of them, such as {printable(str(found[0]))}",
    )  # fmt: skip
