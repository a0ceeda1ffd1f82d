"""OpenCL programs: source assembled from ``kernels/``, built once, arguments bound by name."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable, Mapping
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

# What kernels take by value, by its name in OpenCL C. Of structs not the fields: pyopencl keeps them on disk by their
# size, and would warn of a collision once a field has another name.
TYPES = {"int": np.int32, "float": np.float32, "frame_t": np.void, "settings_t": np.void}


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


def device_flags(devices: Iterable[cl.Device]) -> tuple[str, ...]:
    """Options that a build for these devices needs beside its own.

    The literals of K are doubles cast to its precision. Clang does so too where a device has no doubles, but with a
    warning that belongs to no group, which -Werror makes an error; the option takes it back and changes no bit.
    """
    doubles = all("cl_khr_fp64" in device.extensions.split() for device in devices)
    return () if doubles else ("-cl-single-precision-constant",)


class Kernel(OneProcess):
    """One built kernel; call ``enqueue`` with its arguments by name."""

    def __init__(self, context: cl.Context, name: str, build: Build) -> None:
        self.name, self.build = name, build
        try:
            with warnings.catch_warnings():
                # Some drivers print remarks for every build; -Werror has made errors of the warnings among them.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                options = [*build.flags(), *device_flags(context.devices)]
                program = cl.Program(context, source(name, build)).build(options=options)
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
        self.arguments = [str(name) for name in self._of_arguments(cl.kernel_arg_info.NAME)]
        # By their types all are set in two calls; else each is tried as one thing after another, 10 us of it a number.
        kinds = self._of_arguments(cl.kernel_arg_info.TYPE_NAME)
        self._kernel.set_scalar_arg_dtypes([TYPES.get(kind) for kind in kinds])
        self._starting = Lock()  # arguments are the kernel's own: of two threads one starts it after the other

    def enqueue(
        self, queue: cl.CommandQueue, size: tuple[int, ...], group: tuple[int, ...] | None, arguments: Mapping[str, Any]
    ) -> cl.Event:
        """Start the kernel over ``size`` work-items in groups of ``group``; raises InternalError for a wrong name."""
        values = [arguments[name] for name in self.arguments if name in arguments]
        if not len(values) == len(arguments) == len(self.arguments):
            raise InternalError(
                f"kernel {self.name}: arguments do not match",
                expected=", ".join(self.arguments),
                found=", ".join(arguments),
            )
        with self._starting:
            self._kernel.set_args(*values)
            return cl.enqueue_nd_range_kernel(queue, self._kernel, size, group)

    def _of_arguments(self, what: cl.kernel_arg_info) -> list[Any]:
        return [self._kernel.get_arg_info(index, what) for index in range(self._kernel.num_args)]
