"""``cltaa bench api``: what a call from a program takes, beside its kernels and the bus."""

from __future__ import annotations

import click
from rich.table import Table

from cltaa.commands.options import PRESET, SIZE, device_option, json_option
from cltaa.commands.printing import print_line, print_table
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.lab.bench.api import SIZES, ApiBench, bench_api
from cltaa.printable import json_of, shown


@click.command("api")
@click.option("--preset", type=PRESET, default="default", show_default=True, help="That resolves.")
@click.option(
    "--size",
    "sizes",
    type=SIZE,
    multiple=True,
    default=[f"{width}x{height}" for width, height in SIZES],
    show_default=True,
    metavar="WxH",
    help="Of the frames; may be repeated.",
)
@device_option
@click.option("--rounds", default=9, show_default=True, type=click.IntRange(min=3), help="Rounds a size.")
@json_option
def api(preset: str, sizes: tuple[tuple[int, int], ...], device: str | None, rounds: int, as_json: bool) -> None:
    """Time Resolver.resolve as a program calls it, in milliseconds a frame of colour and depth.

    "kernels" is the device's own time of a call with arrays that are there already, "device arrays" the same by the
    clock, of several calls in a row. "host arrays" are NumPy's, in and out. "copies" are a plain pyopencl loop that
    brings the same arrays to the device and a result back, "pinned" the same through pinned memory, at the speed of the
    bus.
    """
    preset_of = load_preset(preset)
    if preset_of.settings.look_ahead:
        raise UsageError(f"preset {preset} looks ahead, so no call gives an image", cure="take one that does not")
    bench = bench_api(preset_of, device, sizes, rounds=rounds)
    if as_json:
        click.echo(json_of(bench))
    else:
        print_api(bench)


def print_api(bench: ApiBench) -> None:
    """Print the table, and where it was measured."""
    table = Table(title=f"a call, preset {bench.preset}, {bench.rounds} rounds, milliseconds a frame")
    times = ("kernels", "device arrays", "host arrays", "copies", "pinned_copies")
    for heading in ("size", *(name.replace("_copies", "") for name in times)):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in bench.rows:
        found = [getattr(row, name.replace(" ", "_")).median * 1e3 for name in times]
        table.add_row(f"{row.width} x {row.height}", *(f"{value:.3g}" for value in found))
    print_table(table)
    print_line(shown(bench.environment.line))
