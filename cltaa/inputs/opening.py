"""A folder of frames, opened as what it is: a sequence of cltaa's own, or of another tool."""

from __future__ import annotations

from collections.abc import Sequence as Many
from pathlib import Path
from typing import Any

from cltaa.errors import CltaaError, DataError, UsageError
from cltaa.exr.channels import COLOUR
from cltaa.exr.outline import read_layout
from cltaa.inputs.parts import read_any_header
from cltaa.sequences.sources import RESOLVED, Sequence, open_capture


def open_input(
    folder: str | Path,
    *,
    profile: str = "auto",
    assignments: Many[str] = (),
    side_file: str | Path | None = None,
    **options: Any,
) -> Sequence:
    """Open ``folder`` as its profile says; ``options`` are those of ``open_sequence``, whoever wrote the files.

    Raises what ``open_sequence`` and ``open_intake`` raise, and UsageError for what a resolve wrote.
    """
    folder, side_file = Path(folder), None if side_file is None else Path(side_file)
    plain = not assignments and side_file is None
    if plain and profile in ("auto", "cltaa") and is_own(folder):
        return open_capture(folder, **options)
    from cltaa.inputs.foreign import ForeignSequence  # here: a run over cltaa's own files starts without
    from cltaa.inputs.intake import open_intake

    verify = options.pop("verify", True)
    intake = open_intake(folder, profile=profile, assignments=assignments, side_file=side_file, **options)
    sequence = ForeignSequence(folder, intake, sorted(intake.declared), verify=verify)
    sequence.refuse_result()
    return sequence


def open_measured(folder: Path, *, step: int = 1) -> Sequence:
    """Open a sequence that presets are measured on: laid out as cltaa's own, since no profile is asked for.

    Raises UsageError for one that is not, and what ``open_capture`` raises.
    """
    files = sorted(folder.glob("*.exr")) if folder.is_dir() else []
    if files and not is_own(folder):
        try:
            laid_out = {*COLOUR, "Z"} <= read_layout(files[0]).channels.keys()
        except DataError:
            laid_out = False
        if not laid_out:
            cure = "resolve it with each preset and compare: cltaa resolve, cltaa compare (docs/inputs.md)"
            raise UsageError("only what is laid out as cltaa's own is measured on", path=folder, cure=cure)
    return open_capture(folder, step=step)


def is_own(folder: Path) -> bool:
    """True unless the first file that can be read plainly is somebody else's, or where there is none but in subfolders.

    Errors of cltaa's own files are told by its own reader; what a resolve wrote is its own, whatever layers it kept.
    """
    files = sorted(folder.glob("*.exr")) if folder.is_dir() else []
    if not files:
        return not folder.is_dir() or not any(folder.glob("*/*.exr"))
    for file in files:
        try:
            return not {"cltaa:worldToView", RESOLVED}.isdisjoint(read_any_header(file).attributes)
        except CltaaError:
            continue
    return True
