"""Options and types of arguments that several subcommands share."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
import msgspec

from cltaa.commands.names import EFFECT_LIST, INPUT, PROFILE
from cltaa.errors import UsageError, known
from cltaa.frame_checks import EXPOSURE_STOPS
from cltaa.frames import Effect, parse_effects
from cltaa.printable import printable

if TYPE_CHECKING:
    from cltaa.inputs.opening import Reading
    from cltaa.parameters.presets import Preset
    from cltaa.sequences.sources import Sequence

Command = Callable[..., Any]
DIGITS = "[0-9]{1,20}"  # of a whole number: Python refuses to read one of thousands


class _FilePath(click.Path):
    """A path that is not empty: an unset variable in a script would mean the folder that one stands in."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


class _Folder(_FilePath):
    """A folder that tables and plots name by the last word of its path: of ``.`` and ``..`` they need the whole one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        folder: Path = super().convert(value, param, ctx)
        return folder.absolute().resolve() if folder.name in ("", "..") else folder


class _Milliseconds(click.FloatRange):
    """A time above 0, with its unit, as ``cltaa tune --budget`` has it, or without."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number: Any = value.removesuffix("ms") if isinstance(value, str) else value
        return super().convert(number, param, ctx)


class _Stops(click.FloatRange):
    """Stops of exposure within what a picture can have; not NaN, which lies within every range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        stops = super().convert(value, param, ctx)
        if math.isnan(stops):
            self.fail("no number", param, ctx)
        return stops


class _Tuple(click.ParamType[tuple[Any, ...]]):
    """Several values in one text; ``name`` is how that is written, which help shows as it is."""

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return self.name


class _Size(_Tuple):
    """Width and height in pixels, written as 640x360."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        match = re.fullmatch(rf"({DIGITS})x({DIGITS})", value, re.IGNORECASE)
        if match is None or not int(match[1]) * int(match[2]):
            self.fail(f"{value!r} is not WIDTHxHEIGHT, such as 640x360", param, ctx)
        return int(match[1]), int(match[2])


class _FrameRange(_Tuple):
    """The first and the last of some frames, both included, or one frame alone."""

    name = "FIRST-LAST"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        match = re.fullmatch(rf"({DIGITS})(?:-({DIGITS}))?", value)
        if match is None:
            self.fail(f"{value!r} is no range of frames, such as 8-47 or 12", param, ctx)
        return int(match[1]), int(match[2] or match[1])


class _SomeFrames(_FrameRange):
    """The same, or a number of frames from the first on."""

    name = "N|FIRST-LAST"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        counted = re.fullmatch(DIGITS, str(value))
        return click.IntRange(min=1).convert(value, param, ctx) if counted else super().convert(value, param, ctx)


class _Names(_Tuple):
    """A comma-separated list; spaces around its names and empty ones count as nothing."""

    name = "LIST"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        return tuple(name for part in value.split(",") if (name := part.strip()))


class _WholeNumbers(_Tuple):
    """A comma-separated list of whole numbers from ``least`` on."""

    name = "LIST"

    def __init__(self, least: int) -> None:
        self._least = least

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, ...]:
        numbers = NAMES.convert(value, param, ctx)
        if not all(re.fullmatch(DIGITS, number) and int(number) >= self._least for number in numbers):
            self.fail(f"{value!r} is no list of whole numbers from {self._least} on, such as 2,4,8", param, ctx)
        return tuple(map(int, numbers))


FILE_PATH, FOLDER = _FilePath(path_type=Path), _Folder(path_type=Path)
SIZE, FRAME_RANGE, SOME_FRAMES, NAMES = _Size(), _FrameRange(), _SomeFrames(), _Names()
FROM_0, FROM_1, FROM_2 = (_WholeNumbers(least) for least in range(3))  # lists of whole numbers
MILLISECONDS = _Milliseconds(min=0.0, min_open=True)
STOPS = _Stops(-EXPOSURE_STOPS, EXPOSURE_STOPS)

verify_option = click.option(
    "--verify/--no-verify",
    default=True,
    show_default=True,
    help="Refuse a file whose SHA-256 is not the one recorded beside it (sequence.json, manifest.jsonl).",
)


