"""``cltaa compare``: errors of images against the truth, frame by frame or as means of several sequences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import click

from cltaa.commands.options import FILE_PATH, SOME_FRAMES, STOPS, input_options, json_option, listed, verify_option
from cltaa.commands.printing import figures, print_line, print_table, three_digits
from cltaa.errors import LONGEST_VALUE, InputMissing, UsageError
from cltaa.inputs.foreign import first_pictures
from cltaa.io.atomic import make_folder
from cltaa.io.manifest import REFERENCE
from cltaa.io.names import name_of, number_of, real_path, selection_of
from cltaa.io.numbered import even_step, named_frames, ranges
from cltaa.io.sequence import FrameSequence, ImageSequence
from cltaa.lab.judge.comparison import Comparison, doubts, pair_up
from cltaa.lab.judge.entries import Row, judged_entries, means_of
from cltaa.lab.judge.metrics import (
    ALPHA,
    CVVDP_TITLE,
    DEFAULT_METRICS,
    METRICS,
    SAMPLES,
    Measure,
    Metric,
    parse_metrics,
    versions_of,
)
from cltaa.lab.judge.one_pass import judge, stale_maps, summary_of
from cltaa.lab.judge.video_scores import SCORES
from cltaa.printable import counted, json_of, printable, shown

Values = Mapping[str, float]
OURS = "default,fast,gather-8"
BOUNDS = {None: "", "at least": "≥ ", "at most": "≤ "}


def score_heads(metrics: Sequence[Metric], *, alpha: bool = False, moving: bool, samples: bool) -> list[str]:
    """Return column heads for metrics, and for alpha, scores over time (``moving``) and equal-quality samples."""
    heads = [measure.head for measure in (*metrics, *([ALPHA] if alpha else ()), *(SCORES if moving else ()))]
    return [*heads, *([SAMPLES.head] if samples else [])]


def score_cells(
    result: Mapping[str, Any], metrics: Sequence[Metric], *, alpha: bool = False, moving: bool, samples: bool
) -> list[str]:
    """Return the cells of a result under the heads of ``score_heads``."""
    cells = value_cells(result["mean"], metrics)
    if alpha:
        cells.append(format(math.sqrt(result["alpha"]["mse"]), ALPHA.form) if result.get("alpha") else "–")
    if moving:
        scores = result.get("video", dict.fromkeys((score.name for score in SCORES), math.nan))
        cells += ["–" if math.isnan(v) else format(v, s.form) for s in SCORES for v in (scores[s.name],)]
    return [*cells, sample_cell(result)] if samples else cells


def value_cells(values: Values, metrics: Sequence[Metric]) -> list[str]:
    """Format the metrics of a row."""
    return ["identical" if math.isinf(v) else format(v, m.form) for m in metrics for v in (values[m.name],)]


def sample_cell(result: Mapping[str, Any]) -> str:
    """Format the equal-quality samples of a result."""
    equal = result.get("equal_quality_samples")
    if equal is None:
        return "–"
    return "identical" if math.isinf(equal["samples"]) else f"{BOUNDS[equal['bound']]}{equal['samples']:.1f}"


def print_meanings(measures: Iterable[Measure]) -> None:
    """Print the meaning of each column."""
    for measure in measures:
        print_line(f"  {measure.name}: {measure.title}", "dim")


def print_one(result: dict[str, Any], metrics: tuple[Metric, ...]) -> None:
    """Print a result frame by frame, with its mean, alpha, video scores and equal-quality samples."""
    print_line(f"{shown(result['test'])} against {shown(result['reference'])}")
    table = figures(None, "frame", *score_heads(metrics, moving=False, samples=False))
    for row in result["frames"]:
        table.add_row(str(row["frame"]), *value_cells(row["metrics"], metrics))
    table.add_section()
    table.add_row("mean", *value_cells(result["mean"], metrics), style="bold")
    if "mean_one_sample" in result:
        table.add_row("one sample", *value_cells(result["mean_one_sample"], metrics), style="dim")
    print_table(table)
    print_meanings(metrics)
    for label, name in (("alpha", "alpha"), ("alpha of one sample", "alpha_one_sample")):
        if name in result:
            print_line(f"{label}: {_alpha_text(result[name])}")
    if "video" in result:
        _print_video(result)
    if "equal_quality_samples" in result:
        _print_equal_quality(result["equal_quality_samples"])


def _alpha_text(values: Values) -> str:
    """Describe the errors of alpha, and of the picture over white and grey."""
    said = [f"mse {three_digits(values['mse'])}, worst {three_digits(values['worst'])}"]
    for name in ("white", "grey"):
        value = values[f"psnr-{name}"]
        said.append(f"PSNR over {name} {'identical' if math.isinf(value) else f'{value:.2f} dB'}")
    return "; ".join(said)


def _print_equal_quality(equal: dict[str, Any]) -> None:
    if math.isinf(equal["samples"]):  # no finite number of samples has zero error
        print_line("equal-quality samples: no number, for A equals its truth up to white")
        return
    bound = f"{equal['bound']} " if equal["bound"] else ""
    print_line(f"equal-quality samples: {bound}[bold]{equal['samples']:.1f}[/] a pixel ({equal['method']})")


def _print_video(result: dict[str, Any]) -> None:
    table = figures("as moving pictures", "", *score_heads((), moving=True, samples=False), named=True)
    for label, name in ((shown(result["test"]), "video"), ("one sample", "video_one_sample")):
        if name in result:
            cells = score_cells({"mean": {}, "video": result[name]}, (), moving=True, samples=False)
            table.add_row(label, *cells, style="bold" if name == "video" else "dim")
    print_table(table)
    print_meanings(SCORES)


def print_several(results: Sequence[dict[str, Any]], metrics: tuple[Metric, ...]) -> None:
    """Print the means of several results against one reference, one row each."""
    first = results[0]
    single = next((result for result in results if "mean_one_sample" in result), None)  # None for the capture itself
    kinds = {"moving": "video" in first, "samples": single is not None}
    kinds["alpha"] = any("alpha" in result for result in results)
    print_line(f"{shown(first['reference'])} is the truth; means of {counted(len(first['frames']), 'frame')}")
    table = figures(None, "", *score_heads(metrics, **kinds), named=True)
    for result in results:
        table.add_row(shown(result["test"]), *score_cells(result, metrics, **kinds))
    if single:
        alone = {name: single.get(f"{name}_one_sample") for name in ("mean", "alpha", "video")}
        table.add_section()
        table.add_row("one sample", *score_cells(alone, metrics, **kinds | {"samples": False}), "1", style="dim")
    print_table(table)
    moving = SCORES if kinds["moving"] else ()
    print_meanings([*metrics, *([ALPHA] if kinds["alpha"] else ()), *moving, *([SAMPLES] if single else ())])


def print_entries(rows: Sequence[Row], metrics: tuple[Metric, ...], *, cvvdp: bool) -> None:
    """Print the rows of ``--table`` by sequence, and their means over all sequences."""
    timed = any("milliseconds" in row for row in rows)
    kinds = {"moving": True, "samples": True, "alpha": any("alpha" in row for row in rows)}
    heads = [*score_heads(metrics, **kinds), *(["cvvdp ↑"] * cvvdp), *(["ms ↓"] * timed)]
    table = figures(None, "", "", *heads, named=True)
    table.columns[1].justify = "left"
    for name, of_it in groupby([*rows, *means_of(rows)], lambda row: str(row["sequence"])):
        table.add_section()
        for place, row in enumerate(of_it):
            cells = score_cells(row, metrics, **kinds)
            cells += [f"{row['cvvdp']:.2f}" if "cvvdp" in row else "–"] * cvvdp
            cells += [f"{row['milliseconds']:g}" if "milliseconds" in row else "–"] * timed
            table.add_row("" if place else shown(name), shown(row["entry"]), *cells)
    print_table(table)
    print_meanings([*metrics, *([ALPHA] if kinds["alpha"] else ()), *SCORES, SAMPLES])
    if cvvdp:
        print_line(f"  {CVVDP_TITLE}", "dim")


@click.command()
@click.argument("paths", metavar="A... [B]", nargs=-1, required=True, type=FILE_PATH)
@click.option(
    "--metrics",
    "metric_names",
    default=",".join(DEFAULT_METRICS),
    metavar="LIST",
    help=f"all, or some of {', '.join(METRICS)}.",
)
@click.option("--frames", type=SOME_FRAMES, help="Only these frames, both included, or the first N of A.")
@click.option("--stops", type=STOPS, default=0.0, help="Change the exposure before the display transform, in stops.")
@click.option("--heatmap", type=FILE_PATH, metavar="DIR", help="Write an error map of each frame as PNG.")
@click.option("--video", "in_time", is_flag=True, help=f"Also score A over time: {', '.join(s.name for s in SCORES)}.")
@click.option("--table", is_flag=True, help="Make one table of leaderboard entries A... on captured sequences B...")
@click.option("--ours", metavar="LIST", help=f"Presets of ours in --table; may be empty.  [default: {OURS}]")
@click.option("--cvvdp", is_flag=True, help="Add ColorVideoVDP to --table (pip extra cltaa[vdp]).")
@click.option("--film", type=FILE_PATH, metavar="DIR", help="Film each sequence of --table, side by side at 2x.")
@input_options
@verify_option
@json_option
def compare(
    paths: tuple[Path, ...],
    metric_names: str,
    frames: int | tuple[int, int] | None,
    stops: float,
    heatmap: Path | None,
    in_time: bool,
    table: bool,
    ours: str | None,
    cvvdp: bool,
    film: Path | None,
    verify: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Measure the error of A against B, for each frame and in the mean; of several A only the means.

    A and B are folders of numbered EXR frames (from cltaa or another tool) or of PNGs (read as sRGB), patterns
    (x.####.exr), or single files. If B is a captured sequence, its folder reference/ is the truth. The result then
    also has the error of the captured frames, one sample a pixel, and the equal-quality samples: the samples a pixel
    that a supersampler needs for the same error as A. Without B, A is a captured sequence, and its frames are compared
    with its own truth.

    --video needs the motion of the capture. It separates ghosting (the past shows at disoccluded pixels), flicker
    (changes that are not in the truth), blur (lost fine detail) and aliasing (false fine detail). docs/metrics.md has
    the formulas.

    Error maps run from black over red and yellow to white. They show FLIP if it is among the metrics, else the
    absolute difference on the display.

    --table compares other resolves with ours on standard sequences. Each A holds one folder of frames for each B, with
    the same name, and entry.toml with its name, version, settings, device and milliseconds. See docs/leaderboard.md.

    A warning on standard error says if headers or records contradict the comparison (A and B show different things, B
    is no truth), if A lacks frames of B, as after an interrupted resolve, or if B has a truth for only some frames.
    """
    asked = parse_metrics(metric_names)
    metrics = tuple(dict.fromkeys((*asked, METRICS["mse"])))  # equal-quality samples need it
    if table:
        if heatmap is not None:
            raise UsageError("--heatmap does not go with --table", cure="draw maps of one A at a time")
        told: dict[str, Any] = {"stops": stops, "cvvdp": cvvdp, "film": film, "verify": verify}
        rows, doubted = judged_entries(
            paths, listed(OURS if ours is None else ours), metrics, frames, **told, **reading
        )
        for warning in doubted:
            click.echo(f"cltaa: warning: {warning}", err=True)
        if as_json:
            facts = {"stops": stops, "versions": versions_of(metrics), "warnings": doubted}
            click.echo(json_of({"table": rows, "means": means_of(rows)} | facts))
        else:
            print_entries(rows, asked, cvvdp=cvvdp)
        return
    for option, given in (("--cvvdp", cvvdp), ("--film", film is not None), ("--ours", ours is not None)):
        if given:
            raise UsageError(f"{option} goes with --table", cure="add --table")
    places = tuple(map(selection_of, _sequences(paths)))
    by_word = {str(place): place for place in (places[:-1] if len(places) > 1 else places)}
    tests, reference = (*by_word.values(),), places[-1] if len(places) > 1 else None
    chosen = frames
    if isinstance(chosen, int):
        chosen = first_pictures(tests[0], chosen, reading["profile"], reading["assignments"])
    comparisons = pair_up(tests, reference, chosen, verify=verify, **reading)
    named = dict(zip(by_word if len(tests) > 1 else ["A"], comparisons, strict=True))
    _check_alike(named, heatmap)
    if in_time:
        for comparison in comparisons:
            _check_followed(comparison)
    _tell_reading(named, in_time)
    # A single file lacks no frames: the user asked for that one only.
    pairs = zip(tests, comparisons, strict=True)
    lacking = [[] if test.alone else comparison.not_judged(chosen) for test, comparison in pairs]
    warnings = [_warn(*one, without, in_time, heatmap) for one, without in zip(named.items(), lacking, strict=True)]
    found = judge(comparisons, metrics, stops, in_time=in_time, heatmap=heatmap)
    truth = comparisons[0].reference.folder if comparisons[0].capture else reference
    facts = {"reference": str(truth), "stops": stops, "versions": versions_of(metrics)}
    results = [
        {"test": str(test)}
        | facts
        | summary_of(comparison, judged, found, metrics)
        | {"not_judged": sorted({*without, *comparison.without_truth}), "warnings": warned}
        for test, comparison, judged, without, warned in zip(
            tests, comparisons, found.tests, lacking, warnings, strict=True
        )
    ]
    if as_json:
        click.echo(json_of(results[0] if len(results) == 1 else {"compared": results}))
    elif len(results) == 1:
        print_one(results[0], asked)
    else:
        print_several(results, asked)


