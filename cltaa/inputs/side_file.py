"""Matrices, jitter, exposure and cuts from a file beside the pictures: JSON, CSV or text.

A frame has ``world_to_view`` and ``view_to_clip`` (row-major, column vectors, un-jittered; docs/conventions.md),
``jitter_px``, ``exposure`` and ``cut``; each is optional. All formats hold exact doubles, written with 17 digits.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.frame_checks import EXPOSURE_STOPS
from cltaa.errors import DataError, closest
from cltaa.frame import Matrix
from cltaa.io.content import read_text
from cltaa.printable import counted

LARGEST = 1 << 28  # bytes; a frame takes less than 2000, so a hundred thousand frames fit
KEYS = {"world_to_view": 16, "view_to_clip": 16, "jitter_px": 2, "exposure": 1, "cut": 1}


class Side(NamedTuple):
    """The values of one frame in the side file; None for missing ones."""

    world_to_view: Matrix | None
    view_to_clip: Matrix | None
    jitter_px: tuple[float, float] | None
    exposure: float | None = None
    cut: bool | None = None


def read_side_file(path: Path) -> dict[int, Side]:
    """Read ``path`` as .json or .csv by its suffix, else as text; raises InputMissing, or DataError with the line."""
    text = read_text(path, "a side file", LARGEST)
    rows = {".json": _json, ".csv": _csv}.get(path.suffix.lower(), _text)(path, text)
    found: dict[int, Side] = {}
    unknown: dict[str, str | None] = {}  # unknown key -> the key that was probably meant
    for number, values in rows:
        unknown |= {name: closest(name, KEYS) for name in map(str, values) if name not in KEYS and name not in unknown}
        for name, meant in unknown.items():
            if name in values and meant is not None and meant not in values:
                raise DataError(f"unknown key {name}", path=path, frame=number, cure=f"did you mean {meant}?")
        if number in found:
            raise DataError("the frame is given twice", path=path, frame=number, cure="leave one of the two")
        found[number] = _side(path, number, values)
    for number, side in found.items():
        if (side.world_to_view is None) != (side.view_to_clip is None):
            what, cure = "world_to_view and view_to_clip belong together", "give both, or neither"
            raise DataError(what, path=path, frame=number, cure=cure)
    if all(value is None for side in found.values() for value in side):
        what, keys = "no frame has a camera, a jitter, an exposure or a cut", ", ".join(KEYS)
        raise DataError(what, path=path, expected=keys, found=", ".join([*unknown][:9]) or None)
    return found


def _json(path: Path, text: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """``{"frames": {"12": {"world_to_view": [[...] x 4], "view_to_clip": [[...]], "jitter_px": [x, y]}}}``."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise DataError(f"a key is given twice: {twice}", path=path, cure="leave one of the two")
        return made

    try:
        frames = json.loads(text, object_pairs_hook=once)["frames"]
        yield from ((int(number), dict(values)) for number, values in frames.items())
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        said = f": {error}" if isinstance(error, json.JSONDecodeError) else ""
        raise DataError(f"not a side file{said}", path=path, expected='{"frames": {"1": {...}}}') from None


