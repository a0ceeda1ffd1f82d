"""``cltaa bench accuracy``: the time that each step of accuracy costs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from cltaa.commands.options import (
    COUNT,
    FILE_PATH,
    FOLDER,
    PRESET,
    device_option,
    json_option,
    listed,
    measured_options,
    open_each,
    preset_of,
)
from cltaa.commands.printing import answer, figures, print_line, print_table, three_digits
from cltaa.core.presets import Preset, load_preset, preset_names
from cltaa.errors import UsageError, known
from cltaa.inputs.open import Reading
from cltaa.io.atomic import make_folder
from cltaa.lab.bench.accuracy.measurement import Accuracy, MeasuredSequence, bench_accuracy, cost, tasks_of
from cltaa.lab.bench.accuracy.report import page, write_report
from cltaa.lab.bench.cells import Judging
from cltaa.lab.bench.variants import Variant, ladder
from cltaa.lab.judge.metrics import parse_metrics
from cltaa.lab.timing import Clock
from cltaa.printable import counted, printable, shown


@click.command("accuracy")
@click.argument("sequences", nargs=-1, required=True, type=FOLDER, metavar="SEQUENCE...")
@click.option("-o", "--output", required=True, type=FILE_PATH, help="Folder for the report.")
@device_option
@click.option("--preset", type=PRESET, default="default", help="Preset that the variants are derived from.")
@click.option("--config", type=FILE_PATH, help="TOML file of parameters that override the preset.")
@click.option(
    "--only", multiple=True, metavar="NAME", help="Variants or groups beside the default, comma-separated; repeatable."
)
@click.option("--metrics", default="mse,flip", metavar="LIST", help="Metrics against the truth, of cltaa compare.")
@click.option(
    "--rounding-frames",
    default=8,
    type=click.IntRange(min=0),
    help="Number of frames to resolve also in float64 with NumPy, to measure rounding; 0 for none.",
)
@click.option("--rounds", default=15, type=click.IntRange(min=3), help="Least number of timing rounds.")
@click.option(
    "--patience",
    default=20.0,
    type=click.FloatRange(min=0),
    metavar="SECONDS",
    help="Extra time for more rounds on a sequence, while the default and its own copy differ too much to rank.",
)
@click.option("--pixels", type=COUNT, help="Least pixels of a timed frame.  [default: enough to fill the device]")
@click.option("--jobs", default=1, type=click.IntRange(min=1), help="Number of processes that measure errors.")
@click.option("--dask", metavar="ADDRESS", help="Measure errors on the Dask cluster whose scheduler has this address.")
@click.option(
    "--pictured", default=4, type=click.IntRange(min=0), help="Number of first sequences pictured on the page."
)
@measured_options
@json_option
def accuracy(
    sequences: tuple[Path, ...],
    output: Path,
    device: str | None,
    preset: str,
    config: Path | None,
    only: tuple[str, ...],
    metrics: str,
    rounding_frames: int,
    pictured: int,
    reading: Reading,
    as_json: bool,
    **work: Any,
) -> None:
    """Measure error and time of every variant of the resolve on each SEQUENCE, and write a report.

    A SEQUENCE is a capture with its truth (cltaa capture SCENE -o DIR --reference 256 --yardstick 2,4,8,16,32,64), or
    another tool's frames with the truth in a folder reference/ (docs/inputs.md). Errors are measured against the truth
    and against the same algorithm in float64. The output folder keeps finished tasks: the same command, also with
    other --jobs, continues where the last one stopped. This process itself does all timing, in shuffled rounds, after
    all errors.
    """
    if work["dask"] is not None and work["jobs"] > 1:
        raise UsageError("--jobs and --dask both say who measures errors", cure="leave one of them out")
    names = tuple(metric.name for metric in parse_metrics(metrics))
    variants = chosen_variants(preset_of(preset, config), only)
    judging = Judging(metrics=names, rounding_frames=rounding_frames, pictures=True)
    tasks = tasks_of(sequences, variants, device, judging, reading)
    make_folder(output)
    open_each(sequences, reading)  # how files are read shows before the work, not after it
    result = bench_accuracy(tasks, output, **work)
    write_report(result, output, page(result, tasks, output, pictured))
    answer(result, as_json, print_accuracy)
    if not as_json:
        click.echo(f"look at {printable(output / 'index.html')}")


def chosen_variants(preset: Preset, only: Sequence[str]) -> list[Variant]:
    """Return the ladder of ``preset``, or its variants and groups named in ``only``; UsageError for unknown names."""
    every = ladder(preset, [load_preset(name) for name in preset_names()])
    there = {name for variant in every for name in (variant.group, variant.name)}
    names = {name for text in only for name in ([text] if text in there else listed(text))}
    if only and not names:
        raise UsageError("--only names nothing", expected="variants or groups of them", cure="leave it out for all")
    for name in sorted(names - there):
        cure = known(name, sorted(there), "variants and groups")
        raise UsageError(f"--only: unknown variant or group {name}", cure=cure)
    return [every[0], *(each for each in every[1:] if not only or names & {each.group, each.name})]


def print_accuracy(result: Accuracy) -> None:
    """Print a table of all variants for each sequence, and the environment."""
    for measured in result.sequences:
        print_table(_table(result, measured))
        if measured.noisy:
            base = shown(result.variants[0].name)
            print_line(f"too noisy to rank by time: {base} differs from its own copy, or by more than 2 %")
        elif measured.clock is Clock.PROCESSOR:
            print_line("ranked by the processor time of the threads that run kernels: what they wait is not in it")
    print_line(shown(result.environment.line))


def _table(result: Accuracy, measured: MeasuredSequence) -> Table:
    metric = result.metrics[0]
    frames = counted(len(measured.frames), "frame")
    title = f"{shown(measured.name)}: {frames}, {measured.width} x {measured.height}"
    base = f"x {shown(result.variants[0].name)}"
    heads = ("variant", "ms/Mpx", base, "95 %", *result.metrics, "bits right", "beaten by")
    table = figures(title, *heads, named=True)
    table.columns[-1].justify = "left"
    for cell in sorted(measured.cells, key=lambda cell: cost(metric, cell.errors[metric].mean)):
        table.add_row(
            shown(cell.variant),
            three_digits(cell.time.median),
            "noisy" if measured.noisy else f"{cell.ratio.median:.3f}",
            f"{cell.ratio.low:.2f}–{cell.ratio.high:.2f}",
            *(f"{cell.errors[name].mean:.4g}" for name in result.metrics),
            "–" if cell.rounding is None else "all" if cell.rounding.rms == 0 else f"{cell.rounding.bits:.1f}",
            shown(cell.dominated_by.get(metric, "")),
        )
    for row in measured.yardstick:
        added = "–" if row.added is None else three_digits(row.added)
        errors = (f"{row.errors[name].mean:.4g}" for name in result.metrics)
        table.add_row(f"{counted(row.samples, 'sample')} a pixel", added, "", "", *errors, "", "", style="dim")
    return table
