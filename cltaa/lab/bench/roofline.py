"""A roofline of one ``cltaa bench kernels --json``: ``python -m cltaa.lab.bench.roofline BENCH.json PICTURE.svg``."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.core.build import Build, Storage
from cltaa.core.planes import Layout
from cltaa.core.presets import Preset, load_preset, preset_names
from cltaa.core.resolver import Resolver
from cltaa.io.atomic import atomic_path
from cltaa.lab.bench.accuracy.figures import import_pyplot
from cltaa.lab.bench.contenders import BASELINE
from cltaa.lab.bench.frames import Motion, make_frames
from cltaa.lab.bench.kernels import COPY, KernelBench
from cltaa.lab.timing import resolve_job
from cltaa.printable import counted
from cltaa.reference import KERNELS
from cltaa.reference.launcher import NumpyLauncher

SIZE = 64, 48  # of the frames that are counted; the count is of whole planes, so that it does not depend on it
# Bits that move: all else that NumPy does to floats counts one, as a processor has an instruction for it.
FREE = frozenset({np.absolute, np.negative, np.copysign, np.frexp, np.ldexp})


class CountingTwins(NumpyLauncher):
    """Runs the twins of kernels and counts what they do: ``done``, operations a pixel by name."""

    def __init__(self) -> None:
        self.done: Counter[str] = Counter()

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        """Run the twin of a kernel on arrays that count."""
        counting = type("Counting", (_Counting,), {"done": self.done, "image": (layout.height, layout.width)})
        given = {name: _counting(getattr(value, "array", value), counting) for name, value in arguments.items()}
        KERNELS[kernel](build, layout, **given)


class _Counting(np.ndarray[Any, Any]):
    """An array all of whose results count too. A subclass for each run says where to."""

    done: Counter[str]
    image: tuple[int, int]  # its height and width

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        result = getattr(ufunc, method)(*map(_plain, inputs), **{name: _plain(v) for name, v in options.items()})
        floats = any(getattr(value, "dtype", np.dtype(bool)).kind == "f" for value in inputs)
        if floats and ufunc not in FREE:
            self.done[ufunc.__name__] += _planes(result, self.image)
        return _counting(result, type(self))

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        result = function(*map(_plain, arguments), **{name: _plain(value) for name, value in options.items()})
        return _counting(result, type(self))


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return type(value)(map(_plain, value))
    return value.view(np.ndarray) if isinstance(value, _Counting) else value


def _counting(value: Any, kind: type[_Counting]) -> Any:
    if isinstance(value, tuple | list):
        return type(value)(_counting(each, kind) for each in value)
    return value.view(kind) if isinstance(value, np.ndarray) and value.dtype.names is None else value


def _planes(result: Any, image: tuple[int, int]) -> int:
    """Of how many whole images a result is, halo or none: 0 for one row, for the few pixels of a repair."""
    shape = np.shape(result)
    whole = len(shape) >= 2 and shape[-2] >= image[0] and shape[-1] >= image[1]
    return math.prod(shape[:-2]) if whole else 0


def operations(preset: Preset, motion: Motion, storage: Storage = Storage.FLOAT) -> Counter[str]:
    """Operations a pixel, by NumPy's names, of one frame that continues a history under ``motion``.

    Additions, multiplications, divisions, roots, roundings to whole numbers and comparisons count one each; signs and
    choices between two values count nothing. A kernel does fewer, which shares what neighbours have in common.
    """
    twins = CountingTwins()
    job, _ = resolve_job("counted", Resolver(preset, twins, storage=storage), make_frames(*SIZE, motion))
    twins.done.clear()
    job.run()
    return twins.done


def draw(bench: KernelBench, path: Path) -> None:
    """Draw every contender of the first motion under the roof that the copy's bandwidth puts over it.

    Each is taken to do the ``operations`` of what it computes, a preset's its own and all else the core's. Raises
    UsageError without matplotlib.
    """
    pyplot = import_pyplot()
    timing, where = bench.timings[0], bench.environment
    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    intensities = [0.5, 64.0]
    roof = [timing.copy_gigabytes_a_second * intensity for intensity in intensities]
    axes.loglog(intensities, roof, color="#b4500a", label=f"copy: {timing.copy_gigabytes_a_second:.0f} GB/s")
    for row in timing.rows:
        if row.name != COPY:
            nanoseconds, count = (row.device_ns or row.wall_ns).median, _operations(row.name, timing.motion)
            speed = count / nanoseconds
            axes.plot(count / (row.gigabytes_a_second * nanoseconds), speed, "o", label=f"{row.name}: {speed:.3g}")
    axes.set(xlabel="operations a byte that must move", ylabel="operations a nanosecond")
    told = f"{bench.width} x {bench.height}, {bench.storage} history, {timing.motion} motion"
    axes.set_title(
        f"{where.device}\n{where.cpu}, {counted(where.cores, 'core')}, {where.date[:10]}\n{told}", fontsize=9
    )
    axes.legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], bbox_inches="tight")
    pyplot.close(figure)


@cache
def _operations(contender: str, motion: Motion) -> int:
    return operations(load_preset(contender) if contender in preset_names() else BASELINE, motion).total()


if __name__ == "__main__":
    draw(msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=KernelBench), Path(sys.argv[2]))
