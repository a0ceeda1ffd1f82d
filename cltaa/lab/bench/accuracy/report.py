"""Write, read and merge accuracy reports: folders with a page and tables."""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.camera import inverse_depth
from cltaa.errors import DataError, InputMissing
from cltaa.frame import Frame, Image
from cltaa.io.atomic import atomic_path
from cltaa.io.display import Picture, heat, to_picture
from cltaa.lab.bench.accuracy.figures import FORMATS, table, write_plots
from cltaa.lab.bench.accuracy.measurement import Accuracy, Spread, cells_of
from cltaa.lab.bench.cells import COUNT_WHITE, Task, packed
from cltaa.lab.judge.comparison import truth_of
from cltaa.lab.judge.metrics import METRICS
from cltaa.printable import counted, printable

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
        "debug": _addresses({title: packed(picture) for title, picture in _debug_views(frame).items()}),
    }


def _debug_views(frame: Frame) -> dict[str, Picture]:
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


NAME = "accuracy.json"


def falling_metrics(result: Accuracy) -> list[str]:
    """Return the metrics that fall as the image gets better; variants are compared by these errors."""
    return [name for name in result.metrics if not METRICS[name].higher_is_better]


def write_report(
    result: Accuracy, output: Path, pictured: int | None = None, pages: Mapping[str, str] | None = None
) -> str:
    """Write the numbers as JSON and CSV, the plots, a table over all sequences, and ``pages``, texts by file name, into
    the folder ``output``; returns the table, which is empty, and not written, if no metric falls with the error.

    The first ``pictured`` sequences get their own plots. Deletes plots, tables and pages of an earlier report that this
    one lacks. Raises OutputError, StorageError, and UsageError without matplotlib.
    """
    texts = {NAME: msgspec.json.encode(result).decode(), "accuracy.csv": csv_text(result), **(pages or {})}
    falling = falling_metrics(result)
    whole = table(result, falling) if falling else ""
    if whole:
        texts["overview.md"] = whole
    again = (output / NAME).exists()
    for name, text in texts.items():
        with atomic_path(output / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    written = {output / name for name in texts} | set(write_plots(result, output, pictured))
    plots = [f"{name}.{suffix}" for name in ("front-*", "overview") for suffix in FORMATS]
    for pattern in (*plots, "overview.md", "index.html") if again else ():
        for path in {*output.glob(pattern)} - written:
            if path.is_file():  # a sequence may lie beside its report
                path.unlink()
    return whole


def read_report(folder: Path) -> Accuracy:
    """Read the numbers of a report; raises InputMissing if missing and DataError if invalid."""
    path = folder / NAME
    try:
        return msgspec.convert(_restored(msgspec.json.decode(path.read_bytes())), Accuracy)
    except FileNotFoundError:
        raise InputMissing("not a report", path=path, cure="make one: cltaa bench accuracy SEQUENCE -o DIR") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise DataError(f"not the numbers of a report: {error}", path=path) from None


def _restored(value: Any, *, error: bool = False) -> Any:
    """Return ``value`` with infinity for each null error, which is JSON's form for the PSNR of identical images."""
    if isinstance(value, dict):
        return {key: _restored(item, error=error or key == "errors") for key, item in value.items()}
    if isinstance(value, list):
        return [_restored(item, error=error) for item in value]
    return math.inf if error and value is None else value


def merged(reports: Sequence[tuple[Path, Accuracy]]) -> Accuracy:
    """Merge the sequences of some reports; raises DataError for different devices, code or ladders."""
    (_, first), *others = reports
    for path, other in others:
        for what, expected in _agreed(first).items():
            if (found := _agreed(other)[what]) != expected:
                raise DataError(f"another {what} than in {reports[0][0]}", path=path, expected=expected, found=found)
        for ours, theirs in zip(first.variants, other.variants, strict=True):
            if ours != theirs:
                what, cure = f"other parameters of {ours.name} than in {reports[0][0]}", "measure both with the same"
                raise DataError(what, path=path, cure=cure)
    sequences = [measured for _, report in reports for measured in report.sequences]
    names = [measured.name for measured in sequences]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"the sequence {twice} is in two reports", path=reports[-1][0], cure="leave one of them out")
    return msgspec.structs.replace(first, sequences=sequences)


def _agreed(report: Accuracy) -> dict[str, str]:
    """Return the facts that merged reports must share."""
    where = report.environment
    return {
        "device": where.device,
        "number of compute units": str(where.units),
        "processor": where.cpu,
        "version of the kernels": where.kernels_sha256,
        "list of metrics": ", ".join(report.metrics),
        "ladder": ", ".join(variant.name for variant in report.variants),
    }