def _sequences(paths: tuple[Path, ...]) -> list[Path | tuple[Path, ...]]:
    """Group the arguments: consecutive files of one sequence, as a shell expands a pattern, become one."""
    found: list[tuple[Path, ...]] = []
    for path in paths:
        last = found[-1][-1] if found and len(paths) > 2 else None
        alike = last is not None and number_of(path) is not None and path.parent == last.parent
        if alike and last is not None and number_of(last) is not None and name_of(path) == name_of(last):
            found[-1] = (*found[-1], path)
        else:
            found.append((path,))
    return [paths[0] if len(paths) == 1 else paths for paths in found]


def _check_alike(comparisons: Mapping[str, Comparison], heatmap: Path | None) -> None:
    """Raise UsageError if several A have different frames or regions, or if their error maps would share names."""
    first, *others = comparisons
    if heatmap is not None and others:
        raise UsageError("--heatmap: maps of several would have one name", cure="draw those of one A at a time")
    for test in others:
        expected, found = (comparisons[name].test.numbers for name in (first, test))
        if expected != found:
            what, cure = f"other frames than those of {first}", "choose frames that all have with --frames"
            raise UsageError(what, path=Path(test), expected=ranges(expected), found=ranges(found), cure=cure)
        if comparisons[first].region != comparisons[test].region:
            what = f"what it shares with B is another region than what {first} does"
            raise UsageError(what, path=Path(test), cure="compare them with B one at a time")


