"""Options and argument types that several subcommands share, and their shell completion."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from functools import partial, wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from cltaa.core.build import STORAGES, Storage
from cltaa.core.frame_checks import EXPOSURE_STOPS
from cltaa.core.presets import Preset, load_preset, override, renamed, tell_unused
from cltaa.errors import UsageError, known, once
from cltaa.frame import ASKED, Asked, Effect, format_effects, parse_effects
from cltaa.io.names import SUFFIXES, Named, has_suffix
from cltaa.io.preset_file import load_config
from cltaa.printable import names_in, printable
from cltaa.renamed import EFFECTS, current

if TYPE_CHECKING:
    from cltaa.inputs.open import Reading
    from cltaa.io.numbered import FrameRange
    from cltaa.io.sequence import FrameSequence


class _Name(click.ParamType[str]):
    """A name. Only shell completion imports ``module``, whose function ``listed`` gives all names."""

    name = "name"

    def __init__(self, module: str, listed: str, *, also: str = "", or_file: bool = False) -> None:
        self._module, self._listed, self._also, self._or_file = module, listed, also, or_file

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        names = [*self._also.split(), *getattr(import_module(self._module), self._listed)()]
        found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")] * self._or_file


PRESET = _Name("cltaa.core.presets", "preset_names")
PROFILE_ALONE = _Name("cltaa.inputs.profile", "profile_names", or_file=True)
PROFILE = _Name("cltaa.inputs.profile", "profile_names", also="auto", or_file=True)
KERNEL, SCENE = _Name("cltaa.core.build", "kernel_names"), _Name("cltaa.lab.bench.cases", "known_scenes")

Command = Callable[..., Any]
DIGITS = "[0-9]{1,20}"  # bounded, because Python refuses to parse an integer of thousands of digits


class _FilePath(click.Path):
    """A path that is not empty: an unset variable in a script would otherwise mean the working directory."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


class _Folder(_FilePath):
    """A folder. Tables and plots show the last part of its path, so ``.`` and ``..`` become absolute."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        folder: Path = super().convert(value, param, ctx)
        return folder.absolute().resolve() if folder.name in ("", "..") else folder


def one_sequence(ctx: click.Context, first: Path, hint: str = "") -> Named:
    """Return the sequence that the arguments name: ``first``, or ``first`` and ``ctx.args`` where a shell listed files.

    Any extra argument that is not a frame file ends the command with an error that ends in ``hint``.
    """
    words = [first, *map(Path, ctx.args)]
    if ctx.args and not all(has_suffix(path, *SUFFIXES) for path in words):
        ctx.fail(f"Got unexpected extra argument{'s' * (len(ctx.args) > 1)} ({' '.join(ctx.args)}){hint}")
    return words if ctx.args else first


class _Number(click.FloatRange):
    """A finite number, with or without its unit."""

    def __init__(self, unit: str = "", **limits: Any) -> None:
        super().__init__(**limits)
        self._unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        text: Any = value.removesuffix(self._unit) if isinstance(value, str) else value
        number = super().convert(text, param, ctx)
        if not math.isfinite(number):  # NaN passes every range check
            self.fail(f"{value!r} is not a number", param, ctx)
        return number


class _Count(click.IntRange):
    """A whole number of things; help shows it as N."""

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "N"


class _Text(click.ParamType[Any]):
    """A value that ``read`` parses from text; help shows ``name`` unchanged as its metavar."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name, self._read = name, read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return self._read(str(value))

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return self.name


def _size(text: str) -> tuple[int, int]:
    """Parse width and height in pixels."""
    match = re.fullmatch(rf"({DIGITS})x({DIGITS})", text, re.IGNORECASE)
    if match is None or not int(match[1]) * int(match[2]):
        raise click.BadParameter(f"{text!r} is not WIDTHxHEIGHT, such as 640x360")
    return int(match[1]), int(match[2])


def _some_frames(text: str) -> int | tuple[int, int]:
    """Parse a count of frames from the first on, or the first and last frame number, both included."""
    if re.fullmatch(DIGITS, text):
        return click.IntRange(min=1).convert(int(text), None, None)
    match = re.fullmatch(rf"(-?{DIGITS})(?:-(-?{DIGITS}))?", text)
    if match is None:
        raise click.BadParameter(f"{text!r} is no range of frames, such as 8-47 or 12")
    return int(match[1]), int(match[2] or match[1])


