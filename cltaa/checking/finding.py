"""What the detector reports: one finding a mistake, with its evidence and the option that mends it."""

from __future__ import annotations

from typing import Any

import msgspec


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that is wrong (``mistake``), or worth knowing and not wrong (a note).

    ``confidence`` is 0 to 1; ``evidence`` the numbers behind it; ``fix`` the keys of a reader profile that mend it,
    relative to how the frames were read, empty where only rendering again helps; ``option`` the same on a command
    line.
    """

    name: str
    mistake: bool
    confidence: float
    what: str
    evidence: str
    fix: dict[str, dict[str, Any]] = {}
    option: str = ""
