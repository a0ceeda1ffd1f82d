"""How kernels are cut up for a device: lanes, rows, groups and registers of a work-item.

Each class of devices has its shape; that which ``cltaa bench devices`` found the fastest on a device is kept in a file
of the user's cache.
"""

from __future__ import annotations

import hashlib
import json
import shlex
import sys
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from cltaa.core.build import Build, code_sha256
from cltaa.core.parameters import HistoryFilter, HistoryKind, Illumination, Rectify, Reject
from cltaa.printable import printable
from cltaa.process import user_cache

LEAST_ROWS = 8  # of a work-item where rows are chosen by the image; fewer have not been measured
UNIT_REGISTERS = 65536  # of a compute unit of NVIDIA's, since compute capability 3.0 (CUDA C++ Programming Guide)
START_ROWS = 3  # what a column costs at its start, in rows: two of the frame and three of the history are read anew


class Shape(NamedTuple):
    """How kernels are cut up for a class of devices, as was measured to be fast: docs/performance.md, Shapes."""

    lanes: int  # pixels that a work-item computes side by side: a vector of a CPU, one on a GPU
    rows: int  # rows that it slides down: long on a CPU, short on a GPU, which needs many work-items
    group: tuple[int, int]  # work-items a group
    registers: int = 0  # the most that a work-item may have; 0: as many as the compiler likes
    one_size: bool = False  # whether the resolve is built for one size of planes
    registers_to_reject: int = 0  # the same where history is rejected by its depth, which takes more of them
    registers_for_illumination: int = 0  # the same where changing light is tested
    registers_in_place: int = 0  # the same where history is neither moved nor rectified, which takes few
    registers_for_few: int = 0  # the same where history is read from four texels at most
    columns_ahead: int = 0  # work-items right of one whose texels it fetches into the second cache; 0: next, first
    far_first: bool = False  # whether, where history moves, it fetches these into the first, not the second alone
    most_rows: int = 0  # up to which a resolve of whole images takes as many rows as fill the device; 0: ``rows``
    gather_rows: int = 0  # rows of a work-item that gathers; 0: ``rows``
    gather_group: tuple[int, int] | None = None  # work-items a group of those; None: ``group``
    gather_registers: int = 0  # the most registers of one of those; 0: as of others

    def registers_of(self, build: Build) -> int:
        """The most registers that a work-item of a kernel with this build may have; with more of them fewer work-items
        are under way at once."""
        choices = build.choices
        if choices.illumination is not Illumination.STATIC and choices.history is HistoryKind.ACCUMULATED:
            return self.registers_for_illumination
        if choices.reject is not Reject.NONE:
            return self.registers_to_reject
        if in_place(build):
            return self.registers_in_place
        few = choices.history_filter in (HistoryFilter.NEAREST, HistoryFilter.BILINEAR)
        return self.registers_for_few if few else self.registers

    def even_rows(self, width: int, height: int, registers: int, units: int) -> int:
        """Rows a work-item for an image, so that the last groups leave few of a device's ``units`` compute units idle.

        Groups start and end nearly together, in turns of as many as are under way at once; a column costs its rows and
        its start. Columns so long that one turn does are slower where motion varies.
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


# 45 rows share the usual heights (720, 1080, 1440, 2160) out evenly, and leave many cores work-items enough.
CPU_8 = Shape(lanes=8, rows=45, group=(1, 1), columns_ahead=3)
CPU_4 = CPU_8._replace(lanes=4, rows=32)  # without AVX, where LLVM gives up over eight (docs/decisions/14)
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
    gather_rows=1,
    gather_group=(64, 4),
    gather_registers=80,
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
    """The content of a file."""

    measured_on: dict[str, str]  # the device, its runtime, its processor
    code: str  # SHA-256 of the kernels
    shape: str  # a name


def kept_folder() -> Path:
    """Where kept shapes lie; raises RuntimeError where the user has no home."""
    return user_cache() / "cltaa" / "shapes"


def kept_path(measured_on: Mapping[str, str]) -> Path:
    """The file for a device of these facts."""
    return kept_folder() / f"{hashlib.sha256(json.dumps(measured_on, sort_keys=True).encode()).hexdigest()[:32]}.json"


def kept_shape(measured_on: Mapping[str, str], known: Collection[str]) -> str | None:
    """The name kept for a device, None where there is none.

    A file that cannot be used, or whose shape is none of those ``known``, is told of in one line and left alone.
    """
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


@cache  # told once in a process
def _ignored(path: Path, why: str, device: str) -> None:
    cure = f"run: cltaa bench devices --device {shlex.quote(device)}, or: cltaa bench devices --forget"
    print(printable(f"cltaa: {path}: this shape of kernels is ignored: {why}; {cure}"), file=sys.stderr, flush=True)
