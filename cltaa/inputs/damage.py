"""Files of a folder whose headers cannot be read, or that end too early: what a look at the others leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import CltaaError
from cltaa.inputs.parts import read_any_header


class Damaged(NamedTuple):
    """What is wrong with a file, which frame it is of, and the label of its set of files."""

    label: str
    number: int
    error: CltaaError


def damaged_files(sets: Mapping[str, Mapping[int, Path]]) -> dict[Path, Damaged]:
    """The files among ``sets``, by label and frame number, that cannot be read; pixels are not looked at."""
    damaged = {}
    for label, files in sets.items():
        for number, path in files.items():
            try:
                read_any_header(path)
            except CltaaError as error:
                damaged[path] = Damaged(label, number, error)
    return damaged
