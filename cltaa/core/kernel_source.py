"""Where the kernels lie, and one number for all that decides a result beside preset and device."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib import resources
from pathlib import Path

from cltaa.core.constants import CONSTANTS, PAD_X, PAD_Y

# A kernel's function is its name and _kernel, so that stage functions can have the plain name.
_ENTRY = re.compile(r"^__kernel void (\w+)_kernel\(", re.MULTILINE)
_PACKAGE = Path(__file__).resolve().parents[1]

# Raise it where other Python code gives other bits, or a folder of results holds other things: then no run goes on
# where one of the code before has stopped.
FORMAT = 1


@cache
def kernel_folder() -> Path:
    """Where the kernels are: inside the installed package, or beside it in a checkout."""
    packaged = Path(str(resources.files("cltaa"))) / "kernels"
    if packaged.is_dir():
        return packaged
    return _PACKAGE.parent / "kernels"


@cache
def kernel_files() -> dict[str, str]:
    """The entry points of all kernels, sorted, and the file that each of them is in."""
    files = sorted(kernel_folder().glob("*.cl"))
    return dict(sorted((name, path.name) for path in files for name in _ENTRY.findall(path.read_text("utf-8"))))


def kernel_names() -> list[str]:
    """Names of all kernels, sorted."""
    return list(kernel_files())


@cache
def code_sha256() -> str:
    """SHA-256 of what decides a result beside preset and device: the kernels, the constants, ``FORMAT``."""
    folder = kernel_folder()
    values = {name: constant.value for name, constant in CONSTANTS.items()}
    digest = hashlib.sha256(repr([FORMAT, PAD_X, PAD_Y, sorted(values.items())]).encode())
    for path in sorted([*folder.rglob("*.cl"), *folder.rglob("*.h")]):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
