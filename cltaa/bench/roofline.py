"""A roofline of one ``cltaa bench kernels --json``: ``python -m cltaa.bench.roofline BENCH.json PICTURE.svg``."""

from __future__ import annotations

import sys
from pathlib import Path

import msgspec

from cltaa.bench.accuracy.plots import import_pyplot
from cltaa.bench.kernels import COPY, KernelBench
from cltaa.files.atomic import atomic_path

# Additions, multiplications (a fused one: two), divisions, roots and comparisons that keep the greater or lesser, a
# pixel: counted in the machine code of t2 that runs under uniform motion (PoCL 3.0, 16 lanes, 2026-11-21).
OPERATIONS = 449


def draw(bench: KernelBench, path: Path) -> None:
    """Draw every contender of the first motion under the roof that the copy's bandwidth puts over it.

    All contenders are taken to do the core's ``OPERATIONS``, so that height is speed. Raises UsageError without
    matplotlib.
    """
    pyplot = import_pyplot()
    timing = bench.timings[0]
    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    intensities = [0.5, 64.0]
    roof = [timing.copy_gigabytes_a_second * intensity for intensity in intensities]
    axes.loglog(intensities, roof, color="#b4500a", label=f"copy: {timing.copy_gigabytes_a_second:.0f} GB/s")
    for row in timing.rows:
        if row.name != COPY:
            nanoseconds = (row.device_ns or row.wall_ns).median
            speed = OPERATIONS / nanoseconds
            axes.plot(OPERATIONS / (row.gigabytes_a_second * nanoseconds), speed, "o", label=f"{row.name}: {speed:.0f}")
    axes.set(xlabel="operations a byte that must move", ylabel="operations a nanosecond")
    axes.set_title(f"{bench.environment.device}\n{bench.width} x {bench.height}, {bench.storage} history", fontsize=9)
    axes.legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format=path.suffix[1:], bbox_inches="tight")
    pyplot.close(figure)


if __name__ == "__main__":
    draw(msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=KernelBench), Path(sys.argv[2]))
