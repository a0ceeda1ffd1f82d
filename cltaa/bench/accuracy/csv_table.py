"""The numbers of an accuracy measurement as CSV, one row a variant and sequence."""

from __future__ import annotations

import csv
import io

from cltaa.bench.accuracy.results import Accuracy
from cltaa.printable import counted

FIXED = (
    "sequence", "variant", "group", "ms_per_megapixel", "low", "high", "ratio", "ratio_low", "ratio_high", "noisy",
    "clock", "rounding_rms", "rounding_largest",
)  # fmt: skip


def csv_text(result: Accuracy) -> str:
    """All cells and the yardstick; an error is a column ``<metric>``, and with _p5, _p95 and _largest behind it."""
    stream = io.StringIO()
    suffixes = {"": "mean", "_p5": "p5", "_p95": "p95", "_largest": "largest"}
    columns = [f"{metric}{suffix}" for metric in result.metrics for suffix in suffixes]
    writer = csv.DictWriter(stream, [*FIXED, *columns], restval="")
    writer.writeheader()
    groups = {variant.name: variant.group for variant in result.variants}
    for measured in result.sequences:
        for cell in measured.cells:
            time = cell.time(measured.clock)
            values = (
                measured.name, cell.variant, groups[cell.variant], time.median, time.low, time.high, cell.ratio.median,
                cell.ratio.low, cell.ratio.high, int(measured.noisy), str(measured.clock),
                cell.rounding.rms if cell.rounding else "", cell.rounding.largest if cell.rounding else "",
            )  # fmt: skip
            row = dict(zip(FIXED, values, strict=True))
            for metric in result.metrics:
                row |= {f"{metric}{end}": getattr(cell.errors[metric], name) for end, name in suffixes.items()}
            writer.writerow(row)
        for yard in measured.yardstick:
            row = {"sequence": measured.name, "variant": counted(yard.samples, "sample"), "group": "supersampling"}
            row |= {} if yard.added is None else {"ms_per_megapixel": yard.added}
            for metric in result.metrics:
                row |= {f"{metric}{end}": getattr(yard.errors[metric], name) for end, name in suffixes.items()}
            writer.writerow(row)
    return stream.getvalue()
