"""``cltaa doctor``: what this machine offers to capture and resolve."""

from __future__ import annotations

import click
from rich.table import Table

from cltaa.commands.options import json_option
from cltaa.commands.printing import Console
from cltaa.doctor import Diagnosis, diagnose
from cltaa.errors import DeviceMissing
from cltaa.printable import json_of, shown


@click.command()
@json_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool) -> None:
    """Look for what capture and resolve need on this machine.

    Each thing is tried in a process of its own, so that a driver that aborts is only a line in the table, and each
    failure comes with its cure. Capture needs OSMesa or EGL, one of them. The exit code is 0 when capture and resolve
    both work, else 69.
    """
    console = Console(stderr=as_json)
    with console.status("Trying files, linker, OpenCL and OpenGL ..."):
        diagnosis = diagnose()
    if as_json:
        click.echo(json_of(diagnosis))
    else:
        console.print(_findings(diagnosis))
        for devices in filter(None, (finding.devices for finding in diagnosis.findings)):
            console.print(_devices(devices))
    if not (diagnosis.capture and diagnosis.resolve):
        ctx.exit(DeviceMissing.exit_code)


def _findings(diagnosis: Diagnosis) -> Table:
    verdict = ", ".join(
        f"{name} [green]works[/]" if works else f"{name} [red]does not work[/]"
        for name, works in (("capture", diagnosis.capture), ("resolve", diagnosis.resolve))
    )
    table = Table(title=f"cltaa doctor: {verdict}", title_justify="left")
    for heading in ("", "looked for", "found", "cure"):
        table.add_column(heading, overflow="fold")
    for finding in diagnosis.findings:
        mark = "[green]✓[/]" if finding.ok else "[red]✗[/]" if diagnosis.hurts(finding) else "[yellow]–[/]"
        cure = "" if finding.ok or finding.cure is None else finding.cure
        table.add_row(mark, finding.name, shown(finding.found), shown(cure))
    return table


def _devices(devices: list[dict[str, object]]) -> Table:
    table = Table(
        "", title="OpenCL devices, in the order of choice; CLTAA_DEVICE or --device names another", title_justify="left"
    )
    for index in range(len(devices)):
        table.add_column(f"--device {index}")
    for name in devices[0]:
        heading = name.removesuffix("_bytes").replace("_", " ")
        table.add_row(heading, *(_cell(name, device[name]) for device in devices))
    return table


def _cell(name: str, value: object) -> str:
    if isinstance(value, bool):
        return "[green]yes[/]" if value else "[dim]no[/]"
    if isinstance(value, list):
        return shown(", ".join(value) or "none")
    if name.endswith("_bytes") and isinstance(value, int):
        return f"{value / 2**30:.1f} GiB"
    return shown(str(value))
