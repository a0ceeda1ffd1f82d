"""Which OpenCL runtime of a CPU comes first where there are several: in the order of docs/devices.md."""

from __future__ import annotations

import re

POCL = "Portable Computing Language"  # the platform's name
INTEL = "Intel(R) OpenCL"
RUSTICL = "rusticl"
POCL_VERSION = re.compile(r"PoCL (\d+)\.(\d+)")


def preference(platform: str, version: str) -> tuple[int, tuple[int, ...]]:
    """A key that sorts CPU devices by their platform's name and version, the one to take first.

    PoCL comes first, the newest of several, then Intel's runtime, then what has not been measured, then Rusticl.
    """
    if platform == POCL:
        number = POCL_VERSION.search(version)
        return 0, tuple(-int(part) for part in number.groups()) if number else (0,)
    return {INTEL: 1, RUSTICL: 3}.get(platform, 2), ()
