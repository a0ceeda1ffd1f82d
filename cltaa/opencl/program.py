"""OpenCL programs: source assembled from ``kernels/``, built once, arguments bound by name."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import pyopencl as cl

from cltaa.core.build import Build, prelude
from cltaa.core.kernel_source import kernel_files, kernel_folder, kernel_names
from cltaa.errors import InternalError, UsageError, known
from cltaa.opencl.cache import cache_folder, save_log
from cltaa.process import OneProcess


def _pasted(name: str, seen: set[str]) -> list[str]:
    lines = [f'#line 1 "{name}"']
    for number, line in enumerate((kernel_folder() / name).read_text(encoding="utf-8").splitlines(), start=1):
        if line.startswith("#include"):
            included = line.split('"')[1]
            if included not in seen:
                seen.add(included)
                lines.extend(_pasted(included, seen))
                lines.append(f'#line {number + 1} "{name}"')
        else:
            lines.append(line)
    return lines


@cache
def source(kernel: str, build: Build) -> str:
    """The whole text of a kernel as the compiler sees it: prelude, then the file with its includes pasted."""
    name = kernel_files().get(kernel, f"{kernel}.cl")  # those of bench lie in a folder of their own
    if not (kernel_folder() / name).is_file():
        raise UsageError(f"unknown kernel {kernel}", cure=known(kernel, kernel_names(), "kernels"))
    return prelude(build) + "\n".join(_pasted(name, set())) + "\n"


def source_hash(kernel: str, build: Build) -> str:
    """SHA-256 of name, text and flags: what a result depends on, beside the device."""
    return hashlib.sha256("\0".join([kernel, source(kernel, build), *build.flags()]).encode()).hexdigest()


class Kernel(OneProcess):
    """One built kernel; call ``enqueue`` with its arguments by name."""

    def __init__(self, context: cl.Context, name: str, build: Build) -> None:
        self.name, self.build = name, build
        try:
            with warnings.catch_warnings():
                # Some drivers print remarks for every build; -Werror has made errors of the warnings among them.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                program = cl.Program(context, source(name, build)).build(options=list(build.flags()))
        except cl.RuntimeError as error:
            said = (line.strip() for line in str(error).splitlines() if not line.startswith("(options:"))  # -Werror
            reason = next((line for line in said if "error" in line), None)
            log = save_log(Path(name).name, str(error), source(name, build))
            told = f"the whole log and text: {log}; " if log else ""
            cure = f"{told}check the driver and its kernel cache with: cltaa doctor"
            if reason is None:
                other = f"if parts of the kernel cache {cache_folder()} are another user's"
                cure += f"; {other}, set POCL_CACHE_DIR to a folder of your own"
            what = f"kernel {name} does not build: {reason or 'the compiler gave no reason'}"
            raise InternalError(what, cure=cure) from error
        self._kernel = cl.Kernel(program, f"{Path(name).name}_kernel")
        # Their names, in order.
        self.arguments: list[str] = [
            str(self._kernel.get_arg_info(index, cl.kernel_arg_info.NAME)) for index in range(self._kernel.num_args)
        ]
        self._starting = Lock()  # arguments are the kernel's own: of two threads one starts it after the other

    def enqueue(
        self,
        queue: cl.CommandQueue,
        size: tuple[int, ...],
        group: tuple[int, ...] | None,
        arguments: Mapping[str, Any],
    ) -> cl.Event:
        """Start the kernel over ``size`` work-items in groups of ``group``; raises InternalError for a wrong name."""
        if arguments.keys() != set(self.arguments):
            raise InternalError(
                f"kernel {self.name}: arguments do not match",
                expected=", ".join(self.arguments),
                found=", ".join(arguments),
            )
        with self._starting:
            for index, name in enumerate(self.arguments):
                value = arguments[name]
                if isinstance(value, int | np.integer):
                    value = np.int32(value)
                self._kernel.set_arg(index, value)
            return cl.enqueue_nd_range_kernel(queue, self._kernel, size, group)
