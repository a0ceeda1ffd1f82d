"""The folder where PoCL keeps built kernels: private, checked before use, each kernel built by one process at a time.

PoCL's compiler ends the whole process, uncatchably, where the disk of its cache is full or a file may not grow (ulimit
-f), fails with an unrelated message where the folder is not writable, and is not safe when several processes fill the
folder at once (github.com/pocl/pocl/issues/1480). This module rules out each of them beforehand.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import resource
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cltaa.errors import DeviceMissing, ResourceError
from cltaa.process import user_cache

# One kernel takes well under 1 MB, all kernels of a device about 10 MB; the rest is for other writers to the disk.
LEAST_FREE = 64 * 2**20  # bytes
# The largest file of a kernel is its text after macro expansion, about 1.5 MB.
LEAST_FILE = 4 * 2**20  # bytes
NEVER_ENDED = (
    "cltaa: the last process that built this kernel was killed, or ended by the driver's compiler; if this one ends "
    "as well, use --device numpy or another OpenCL driver, and see: cltaa doctor"
)
CURE = "free some space there, or set POCL_CACHE_DIR to a folder that can be written"

_held = threading.RLock()  # reentrant: a process that has the lock may take it again
_depth = 0


def cache_folder() -> Path:
    """Return the folder where PoCL keeps kernels; in a process of another program, its folder for all programs."""
    chosen = os.environ.get("POCL_CACHE_DIR")
    return Path(chosen) if chosen else user_cache() / "pocl" / "kcache"


def check_cache() -> int:
    """Return the free bytes where kernels are kept; raises DeviceMissing or ResourceError where none can be."""
    folder = cache_folder()
    with _written(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    if free < LEAST_FREE:
        expected, found = f"{LEAST_FREE / 1e6:.0f} MB", f"{free / 1e6:.0f} MB free"
        raise ResourceError("too little room for built kernels", path=folder, expected=expected, found=found, cure=CURE)
    most = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if most != resource.RLIM_INFINITY and most < LEAST_FILE:
        what = "files may not grow large enough for built kernels"
        cure = "the shell limits the size of a file: ulimit -f unlimited"
        expected, found = f"{LEAST_FILE / 1e6:.1f} MB", f"at most {most / 1e6:.1f} MB"
        raise ResourceError(what, path=folder, expected=expected, found=found, cure=cure)
    return free


@contextmanager
def _written(folder: Path) -> Iterator[None]:
    """Raise system errors about a cache's ``folder`` as DeviceMissing."""
    try:
        yield
    except OSError as error:
        what = f"the kernel cache cannot be written: {error.strerror}"
        raise DeviceMissing(what, path=folder, cure=CURE) from error


@contextmanager
def filling(kernel: str) -> Iterator[None]:
    """Check the cache and be the one process that builds ``kernel``, a hash; others wait for it.

    Each kernel has a lock: processes that need another one, or one that is built, do not wait. A warning is printed if
    the previous holder ended during the build, because a compiler that aborts gives no cure. Raises as ``check_cache``.
    """
    global _depth
    with _held:
        if _depth:
            yield
            return
        check_cache()
        locks = cache_folder() / "locks"
        with _written(cache_folder()):
            locks.mkdir(exist_ok=True)
            file = (locks / kernel).open("a+")
        with file as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            in_doubt = os.fstat(lock.fileno()).st_size > 0
            if in_doubt:
                print(NEVER_ENDED, file=sys.stderr, flush=True)
            lock.write("begun")  # remains where the process ends during the build
            lock.flush()
            _depth += 1
            try:
                yield
                in_doubt = False
            finally:
                _depth -= 1
                if not in_doubt:
                    lock.truncate(0)


def save_log(name: str, said: str, text: str) -> Path | None:
    """Save the log of a compiler with the kernel's text, for a bug report; None where that is impossible.

    Beside the kernels, where no other user can plant a link, and once for each text, so that logs do not pile up.
    """
    log = cache_folder() / "logs" / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.log"
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text(f"{said}\n\n{text}", encoding="utf-8")
    except OSError:
        return None
    return log