device_option = click.option(
    "--device", metavar="NAME", help="OpenCL device: its index or a part of its name; see cltaa doctor."
)
effects_option = click.option(
    "--effects", type=EFFECT_LIST, metavar="LIST", default="auto", show_default=True,
    help="auto (as declared), all, or a comma-separated list.",
)  # fmt: skip
step_option = click.option(
    "--step", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Frame numbers are N apart, and motion vectors span N (docs/inputs.md).",
)  # fmt: skip
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON and nothing else.")


def input_options(command: Command) -> Command:
    """Add ``--profile``, ``--input``, ``--camera`` and ``--step``, by the names of ``open_input``."""
    for option in (
        step_option,
        click.option("--camera", "side_file", type=FILE_PATH, metavar="FILE",
                     help="Matrices, jitter, exposure and cuts of each frame: .json, .csv or text (docs/inputs.md)."),
        click.option("--input", "assignments", type=INPUT, multiple=True, metavar="SECTION.KEY=VALUE",
                     help="One key of the profile, such as motion.scale=1,-1; may be repeated."),
        click.option("--profile", type=PROFILE, metavar="NAME", default="auto", show_default=True,
                     help="Who wrote the files: auto, a name (cltaa profiles), or FILE.toml."),
    ):  # fmt: skip
        command = option(command)
    return command


def reading_options(command: Command) -> Command:
    """Add ``--effects`` and ``input_options``, all as one argument ``reading``, to what measures."""

    @wraps(command)
    def read(*, side_file: Path | None, truth: Path | None = None, **others: Any) -> Any:
        from cltaa.inputs.opening import Reading

        chosen_effects(others["effects"])  # a name that is none is told here
        files: dict[str, Any] = {"side_file": side_file and str(side_file), "truth": truth and str(truth)}
        told = {name: others.pop(name) for name in ("profile", "assignments", "effects", "step")}
        return command(reading=Reading(**told, **files), **others)

    return input_options(effects_option(read))


def measured_options(command: Command) -> Command:
    """Add ``--truth`` and ``reading_options``, all as one argument ``reading``, to what judges by a truth."""
    truth = click.option(
        "--truth", type=FILE_PATH, metavar="DIR",
        help="Where the truth is, as B of cltaa compare.  [default: reference/ of each sequence]",
    )  # fmt: skip
    return reading_options(truth(command))


def open_each(folders: Iterable[Path], reading: Reading) -> dict[Path, Sequence]:
    """Open sequences as they are asked to be read; says on standard error what was decided about another tool's."""
    from cltaa.inputs.opening import readings

    opened = {folder: how.open(folder) for folder, how in readings(folders, reading).items()}
    for folder, sequence in opened.items():
        if sequence.notes:
            click.echo(printable(f"{folder}: {'; '.join(sequence.notes)}"), err=True)
    return opened


def chosen_effects(text: str) -> frozenset[Effect] | Literal["auto", "all"]:
    """``auto``, ``all``, or the effects of a comma-separated list."""
    if text == "auto":
        return "auto"
    if text == "all":
        return "all"
    for name in (part.strip() for part in text.split(",")):
        if name and name not in [*Effect]:
            raise UsageError(f"--effects: unknown effect {name}", cure=known(name, ["auto", "all", *Effect], "effects"))
    return parse_effects(text)


def assigned(preset: Preset, assignments: tuple[str, ...]) -> Preset:
    """``preset`` with what ``--set`` says, which its name tells; raises UsageError for what is no assignment."""
    from cltaa.parameters.presets import override  # here: most commands have none

    values = _values(assignments)
    if not values:
        return preset
    told = ", ".join(f"{key}={value}" for key, value in values.items())
    return msgspec.structs.replace(override(preset, values), name=f"{preset.name} with {told}")


def _values(assignments: tuple[str, ...]) -> dict[str, str]:
    values: dict[str, str] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise UsageError(f"--set {assignment}: no value", expected="KEY=VALUE", found=assignment)
        values[key.strip()] = value.strip()
    return values
