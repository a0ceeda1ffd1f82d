"""Text from outside (names of files and channels, attributes, messages of drivers), made safe to print.

A name may hold an escape sequence that clears the screen or sets a title, a line feed that begins a second message, a
character that reverses the direction of reading, or bytes that are not UTF-8. Each is replaced by its escape.
"""

from __future__ import annotations

import html
import json
import math
import os
import re
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec


def printable(text: str | Path, *, longest: int | None = None) -> str:
    """Return ``text`` with every unprintable character escaped, cut in the middle to ``longest`` characters."""
    line = str(text)
    if longest is not None and len(line) > longest:
        half = (longest - 5) // 2
        line = f"{line[:half]} ... {line[-half:]}"
    if line.isprintable():
        return line
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in line)


def shown(text: str | Path) -> str:
    """Return ``text`` so that rich prints it literally: markup escaped, and unprintable characters too."""
    from rich.markup import escape  # imported here: every error is made printable, and few tables are printed

    return escape(printable(text))


def shell_word(word: str | Path) -> str:
    """Return a word of a command, printable and on one line, as a shell reads it; a path never begins with ``-``."""
    text = f"./{word}" if isinstance(word, Path) and str(word)[0] == "-" else str(word)
    if text.isprintable() and "  " not in text:  # of which a message keeps one
        return shlex.quote(text)
    octal = {sign: "".join(f"\\{byte:03o}" for byte in os.fsencode(sign)) for sign in {*text}}
    plain = (sign if sign.isprintable() and sign not in "'\\ " else octal[sign] for sign in text)
    return f"$'{''.join(plain)}'"


def counted(number: int, thing: str) -> str:
    """Return a count with its noun: ``1 frame``, ``2 frames``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def bytes_of(count: float) -> str:
    """Return a count of bytes in the unit that suits it: ``1.5 kB``, ``12.0 GB``."""
    unit, name = next((u, n) for u, n in ((1e9, "GB"), (1e6, "MB"), (0.0, "kB")) if count >= u)
    return f"{count / (unit or 1e3):.1f} {name}"


def markdown(heads: Iterable[str], rows: Iterable[Iterable[str]], *, figures: bool = False) -> str:
    """Return a table in Markdown, a line each, with the text of every cell as ``literal`` writes it; with ``figures``
    all columns but the first align right."""
    heads = [*heads]
    rule = ["---", *["---:" if figures else "---"] * (len(heads) - 1)]
    return "".join(f"| {' | '.join(map(literal, cells))} |\n" for cells in (heads, rule, *rows))


def literal(text: str) -> str:
    """Return text that begins no tag and ends no cell in Markdown, nor in HTML within it."""
    return html.escape(printable(text), quote=False).replace("|", "&#124;")


def json_of(value: Any) -> str:
    """Return a struct or a plain value as every ``--json`` prints it: indented JSON in ASCII.

    All other characters are escaped, the only form of JSON for a file name that is not UTF-8. JSON has no infinity and
    no NaN: the PSNR of identical images, and an undefined score, become null.
    """
    return json.dumps(_finite(msgspec.to_builtins(value)), indent=2)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_WORDS = re.compile(
    r'"(?P<double>(?:[^"\\]|\\.)*)"(?=[\s,]|$)'
    r"|'(?P<single>[^']*)'(?=[\s,]|$)|(?P<comma>,)|(?P<space>\s+)|(?P<bare>[^\s,]+)"
)


def names_in(text: str, count: int = 1) -> list[list[str]]:
    """Read comma-separated lists of ``count`` names each; spaces separate the names of a list.

    A name that holds a space or comma, or begins with a quotation mark, needs quotes as in JSON; in a list of one,
    spaces need none. Where all names of a list have equally many spaces they need no quotes either. A list of another
    length is returned unchanged: the caller reports it.
    """
    lists: list[list[str]] = []
    quoted, begin = False, 0
    words: list[str] = []
    for word in [*_WORDS.finditer(text), None]:
        if word is not None and not word["comma"]:
            if word["space"]:
                continue
            quoted = quoted or word["bare"] is None
            words.append(word["bare"] if word["bare"] is not None else _unquoted(word))
            continue
        if count == 1 and (not quoted or len(words) > 1):
            words = [text[begin : word.start() if word else None].strip()]
        elif count > 1 == len(words) and quoted and len(words[0].split()) == count:  # a shell quoted them all
            words = words[0].split()
        elif not quoted and words and len(words) % count == 0:
            size = len(words) // count
            words = [" ".join(words[place : place + size]) for place in range(0, len(words), size)]
        lists.append(words)
        words, quoted, begin = [], False, word.end() if word else 0
    return lists


def _unquoted(word: re.Match[str]) -> str:
    if word["double"] is None:
        return word["single"]
    try:
        return str(json.loads(f'"{word["double"]}"', strict=False))
    except ValueError:  # a backslash that begins no escape
        return word["double"]


def written(names: Iterable[str], between: str = " ") -> str:
    """Return names as ``names_in`` reads them: quoted where they would be read as several."""
    return between.join(_quoted(name) for name in names)


def _quoted(name: str) -> str:
    if name.isprintable() and name and not re.search(r"[\s,]", name) and name[0] not in "\"'[":
        return name
    # Messages collapse white space, so that after the first of a run is escaped, and escape other spaces their own way.
    text = re.sub(r"(?<=\s)\s", lambda sign: f"\\u{ord(sign[0]):04x}", json.dumps(name, ensure_ascii=False))
    return "".join(sign if sign.isprintable() else json.dumps(sign)[1:-1] for sign in text)
