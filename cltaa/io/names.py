"""Names of numbered files, ``<name>.<frame>.exr`` or ``.png``: the sequence of a file, and its place there."""

from __future__ import annotations

import re
from pathlib import Path

# Nine digits fit cltaa:frame, an int. A number below 0, ``x.-001.exr``, is none: its frames would come in wrong order.
NUMBERED = re.compile(r"(?P<name>.*?)[._-]?(?<![0-9])(?<![._]-)(?<!^-)(?P<number>[0-9]{1,9})\.(exr|png)", re.DOTALL)


def number_of(path: Path) -> int | None:
    """The frame number in a file's name, or None where there is none."""
    match = NUMBERED.fullmatch(path.name)
    return int(match["number"]) if match else None


def name_of(path: Path) -> str:
    """The name of the sequence that ``path`` belongs to; that of the file where it has no number."""
    match = NUMBERED.fullmatch(path.name)
    return match["name"] if match else path.stem


def renumbered(path: Path, number: int) -> Path:
    """The file of frame ``number`` in the sequence that ``path`` belongs to; as it is where it has no number."""
    match = NUMBERED.fullmatch(path.name)
    if match is None:
        return path
    start, end = match.span("number")
    return path.with_name(f"{path.name[:start]}{number:0{end - start}d}{path.name[end:]}")
