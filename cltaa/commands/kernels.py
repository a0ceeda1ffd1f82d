"""``cltaa kernels``: list the OpenCL kernels, or print one as it is built."""

from __future__ import annotations

import click

from cltaa.commands.options import KERNEL, PRESET, json_option
from cltaa.core.build import Build, Steps
from cltaa.core.kernel_source import kernel_names
from cltaa.core.presets import load_preset
from cltaa.printable import json_of


@click.command("kernels")
@click.option(
    "--show", type=KERNEL, metavar="KERNEL", help="Print the whole text of a kernel, prelude and includes pasted."
)
@click.option(
    "--preset", type=PRESET, default="default", show_default=True, help="Preset whose choices the prelude carries."
)
@click.option(
    "--lanes", type=click.Choice(["1", "4", "8", "16"]), default="8", show_default=True, help="Pixels a work-item."
)
@click.option("--strict", is_flag=True, help="The strict build.")
@json_option
def kernels(show: str | None, preset: str, lanes: str, strict: bool, as_json: bool) -> None:
    """List the OpenCL kernels with the hash of their text, or print one as the compiler sees it."""
    from cltaa.opencl.program import source, source_hash

    build = Build(choices=load_preset(preset).choices, steps=Steps(), lanes=int(lanes), rows=32, strict=strict)
    if show is not None:
        text = source(show, build)
        told = {"kernel": show, "flags": list(build.flags()), "hash": source_hash(show, build), "text": text}
        click.echo(json_of(told) if as_json else text, nl=as_json)
        return
    hashes = {name: source_hash(name, build) for name in kernel_names()}
    if as_json:
        click.echo(json_of({"flags": list(build.flags()), "kernels": hashes}))
        return
    click.echo(f"built with {' '.join(build.flags())}")
    for name, digest in hashes.items():
        click.echo(f"{name:26} {digest[:16]}")
