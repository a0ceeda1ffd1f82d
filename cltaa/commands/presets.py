"""``cltaa presets``, ``profiles`` and ``kernels``: list what comes with cltaa, and every parameter."""

from __future__ import annotations

import json
from typing import Any, get_type_hints

import click
import msgspec
import tomli_w
from rich.markup import escape
from rich.padding import Padding

from cltaa.commands.options import KERNEL, PRESET, PROFILE_ALONE, json_option
from cltaa.commands.printing import Console, listing
from cltaa.core.build import Build, Steps, kernel_names, source, source_hash
from cltaa.core.parameters import Choices, Settings
from cltaa.core.presets import LADDER, Preset, allowed, load_preset, preset_names
from cltaa.errors import UsageError
from cltaa.inputs.profile import load_profile, profile_names, toml_text
from cltaa.printable import json_of


@click.command("presets")
@click.argument("name", required=False, type=PRESET)
@click.option("--against", type=PRESET, help="Print only the parameters that differ between NAME and this preset.")
@click.option("--parameters", is_flag=True, help="List every parameter: range, unit, meaning, and its value in NAME.")
@json_option
def presets(name: str | None, against: str | None, parameters: bool, as_json: bool) -> None:
    """List the presets; with NAME, print that preset as TOML for cltaa resolve --config."""
    if against is not None:
        if parameters:
            raise UsageError("--against and --parameters are two lists", cure="leave one of them out")
        if name is None:
            raise UsageError("--against compares with a preset", expected="cltaa presets NAME --against OTHER")
        base = load_preset(against)
        rows = difference(load_preset(name), base)
        click.echo(json_of(rows) if as_json else _toml_over(base, rows), nl=as_json)
    elif parameters:
        chosen = None if name is None else load_preset(name)
        rows = parameter_rows(chosen)
        click.echo(json_of(rows)) if as_json else _print_parameters(rows, chosen)
    elif name is not None:
        preset = load_preset(name)
        click.echo(json_of(preset) if as_json else _toml(preset), nl=as_json)
    else:
        others = sorted(map(load_preset, {*preset_names()} - {*LADDER}), key=lambda preset: preset.name)
        listed = [*map(load_preset, LADDER), *sorted(others, key=lambda preset: bool(preset.published))]  # ours first
        rows = [{"preset": preset.name, "description": preset.description} for preset in listed]
        click.echo(json_of(rows)) if as_json else _print_presets(listed)


def parameter_rows(preset: Preset | None = None) -> list[dict[str, Any]]:
    """Return one row for each parameter: its declaration, and its value in ``preset`` if given."""
    rows: list[dict[str, Any]] = []
    values: dict[str, Any] = {}
    if preset is not None:
        values = msgspec.to_builtins(preset.choices) | msgspec.to_builtins(preset.settings)
    for struct in (Choices, Settings):
        hints: dict[str, Any] = get_type_hints(struct, include_extras=True)
        for field in msgspec.structs.fields(struct):
            hint = hints[field.name]
            default = f"{field.default:g}" if struct is Settings else field.default
            row: dict[str, Any] = {"parameter": field.name, "default": default}
            if preset is not None:
                row["value"] = values[field.name]
            if struct is Settings:
                (meta,) = hint.__metadata__
                extra = meta.extra
                unit = "" if extra["unit"] == "1" else f", in {extra['unit']}"
                row |= {"values": allowed(field.name), "meaning": f"{meta.description}{unit} [{extra['source']}]"}
            else:
                doc = (hint.__doc__ or "").strip().rstrip(".")
                row |= {"values": allowed(field.name), "meaning": doc}
                row["value_meanings"] = {value: value.meaning for value in hint if value.meaning}
            rows.append(row)
    return rows


def _toml(preset: Preset) -> str:
    parts: dict[str, Any] = msgspec.to_builtins(preset)
    where = {key: parts[key] for key in ("jitter", "published")} if preset.published else {}
    told = tomli_w.dumps(where | parts["choices"] | parts["settings"])
    return f"# {preset.name}: {preset.description}\n{told}"


def difference(preset: Preset, other: Preset) -> list[dict[str, Any]]:
    """Return one row for each parameter that affects the result and differs between the two presets."""
    ours, theirs = preset.deciding(), other.deciding()
    pairs = [(key, ours[part][key], theirs[part][key]) for part in ("choices", "settings") for key in ours[part]]
    pairs.append(("published", ours["published"], theirs["published"]))
    return [{"parameter": key, "value": one, "against": another} for key, one, another in pairs if one != another]


def _toml_over(base: Preset, rows: list[dict[str, Any]]) -> str:
    lines = [(f"{row['parameter']} = {json.dumps(row['value'])}", json.dumps(row["against"])) for row in rows]
    width = max((len(line) for line, _ in lines), default=0)
    told = [f"{line:{width}}  # {against}" for line, against in lines]
    return "\n".join([f"preset = {json.dumps(base.name)}", *told]) + "\n"


def _print_presets(presets: list[Preset]) -> None:
    table = listing("preset", "description")
    table.columns[0].no_wrap, table.columns[0].overflow = True, "ignore"  # whole names, so that they can be copied
    for preset in presets:
        table.add_row(preset.name, escape(preset.description))
    Console().print(table)


def _print_parameters(rows: list[dict[str, Any]], preset: Preset | None) -> None:
    """Print one paragraph for each row, because four columns leave too little width for the text."""
    console = Console()
    if preset is None:
        sets = "cltaa presets NAME --parameters"
        console.print(f"What each is where a preset does not set it (and what it can be); what one sets: {sets}\n")
    else:
        console.print(f"What each is in {escape(preset.name)} (and what it can be)\n")
    for row in rows:
        text = {name: escape(value) for name, value in row.items() if isinstance(value, str)}
        value = row["default" if preset is None else "value"]
        value = escape(value if isinstance(value, str) else f"{value:g}")
        console.print(f"[bold]{text['parameter']}[/] = {value}  [dim]({text['values']})[/]")
        console.print(Padding(text["meaning"], (0, 0, 0, 4)))
        for value, meaning in row.get("value_meanings", {}).items():
            console.print(Padding(f"[dim]{value}:[/] {escape(meaning)}", (0, 0, 0, 8)))


@click.command()
@click.argument("name", required=False, type=PROFILE_ALONE)
@json_option
def profiles(name: str | None, as_json: bool) -> None:
    """List the reader profiles; with NAME, print all its keys as TOML, to start your own from."""
    if name is not None:
        profile = load_profile(name)
        click.echo(json_of(profile) if as_json else toml_text(profile), nl=as_json)
        return
    if as_json:
        rows = [{"profile": known, "description": load_profile(known).description} for known in profile_names()]
        click.echo(json_of(rows))
        return
    table = listing("profile", "what it reads")
    for known in profile_names():
        table.add_row(known, load_profile(known).description)
    Console().print(table)


@click.command("kernels")
@click.option("--show", type=KERNEL, metavar="KERNEL", help="Print the source of a kernel, with prelude and includes.")
@click.option("--preset", type=PRESET, default="default", help="Preset whose choices the prelude defines.")
@click.option("--lanes", type=click.Choice(["1", "4", "8", "16"]), default="8", help="Pixels of a work-item.")
@click.option("--strict", is_flag=True, help="Print the strict build.")
@json_option
def kernels(show: str | None, preset: str, lanes: str, strict: bool, as_json: bool) -> None:
    """List the OpenCL kernels with the hash of their source, or print one as the compiler sees it."""
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
