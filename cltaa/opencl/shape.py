"""Shapes of kernels, which fit them to a device: lanes, rows, groups and registers of a work-item.

Each class of devices has its shape; a file in the user's cache keeps the fastest one that ``cltaa bench devices`` found
on a device.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from cltaa.core.build import Build, code_sha256
from cltaa.core.parameters import HistoryFilter, HistoryKind, Illumination, Rectify, Reject
from cltaa.printable import printable, shell_word
from cltaa.process import user_cache

GATHERING = frozenset({"gather", "gather_windows"})  # kernels that gather
LEAST_ROWS = 8  # of a work-item where the image decides the rows; fewer were not measured
UNIT_REGISTERS = 65536  # of an NVIDIA compute unit, since compute capability 3.0 (CUDA C++ Programming Guide)
START_ROWS = 3  # cost of a column's start, in rows: it reads two of the frame and three of the history again


class Cut(NamedTuple):
    """How one kernel is divided where other numbers suit it."""

    rows: int  # of a work-item
    group: tuple[int, int]  # work-items
    registers: int  # most of a work-item


class Shape(NamedTuple):
    """How kernels are divided on a class of devices, as measured to be fast: docs/performance.md, Shapes."""

    lanes: int  # pixels that a work-item computes side by side: a vector on a CPU, one on a GPU
    rows: int  # rows that it slides down: many on a CPU, few on a GPU, which needs many work-items
    group: tuple[int, int]  # work-items a group
    registers: int = 0  # most registers of a work-item; 0: no limit
    one_size: bool = False  # whether the resolve is built for one size of planes
    registers_to_reject: int = 0  # the same where history is rejected by depth, which needs more of them
    registers_for_illumination: int = 0  # the same with the illumination test
    registers_in_place: int = 0  # the same where history is neither moved nor rectified, which needs few
    registers_for_few: int = 0  # the same where history is read from at most four texels
    columns_ahead: int = 0  # distance of the prefetch to the right, in work-items; 0: only the next one
    far_first: bool = False  # whether, where history moves, that prefetch fills the first-level cache too
    most_rows: int = 0  # limit of the rows that a resolve of whole images chooses to fill the device; 0: ``rows``
    gather: Cut | None = None  # of the kernels that gather; None: as others
    mix: Cut | None = None  # of mix_windows

    def registers_of(self, build: Build) -> int:
        """Return the most registers of a work-item of a kernel with this build; with more, fewer run at once."""
        choices = build.choices
        if choices.illumination is not Illumination.STATIC and choices.history is HistoryKind.ACCUMULATED:
            return self.registers_for_illumination
        if choices.reject is not Reject.NONE:
            return self.registers_to_reject
        if in_place(build):
            return self.registers_in_place
        few = choices.history_filter in (HistoryFilter.NEAREST, HistoryFilter.BILINEAR)
        return self.registers_for_few if few else self.registers

    def cut_of(self, kernel: str) -> Cut | None:
        """Return the numbers of a kernel that has its own, None for others."""
        return self.gather if kernel in GATHERING else self.mix if kernel == "mix_windows" else None

    def even_rows(self, width: int, height: int, registers: int, units: int) -> int:
        """Return the rows of a work-item with which the last groups leave few of ``units`` compute units idle.

        Groups start and end nearly together, in rounds of as many as run at once; a column costs its rows and its
        start. Columns long enough for a single round are slower where motion varies.
        """
        across, down = self.group
        at_once = units * max(UNIT_REGISTERS // (max(registers, 1) * across * down), 1)

        def cost(rows: int) -> int:
            groups = -(-width // (across * self.lanes)) * -(-height // (down * rows))
            return -(-groups // at_once) * (rows + START_ROWS)

        return min(range(LEAST_ROWS, self.most_rows + 1), key=cost)


def in_place(build: Build) -> bool:
    """True where history is neither moved nor rectified."""
    moves = build.steps.camera_motion or build.steps.own_motion
    return not moves and build.choices.rectify is Rectify.NONE


# 45 rows divide the usual heights (720, 1080, 1440, 2160) evenly, and leave enough work-items for many cores.
CPU_8 = Shape(lanes=8, rows=45, group=(1, 1), columns_ahead=3)
CPU_4 = CPU_8._replace(lanes=4, rows=32)  # without AVX, where LLVM fails over eight (docs/decisions/14)
CPU_16 = Shape(lanes=16, rows=64, group=(1, 1), columns_ahead=3, far_first=True)
INTEL_16 = CPU_16._replace(rows=45, far_first=False)
GPU = Shape(lanes=1, rows=8, group=(64, 2))
GPU_LONG = Shape(lanes=1, rows=16, group=(128, 1))
NVIDIA = Shape(
    lanes=1,
    rows=16,
    group=(128, 1),
    one_size=True,
    registers=96,
    registers_to_reject=128,
    registers_for_illumination=112,
    registers_in_place=64,
    registers_for_few=72,
    most_rows=36,
    gather=Cut(rows=1, group=(64, 4), registers=80),
    mix=Cut(rows=5, group=(128, 2), registers=128),
)

SHAPES = {
    "cpu-16": CPU_16,
    "intel-16": INTEL_16,
    "cpu-8": CPU_8,
    "cpu-4": CPU_4,
    "gpu": GPU,
    "gpu-long": GPU_LONG,
    "nvidia": NVIDIA,
}


class Kept(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of the file of a kept shape."""

    measured_on: dict[str, str]  # the device, its runtime, its processor
    code: str  # SHA-256 of the kernels
    shape: str  # a name


def kept_folder() -> Path:
    """Return the folder of kept shapes; raises RuntimeError where the user has no home."""
    return user_cache() / "cltaa" / "shapes"


def kept_path(measured_on: Mapping[str, str]) -> Path:
    """Return the file for a device with these facts."""
    return kept_folder() / f"{hashlib.sha256(json.dumps(measured_on, sort_keys=True).encode()).hexdigest()[:32]}.json"


def kept_shape(measured_on: Mapping[str, str], known: Collection[str]) -> str | None:
    """Return the name kept for a device, None where there is none; a file that cannot be used is reported in a line."""
    try:
        path = kept_path(measured_on)
        kept = msgspec.json.decode(path.read_bytes(), type=Kept)
    except (FileNotFoundError, NotADirectoryError, RuntimeError):
        return None
    except OSError as error:
        return _ignored(path, error.strerror or str(error), measured_on["device"])
    except (msgspec.DecodeError, UnicodeError):
        return _ignored(path, "damaged", measured_on["device"])
    if kept.code != code_sha256():
        return _ignored(path, "measured with other kernels", measured_on["device"])
    if kept.measured_on != measured_on or kept.shape not in known:
        return _ignored(path, "of another device", measured_on["device"])
    return kept.shape


@cache  # reported once per process
def _ignored(path: Path, why: str, device: str) -> None:
    cure = f"run: cltaa bench devices --device {shell_word(device)}, or: cltaa bench devices --forget"
    print(printable(f"cltaa: {path}: this shape of kernels is ignored: {why}; {cure}"), file=sys.stderr, flush=True)
