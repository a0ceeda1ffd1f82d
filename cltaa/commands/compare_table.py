"""``cltaa compare --table``: any number of results of the standard sequences beside ours; the cells of all tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from cltaa.commands.printing import figures, print_line, print_table
from cltaa.errors import UsageError
from cltaa.io.atomic import make_folder
from cltaa.io.numbered import FrameRange
from cltaa.io.video import USUAL_RATE, import_av, open_video, rate_of
from cltaa.lab.judge.entries import Entry, Round, divided, lacking, read_entry, resolved_by_us, rounds
from cltaa.lab.judge.metrics import CVVDP_TITLE, Measure, Metric, import_cvvdp, jod, mean_psnr, versions_of
from cltaa.lab.judge.one_pass import judge, summary_of
from cltaa.lab.judge.video_scores import SCORES
from cltaa.printable import counted, json_of, printable

Row = dict[str, Any]
Values = Mapping[str, float]
BOUNDS = {None: "", "at least": "≥ ", "at most": "≤ "}


def score_heads(metrics: Sequence[Metric], *, moving: bool, samples: bool) -> list[str]:
    """Heads of columns of metrics, of scores as ``moving`` pictures, and of equal-quality ``samples``."""
    heads = [measure.head for measure in (*metrics, *(SCORES if moving else ()))]
    return [*heads, *(["samples ↑"] if samples else [])]


def score_cells(result: Mapping[str, Any], metrics: Sequence[Metric], *, moving: bool, samples: bool) -> list[str]:
    """The cells of a result under these heads."""
    cells = value_cells(result["mean"], metrics)
    if moving:
        scores = result.get("video", dict.fromkeys((score.name for score in SCORES), math.nan))
        cells += ["–" if math.isnan(v) else format(v, s.form) for s in SCORES for v in (scores[s.name],)]
    return [*cells, sample_cell(result)] if samples else cells


def value_cells(values: Values, metrics: Sequence[Metric]) -> list[str]:
    """The metrics of a row."""
    return ["identical" if math.isinf(v) else format(v, m.form) for m in metrics for v in (values[m.name],)]


def sample_cell(result: Mapping[str, Any]) -> str:
    """The equal-quality samples as a cell."""
    equal = result.get("equal_quality_samples")
    if equal is None:
        return "–"
    return "identical" if math.isinf(equal["samples"]) else f"{BOUNDS[equal['bound']]}{equal['samples']:.1f}"


def print_meanings(measures: Iterable[Measure]) -> None:
    """Print what each column says."""
    for measure in measures:
        print_line(f"  {measure.name}: {measure.title}", "dim")


def compare_table(
    paths: Sequence[Path],
    ours: Sequence[str],
    metrics: tuple[Metric, ...],
    asked: tuple[Metric, ...],
    *,
    stops: float,
    cvvdp: bool,
    film: Path | None,
    as_json: bool,
    frames: int | FrameRange | None,
    **reading: Any,
) -> None:
    """Judge entries and our presets ``ours`` on captured sequences, and print one table or JSON."""
    folders, sequences = divided(paths)
    entries = [read_entry(folder, sequences) for folder in folders]
    if cvvdp:
        import_cvvdp()
    if film is not None:
        import_av()
        make_folder(film)
    with resolved_by_us(ours, sequences) as own:
        played = rounds([*entries, *own], sequences, frames, **reading)
        rows = [row for one in played for row in _judged(one, metrics, stops, cvvdp=cvvdp)]
        for one in played:
            if left := lacking(one):
                click.echo(f"cltaa: warning: not judged: {printable(left)}", err=True)
            if film is not None:
                write_film(film / f"{one.sequence.resolve().name}.mp4", one, stops)
    if as_json:
        click.echo(json_of({"table": rows, "stops": stops, "versions": versions_of(metrics)}))
    else:
        _print(rows, asked, several=len(sequences) > 1, cvvdp=cvvdp)


def _judged(one: Round, metrics: tuple[Metric, ...], stops: float, *, cvvdp: bool) -> list[Row]:
    found = judge(one.comparisons, metrics, stops, in_time=one.in_time)
    rows = []
    for entry, comparison, judged in zip(one.entries, one.comparisons, found.tests, strict=True):
        summary = summary_of(comparison, judged, found, metrics)
        row: Row = {
            "sequence": one.sequence.resolve().name,
            "entry": entry.name,
            **_facts(entry),
            "frames": one.numbers,
            **{key: summary[key] for key in ("mean", "video", "equal_quality_samples") if key in summary},
        }
        if cvvdp and one.in_time:
            if comparison.region is not None:
                what = "--cvvdp judges whole pictures only"
                raise UsageError(what, path=comparison.test.folder, cure="leave --cvvdp out")
            test, truth = ([side.image(n) for n in one.numbers] for side in (comparison.test, comparison.reference))
            row["cvvdp"] = jod(test, truth, float(rate_of_round(one)), stops)
        rows.append(row)
    return rows


def _facts(entry: Entry) -> Row:
    facts = {name: getattr(entry.facts, name) for name in ("version", "settings", "device", "milliseconds")}
    return {name: value for name, value in facts.items() if value not in ("", None)}


def rate_of_round(one: Round) -> Any:
    """Frames a second at which a sequence is shown."""
    capture = one.comparisons[0].capture
    return USUAL_RATE if capture is None else rate_of(capture.attributes, capture.sequence_json, capture.step)


def _print(rows: list[Row], asked: tuple[Metric, ...], *, several: bool, cvvdp: bool) -> None:
    timed = any("milliseconds" in row for row in rows)
    heads = [*score_heads(asked, moving=True, samples=True), *(["cvvdp ↑"] * cvvdp), *(["ms ↓"] * timed)]
    table = figures(None, "", "", *heads, named=True)
    table.columns[1].justify = "left"
    last = ""
    for row in [*rows, *(_means(rows) if several else [])]:
        if last and row["sequence"] != last:
            table.add_section()
        named = printable(row["sequence"]) if row["sequence"] != last else ""
        last = row["sequence"]
        cells = score_cells(row, asked, moving=True, samples=True)
        cells += [f"{row['cvvdp']:.2f}" if "cvvdp" in row else "–"] if cvvdp else []
        cells += [f"{row['milliseconds']:g}" if "milliseconds" in row else "–"] if timed else []
        table.add_row(named, printable(row["entry"]), *cells)
    print_table(table)
    print_meanings([*asked, *SCORES])
    if cvvdp:
        print_line(f"  {CVVDP_TITLE}", "dim")


def _means(rows: list[Row]) -> list[Row]:
    """The means over sequences of the entries that have all of them."""
    count = len({row["sequence"] for row in rows})
    means = []
    for name in dict.fromkeys(row["entry"] for row in rows):
        of_it = [row for row in rows if row["entry"] == name]
        if len(of_it) < count:
            continue
        mean = {key: _mean(key, [row["mean"][key] for row in of_it]) for key in of_it[0]["mean"]}
        row: Row = {"sequence": f"mean of {counted(count, 'sequence')}", "entry": name, "mean": mean}
        if all("video" in one for one in of_it):
            row["video"] = {key: _mean(key, [one["video"][key] for one in of_it]) for key in of_it[0]["video"]}
        row |= {key: _mean(key, [one[key] for one in of_it]) for key in ("cvvdp",) if all(key in one for one in of_it)}
        means.append(row | {key: of_it[0][key] for key in ("milliseconds",) if key in of_it[0]})
    return means


def _mean(name: str, values: Sequence[float]) -> float:
    """The mean of what is a number: of PSNR by squared errors."""
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return math.nan
    return mean_psnr(known) if name.startswith("psnr") else math.fsum(known) / len(known)


MAGNIFIED = 2  # times in a film, each pixel as a square


def write_film(path: Path, one: Round, stops: float) -> None:
    """Write the entries of a sequence and its truth side by side as an MP4, magnified without a filter."""
    from cltaa.io.display import beside, to_picture

    first = one.comparisons[0]
    names = [*(entry.name for entry in one.entries), "truth"]
    images = [*(comparison.test for comparison in one.comparisons), first.reference]
    with open_video(path, rate_of_round(one)) as video:
        for number in one.numbers:
            pictures = [to_picture(source.image(number)[..., :3], stops) for source in images]
            video.add(beside([p.repeat(MAGNIFIED, 0).repeat(MAGNIFIED, 1) for p in pictures], names))
