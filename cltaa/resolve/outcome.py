"""What a run over a sequence did and how long its stages took: as a struct, a table and a file beside the images."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from cltaa.files.atomic import atomic_path
from cltaa.parameters.presets import Preset


class StageTimes(msgspec.Struct, kw_only=True):
    """Seconds a frame: the median of each stage, and ``whole``, the mean of a run by the clock.

    Stages overlap, so that the whole of many frames is less than their sum; it holds what no stage does too, such as
    building kernels and drawing debug views, which is most of it where few frames are resolved.
    """

    read: float
    upload: float
    kernels: float
    read_back: float
    write: float
    whole: float


class Outcome(msgspec.Struct, kw_only=True):
    """What a run of ``resolve_sequence`` did: of ``frames``, ``resolved`` were written now, the others before.

    ``repaired`` counts the pixels of those whose colour was no usable number (NaN, infinite, beyond 2^50), ``opaque``
    the frames whose alpha is 1 everywhere, ``saturated`` the pixels as bright as the largest half, where halves are
    written or kept as history.
    """

    output: str
    frames: int
    resolved: int
    repaired: int
    opaque: int
    saturated: int
    width: int
    height: int
    device: str
    preset: str
    seconds: StageTimes


def write_record(folder: Path, outcome: Outcome, preset: Preset) -> None:
    """Write ``resolve.json``: beside the images, what made them. Raises OutputError and StorageError."""
    record: dict[str, Any] = {"outcome": msgspec.to_builtins(outcome), "preset": msgspec.to_builtins(preset)}
    with atomic_path(folder / "resolve.json") as temporary:
        temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def stage_rows(seconds: StageTimes) -> Iterable[tuple[str, float]]:
    """Name and milliseconds a frame of each stage, for a table."""
    return ((field.replace("_", " "), getattr(seconds, field) * 1e3) for field in StageTimes.__struct_fields__)
