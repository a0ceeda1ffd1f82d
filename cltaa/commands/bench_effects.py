"""``cltaa bench effects``: what the plan saves, and proof that it changes time and not the picture."""

from __future__ import annotations

from pathlib import Path

import click

from cltaa.commands.options import FILE_PATH, PRESET, SIZE, device_option, json_option
from cltaa.core.backend import launcher_for
from cltaa.errors import DataError
from cltaa.io.sequence import open_sequence
from cltaa.lab.bench.effects import EffectRow, cells, judge_effects, line, markdown
from cltaa.lab.bench.quality.cases import check_scenes, known_scenes
from cltaa.printable import json_of, printable
from cltaa.process import run_cltaa


@click.command("effects")
@click.argument("scenes", nargs=-1)
@click.option("--work", type=FILE_PATH, default=Path("effects"), show_default=True, help="Folder of captures.")
@click.option("--size", type=SIZE, default="320x180", show_default=True, help="Pixels of a capture.")
@click.option("--frames", default=16, show_default=True, type=click.IntRange(min=2), help="Frames of a capture.")
@click.option("--preset", type=PRESET, default="default", show_default=True, help="Whose steps.")
@device_option
@click.option("--rounds", default=21, show_default=True, type=click.IntRange(min=3), help="Rounds of timing.")
@json_option
@click.pass_context
def effects(
    ctx: click.Context,
    scenes: tuple[str, ...],
    work: Path,
    size: tuple[int, int],
    frames: int,
    preset: str,
    device: str | None,
    rounds: int,
    as_json: bool,
) -> None:
    """Resolve SCENES (all, unless named) as planned and with every effect on; compare bits and time.

    Missing captures are drawn by cltaa capture. The table is Markdown, as in docs/generated/effects.md. The exit code
    is 65 where a step that was left out would have changed a bit.
    """
    rows: list[EffectRow] = []
    check_scenes(scenes)
    pixels = f"{size[0]}x{size[1]}"
    launcher = launcher_for(device)
    if not as_json:
        click.echo(markdown([]), nl=False)
    for number, scene in enumerate(scenes or sorted(known_scenes()), start=1):
        click.echo(f"{number}: {printable(scene)}", err=True)
        folder = work / f"{scene}-{pixels}x{frames}"
        run_cltaa(["capture", scene, "-o", str(folder), "--frames", str(frames), "--size", pixels])
        rows.append(judge_effects(open_sequence(folder), preset, launcher, rounds=rounds))
        if not as_json:
            click.echo(line(cells(rows[-1])), nl=False)  # as soon as it is known: all scenes take a while
    if as_json:
        click.echo(json_of(rows))
    if not all(row.same_bits for row in rows):
        ctx.exit(DataError.exit_code)