def _csv(path: Path, text: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Columns ``frame``, ``world_to_view.0`` to ``.15``, ``view_to_clip.0`` to ``.15``, ``jitter_px.0`` and ``.1``, ...

    Yields other columns by name only, without their values. The delimiter may also be a tab, or a semicolon with
    decimal commas, as spreadsheets write in many countries.
    """
    delimiter = next((mark for mark in ";,\t" if mark in text.partition("\n")[0]), ",")
    if delimiter == ";":
        text = text.replace(",", ".")
    blank = " " if delimiter == "\t" else " \t"
    lines = re.sub(f"[{blank}]*{delimiter}[{blank}]*", delimiter, text).splitlines()
    table = csv.DictReader(map(str.strip, lines), delimiter=delimiter)
    headings = [*filter(None, table.fieldnames or ())]
    if twice := sorted({name for name in headings if headings.count(name) > 1}):
        raise DataError(f"a heading stands twice: {', '.join(twice)}", path=path, cure="leave one of the two")
    for line, row in enumerate(table, start=2):
        if any(row.get(None, ())):
            what, many = f"line {line}: more cells than headings", len(headings) + len(row[None])
            cure = "numbers with decimal commas need semicolons between them"
            raise DataError(what, path=path, expected=str(len(headings)), found=many, cure=cure)
        try:
            names = {re.sub(r"\.[0-9]+$", "", column) for column in row if column} - {"frame"}
            values = {name: _columns(row, name) if name in KEYS else () for name in sorted(names)}
            number = row["frame"]
        except (KeyError, TypeError) as error:
            raise DataError(f"line {line}: {error} is missing", path=path) from None
        if not re.fullmatch(r" *-?[0-9]{1,9}(\.0*)? *", number or ""):  # 1.0: a spreadsheet may write floats
            raise DataError(f"line {line}: frame is no whole number", path=path, found=number)
        yield int(float(number)), values


def _text(path: Path, text: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """``frame 12``, then lines such as ``world_to_view`` with 16 numbers; brackets and commas are optional."""
    number, values = None, dict[str, Sequence[str]]()
    for line, content in enumerate(text.splitlines(), start=1):
        words = content.split("#")[0].translate(str.maketrans("(),[]=:", "       ")).split()
        if not words:
            continue
        if words[0] == "frame" and len(words) == 2 and re.fullmatch("-?[0-9]{1,9}", words[1]):
            if number is not None:
                yield number, values
            number, values = int(words[1]), {}
        elif number is not None and words[0] in values:
            raise DataError(f"line {line}: {words[0]} is given twice", path=path, cure="leave one of the two")
        elif number is not None and words[0] in KEYS:
            values[words[0]] = words[1:]
        else:
            expected = f"frame N, then {', '.join(KEYS)}"
            raise DataError(f"line {line} is not understood", path=path, expected=expected, found=words[0])
    if number is not None:
        yield number, values


def _columns(row: Mapping[str, str], name: str) -> list[str]:
    """Return the numbers of one key, from one column or from numbered columns."""
    count = KEYS[name]
    return [row[name]] if count == 1 and name in row else [row[f"{name}.{place}"] for place in range(count)]


def _side(path: Path, frame: int, values: Mapping[str, Any]) -> Side:
    """Parse the values of one frame; raises DataError for impossible ones."""
    view, clip, jitter, exposures, cuts = (_numbers(path, frame, name, values.get(name)) for name in KEYS)
    side = Side(
        None if view is None else view.reshape(4, 4),
        None if clip is None else clip.reshape(4, 4),
        None if jitter is None else (float(jitter[0]), float(jitter[1])),
        None if exposures is None else float(exposures[0]),
        None if cuts is None else bool(cuts[0]),
    )
    if side.exposure is not None and not 2.0**-EXPOSURE_STOPS <= side.exposure <= 2.0**EXPOSURE_STOPS:
        expected = f"a positive factor within {EXPOSURE_STOPS:g} stops of 1"
        raise DataError("exposure is wrong", path=path, frame=frame, expected=expected, found=side.exposure)
    if cuts is not None and cuts[0] not in (0, 1):
        raise DataError("cut is wrong", path=path, frame=frame, expected="0 or 1", found=cuts[0])
    return side


def _numbers(path: Path, frame: int, name: str, given: Any) -> Matrix | None:
    """Return the numbers of one key as a flat array; raises DataError for a wrong count or non-finite numbers."""
    if given is None:
        return None
    try:
        numbers = np.array(given, dtype=np.float64).ravel()
    except (ValueError, TypeError):
        numbers = np.empty(0)
    if len(numbers) != KEYS[name] or not np.isfinite(numbers).all():
        expected = counted(KEYS[name], "finite number")
        raise DataError(f"{name} is wrong", path=path, frame=frame, expected=expected, found=given)
    return numbers
