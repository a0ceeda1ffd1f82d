"""What ``cltaa compare`` prints: one comparison frame by frame, or the means of several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from cltaa.commands.printing import print_line, print_table
from cltaa.judging.metrics import Metric
from cltaa.judging.video_scores import SCORES
from cltaa.printable import counted, shown

Values = Mapping[str, float]
BOUNDS = {None: "", "at least": "≥ ", "at most": "≤ "}


def print_one(result: dict[str, Any], metrics: tuple[Metric, ...]) -> None:
    """Print a result frame by frame, with its mean and what was found besides."""
    print_line(f"{shown(result['test'])} against {shown(result['reference'])}")
    table = Table()
    table.add_column("frame", justify="right")
    for metric in metrics:
        table.add_column(_head(metric), justify="right")
    for row in result["frames"]:
        table.add_row(str(row["frame"]), *_cells(row["metrics"], metrics))
    table.add_section()
    table.add_row("mean", *_cells(result["mean"], metrics), style="bold")
    if "mean_one_sample" in result:
        table.add_row("one sample", *_cells(result["mean_one_sample"], metrics), style="dim")
    print_table(table)
    for metric in metrics:
        print_line(f"  {metric.name}: {metric.title}", "dim")
    if "video" in result:
        _print_video(result)
    if "equal_quality_samples" in result:
        _print_equal_quality(result["equal_quality_samples"])


def _print_equal_quality(equal: dict[str, Any]) -> None:
    if math.isinf(equal["samples"]):  # no number of samples errs as little as nothing
        print_line("equal-quality samples: no number, for A equals its truth up to white")
        return
    bound = f"{equal['bound']} " if equal["bound"] else ""
    print_line(f"equal-quality samples: {bound}[bold]{equal['samples']:.1f}[/] a pixel ({equal['method']})")


def _print_video(result: dict[str, Any]) -> None:
    table = Table(title="as moving pictures")
    table.add_column("")
    for score in SCORES:
        table.add_column(f"{score.name} ↓", justify="right")
    for label, name in (("A", "video"), ("one sample", "video_one_sample")):
        if name in result:
            table.add_row(label, *_video_cells(result[name]), style="bold" if name == "video" else "dim")
    print_table(table)
    for score in SCORES:
        print_line(f"  {score.name}: {score.title}", "dim")


def _cells(values: Values, metrics: tuple[Metric, ...]) -> list[str]:
    return ["identical" if math.isinf(v) else format(v, m.form) for m in metrics for v in (values[m.name],)]


def print_several(results: Sequence[dict[str, Any]], metrics: tuple[Metric, ...]) -> None:
    """Print the means of several results that were judged against one reference, a line each."""
    first = results[0]
    single = next((result for result in results if "mean_one_sample" in result), None)  # none beside the capture itself
    scores = SCORES if "video" in first else ()
    print_line(f"{shown(first['reference'])} is the truth; means of {counted(len(first['frames']), 'frame')}")
    table = Table()
    table.add_column("")
    for column in (*(_head(metric) for metric in metrics), *(f"{score.name} ↓" for score in scores)):
        table.add_column(column, justify="right")
    if single:
        table.add_column("samples ↑", justify="right")
    for result in results:
        moving = _video_cells(result["video"]) if scores else []
        samples = [_samples(result)] if single else []
        table.add_row(shown(result["test"]), *_cells(result["mean"], metrics), *moving, *samples)
    if single:
        table.add_section()
        moving = _video_cells(single["video_one_sample"]) if scores else []
        table.add_row("one sample", *_cells(single["mean_one_sample"], metrics), *moving, "1", style="dim")
    print_table(table)
    for measure in (*metrics, *scores):
        print_line(f"  {measure.name}: {measure.title}", "dim")
    if single:
        print_line("  samples: equal-quality samples, so many a pixel a supersampler needs for the same error", "dim")


def _samples(result: Mapping[str, Any]) -> str:
    """The equal-quality samples as a cell."""
    equal = result.get("equal_quality_samples")
    if equal is None:
        return "–"
    return "identical" if math.isinf(equal["samples"]) else f"{BOUNDS[equal['bound']]}{equal['samples']:.1f}"


def _head(metric: Metric) -> str:
    return f"{metric.name} {'↑' if metric.higher_is_better else '↓'}"


def _video_cells(values: Values) -> list[str]:
    return ["–" if math.isnan(v) else format(v, s.form) for s in SCORES for v in (values[s.name],)]
