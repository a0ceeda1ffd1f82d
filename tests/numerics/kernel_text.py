"""The text of the kernels, as the tests that forbid a word in it read it."""

from __future__ import annotations

import re
from pathlib import Path

KERNELS = Path(__file__).parents[2] / "kernels"


def without_comments(text: str) -> str:
    """OpenCL C without its comments."""
    return re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)


def calls_of(text: str, *names: str) -> list[str]:
    """Every call of one of ``names`` (regular expressions) in OpenCL C, comments left out."""
    return re.findall(rf"(?<![\w.])(?:{'|'.join(names)})\s*\(", without_comments(text))


def kernel_files() -> dict[str, str]:
    """Name and text of every file of the resolve's kernels; not of what is only raced against them."""
    files = (path for path in sorted(KERNELS.rglob("*.*")) if path.parent.name != "bench")
    return {path.relative_to(KERNELS).as_posix(): path.read_text(encoding="utf-8") for path in files}
