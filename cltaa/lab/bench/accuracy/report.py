"""Accuracy reports: folders with a page, tables and numbers."""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from statistics import geometric_mean
from typing import Any, NamedTuple

import msgspec
import numpy as np

from cltaa.camera import inverse_depth
from cltaa.frame import Frame, Image
from cltaa.io.atomic import atomic_path
from cltaa.io.display import Picture, heat, to_picture
from cltaa.lab.bench.accuracy.measurement import Accuracy, Measured, MeasuredSequence, Spread, cells_of
from cltaa.lab.bench.cells import COUNT_WHITE, Task, packed
from cltaa.lab.bench.variants import PRESETS
from cltaa.lab.judge.comparison import truth_of
from cltaa.lab.judge.metrics import METRICS
from cltaa.lab.timing import Interval
from cltaa.printable import counted, literal, markdown, printable

_FOLDER = resources.files("cltaa") / "lab" / "bench" / "accuracy" / "page"


def page(result: Accuracy, tasks: Sequence[Task], output: Path, pictured: int | None = None) -> str:
    """Return the report as HTML; ``tasks`` are those of the measurement, with their results in ``output``.

    Shows frames of the first ``pictured`` sequences; None: all.
    """
    data = {
        "accuracy": msgspec.to_builtins(result),
        "higher_is_better": [metric.name for metric in METRICS.values() if metric.higher_is_better],
        "count_white": COUNT_WHITE,
        "pictures": {
            measured.name: _pictures([task for task in tasks if printable(task.sequence) == measured.folder], output)
            for measured in result.sequences[:pictured]
        },
    }
    text = msgspec.json.encode(data).decode().replace("<", "\\u003c")  # so that no text ends the script element
    parts = {"STYLE": _read("page.css"), "SCRIPT": _read("page.js"), "DATA": text}
    html = _read("page.html")
    for name, part in parts.items():
        html = html.replace(f"/*{name}*/", part)
    return html


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _pictures(tasks: Sequence[Task], output: Path) -> dict[str, Any]:
    """Return data URLs of the pictures of one sequence, all of its last frame."""
    sequence = tasks[0].open()
    (frame,) = sequence.select(sequence.last, sequence.last)
    truth = to_picture(truth_of(sequence).image(sequence.last))
    inputs = {"truth": truth, "one sample": to_picture(frame.colour)}
    return {
        "inputs": {name: _addresses({"picture": packed(picture)}) for name, picture in inputs.items()},
        "variants": {variant.name: _addresses(cell.pictures) for variant, cell in cells_of(tasks, output).items()},
        "debug": _addresses({title: packed(picture) for title, picture in debug_views(frame).items()}),
    }


def debug_views(frame: Frame) -> dict[str, Picture]:
    """Return pictures of the resolve's inputs other than colour."""
    near = np.empty(frame.depth.shape, np.float32)
    inverse_depth(frame.depth, near, parallel=frame.camera.orthographic)
    low, high = float(near.min()), float(near.max())
    views = {"inverse depth (bright is near)": heat(near - np.float32(low), max(high - low, 1e-30))}
    if frame.motion is not None:
        length: Image = np.nan_to_num(np.hypot(frame.motion[..., 0], frame.motion[..., 1]), nan=0.0)
        longest = float(length.max())
        views[f"own motion (white: {longest:.3g} px)"] = heat(length, max(longest, 1e-30))
    return views if frame.reactive is None else views | {"reactive": heat(frame.reactive)}


def _addresses(pictures: Mapping[str, bytes]) -> dict[str, str]:
    """Return WebP pictures as data URLs."""
    return {name: f"data:image/webp;base64,{base64.b64encode(each).decode()}" for name, each in pictures.items()}


def csv_text(result: Accuracy) -> str:
    """Return all cells and the yardstick as CSV; an error has columns ``<metric>``, and with _p5, _p95, _largest."""
    stream, rows = io.StringIO(), [*_rows(result)]
    writer = csv.DictWriter(stream, rows[0], restval="")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _rows(result: Accuracy) -> Iterator[dict[str, object]]:
    groups = {variant.name: variant.group for variant in result.variants}
    for measured in result.sequences:
        for cell in measured.cells:
            time, ratio, rounding = cell.time, cell.ratio, cell.rounding
            yield {
                "sequence": measured.name,
                "variant": cell.variant,
                "group": groups[cell.variant],
                "ms_per_megapixel": time.median,
                "low": time.low,
                "high": time.high,
                "ratio": ratio.median,
                "ratio_low": ratio.low,
                "ratio_high": ratio.high,
                "noisy": int(measured.noisy),
                "clock": str(measured.clock),
                "rounding_rms": rounding.rms if rounding else "",
                "rounding_largest": rounding.largest if rounding else "",
            } | _columns(cell.errors)
        for yard in measured.yardstick:
            row = {"sequence": measured.name, "variant": counted(yard.samples, "sample"), "group": "supersampling"}
            yield row | {"ms_per_megapixel": "" if yard.added is None else yard.added} | _columns(yard.errors)


def _columns(errors: Mapping[str, Spread]) -> dict[str, object]:
    ends = {"": "mean", "_p5": "p5", "_p95": "p95", "_largest": "largest"}
    return {f"{name}{end}": getattr(errors[name], part) for name in errors for end, part in ends.items()}


