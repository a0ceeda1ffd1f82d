"""``cltaa compare``: errors of images against the truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table

from cltaa.commands.names import METRIC_LIST
from cltaa.commands.options import FILE_PATH, FRAME_RANGE, STOPS, input_options, json_option, verify_option
from cltaa.commands.printing import print_line, print_table
from cltaa.errors import UsageError
from cltaa.files.atomic import make_folder
from cltaa.judging.comparison import Comparison, equal_quality, pair_up
from cltaa.judging.heat_maps import measure_map, stale_maps, write_map
from cltaa.judging.metrics import DEFAULT_METRICS, METRICS, Metric, mean, measure, parse_metrics
from cltaa.judging.same_scene import doubts
from cltaa.judging.video_scores import SCORES, VideoScores
from cltaa.printable import json_of, printable, shown
from cltaa.progress import track
from cltaa.sequences.frame_numbers import even_step
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.sources import Sequence
from cltaa.sequences.streams import read_ahead

Values = dict[str, float]


@click.command()
@click.argument("test", metavar="A", type=FILE_PATH)
@click.argument("reference", metavar="[B]", required=False, type=FILE_PATH)
@click.option(
    "--metrics",
    "metric_names",
    type=METRIC_LIST,
    default=",".join(DEFAULT_METRICS),
    show_default=True,
    metavar="LIST",
    help=f"Comma-separated, or all: {', '.join(METRICS)}.",
)
@click.option("--frames", type=FRAME_RANGE, help="Only these frames, both included.")
@click.option(
    "--stops", type=STOPS, default=0.0, show_default=True, help="Exposure before the display transform, in stops."
)
@click.option("--heatmap", type=FILE_PATH, metavar="DIR", help="Write an error map a frame as PNG.")
@click.option(
    "--video",
    "in_time",
    is_flag=True,
    help=f"Also judge A as moving pictures: {', '.join(score.name for score in SCORES)}.",
)
@input_options
@verify_option
@json_option
def compare(
    test: Path,
    reference: Path | None,
    metric_names: str,
    frames: tuple[int, int] | None,
    stops: float,
    heatmap: Path | None,
    in_time: bool,
    verify: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Judge A against B, frame by frame and in the mean.

    A and B are folders of numbered EXR frames, of cltaa or of another tool, or of PNGs, which are taken for sRGB; or
    single files. Where B is a captured sequence, A is judged against the truth in its folder reference/, beside the
    single samples that were captured, and the equal-quality samples are stated: how many samples a pixel a
    supersampler needs for the same error. Where B is left out, A is a captured sequence and its single samples are
    judged against its own truth.

    --video needs the capture, for the motion in it, and tells apart what an error of single images cannot: ghosting
    (the past shows at uncovered pixels), flicker (changes that are not in the truth), blur (fine detail lost) and
    aliasing (fine detail that is false). docs/metrics.md has the formulas.

    Heat maps run from black over red and yellow to white; they show FLIP where it is among the metrics, else the
    absolute difference on the display.

    Where headers or records say that A and B show different things, that is said on standard error, as a warning.
    """
    asked = parse_metrics(metric_names)
    metrics = tuple(dict.fromkeys((*asked, METRICS["mse"])))  # equal-quality samples rest on it, shown or not
    comparison = pair_up(test, reference, frames, verify=verify, **reading)
    read: dict[str, ImageSequence | Sequence] = {"A": comparison.test, "B": comparison.reference}
    if in_time and comparison.capture is not None:  # more of it is read than its colour
        read["A" if comparison.of_itself else "B"] = comparison.capture
    for name, images in read.items():
        if images.notes:
            click.echo(printable(f"{name}: {'; '.join(images.notes)}"), err=True)
    if comparison.region is not None:
        left, top, right, bottom = comparison.region
        size = f"{right - left + 1} x {bottom - top + 1} at ({left}, {top})"
        click.echo(f"judged where both show something: {size} of the display window", err=True)
    warnings = doubts(comparison, followed=in_time)
    if heatmap is not None:
        make_folder(heatmap)
        if any(images.folder.samefile(heatmap) for images in (comparison.test, comparison.reference)):
            raise UsageError("--heatmap: maps have the names of the pictures there", path=heatmap, cure="name another")
        warnings += stale_maps(heatmap, comparison.test)
    for warning in warnings:
        click.echo(f"cltaa: warning: {warning}", err=True)
    video = _video_scores(comparison, stops) if in_time else None
    rows = _measure_all(comparison, metrics, stops, heatmap, video)
    result: dict[str, Any] = {
        "test": str(test),
        "reference": str(comparison.reference.folder if comparison.capture else reference),
        "stops": stops,
    }
    result |= _summary(comparison, rows, metrics, stops)
    result["warnings"] = warnings
    if video is not None:
        names = ("video", "video_one_sample")
        result["definitions"] |= {score.name: score.title for score in SCORES}
        result |= {name: sums.scores() for name, sums in zip(names, video.totals, strict=False)}
    if as_json:
        click.echo(json_of(result))
    else:
        _print(result, asked)


