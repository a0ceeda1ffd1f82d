"""``cltaa bench growth``: time a pixel and memory from small images to large ones."""

from __future__ import annotations

import click
from rich.table import Table

from cltaa.commands.options import FROM_1, PRESET, device_option, json_option
from cltaa.commands.printing import print_line, print_table
from cltaa.core.bands import BAND_ROWS
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.lab.bench.growth import FLAT, REFERENCE, SIZES, GrowthBench, bench_growth
from cltaa.printable import json_of, shown


@click.command("growth")
@click.option("--preset", type=PRESET, default="default", show_default=True, help="Whose choices.")
@click.option(
    "--sizes", type=FROM_1, default=",".join(map(str, SIZES)), show_default=True, help="Sides of the square images."
)
@click.option(
    "--banded-from",
    default=16384,
    show_default=True,
    type=click.IntRange(min=1),
    metavar="SIDE",
    help=f"From this size on in bands of {BAND_ROWS} rows.",
)
@device_option
@click.option(
    "--rounds",
    default=9,
    show_default=True,
    type=click.IntRange(min=3),
    help="Rounds a size; fewer beyond 4096 x 4096.",
)
@json_option
def growth(
    preset: str, sizes: tuple[int, ...], banded_from: int, device: str | None, rounds: int, as_json: bool
) -> None:
    """Time a pixel of square images of growing size, and count the memory on the device.

    Each size runs in turn with one of 2048 x 2048; "x 2048" is the ratio of the kernels' times a pixel, with its 95 %
    interval. "formula" is what cltaa inspect --plan says that the planes take. --sizes 16384 takes 11 GB.
    """
    if not sizes:
        raise UsageError("--sizes: none is named", expected="as 256,1024")
    bench = bench_growth(
        load_preset(preset),
        device,
        sizes,
        rounds=rounds,
        banded_from=banded_from,
    )
    if as_json:
        click.echo(json_of(bench))
    else:
        print_growth(bench)


def print_growth(bench: GrowthBench) -> None:
    """Print the table, and where it was measured."""
    table = Table(title=f"preset {bench.preset}, float history")
    for heading in (
        "size",
        "bands",
        "rounds",
        "ns/px",
        "least",
        f"x {REFERENCE}",
        "95 %",
        "MB on the device",
        "of formula",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in bench.rows:
        table.add_row(
            f"{row.side}²",
            str(row.band_rows or "–"),
            str(row.rounds),
            f"{row.ns_a_pixel.median:.3g}",
            f"{row.least_ns:.3g}",
            f"{row.ratio.median:.3f}",
            f"{row.ratio.low:.3f}–{row.ratio.high:.3f}",
            f"{row.allocated / 1e6:.1f}",
            f"{row.allocated / row.formula:.1%}",
        )
    print_table(table)
    large = [row for row in bench.rows if row.side >= REFERENCE]
    apart = [row.side for row in large if abs(row.ratio.median - 1.0) > FLAT]
    if apart:
        print_line(f"apart by more than {FLAT:.0%}: {', '.join(map(str, apart))}")
    elif large:
        print_line(f"from {REFERENCE}² on: flat within {FLAT:.0%}")
    print_line(shown(bench.environment.line))
