"""The shape that ``cltaa bench devices`` found the fastest on a device, kept in a file of the user's cache."""

from __future__ import annotations

import hashlib
import json
import shlex
import sys
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path

import msgspec

from cltaa.core.kernel_source import code_sha256
from cltaa.printable import printable
from cltaa.process import user_cache


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
