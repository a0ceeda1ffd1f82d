"""What tables and plots go by: the last word of a path."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cltaa.errors import UsageError


def by_name(paths: Iterable[Path], what: str) -> dict[str, Path]:
    """Paths of ``what`` by their last word, which tables go by; raises UsageError for two of one name."""
    named: dict[str, Path] = {}
    for path in paths:
        if named.setdefault(path.name, path) != path:
            told, cure = f"two {what} of one name, which tables go by", "rename one of them"
            raise UsageError(told, path=path, found=named[path.name], cure=cure)
    return named
