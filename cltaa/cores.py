"""The cores that this process may use."""

from __future__ import annotations

import os

CORES, MANY_CORES = len(os.sched_getaffinity(0)), 8
