"""``cltaa bench quality``: scores of each preset on each scene, against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import click
import msgspec

from cltaa.commands.options import (
    COUNT,
    FILE_PATH,
    FOLDER,
    FROM_0,
    PRESET,
    SCENE,
    SIZE,
    device_option,
    json_option,
    measured_options,
    open_each,
    refuse_given,
)
from cltaa.commands.printing import figures, print_line, print_table
from cltaa.core.presets import Preset, load_preset, preset_names
from cltaa.errors import UsageError, known
from cltaa.inputs.open import DEFAULT_READING, Reading, readings
from cltaa.io.preset_file import load_config
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.cases import (
    GIVEN,
    HELD_OUT,
    MODEL,
    TRAIN,
    Case,
    Shape,
    by_name,
    capture,
    known_scenes,
    open_case,
    planned,
)
from cltaa.lab.bench.cells import (
    COLUMNS,
    ONE_SAMPLE,
    QUALITY,
    Judged,
    check_judged,
    import_judges,
    launcher_of,
    run_all,
    task_of,
)
from cltaa.lab.bench.quality.pictures import write_pictures
from cltaa.lab.bench.quality.table import (
    Table,
    about_of,
    check_pages,
    columns_of,
    ordered,
    summarise,
    write_pages,
    written,
)
from cltaa.lab.bench.variants import Variant
from cltaa.lab.judge.metrics import ALPHA, METRICS, SSIM_SMALLEST_SIDE, versions_of
from cltaa.printable import counted, json_of, printable, shown

ALL_SCENES = "all"  # all that cltaa scenes lists
OF_CAPTURES = ("size", "frames", "samples", "jitter", "train", "held_out")  # options


@click.command("quality")
@click.option(
    "--scene",
    "scenes",
    multiple=True,
    type=SCENE,
    help="Scene, file:PATH, or all; repeatable.  [default: all; none with --sequence]",
)
@click.option(
    "--sequence",
    "folders",
    multiple=True,
    type=FOLDER,
    metavar="DIR",
    help="Sequence with its truth in reference/, also another tool's; judged in addition to any --scene; repeatable.",
)
@click.option("--preset", "presets", type=PRESET, multiple=True, help="Preset to judge; repeatable.  [default: all]")
@click.option(
    "--config",
    "configs",
    type=FILE_PATH,
    multiple=True,
    metavar="FILE",
    help="TOML file of parameters that override the default preset, or the one that it names; judged in addition to "
    "any --preset; repeatable.",
)
@device_option
@click.option("--size", type=SIZE, default="320x180", help="Frame size of a capture in pixels.")
@click.option("--frames", default=64, type=click.IntRange(min=2), help="Number of frames of a capture.")
@click.option(
    "--samples", default=256, type=COUNT, help="Samples a pixel of the truth; 4 times as many where nothing moves."
)
@click.option("--jitter", default="lattice:64", help="Sample positions, as for cltaa capture.")
@click.option("--train", type=FROM_0, default="0", help="Scene seeds that presets were tuned on.")
@click.option("--held-out", type=FROM_0, default="1", help="Scene seeds that they were not tuned on; may be empty.")
@click.option("--settled", default=8, type=click.IntRange(min=0), help="First frame that is judged.")
@click.option("--work", default=Path("quality"), type=FILE_PATH, help="Folder for captures and finished results.")
@click.option(
    "--page",
    type=FILE_PATH,
    metavar="PAGE.md",
    help="Write the table into this Markdown page, between its marks if it exists; PAGE-scenes.md beside it gets the "
    "rows of each scene.",
)
@click.option(
    "--pictures",
    type=FILE_PATH,
    metavar="DIR",
    help="Write a picture of each preset's worst place beside the truth, unless it is never worse than the default.",
)
@partial(measured_options, effects="find")
@json_option
@click.pass_context
def quality(
    ctx: click.Context,
    scenes: tuple[str, ...],
    folders: tuple[Path, ...],
    presets: tuple[str, ...],
    configs: tuple[Path, ...],
    device: str | None,
    size: tuple[int, int],
    frames: int,
    samples: int,
    jitter: str,
    train: tuple[int, ...],
    held_out: tuple[int, ...],
    settled: int,
    work: Path,
    page: Path | None,
    pictures: Path | None,
    reading: Reading,
    as_json: bool,
) -> None:
    """Judge presets on sequences with a truth: PSNR, SSIM, FLIP, equal-quality samples and faults over time.

    cltaa capture draws missing captures. All presets resolve the same frames. --work keeps finished results, and only
    a change of sequence, preset or code measures them again, so an interrupted run can continue. Runs on other scenes
    may use the same --work at the same time. The effects that a sequence declares are ignored, because most files
    declare none; --effects auto uses them.
    """
    import_judges()  # a missing package or page stops the run before hours of work
    if page is not None:
        check_pages(page)
    chosen = chosen_presets(presets, configs)
    cases = [Case(folder.name, GIVEN, folder) for folder in folders]
    shape = Shape(*size, frames, samples, jitter)
    if scenes or not folders:
        cases += planned(_effects_of(scenes), _seeds(train, held_out), shape, work / "sequences")
        if min(size) < SSIM_SMALLEST_SIDE:
            expected, found = f"at least {SSIM_SMALLEST_SIDE} pixels a side", f"{size[0]} x {size[1]}"
            raise UsageError("--size: too small to judge by SSIM", expected=expected, found=found)
        if frames <= settled:
            found, cure = counted(frames, "frame"), "ask for more --frames, or judge sooner: --settled 0"
            raise UsageError("captures would end before they are judged", found=found, cure=cure)
    if msgspec.structs.replace(reading, effects="auto") != DEFAULT_READING and not folders:
        what, cure = ("profile, input, camera, step and truth are of frames that are there", "name them: --sequence")
        raise UsageError(what, cure=cure)
    if folders and not scenes:
        refuse_given(ctx, OF_CAPTURES, "is of captures", "name their --scene too, or leave it out")
    by_name(folders, "sequences")
    opened = open_each(folders, reading)
    for sequence in opened.values():
        check_judged(sequence, settled)  # fails before the work
    judging, ways = msgspec.structs.replace(QUALITY, settled=settled), readings(folders, reading)
    variants = [Variant.of(preset) for preset in chosen]
    judged: list[tuple[Case, dict[str, Judged]]] = []
    sequences: dict[str, FrameSequence] = {}
    for number, case in enumerate(cases, start=1):
        click.echo(f"{number} of {len(cases)}: {printable(case.key)}", err=True)
        if case.folder in opened:
            sequence, how = opened[case.folder], ways[case.folder]
        else:
            how = Reading(effects=reading.effects)
            sequence = (None if case.of_a_model else open_case(case)) or capture(case, shape)
            if how != DEFAULT_READING:  # effects other than those that the scene declares
                sequence = how.open(case.folder)
        task = task_of(sequence, variants, device, judging, how)
        for _ in run_all([task], work):
            pass
        sequences[case.key] = sequence
        judged.append((case, {name: cell.judged for name, cell in task.finished(work).items()}))
    table = summarise(judged)
    texts: dict[str, str] = {}
    if pictures is not None:
        texts = write_pictures(table, sequences, chosen, pictures, page, launcher_of(device))
    about = about_of(table, sequences.values(), settled, chosen)
    if page is not None:
        write_pages(page, table, about, texts)
    if as_json:
        definitions = {column.name: column.title for column in (*COLUMNS, ALPHA)}
        read = {name: sequence.notes for name, sequence in sequences.items() if sequence.notes}
        facts = {"about": about, "versions": versions_of(METRICS.values()), "definitions": definitions, "read": read}
        click.echo(json_of(facts | msgspec.to_builtins(table)))
    else:
        _print(table)
        if pictures is not None:
            _print_captions(texts, pictures)


def chosen_presets(names: Sequence[str], configs: Sequence[Path]) -> list[Preset]:
    """Return the named presets and one preset for each TOML file, named as the file; without either all of cltaa's.

    A file overrides the default unless it names another preset; its description says which one.
    Raises UsageError for two files of one name, for one named as a preset, and what ``load_preset`` and ``load_config``
    raise.
    """
    chosen = [load_preset(name) for name in dict.fromkeys(names) or (() if configs else preset_names())]
    for name, path in by_name(configs, "presets").items():
        if name in (ONE_SAMPLE, *preset_names()):
            raise UsageError("this is the name of a preset, and tables go by it", path=path, cure="rename the file")
        over = load_config(path, load_preset())
        chosen.append(msgspec.structs.replace(over, name=name, description=over.name))
    return chosen


def _seeds(train: Sequence[int], held_out: Sequence[int]) -> dict[int, str]:
    """Return the split of each seed; raises UsageError for none, and for one of both splits."""
    if both := {*train} & {*held_out}:
        cure = "leave it out of --train or of --held-out"
        raise UsageError(f"seed {min(both)} was either tuned on or not", cure=cure)
    if not train and not held_out:
        raise UsageError("no seed to capture with", cure="name one by --train or --held-out")
    return dict.fromkeys(train, TRAIN) | dict.fromkeys(held_out, HELD_OUT)


def _effects_of(scenes: tuple[str, ...]) -> dict[str, frozenset[str]]:
    """Return the effects of each of ``scenes`` (all if empty); raises UsageError for an unknown scene."""
    registered = known_scenes()
    for scene in scenes:
        if scene not in (ALL_SCENES, *registered) and not scene.startswith(MODEL):
            there = [*sorted([ALL_SCENES, *registered]), f"{MODEL}PATH"]
            raise UsageError(f"unknown scene {scene}", cure=known(scene, there, "scenes"))
    names = [name for scene in scenes or [ALL_SCENES] for name in (registered if scene == ALL_SCENES else [scene])]
    return {name: registered.get(name, frozenset({"motion"})) for name in names}


def _print(table: Table) -> None:
    for split, means in table.means.items():
        columns = columns_of(means.values())
        heads = [column.head for column in columns]
        grid = figures(f"means over sequences, {split}", "preset", *heads, named=True)
        for name in ordered(means):
            grid.add_row(shown(name), *(written(means[name].get(column.name), column) for column in columns))
        print_table(grid)
    for duel in table.duels:
        losses = f"; not in {', '.join(duel.not_better)}" if duel.not_better else ""
        line = f"{duel.preset} beats {duel.against} by FLIP and PSNR in {duel.better} of {duel.sequences}{losses}"
        print_line(shown(line))


def _print_captions(texts: Mapping[str, str], pictures: Path) -> None:
    """Print the caption of each picture, or the reason why a preset has none."""
    print_line(f"the worst place of each preset is shown in {shown(pictures)}")
    for name, text in texts.items():
        caption, _, picture = text.partition("\n\n")
        print_line(shown(f"  {name}: {'' if picture else 'no picture: '}{caption}"))
