"""``cltaa tune``: search for the least error within a time, or the least time within an error."""

from __future__ import annotations

from pathlib import Path

import click

from cltaa.commands.options import FILE_PATH, FOLDER, PRESET, json_option, measured_options, open_each, preset_of
from cltaa.commands.printing import answer
from cltaa.core.backend import launcher_for
from cltaa.errors import UsageError
from cltaa.inputs.open import Reading
from cltaa.io.atomic import check_creatable
from cltaa.io.names import real_path
from cltaa.lab.tune import PRESET as AS_IT_IS
from cltaa.lab.tune import Tuned, parse_goal, tune
from cltaa.printable import counted, printable, shell_word


@click.command("tune")
@click.argument("sequences", nargs=-1, required=True, type=FOLDER, metavar="SEQUENCE...")
@click.option("--budget", metavar="TIME", help="Find the least error within this kernel time a frame, such as 5ms.")
@click.option("--target", metavar="METRIC=VALUE", help="Find the least time within this error, such as flip=0.02.")
@click.option("--metric", help="Error to minimise within a --budget; see cltaa compare.  [default: mse]")
@click.option(
    "--check",
    "checked",
    multiple=True,
    type=FOLDER,
    metavar="SEQUENCE",
    help="Measure the outcome on this sequence and do not search on it; repeatable.  [default: the last SEQUENCE]",
)
@click.option("--preset", type=PRESET, default="default", help="Preset that the search starts from.")
@click.option("--config", type=FILE_PATH, help="TOML file of parameters that override the preset.")
@click.option("--trials", default=40, type=click.IntRange(min=2), help="Number of settings to try.")
@click.option("--seed", default=0, type=click.IntRange(0, 2**32 - 1), help="Seed of the search.")
@click.option("--device", metavar="NAME", help="OpenCL device, by index or part of its name, or numpy.")
@click.option("-o", "--output", required=True, type=FILE_PATH, help="TOML file to write, for cltaa resolve --config.")
@measured_options
@json_option
def command(
    sequences: tuple[Path, ...],
    budget: str | None,
    target: str | None,
    metric: str | None,
    checked: tuple[Path, ...],
    preset: str,
    config: Path | None,
    trials: int,
    seed: int,
    device: str | None,
    output: Path,
    reading: Reading,
    as_json: bool,
) -> None:
    """Search for the settings with the least error within a time, or the least time within an error.

    Every SEQUENCE is a capture with its truth, or another tool's frames with the truth in a folder reference/
    (docs/inputs.md). The search also tries our presets that do not look ahead, unchanged. It then measures the outcome
    on sequences that it did not search on, and reports over-fitting where less than half of the gain is left. The same
    command continues an interrupted search, also with more --trials.
    """
    goal = parse_goal(budget, target, metric)
    if not checked and len(sequences) > 1:
        sequences, checked = sequences[:-1], sequences[-1:]
    if set(map(real_path, sequences)) & set(map(real_path, checked)):
        raise UsageError("a sequence is used both to search and to check", cure="name another one with --check")
    check_creatable(output)
    opened = open_each([*sequences, *checked], reading)
    tuned = tune(
        [opened[path] for path in sequences],
        [opened[path] for path in checked],
        goal,
        launcher_for(device),
        base=preset_of(preset, config),
        trials=trials,
        seed=seed,
        output=output,
    )
    use = f"written to {output}; use it with: cltaa resolve --config {shell_word(output)}"
    answer(tuned, as_json, lambda tuned: click.echo("\n".join(map(printable, [*outcome_lines(tuned), use]))))


def outcome_lines(tuned: Tuned) -> list[str]:
    """Describe the outcome in a few lines."""
    goal, best, start = tuned.goal, tuned.best, tuned.start
    lines = [
        f"{goal.metric} {best.error:.4g} in {best.milliseconds:.3g} ms a frame; it began with {start.error:.4g} in "
        f"{start.milliseconds:.3g} ms ({counted(tuned.trials, 'trial')} on {', '.join(tuned.searched_on)})"
    ]
    if not tuned.reached:
        lines.append("the goal was not reached; this is what came nearest")
    unchanged = best.values == start.values
    if AS_IT_IS in best.values:
        lines.append(f"that is the preset {best.values[AS_IT_IS]} as it is; no settings that were tried are better")
    if unchanged:
        lines.append("nothing better than where it began was found; more --trials, or another --preset, may find it")
    if tuned.gain_elsewhere is None:
        lines.append("not checked on any other sequence: it may over-fit this one; name one with --check")
    elif not unchanged:
        verdict = ": it over-fits" if tuned.overfits else ": it holds there" if tuned.gain > 1.0 else ""
        lines.append(
            f"error {tuned.gain:.3f} times smaller where it was searched, {tuned.gain_elsewhere:.3f} times on "
            f"{', '.join(tuned.checked_on)}{verdict}"
        )
    return lines
