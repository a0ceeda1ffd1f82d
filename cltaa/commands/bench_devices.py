"""``cltaa bench devices``: which shape of kernels suits a device."""

from __future__ import annotations

import click

from cltaa.commands.options import device_option, json_option
from cltaa.commands.printing import answer, figures, print_line, print_table, three_digits
from cltaa.lab.bench.devices import ShapesBench, bench_shapes, forget_shapes
from cltaa.printable import counted, shown


@click.command("devices")
@device_option
@click.option("--forget", is_flag=True, help="Remove what was kept, of every device, and measure nothing.")
@json_option
def devices(device: str | None, forget: bool, as_json: bool) -> None:
    """Measure how the kernels are best cut up for a device, and keep the answer for later resolves on it.

    For a device whose shape is a guess, as cltaa doctor says. The default preset runs in each of a few shapes, in
    rounds; the usual one stays unless another takes 5 % less, beyond chance. The answer holds for this device, runtime,
    processor and version of the kernels, and changes no bit of a strict build.
    """
    if forget:
        answer({"forgotten": forget_shapes()}, as_json, _print_forgotten)
    else:
        answer(bench_shapes(device), as_json, _print)


def _print_forgotten(found: dict[str, int]) -> None:
    print_line(f"forgotten: {counted(found['forgotten'], 'shape')}")


def _print(bench: ShapesBench) -> None:
    table = figures(None, "shape", "lanes", "ms for two frames", "x usual", "95 %", named=True)
    for row in bench.rows:
        cells = [row.shape, str(row.lanes)]
        if row.seconds is not None and row.ratio is not None:
            cells += [three_digits(row.seconds.median * 1e3), f"{row.ratio.median:.3g}"]
            cells += [f"{row.ratio.low:.3g} to {row.ratio.high:.3g}"]
        table.add_row(*cells)
    print_table(table)
    for row in bench.rows:
        if row.absent is not None:
            print_line(f"{row.shape} is absent: {shown(row.absent)}")
    print_line(f"usual: {bench.usual}, {bench.origin}; taken from now on: {bench.taken}, kept in {shown(bench.kept)}")
    print_line(shown(bench.environment.line))
