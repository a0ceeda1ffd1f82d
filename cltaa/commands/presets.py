"""``cltaa presets``: list the presets, what each sets, and every parameter there is."""

from __future__ import annotations

import json
from typing import Any, get_type_hints

import click
import msgspec
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cltaa.commands.options import PRESET
from cltaa.params import Choices, Settings
from cltaa.presets import Preset, allowed, load_preset, preset_names


@click.command("presets")
@click.argument("name", required=False, type=PRESET)
@click.option("--parameters", is_flag=True, help="List every parameter with its range, unit and meaning.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def presets(name: str | None, parameters: bool, as_json: bool) -> None:
    """List the presets; with NAME, print that one as TOML for ``cltaa resolve --config``."""
    if parameters:
        _print_rows(parameter_rows(), ("parameter", "default", "values", "meaning"), as_json)
    elif name is not None:
        preset = load_preset(name)
        click.echo(json.dumps(msgspec.to_builtins(preset)) if as_json else _toml(preset), nl=as_json)
    else:
        rows = [{"preset": entry, "description": load_preset(entry).description} for entry in preset_names()]
        _print_rows(rows, ("preset", "description"), as_json)


def parameter_rows() -> list[dict[str, str]]:
    """One row a parameter, from its declaration."""
    rows = []
    for struct in (Choices, Settings):
        hints: dict[str, Any] = get_type_hints(struct, include_extras=True)
        for field in msgspec.structs.fields(struct):
            hint = hints[field.name]
            row = {"parameter": field.name, "default": f"{field.default:g}" if struct is Settings else field.default}
            if struct is Settings:
                (meta,) = hint.__metadata__
                extra = meta.extra
                unit = "" if extra["unit"] == "1" else f", in {extra['unit']}"
                row |= {
                    "values": allowed(field.name),
                    "meaning": f"{meta.description}{unit} [{extra['source']}]",
                }
            else:
                doc = (hint.__doc__ or "").strip().rstrip(".")
                row |= {"values": allowed(field.name), "meaning": doc}
            rows.append(row)
    return rows


def _toml(preset: Preset) -> str:
    lines = [f"# {preset.name}: {preset.description}"]
    if preset.published:
        lines += [f'jitter = "{preset.jitter}"', "published = true"]
    for part in (preset.choices, preset.settings):
        for key, value in msgspec.to_builtins(part).items():
            lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}")
    return "\n".join(lines) + "\n"


def _print_rows(rows: list[dict[str, str]], columns: tuple[str, ...], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(rows))
        return
    table = Table()
    for column in columns:
        table.add_column(column, overflow="fold", no_wrap=column in ("parameter", "preset"))
    for row in rows:
        table.add_row(*(escape(str(row[column])) for column in columns))
    Console().print(table)
