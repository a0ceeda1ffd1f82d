"""What the last measurement on each device found, kept for ``cltaa resolve --budget-ms``."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import msgspec

from cltaa.errors import DataError, UsageError
from cltaa.io.atomic import atomic_path, make_folder
from cltaa.lab.bench.accuracy.figures import overall
from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.accuracy.results import Accuracy, Cell
from cltaa.lab.judge.metrics import METRICS
from cltaa.lab.timing import Clock
from cltaa.printable import counted


class Candidate(msgspec.Struct, frozen=True, kw_only=True):
    """A variant with what it cost and what it brought, over all sequences of the measurement."""

    variant: Variant
    ms_per_megapixel: float  # the greatest of the medians over the sequences
    error: float  # over the default's, geometric mean over the sequences: less than 1 is better


class Remembered(msgspec.Struct, frozen=True, kw_only=True):
    """The last measurement on one device that was no smaller than the one before it."""

    device: str
    date: str
    metric: str
    sequences: list[str]
    noisy: bool
    candidates: list[Candidate]
    pixels: int = 0  # of the least of the sequences' frames


class Choice(msgspec.Struct, frozen=True, kw_only=True):
    """What was chosen, and the line that says why."""

    variant: Variant
    why: str


def path_for(device: str) -> Path:
    """The file about a device, in the user's data folder."""
    base = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    return base / "cltaa" / "bench" / f"{hashlib.sha256(device.encode()).hexdigest()[:16]}.json"


def remember(result: Accuracy) -> str | None:
    """Keep what ``resolve --budget-ms`` needs of a measurement; returns why where it is not kept.

    It chooses by a metric that falls with the error. A quick look at a few variants, sequences or small frames does not
    take the place of a larger measurement.
    """
    metric = next((name for name in result.metrics if not METRICS[name].higher_is_better), None)
    if metric is None:
        return "it goes by a metric that falls with the error"
    errors = {row.variant: row.error for row in overall(result, metric)}
    rows = [
        Candidate(
            variant=variant,
            ms_per_megapixel=max(_milliseconds(measured.cells[place]) for measured in result.sequences),
            error=errors[variant.name],
        )
        for place, variant in enumerate(result.variants)
        if not variant.laboratory
    ]
    remembered = Remembered(
        device=result.environment.device,
        date=result.environment.date,
        metric=metric,
        sequences=[measured.name for measured in result.sequences],
        noisy=any(measured.noisy for measured in result.sequences),
        candidates=rows,
        pixels=min(measured.width * measured.height for measured in result.sequences),
    )
    path = path_for(remembered.device)
    if (before := _kept(path)) is not None and (less := _less(remembered, before)):
        return f"{less}, measured {before.date}; delete {path} to keep this one"
    make_folder(path.parent)
    with atomic_path(path) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(remembered)))
    return None


def _kept(path: Path) -> Remembered | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=Remembered)
    except (OSError, msgspec.DecodeError):
        return None


def _less(new: Remembered, kept: Remembered) -> str:
    """What of a measurement is less than of the one that is kept; empty where nothing is."""
    sizes = (
        ("sequence", len(new.sequences), len(kept.sequences)),
        ("variant", len(new.candidates), len(kept.candidates)),
        ("pixel", new.pixels, kept.pixels),
    )
    return " and ".join(f"{counted(own, what)} where {theirs} are kept" for what, own, theirs in sizes if own < theirs)


def choose(device: str, budget_ms: float, width: int, height: int) -> Choice:
    """The variant with the least error whose kernels take at most ``budget_ms`` for a frame of that size.

    Raises UsageError where nothing was measured on the device, or nothing is fast enough.
    """
    path = path_for(device)
    if not path.is_file():
        cure = "measure first: cltaa bench accuracy SEQUENCE -o report"
        raise UsageError(f"nothing was measured on {device} yet", path=path, cure=cure)
    try:
        remembered = msgspec.json.decode(path.read_bytes(), type=Remembered)
    except msgspec.DecodeError as error:
        raise DataError(f"not a measurement: {error}", path=path, cure="measure again: cltaa bench accuracy") from None
    megapixels = width * height * 1e-6
    fitting = [row for row in remembered.candidates if row.ms_per_megapixel * megapixels <= budget_ms]
    if not fitting:
        least = min(row.ms_per_megapixel for row in remembered.candidates) * megapixels
        expected, found = f"{least:.3g} ms or more", f"{budget_ms:.3g} ms"
        raise UsageError(
            "no known variant is fast enough", expected=expected, found=found, cure="allow more, or less size"
        )
    best = min(fitting, key=lambda row: (row.error, row.ms_per_megapixel))
    noise = "; that machine was noisy, so times are rough" if remembered.noisy else ""
    why = (
        f"{best.variant.name}: {best.ms_per_megapixel * megapixels:.3g} of {budget_ms:.3g} ms a frame, "
        f"{best.error:.3f} times the {remembered.metric} of {remembered.candidates[0].variant.name}; "
        f"the best of {len(fitting)} that fit of {len(remembered.candidates)}, measured {remembered.date} on "
        f"{', '.join(remembered.sequences)}{noise}"
    )
    return Choice(variant=best.variant, why=why)


def _milliseconds(cell: Cell) -> float:
    return cell.time(Clock.DEVICE).median