class Overall(NamedTuple):
    """A variant over all sequences: error and time over the default's, for each sequence and as geometric means."""

    variant: str
    errors: list[float | None]  # None if either of the two has no error
    error: float
    times: list[Interval]  # of the sequences that were not too noisy to rank
    rounding: float | None  # root mean square over the sequences
    best_of: int  # number of sequences on which no variant has less error

    @property
    def time(self) -> float | None:
        """The geometric mean of the times; None if every sequence was too noisy."""
        return geometric_mean(time.median for time in self.times) if self.times else None

    @property
    def error_range(self) -> tuple[float, float]:
        """The least and the greatest of the known errors; 1 without any."""
        there = [error for error in self.errors if error is not None] or [1.0]
        return min(there), max(there)


def overall(result: Accuracy, metric: str) -> list[Overall]:
    """Return every variant, least error first; ``metric`` must fall as the image gets better."""
    least = [min(cell.errors[metric].mean for cell in measured.cells) for measured in result.sequences]
    rows = []
    for place, variant in enumerate(result.variants):
        cells = [measured.cells[place] for measured in result.sequences]
        errors = [_ratio(measured, cell, metric) for measured, cell in zip(result.sequences, cells, strict=True)]
        times = [measured.cells[place].ratio for measured in result.sequences if not measured.noisy]
        best = sum(cell.errors[metric].mean <= value for cell, value in zip(cells, least, strict=True))
        apart = [cell.rounding.rms**2 for cell in cells if cell.rounding is not None]
        rounding = math.sqrt(math.fsum(apart) / len(apart)) if apart else None
        mean = geometric_mean([error for error in errors if error is not None] or [1.0])
        rows.append(Overall(variant.name, errors, mean, times, rounding, best))
    return sorted(rows, key=lambda row: row.error)


def table(result: Accuracy, metrics: Sequence[str]) -> str:
    """Return Markdown: a row for each variant, least error by the first metric first; then a row for each sequence."""
    every = {metric: {row.variant: row for row in overall(result, metric)} for metric in metrics}
    heads = ["variant", *(head for metric in metrics for head in (metric, "least to greatest", "best in"))]
    rows = []
    for variant, row in every[metrics[0]].items():
        texts = [variant]
        for own in (found[variant] for found in every.values()):
            texts += [f"{own.error:.3f}", "{:.3f} to {:.3f}".format(*own.error_range), str(own.best_of)]
        low, high = min((t.low for t in row.times), default=0.0), max((t.high for t in row.times), default=0.0)
        texts += ["too noisy to rank", "–"] if row.time is None else [f"{row.time:.3f}", f"{low:.3f} to {high:.3f}"]
        rows.append([*texts, "–" if row.rounding is None else f"{row.rounding:.1e}" if row.rounding else "0"])
    whole = markdown([*heads, "time", "95 % of every sequence within", "rounding"], rows)
    return f"{_about(result)}\n\n{whole}{by_sequence(result, metrics[0])}"


def by_sequence(result: Accuracy, metric: str) -> str:
    """Return Markdown with a row for each sequence: the default's error and time, then the ratios of every other
    preset; empty without another preset."""
    presets = [variant.name for variant in result.variants if variant.group == PRESETS]
    if not presets:
        return ""
    rows = []
    for measured in result.sequences:
        first = measured.cells[0]
        own = [f"{first.errors[metric].mean:.3g}", "noisy" if measured.noisy else f"{first.time.median:.3g}"]
        others = (_beside(measured, cell, metric) for cell in measured.cells if cell.variant in presets)
        rows.append([measured.name, *own, *others])
    base = result.variants[0].name
    heads = "sequence", f"{base}: {metric}", "ms a megapixel", *presets
    return f"\nBy sequence, {metric} and time of each preset over those of {literal(base)}:\n\n{markdown(heads, rows)}"


def _beside(measured: MeasuredSequence, cell: Measured, metric: str) -> str:
    ratio = _ratio(measured, cell, metric)
    time = "noisy" if measured.noisy else f"{cell.ratio.median:.3g}"
    return f"{'–' if ratio is None else f'{ratio:.2f}'}, {time}"


def _about(result: Accuracy) -> str:
    noisy = [measured.name for measured in result.sequences if measured.noisy]
    without = f" Times without those that were too noisy to rank: {', '.join(noisy)}." if noisy else ""
    where, base = result.environment, result.variants[0].name
    over = counted(len(result.sequences), "sequence")
    return literal(
        f"{where.hardware}; {where.cpu}; {where.date} UTC. Multiples of those of {base}, geometric means"
        f" over {over}; rounding is the relative rms distance from float64.{without}"
    )


def _ratio(measured: MeasuredSequence, cell: Measured, metric: str) -> float | None:
    base, own = measured.cells[0].errors[metric].mean, cell.errors[metric].mean
    return own / base if base > 0 and own > 0 else None


def write_report(result: Accuracy, output: Path, html: str) -> None:
    """Write the numbers as JSON and CSV, the page ``html``, and a table over all sequences, if a metric falls with the
    error, into the folder ``output``; deletes the table of an earlier report that this one lacks. Raises OutputError
    and StorageError.
    """
    numbers, overview = output / "accuracy.json", output / "overview.md"
    texts = {numbers: msgspec.json.encode(result).decode(), output / "accuracy.csv": csv_text(result)}
    texts[output / "index.html"] = html
    falling = [name for name in result.metrics if not METRICS[name].higher_is_better]
    if falling:
        texts[overview] = table(result, falling)
    elif numbers.exists():
        overview.unlink(missing_ok=True)
    for path, text in texts.items():
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