def _video_scores(comparison: Comparison, stops: float) -> VideoScores:
    if comparison.capture is None:
        raise UsageError("--video needs the capture", cure="give the captured sequence as B, or alone as A")
    if comparison.region is not None:
        expected, found = (images.layouts[images.first].size for images in (comparison.reference, comparison.test))
        raise UsageError(
            "--video judges whole pictures only", path=comparison.test.folder, expected=expected, found=found,
            cure="leave --video out for a region",
        )  # fmt: skip
    apart = even_step(comparison.test.numbers)
    if apart > 1 and comparison.capture.step == 1:
        raise UsageError(
            "--video follows each frame to the next, but no number lies beside another", path=comparison.test.folder,
            expected="frames 1 apart", found=f"{apart} apart", cure=f"say --step {apart} if each continues the last",
        )  # fmt: skip
    return VideoScores(1 if comparison.of_itself else 2, stops)


def _measure_all(
    comparison: Comparison,
    metrics: tuple[Metric, ...],
    stops: float,
    heatmap: Path | None,
    video: VideoScores | None,
) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    capture = comparison.capture
    part = np.s_[:, :] if capture is None else comparison.part_of(capture)
    with read_ahead(comparison.pairs()) as pairs:
        for number, test, reference in track(pairs, len(comparison.test), "comparing"):
            path, truth_path = comparison.test.path(number), comparison.truth_path(number)
            if heatmap is None:
                values = measure(test, reference, metrics, stops, path=path, truth_path=truth_path, frame=number)
            else:
                values, errors = measure_map(
                    test, reference, metrics, stops, path=path, truth_path=truth_path, frame=number
                )
                write_map(heatmap, path, errors)
            rows.append({"frame": number, "metrics": values})
            if capture is not None and (video is not None or not comparison.of_itself):
                sample = capture.frame(number)
                images = [test]
                if not comparison.of_itself:
                    images.append(sample.colour[part])
                    rows[-1]["one_sample"] = measure(
                        images[-1], reference, metrics, stops, path=sample.path, frame=number
                    )
                if video is not None:
                    rows[-1]["video"] = video.add(sample, reference, images)[0].scores()
    return rows


def _summary(
    comparison: Comparison, rows: list[dict[str, Any]], metrics: tuple[Metric, ...], stops: float
) -> dict[str, Any]:
    result: dict[str, Any] = {
        "definitions": {metric.name: metric.title for metric in metrics},
        "mean": mean(row["metrics"] for row in rows),
        "frames": rows,
    }
    if "one_sample" in rows[0]:
        result["mean_one_sample"] = mean(row["one_sample"] for row in rows)
        one_sample_mse = result["mean_one_sample"]["mse"]
        if one_sample_mse > 0:  # a picture that one sample gets right has no such number
            found = equal_quality(comparison, result["mean"]["mse"], one_sample_mse, stops)
            result["equal_quality_samples"] = found._asdict()
    return result


def _print(result: dict[str, Any], metrics: tuple[Metric, ...]) -> None:
    print_line(f"{shown(result['test'])} against {shown(result['reference'])}")
    table = Table()
    table.add_column("frame", justify="right")
    for metric in metrics:
        table.add_column(f"{metric.name} {'↑' if metric.higher_is_better else '↓'}", justify="right")
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
            cells = ("–" if math.isnan(v) else format(v, s.form) for s in SCORES for v in (result[name][s.name],))
            table.add_row(label, *cells, style="bold" if name == "video" else "dim")
    print_table(table)
    for score in SCORES:
        print_line(f"  {score.name}: {score.title}", "dim")


def _cells(values: Values, metrics: tuple[Metric, ...]) -> list[str]:
    return ["identical" if math.isinf(v) else format(v, m.form) for m in metrics for v in (values[m.name],)]