def frame_range(named: Named, frames: int | FrameRange | None, **reading: Any) -> FrameRange | None:
    """Return the frame range of ``--frames``; a count N becomes the numbers of the first and the N-th frame, as
    ``reading`` (profile and assignments) opens them."""
    if not isinstance(frames, int):
        return frames
    from cltaa.inputs.intake import first_frames

    return first_frames(named, frames, reading.get("profile", "auto"), reading.get("assignments", ()))


def listed(text: str) -> tuple[str, ...]:
    """Split a comma-separated list into names; strips spaces and drops empty names."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def _layers(text: str) -> tuple[str, ...]:
    """Split a comma-separated list of channels; a name that contains a comma is quoted."""
    names = tuple(name for (name,) in names_in(text) if name)
    if not names:
        raise click.BadParameter(f"{text!r} names no channel; none keeps none")
    return names


def _whole_numbers(least: int, text: str) -> tuple[int, ...]:
    """Parse a comma-separated list of whole numbers, each at least ``least``."""
    numbers = listed(text)
    if not all(re.fullmatch(DIGITS, number) and int(number) >= least for number in numbers):
        raise click.BadParameter(f"{text!r} is no list of whole numbers from {least} on, such as 2,4,8")
    return tuple(map(int, numbers))


FILE_PATH, FOLDER = _FilePath(path_type=Path), _Folder(path_type=Path)
SIZE, SOME_FRAMES, LAYERS = _Text("WxH", _size), _Text("N|FIRST-LAST", _some_frames), _Text("LIST", _layers)
FROM_0, FROM_2 = (_Text("LIST", partial(_whole_numbers, least)) for least in (0, 2))
COUNT, COUNT_OR_0 = _Count(1), _Count(0)
SECONDS = _Number("s", min=0.0, min_open=True)
STOPS = _Number(min=-EXPOSURE_STOPS, max=EXPOSURE_STOPS)

verify_option = click.option(
    "--verify/--no-verify",
    default=True,
    help="Refuse a file whose SHA-256 differs from the one in sequence.json or manifest.jsonl beside it.",
)


device_option = click.option(
    "--device", metavar="NAME", help="OpenCL device, by index or part of its name (cltaa doctor)."
)


def effects_option_of(default: str) -> Callable[[Command], Command]:
    """Return the option ``--effects`` with ``default``."""
    return click.option(
        "--effects",
        metavar="LIST",
        default=default,
        help="What happens in the sequence: auto (as the files declare, else found in the pixels), find (always found "
        "in the pixels), all (run every step), none, or a comma-separated list of effects.",
    )


effects_option = effects_option_of("auto")
step_option = click.option(
    "--step", type=COUNT, default=1, help="Frame numbers increase by N, which motion vectors span (docs/inputs.md)."
)


def storage_option(command: Command, where: str = "") -> Command:
    """Add ``--storage``; its help begins with ``where``, the mode in which it applies."""
    return click.option(
        "--storage",
        type=click.Choice([kind.value for kind in STORAGES]),
        default=Storage.FLOAT.value,
        help=f"{where}Number format of the stored history.",
    )(command)


def denoise_option(command: Command, where: str = "") -> Command:
    """Add ``--denoise``; its help begins with ``where``, the mode in which it applies."""
    from cltaa.pipeline.denoise import DENOISERS  # imported late, because most commands do not need it

    return click.option(
        "--denoise",
        type=click.Choice(DENOISERS),
        default="none",
        help=f"{where}Denoise each frame before the resolve: oidn is Open Image Denoise (pip extra cltaa[denoise]).",
    )(command)


json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON and nothing else.")


def _each_once(_: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    once(param.opts[0], (assignment.partition("=")[0] for assignment in value))
    return value


def input_options(command: Command) -> Command:
    """Add ``--profile``, ``--input``, ``--camera`` and ``--step``, named as the arguments of ``open_input``."""
    for option in (
        step_option,
        click.option(
            "--camera",
            "side_file",
            type=FILE_PATH,
            metavar="FILE",
            help="File with the matrices, jitter, exposure and cuts of each frame: .json, .csv or text "
            "(docs/inputs.md).",
        ),
        click.option(
            "--input",
            "assignments",
            multiple=True,
            callback=_each_once,
            metavar="SECTION.KEY=VALUE",
            help="Override a key of the profile, as motion.scale=1,-1; repeatable.",
        ),
        click.option(
            "--profile", type=PROFILE, default="auto", help="Conventions: auto, one of cltaa profiles, or FILE.toml."
        ),
    ):
        command = option(command)
    return command


def reading_options(command: Command, effects: str = "auto") -> Command:
    """Add ``--effects`` and ``input_options`` to a command that measures; passes them as one argument ``reading``."""

    @wraps(command)
    def read(*, side_file: Path | None, truth: Path | None = None, **others: Any) -> Any:
        from cltaa.inputs.open import Reading

        declared = chosen_effects(others["effects"])  # raises for an unknown name before anything is opened
        others["effects"] = declared if isinstance(declared, str) else format_effects(declared)
        files: dict[str, Any] = {"side_file": side_file and str(side_file), "truth": truth and str(truth)}
        told = {name: others.pop(name) for name in ("profile", "assignments", "effects", "step")}
        return command(reading=Reading(**told, **files), **others)

    return input_options(effects_option_of(effects)(read))


def measured_options(command: Command, effects: str = "auto") -> Command:
    """Add ``--truth`` and ``reading_options`` to a command that judges; passes them as one argument ``reading``."""
    truth = click.option(
        "--truth", type=FILE_PATH, metavar="DIR", help="Frames of the truth.  [default: reference/ of each sequence]"
    )
    return reading_options(truth(command), effects)


def open_each(folders: Iterable[Path], reading: Reading) -> dict[Path, FrameSequence]:
    """Open each sequence as ``reading`` asks; prints to standard error how another tool's files are read."""
    from cltaa.inputs.open import is_own, readings

    opened = {folder: how.open(folder) for folder, how in readings(folders, reading).items()}
    asked = (reading.profile, reading.assignments, reading.side_file) != ("auto", (), None)
    for folder, sequence in opened.items():
        if sequence.notes and (asked or not is_own(folder)):  # other effects of own frames need no report
            click.echo(printable(f"{folder}: {'; '.join(sequence.notes)}"), err=True)
    return opened


