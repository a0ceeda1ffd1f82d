"""Where the kernels lie, and one number for all the code that decides a result."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import resources
from pathlib import Path


@cache
def kernel_folder() -> Path:
    """Where the kernels are: inside the installed package, or beside it in a checkout."""
    packaged = Path(str(resources.files("cltaa"))) / "kernels"
    if packaged.is_dir():
        return packaged
    return Path(__file__).resolve().parent.parent / "kernels"


def kernel_names() -> list[str]:
    """Names of all kernels, sorted."""
    return sorted(path.stem for path in kernel_folder().glob("*.cl"))


def deciding_files() -> list[Path]:
    """The code that decides the bits of a result: kernels, the modules of this package, its readers and the twins."""
    package = Path(__file__).resolve().parent
    files = [*kernel_folder().rglob("*.cl"), *kernel_folder().rglob("*.h")]
    for folder in (package, package / "inputs", package / "reference"):
        files += folder.glob("*.py")
    return files


@cache
def code_sha256() -> str:
    """SHA-256 over the ``deciding_files``: other code may give other bits."""
    digest = hashlib.sha256()
    for path in sorted(deciding_files(), key=lambda path: (path.parent.name, path.name)):
        digest.update(f"{path.parent.name}/{path.name}".encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
