"""``cltaa compare``: errors of images against the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cltaa.commands.compare_tables import print_one, print_several
from cltaa.commands.names import METRIC_LIST
from cltaa.commands.options import FILE_PATH, FRAME_RANGE, STOPS, input_options, json_option, verify_option
from cltaa.errors import LONGEST_VALUE, UsageError
from cltaa.files.atomic import make_folder
from cltaa.inputs.png_images import is_png
from cltaa.judging.comparison import Comparison, pair_up, truth_samples
from cltaa.judging.equal_quality import equal_quality
from cltaa.judging.heat_maps import stale_maps
from cltaa.judging.metrics import DEFAULT_METRICS, METRICS, Metric, mean, parse_metrics, versions_of
from cltaa.judging.one_pass import Found, Judged, judge
from cltaa.judging.same_scene import doubts
from cltaa.judging.video_scores import SCORES
from cltaa.printable import counted, json_of, printable
from cltaa.sequences.frame_numbers import even_step, named_frames, ranges
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.sources import Sequence


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

    Where headers or records say that A and B show different things, or that B is no truth, or where A has not all of
    the frames of B, as a resolve that was interrupted, that is said on standard error, as a warning.
    """
    asked = parse_metrics(metric_names)
    metrics = tuple(dict.fromkeys((*asked, METRICS["mse"])))  # equal-quality samples rest on it, shown or not
    tests, reference = (paths[:-1], paths[-1]) if len(paths) > 1 else (paths, None)
    tests = tuple(dict.fromkeys(tests))
    comparisons = pair_up(tests, reference, frames, verify=verify, **reading)
    named = dict(zip(map(str, tests) if len(tests) > 1 else ["A"], comparisons, strict=True))
    _check_alike(named, heatmap)
    if in_time:
        for comparison in comparisons:
            _check_followed(comparison)
    _tell_reading(named, in_time)
    # Who names a single file asks for it alone.
    lacking = [
        comparison.not_judged(frames) if test.is_dir() else []
        for test, comparison in zip(tests, comparisons, strict=True)
    ]
    warnings = [_warn(*one, without, in_time, heatmap) for one, without in zip(named.items(), lacking, strict=True)]
    found = judge(comparisons, metrics, stops, in_time=in_time, heatmap=heatmap)
    truth = comparisons[0].reference.folder if comparisons[0].capture else reference
    facts = {"reference": str(truth), "stops": stops, "versions": versions_of(metrics)}
    results = [
        {"test": str(test)} | facts | _summary(comparison, judged, found, metrics)
        | {"not_judged": without, "warnings": warned}
        for test, comparison, judged, without, warned in
        zip(tests, comparisons, found.tests, lacking, warnings, strict=True)
    ]  # fmt: skip
    if as_json:
        click.echo(json_of(results[0] if len(results) == 1 else {"compared": results}))
    elif len(results) == 1:
        print_one(results[0], asked)
    else:
        print_several(results, asked)


def _check_alike(comparisons: Mapping[str, Comparison], heatmap: Path | None) -> None:
    """Raise UsageError where the means of several would be of other frames, or their maps would have one name."""
    first, *others = comparisons
    if heatmap is not None and others:
        raise UsageError("--heatmap: maps of several would have one name", cure="draw those of one A at a time")
    for test in others:
        expected, found = (comparisons[name].test.numbers for name in (first, test))
        if expected != found:
            raise UsageError(
                f"other frames than those of {first}", path=Path(test), expected=ranges(expected), found=ranges(found),
                cure="choose frames that all have with --frames",
            )  # fmt: skip
        if comparisons[first].region != comparisons[test].region:
            what = f"what it shares with B is another region than what {first} does"
            raise UsageError(what, path=Path(test), cure="compare them with B one at a time")


def _tell_reading(comparisons: Mapping[str, Comparison], in_time: bool) -> None:
    """Say on standard error how each A, by its name, and B are read."""
    read: dict[str, ImageSequence | Sequence] = {}
    for name, comparison in comparisons.items():
        read |= {name: comparison.test, "B": comparison.reference}
        if in_time and comparison.capture is not None:  # more of it is read than its colour
            read[name if comparison.of_itself else "B"] = comparison.capture
    for label, images in read.items():
        if images.notes:
            click.echo(printable(f"{label}: {'; '.join(images.notes)}"), err=True)
    comparison = next(iter(comparisons.values()))
    if comparison.region is not None:
        left, top, right, bottom = comparison.region
        size = f"{right - left + 1} x {bottom - top + 1} at ({left}, {top})"
        click.echo(f"judged where both show something: {size} of the display window", err=True)


def _warn(name: str, comparison: Comparison, lacking: list[int], in_time: bool, heatmap: Path | None) -> list[str]:
    """Return what speaks against a comparison with A, after saying it on standard error, where A is called ``name``."""
    warnings = doubts(comparison, followed=in_time)
    if lacking:
        have, which = len(comparison.test), printable(named_frames(lacking), longest=LONGEST_VALUE)
        warnings.append(
            f"A has {have} of the {counted(have + len(lacking), 'frame')} of B: {which}"
            f" {'is' if len(lacking) == 1 else 'are'} not judged; finish A, or choose frames with --frames"
        )
    if heatmap is not None:
        make_folder(heatmap)
        for images in (comparison.test, comparison.reference):
            if is_png(images.path(images.first)) and images.folder.samefile(heatmap):
                what = "--heatmap: maps have the names of the pictures there"
                raise UsageError(what, path=heatmap, cure="name another folder")
        warnings += stale_maps(heatmap, comparison.test)
    for warning in warnings:
        click.echo(f"cltaa: warning: {'' if name == 'A' else f'{printable(name)}: '}{warning}", err=True)
    return warnings


def _check_followed(comparison: Comparison) -> None:
    """Raise UsageError where nothing tells how A moves, or nothing of it can be followed."""
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


def _summary(comparison: Comparison, judged: Judged, found: Found, metrics: tuple[Metric, ...]) -> dict[str, Any]:
    """What is said of one test; the single samples stand beside it unless it is they."""
    single = None if comparison.of_itself else found.one_sample
    rows = [
        {"frame": number, "metrics": values}
        for number, values in zip(comparison.test.numbers, judged.metrics, strict=True)
    ]
    result: dict[str, Any] = {
        "definitions": {metric.name: metric.title for metric in metrics},
        "mean": mean(judged.metrics),
        "frames": rows,
    }
    if single is not None:
        _add(rows, "one_sample", single.metrics)
        result["mean_one_sample"] = mean(single.metrics)
        mse, one_sample_mse = (result[name]["mse"] for name in ("mean", "mean_one_sample"))
        if one_sample_mse > 0:  # a picture that one sample gets right has no such number
            equal = equal_quality(mse, one_sample_mse, found.yardsticks, truth_samples(comparison.reference))
            result["equal_quality_samples"] = equal._asdict()
    if judged.total is not None:
        _add(rows, "video", judged.video)
        result["definitions"] |= {score.name: score.title for score in SCORES}
        result["video"] = judged.total.scores()
        if single is not None and single.total is not None:
            result["video_one_sample"] = single.total.scores()
    return result


def _add(rows: list[dict[str, Any]], name: str, values: list[dict[str, float]]) -> None:
    for row, value in zip(rows, values, strict=True):
        row[name] = value
