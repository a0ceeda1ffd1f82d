"""Where the kernels lie, and one number for all the code that decides a result."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib import resources
from pathlib import Path

# A kernel's function is its name and _kernel, so that stage functions can have the plain name.
_ENTRY = re.compile(r"^__kernel void (\w+)_kernel\(", re.MULTILINE)
_PACKAGE = Path(__file__).resolve().parents[1]

# What a resolve loads, the modules beside these packages apart; tests/opencl/test_deciding_files.py looks after it.
_DECIDING = (
    "devices",
    "exr",
    "files",
    "inputs",
    "memory",
    "parameters",
    "pictures",
    "planning",
    "reference",
    "resolve",
    "sequences",
)


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


def deciding_files() -> list[Path]:
    """The code that decides the bits of a result: the kernels, and the modules that a resolve loads."""
    files = [*kernel_folder().rglob("*.cl"), *kernel_folder().rglob("*.h"), *_PACKAGE.glob("*.py")]
    for name in _DECIDING:
        files += (_PACKAGE / name).glob("*.py")
    return files


@cache
def code_sha256() -> str:
    """SHA-256 over the ``deciding_files``: other code may give other bits."""
    digest = hashlib.sha256()
    for path in sorted(deciding_files(), key=lambda path: (path.parent.name, path.name)):
        digest.update(f"{path.parent.name}/{path.name}".encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