def _tell_reading(comparisons: Mapping[str, Comparison], in_time: bool) -> None:
    """Print to standard error how each A, by its name, and B are read."""
    read: dict[str, ImageSequence | FrameSequence] = {}
    for name, comparison in comparisons.items():
        read |= {name: comparison.test, "B": comparison.reference}
        if in_time and comparison.capture is not None:  # depth and motion of the capture are read too
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
    """Return the warnings of a comparison, after printing them to standard error with the ``name`` of A."""
    warnings = doubts(comparison, followed=in_time)
    if lacking:
        have, which = len(comparison.test), printable(named_frames(lacking), longest=LONGEST_VALUE)
        warnings.append(
            f"A has {have} of the {counted(have + len(lacking), 'frame')} of B: {which}"
            f" {'is' if len(lacking) == 1 else 'are'} not judged; finish A, or choose frames with --frames"
        )
    if without := comparison.without_truth:
        have, which = len(comparison.test), printable(named_frames(comparison.test.numbers), longest=LONGEST_VALUE)
        others = "other is" if len(without) == 1 else f"{len(without)} others are"
        warnings.append(
            f"B has a truth for {have} of the {counted(have + len(without), 'frame')} of A: {which}"
            f" {'is' if have == 1 else 'are'} judged, the {others} not"
        )
    if heatmap is not None:
        _refuse_among_pictures(comparison, heatmap)
        make_folder(heatmap)
        warnings += stale_maps(heatmap, comparison.test)
    for warning in warnings:
        click.echo(f"cltaa: warning: {'' if name == 'A' else f'{printable(name)}: '}{warning}", err=True)
    return warnings


