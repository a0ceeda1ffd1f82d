"""A roofline of one ``cltaa bench kernels --json``: ``python -m cltaa.bench.roofline BENCH.json PICTURE.svg``."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import msgspec

from cltaa.bench.accuracy.plots import import_pyplot
from cltaa.bench.baseline import BASELINE
from cltaa.bench.frames import Motion
from cltaa.bench.kernels import COPY, KernelBench
from cltaa.bench.operations import operations
from cltaa.files.atomic import atomic_path
from cltaa.parameters.presets import load_preset, preset_names
from cltaa.printable import counted


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
