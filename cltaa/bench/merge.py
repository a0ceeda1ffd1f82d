"""Reports put together: what was measured of other sequences by other processes, each on a card of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from cltaa.bench.accuracy_results import Accuracy
from cltaa.errors import DataError, InputMissing

NAME = "accuracy.json"


def read_report(folder: Path) -> Accuracy:
    """The numbers of a report; raises InputMissing without them and DataError where they are none."""
    path = folder / NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=Accuracy)
    except FileNotFoundError:
        raise InputMissing("not a report", path=path, cure="make one: cltaa bench accuracy SEQUENCE -o DIR") from None
    except msgspec.DecodeError as error:
        raise DataError(f"not the numbers of a report: {error}", path=path) from None


def merged(reports: Sequence[tuple[Path, Accuracy]]) -> Accuracy:
    """All sequences of some reports as one; raises DataError where they are not of one device, code and ladder."""
    (_, first), *others = reports
    for path, other in others:
        for what, found, expected in _agreements(other, first):
            if found != expected:
                raise DataError(f"another {what} than in {reports[0][0]}", path=path, expected=expected, found=found)
    sequences = [measured for _, report in reports for measured in report.sequences]
    names = [measured.name for measured in sequences]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"the sequence {twice} is in two reports", path=reports[-1][0], cure="leave one of them out")
    return msgspec.structs.replace(first, sequences=sequences)


def _agreements(one: Accuracy, other: Accuracy) -> Iterable[tuple[str, str, str]]:
    """What two reports must agree in: what it is, and how either has it."""
    for what, get in (
        ("device", lambda report: report.environment.device),
        ("number of compute units", lambda report: str(report.environment.units)),
        ("processor", lambda report: report.environment.cpu),
        ("version of the kernels", lambda report: report.environment.kernels_sha256),
        ("list of metrics", lambda report: ", ".join(report.metrics)),
        ("ladder", lambda report: ", ".join(variant.name for variant in report.variants)),
    ):
        yield what, get(one), get(other)