def refuse_given(ctx: click.Context, names: Collection[str], what: str, cure: str) -> None:
    """Raise UsageError for an option of those ``names`` on the command line, where it would have no effect."""
    for option in ctx.command.params:
        if option.name in names and ctx.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"{option.opts[0]} {what}", cure=cure)


NO_EFFECT = "none"


def chosen_effects(text: str) -> Asked:
    """Parse ``auto``, ``find``, ``all``, ``none``, or a comma-separated list of effects; raises UsageError."""
    for word in ASKED:
        if text == word:
            return word
    names = listed(text)
    if not names:  # an unset shell variable must not promise that nothing happens
        raise UsageError("--effects names no effect", cure="--effects none promises that nothing happens")
    if len(names) > 1 and (alone := {*names} & {*ASKED, NO_EFFECT}):
        what, cure = f"--effects: {min(alone)} stands alone", "leave it out, or all others"
        raise UsageError(what, found=text, cure=cure)
    for name in () if names == (NO_EFFECT,) else names:
        if current(name, EFFECTS, frozenset(Effect), "effect") not in [*Effect]:
            words = [*Effect] if len(names) > 1 else [*ASKED, NO_EFFECT, *Effect]
            raise UsageError(f"--effects: unknown effect {name}", cure=known(name, words, "effects"))
    return frozenset() if names == (NO_EFFECT,) else parse_effects(text)


def preset_of(name: str, config: Path | None, before: Callable[[Preset], Preset] | None = None) -> Preset:
    """Load the preset ``name``, apply ``before``, then the TOML file ``config``, where given."""
    preset = load_preset(name) if before is None else before(load_preset(name))
    return preset if config is None else load_config(config, preset)


def assigned(preset: Preset, assignments: tuple[str, ...], option: str = "--set") -> Preset:
    """Return ``preset`` with the assignments KEY=VALUE of ``option`` applied and added to its name."""
    told = [assignment.partition("=") for assignment in assignments]
    for key, equals, _ in told:
        if not equals:
            raise UsageError(f"--set {key}: no value", expected="KEY=VALUE", found=key)
    once(option, (key for key, _, _ in told))
    values = renamed({key.strip(): value.strip() for key, _, value in told})
    if not values:
        return preset
    changes = ", ".join(f"{key}={value}" for key, value in values.items())
    changed = override(preset, values, option)
    tell_unused(changed, values, option)
    return msgspec.structs.replace(changed, name=f"{preset.name} with {changes}")
