"""Text that came from outside (file names, attributes, messages of drivers), made safe to print.

A name may hold an escape sequence that clears the screen or sets a title, a line feed that begins a second message, a
sign that turns the direction of reading, or bytes that are no UTF-8. Each such character is written as its escape.
"""

from __future__ import annotations

from pathlib import Path


def printable(text: str | Path, *, longest: int | None = None) -> str:
    """Return ``text`` with every character that does not print as its escape, cut in the middle to ``longest``."""
    line = str(text)
    if longest is not None and len(line) > longest:
        half = (longest - 5) // 2
        line = f"{line[:half]} ... {line[-half:]}"
    if line.isprintable():
        return line
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in line)