def _refuse_among_pictures(comparison: Comparison, heatmap: Path) -> None:
    """Raise UsageError for a folder of maps that holds what is compared, or is in the place of a truth."""
    place, capture = real_path(heatmap), comparison.capture
    read = [comparison.test, comparison.reference, *([] if capture is None else [capture])]
    if place in {real_path(images.folder) for images in read}:
        what = "--heatmap: maps have the names of the pictures there"
    elif REFERENCE.fullmatch(place.name) and place.parent in {real_path(images.folder) for images in read}:
        what = "--heatmap: maps there would be taken for a truth"
    else:
        return
    raise UsageError(what, path=heatmap, cure="name another folder")


def _check_followed(comparison: Comparison) -> None:
    """Raise UsageError if --video cannot judge A: no capture, only a region, or no consecutive frames; InputMissing if
    no two of these have a truth."""
    if comparison.capture is None:
        raise UsageError("--video needs the capture", cure="give it as B, or alone as A, with its truth in reference/")
    if comparison.region is not None:
        expected, found = (images.layouts[images.first].size for images in (comparison.reference, comparison.test))
        what, cure = "--video judges whole pictures only", "leave --video out for a region"
        raise UsageError(what, path=comparison.test.folder, expected=expected, found=found, cure=cure)
    numbers, step = comparison.test.numbers, comparison.capture.step
    if comparison.without_truth and not any(number + step in numbers for number in numbers):
        what = "--video follows each frame to the next, but no two consecutive frames have a truth"
        cure = "render the truth of consecutive frames, or leave --video out"
        raise InputMissing(what, path=comparison.reference.folder, found=ranges(numbers), cure=cure)
    apart = even_step(numbers)
    if apart > 1 and step == 1:
        what = "--video follows each frame to the next, but no two frame numbers are consecutive"
        found, cure = f"{apart} apart", f"say --step {apart} if each continues the last"
        raise UsageError(what, path=comparison.test.folder, expected="frames 1 apart", found=found, cure=cure)
