"""``cltaa compare``: errors of images against the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from cltaa.commands.compare_tables import print_one, print_several
from cltaa.commands.names import METRIC_LIST
from cltaa.commands.options import FILE_PATH, FRAME_RANGE, STOPS, input_options, json_option, verify_option
from cltaa.errors import UsageError
from cltaa.files.atomic import make_folder
from cltaa.inputs.png_images import is_png
from cltaa.judging.comparison import Comparison, equal_quality, pair_up
from cltaa.judging.heat_maps import measure_map, stale_maps, write_map
from cltaa.judging.metrics import DEFAULT_METRICS, METRICS, Metric, mean, measure, parse_metrics, versions_of
from cltaa.judging.same_scene import doubts
from cltaa.judging.video_scores import SCORES, VideoScores
from cltaa.printable import json_of, printable
from cltaa.progress import track
from cltaa.sequences.frame_numbers import even_step, ranges
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.sources import Sequence
from cltaa.sequences.streams import read_ahead


@click.command()
@click.argument("paths", metavar="A... [B]", nargs=-1, required=True, type=FILE_PATH)
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
    paths: tuple[Path, ...],
    metric_names: str,
    frames: tuple[int, int] | None,
    stops: float,
    heatmap: Path | None,
    in_time: bool,
    verify: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Judge A against B, frame by frame and in the mean; several A, each against B, in the mean.

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
    tests, reference = (paths[:-1], paths[-1]) if len(paths) > 1 else (paths, None)
    comparisons = {test: pair_up(test, reference, frames, verify=verify, **reading) for test in tests}
    if len(comparisons) > 1:
        _check_alike(comparisons, heatmap)
    videos = {test: _video_scores(comparison, stops) if in_time else None for test, comparison in comparisons.items()}
    results = []
    for test, comparison in comparisons.items():
        warnings = _tell(comparison, in_time, heatmap, "A" if len(comparisons) == 1 else str(test))
        rows = _measure_all(comparison, metrics, stops, heatmap, videos[test])
        shown_reference = comparison.reference.folder if comparison.capture else reference
        result = {
            "test": str(test),
            "reference": str(shown_reference),
            "stops": stops,
            "versions": versions_of(metrics),
        }
        results.append(result | _summary(comparison, rows, metrics, stops, videos[test]) | {"warnings": warnings})
    if as_json:
        click.echo(json_of(results[0] if len(results) == 1 else {"compared": results}))
    elif len(results) == 1:
        print_one(results[0], asked)
    else:
        print_several(results, asked)


def _check_alike(comparisons: Mapping[Path, Comparison], heatmap: Path | None) -> None:
    """Raise UsageError where the means of several would be of other frames, or their maps would have one name."""
    if heatmap is not None:
        raise UsageError("--heatmap: maps of several would have one name", cure="draw those of one A at a time")
    first, *others = comparisons
    for test in others:
        expected, found = (comparisons[path].test.numbers for path in (first, test))
        if expected != found:
            raise UsageError(
                f"other frames than those of {first}", path=test, expected=ranges(expected), found=ranges(found),
                cure="choose frames that all have with --frames",
            )  # fmt: skip


def _tell(comparison: Comparison, in_time: bool, heatmap: Path | None, name: str) -> list[str]:
    """Say on standard error how A, called ``name``, and B are read; return the warnings, said there too."""
    read: dict[str, ImageSequence | Sequence] = {name: comparison.test, "B": comparison.reference}
    if in_time and comparison.capture is not None:  # more of it is read than its colour
        read[name if comparison.of_itself else "B"] = comparison.capture
    for label, images in read.items():
        if images.notes:
            click.echo(printable(f"{label}: {'; '.join(images.notes)}"), err=True)
    if comparison.region is not None:
        left, top, right, bottom = comparison.region
        size = f"{right - left + 1} x {bottom - top + 1} at ({left}, {top})"
        click.echo(f"judged where both show something: {size} of the display window", err=True)
    warnings = doubts(comparison, followed=in_time)
    if heatmap is not None:
        make_folder(heatmap)
        for images in (comparison.test, comparison.reference):
            if is_png(images.path(images.first)) and images.folder.samefile(heatmap):
                what = "--heatmap: maps have the names of the pictures there"
                raise UsageError(what, path=heatmap, cure="name another folder")
        warnings += stale_maps(heatmap, comparison.test)
    for warning in warnings:
        click.echo(f"cltaa: warning: {warning}", err=True)
    return warnings


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
    comparison: Comparison,
    rows: list[dict[str, Any]],
    metrics: tuple[Metric, ...],
    stops: float,
    video: VideoScores | None,
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
    if video is not None:
        names = ("video", "video_one_sample")
        result["definitions"] |= {score.name: score.title for score in SCORES}
        result |= {name: sums.scores() for name, sums in zip(names, video.totals, strict=False)}
    return result
