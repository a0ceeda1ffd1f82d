"""``cltaa bench kernels``: time the kernels against the alternatives and the floor."""

from __future__ import annotations

import click
from rich.table import Table

from cltaa.commands.options import PRESET, SIZE, device_option, json_option
from cltaa.commands.printing import print_line, print_table, three_digits
from cltaa.core.build import STORAGES, Storage
from cltaa.core.presets import load_preset
from cltaa.lab.bench.frames import Motion
from cltaa.lab.bench.kernels import KernelBench, Row, Timing, bench_kernels
from cltaa.lab.timing import Interval
from cltaa.printable import json_of, shown


@click.command("kernels")
@click.option(
    "--preset",
    "presets",
    type=PRESET,
    multiple=True,
    default=["default"],
    show_default=True,
    help="To time; repeatable.",
)
@click.option("--size", type=SIZE, default="1920x1080", show_default=True, help="Pixels.")
@device_option
@click.option(
    "--motion",
    "motions",
    multiple=True,
    type=click.Choice([kind.value for kind in Motion]),
    help="Camera motion: uniform, or turn (rotation with zoom, another displacement at each pixel); "
    "repeatable; both unless given.",
)
@click.option(
    "--storage",
    type=click.Choice([kind.value for kind in STORAGES]),
    default=Storage.FLOAT.value,
    show_default=True,
    help="Number that the history is kept in.",
)
@click.option("--rounds", default=31, show_default=True, type=click.IntRange(min=3), help="Rounds of all contenders.")
@click.option("--oracle/--no-oracle", default=True, show_default=True, help="Also time the NumPy oracle, in 3 rounds.")
@json_option
def kernels(
    presets: tuple[str, ...],
    size: tuple[int, int],
    device: str | None,
    motions: tuple[str, ...],
    storage: str,
    rounds: int,
    oracle: bool,
    as_json: bool,
) -> None:
    """Time the resolve's kernels against a shader, a plain port, the NumPy oracle and the floor.

    The core is the algorithm that all of them compute: 3x3 variance, the nearest surface's motion, 16 taps of
    Catmull-Rom, clip, weighted blend, a counter. Every round runs all contenders in a new order; ratios are medians
    over rounds with 95 % intervals, by the device's clock where it has one (column device, ns a pixel), else by the
    host's (ns/px). "floor" is the share of the copy bandwidth that is reached. "core again" is a copy of the core:
    where its ratio is not 1, or its interval wide, the machine is too noisy to rank anything.
    """
    bench = bench_kernels(
        [load_preset(name) for name in presets],
        device,
        width=size[0],
        height=size[1],
        motions=[Motion(name) for name in motions] or list(Motion),
        rounds=rounds,
        storage=Storage(storage),
        oracle=oracle,
    )
    if as_json:
        click.echo(json_of(bench))
    else:
        print_bench(bench)


def print_bench(bench: KernelBench) -> None:
    """Print one table for each kind of motion, and where it was measured."""
    for timing in bench.timings:
        print_table(_table(bench, timing))
        print_line(f"floor {timing.floor_ns:.3g} ns a pixel: {timing.copy_gigabytes_a_second:.3g} GB/s by copying")
        if timing.opengl is not None:
            print_line(f"GLSL by {shown(timing.opengl)}")
        for name, why in timing.absent.items():
            print_line(f"{name} is absent: {shown(why)}")
        if timing.noisy or timing.device_noisy:
            print_line("too noisy to rank: the core differs from its own copy, or by more than 2 % either way")
    print_line(shown(bench.environment.line))


def _table(bench: KernelBench, timing: Timing) -> Table:
    title = f"{bench.width} x {bench.height}, {timing.motion} motion, {bench.storage} history, {bench.rounds} rounds"
    table = Table(title=title)
    table.add_column("contender", no_wrap=True)
    for heading in ("ns/px", "least", "device", "GB/s", "floor", "x core", "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in timing.rows:
        ratio = _fairest(row)
        table.add_row(
            row.name,
            three_digits(row.wall_ns.median),
            three_digits(row.least_wall_ns),
            "–" if row.device_ns is None else three_digits(row.device_ns.median),
            f"{row.gigabytes_a_second:.3g}",
            f"{row.of_floor:.1%}",
            "noisy" if _is_noisy(timing, row) else f"{ratio.median:.3g}",
            f"{ratio.low:.3g}–{ratio.high:.3g}",
        )
    return table


def _is_noisy(timing: Timing, row: Row) -> bool:
    """Whether the clock that times the row says that nothing can be ranked."""
    return timing.noisy if row.device_ratio is None else timing.device_noisy


def _fairest(row: Row) -> Interval:
    """The ratio by the device's clock, where it has one, else by the host's."""
    return row.ratio if row.device_ratio is None else row.device_ratio
