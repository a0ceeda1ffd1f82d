"""Text that came from outside (file names, attributes, messages of drivers), made safe to print.

A name may hold an escape sequence that clears the screen or sets a title, a line feed that begins a second message, a
sign that turns the direction of reading, or bytes that are no UTF-8. Each such character is written as its escape.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import msgspec


def printable(text: str | Path, *, longest: int | None = None) -> str:
    """Return ``text`` with every character that does not print as its escape, cut in the middle to ``longest``."""
    line = str(text)
    if longest is not None and len(line) > longest:
        half = (longest - 5) // 2
        line = f"{line[:half]} ... {line[-half:]}"
    if line.isprintable():
        return line
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in line)


def shown(text: str | Path) -> str:
    """Return ``text`` as rich prints it to the letter: no markup, nothing that does not print."""
    from rich.markup import escape  # here: every error is made printable, and few tables are printed

    return escape(printable(text))


def counted(number: int, thing: str) -> str:
    """Return how many of a thing there are in words: ``1 frame``, ``2 frames``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def bytes_of(count: float) -> str:
    """Return a count of bytes in the unit that suits it: ``1.5 kB``, ``12.0 GB``."""
    unit, name = next((u, n) for u, n in ((1e9, "GB"), (1e6, "MB"), (0.0, "kB")) if count >= u)
    return f"{count / (unit or 1e3):.1f} {name}"


def json_of(value: Any) -> str:
    """Return a struct, or what JSON has a form for, as every ``--json`` prints it: indented, in ASCII.

    Every other character is its escape, the only form of JSON for a file name that is no UTF-8. JSON has no infinity
    and no NaN: the PSNR of identical images, and a score of nothing, become null.
    """
    return json.dumps(_finite(msgspec.to_builtins(value)), indent=2)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
