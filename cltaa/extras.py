"""Libraries that only some commands need: imported when used, missed in one line that says what to install."""

from __future__ import annotations

import importlib
from types import ModuleType

from cltaa.errors import UsageError


def import_extra(module: str, *, package: str, extra: str, purpose: str) -> ModuleType:
    """Import ``module`` of ``package``; raises UsageError with the command that installs the extra it belongs to."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(
            f"{purpose} needs {package}, which cannot be imported: {error}",
            cure=f"install it with: pip install 'cltaa[{extra}]'",
        ) from error
