"""Every ``cltaa`` command of README and the pages can be given: its options, presets and keys are there."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import click
import pytest

from cltaa.cli import root
from cltaa.core.presets import load_preset, override
from cltaa.errors import CltaaError

TOP = Path(__file__).parents[1]
PAGES = sorted([*TOP.glob("*.md"), *(TOP / "docs").rglob("*.md")])
# A line of a code block, or text between backquotes (over the end of a line too), that begins with the program's name.
BLOCK_LINE = re.compile(r"^(?: {4}|\$ )?(cltaa [^\n#]+)", re.MULTILINE)
INLINE = re.compile(r"`(cltaa [^`]+)`")
FENCED = re.compile(r"^```[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands(text: str) -> list[str]:
    blocks = "\n".join(FENCED.findall(text)) + "\n" + "\n".join(re.findall(r"^ {4}.*$", text, re.MULTILINE))
    found = BLOCK_LINE.findall(blocks) + INLINE.findall(FENCED.sub("", text))
    return [" ".join(part.split()) for line in found for part in line.split(";") if part.strip().startswith("cltaa ")]


def check(line: str) -> None:
    """Parse as click does, without looking at files; raises click.UsageError or CltaaError."""
    words = [word for word in shlex.split(line.partition(" | ")[0])[1:] if word != "..."]
    for option, value in pairwise(words):
        if option in ("--preset", "--against") and not value.isupper():  # NAME stands for any
            load_preset(value)
        if option == "--set" and "=" in value:
            override(load_preset("default"), dict([value.split("=")]))
    command: click.Command = root
    context = click.Context(root, info_name="cltaa")
    while isinstance(command, click.Group):
        _, words, _ = command.make_parser(context).parse_args(words)
        if not words:
            return
        name, words = words[0], words[1:]
        found = command.get_command(context, name)
        if found is None:
            raise click.UsageError(f"no command {name}")
        command, context = found, click.Context(found, info_name=name, parent=context)
    given = command.make_parser(context).parse_args(words)[0]
    for parameter in command.params:
        said = given.get(parameter.name or "")
        # A word in capitals stands for any, and a path need not be there.
        if isinstance(said, str | list) and not isinstance(parameter.type, click.Path) and not str(said).isupper():
            parameter.type_cast_value(context, said)


def wrong(page: Path) -> list[str]:
    """The commands of a page that cannot be given, with what is wrong with each."""
    told = []
    for line in commands(page.read_text(encoding="utf-8")):
        try:
            check(line)
        except click.BadOptionUsage as error:
            if not line.endswith(str(error.option_name)):  # an option that is only mentioned
                told.append(f"{line}: {error}")
        except (click.UsageError, CltaaError, ValueError) as error:
            told.append(f"{line}: {error}")
    return told


def test_commands_of_the_pages_can_be_given() -> None:
    assert {page.name: told for page in PAGES if (told := wrong(page))} == {}


def test_wrong_commands_are_reported() -> None:
    page = (
        "`cltaa inspect DIR --piexls`\n\n```sh\ncltaa rseolve DIR  # as ever\n```\n\n    cltaa scenes; cltaa bench x\n"
    )
    assert commands(page) == ["cltaa rseolve DIR", "cltaa scenes", "cltaa bench x", "cltaa inspect DIR --piexls"]
    values = ("cltaa inspect DIR --storage third", "cltaa capture spinner --size large", "cltaa compare A --frames x")
    for line in ("cltaa rseolve DIR", "cltaa bench x", "cltaa inspect DIR --piexls", *values):
        with pytest.raises(click.UsageError):
            check(line)
    for line in ("cltaa resolve DIR --preset t9", "cltaa resolve DIR --set histroy_filter=bilinear"):
        with pytest.raises(CltaaError):
            check(line)
