"""How far the kernels are from both oracles, measured: ``python -m tests.numerics.tolerances`` prints the tables.

A fast build of each stage is compared with its twin in float64 with a running error bound, a strict build against its
twin in float32, bit for bit. ``--write`` puts them into docs/generated/numerics-tables.md. The device is the one that
CLTAA_DEVICE names, else the first.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.core.backend import Launcher
from cltaa.core.build import HALVES, Build
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import Planes
from tests.kernels.stage_chain import ALL_STEPS, WRITES, Work, arguments_of, chain_work, run_stage, variants
from tests.numerics.units import OUTPUTS, STORED, Output, U
from tests.numerics.with_bounds import with_bounds

PAGE = Path(__file__).parents[2] / "docs" / "generated" / "numerics-tables.md"
LEAST_SCALE = 2.0**-90  # below it, what flushes to 0 is more than what rounds


class Row(NamedTuple):
    """One output of a stage over all its pixels; error and bound in the output's unit."""

    label: str
    unit: str
    values: int
    bound: float
    error: float
    ratio: float  # largest error / bound
    outside: int  # values beyond their bound
    open: float  # share of values that rounding may turn either way, not compared
    lost: float  # share of values that are not finite in float64 either: history poisoned on purpose
    rounded: int  # values that are compared and that the bound allows to be off


class Difference(NamedTuple):
    """A strict kernel beside its twin."""

    kernel: str
    values: int
    different: int
    ulps: int  # largest difference in units in the last place
    relative: float  # largest difference over the larger magnitude


def bounds_of(kernel: str, build: Build, work: Work) -> dict[str, tuple[NDArray[Any], NDArray[Any]]]:
    """Value and bound of every plane that a kernel writes, inside the image."""
    planes = with_bounds(kernel, build, work.layout, arguments_of(kernel, build, work))
    inside = work.layout.inside
    return {name: (inside(planes[name].value), inside(planes[name].error)) for name in WRITES[kernel]}


def row_of(output: Output, work: Work, written: Planes, bounds: dict[str, tuple[NDArray[Any], NDArray[Any]]]) -> Row:
    """The row of one output from what a device wrote and the oracle's values and bounds."""
    found = work.layout.inside(written[output.plane])[output.channels].astype(np.float64)
    value, bound = (part[output.channels] for part in bounds[output.plane])
    lost = ~np.isfinite(value)
    is_open = ~np.isfinite(bound) & ~lost
    compared = ~lost & ~is_open
    with np.errstate(all="ignore"):
        error = np.where(compared, np.abs(found - value), 0.0)
        ratio = np.where(error > 0, error / bound, 0.0)
        scale = np.broadcast_to(U * np.maximum(output.scale(work), LEAST_SCALE), value.shape)
        scaled = [float(np.where(compared & (scale > 0), part / scale, 0.0).max()) for part in (bound, error)]
        rounded = int((compared & (bound > 0)).sum())
        outside = int((compared & ~(np.abs(found - value) <= bound)).sum())
    shares = float(is_open.mean()), float(lost.mean())
    return Row(
        output.label, output.unit, value.size, scaled[0], scaled[1], float(ratio.max()), outside, *shares, rounded
    )


def compare_strict(kernel: str, build: Build, work: Work, launcher: Launcher) -> Difference:
    """A strict build beside its twin in float32."""
    ours, theirs = (run_stage(kernel, build, work, on) for on in (launcher, NumpyLauncher()))
    inside = work.layout.inside
    return difference(kernel, *({name: inside(planes[name]) for name in planes} for planes in (ours, theirs)))


def difference(kernel: str, ours: Planes, theirs: Planes) -> Difference:
    """How far two results are apart; any NaN is as good as another."""
    values = different = ulps = 0
    relative = 0.0
    for name, a in ours.items():
        b = theirs[name]
        apart = np.abs(_ordered(a) - _ordered(b)) * ~(np.isnan(a) & np.isnan(b))
        with np.errstate(all="ignore"):
            share = np.abs(a.astype(float) - b) / np.maximum(np.abs(a), np.abs(b))
        values, different, ulps = values + a.size, different + int((apart > 0).sum()), max(ulps, int(apart.max()))
        relative = max(relative, float(np.nan_to_num(share[apart > 0]).max(initial=0.0)))
    return Difference(kernel, values, different, ulps, relative)


def _ordered(values: NDArray[Any]) -> NDArray[np.int64]:
    """Floats of any kind as whole numbers whose difference is the number of floats between them; -0 is 1 below 0."""
    size = values.dtype.itemsize
    whole = np.ascontiguousarray(values).view(f"i{size}").astype(np.int64)
    return np.where(whole < 0, -(2 ** (8 * size - 1)) - whole - 1, whole)


def tolerance_rows(side: int, launcher: Launcher, kernels: Iterable[str] = WRITES) -> Iterator[Row]:
    """Every output of the stages with the default choices."""
    work = chain_work(side, side)
    for kernel in kernels:
        build = launcher.build(Build(steps=ALL_STEPS))
        written, bounds = run_stage(kernel, build, work, launcher), bounds_of(kernel, build, work)
        yield from (row_of(output, work, written, bounds) for output in OUTPUTS if output.kernel == kernel)


def stored_rows(side: int, launcher: Launcher) -> Iterator[Row]:
    """What the blend leaves in each kind of halves."""
    work = chain_work(side, side)
    for storage in HALVES:
        build = launcher.build(Build(steps=ALL_STEPS, storage=storage))
        written, bounds = run_stage("blend", build, work, launcher), bounds_of("blend", build, work)
        for output in STORED:
            row = row_of(output, work, written, bounds)
            yield row._replace(label=f"{storage}: {row.label}")


def choice_rows(side: int, launcher: Launcher) -> Iterator[tuple[str, str, Row]]:
    """The output nearest to its bound, of every choice and step apart from the default."""
    work = chain_work(side, side)
    for kernel in WRITES:
        for name, wanted in variants(kernel, Build(steps=ALL_STEPS)).items():
            if name == "default":
                continue
            build = launcher.build(wanted)
            written, bounds = run_stage(kernel, build, work, launcher), bounds_of(kernel, build, work)
            rows = [row_of(output, work, written, bounds) for output in OUTPUTS if output.kernel == kernel]
            worst = max(rows, key=lambda row: row.ratio)
            yield kernel, name, worst._replace(outside=sum(row.outside for row in rows))


def strict_rows(side: int, launcher: Launcher, kernels: Iterable[str] = WRITES) -> Iterator[Difference]:
    """The kernels with the default choices, the fused ones among them."""
    work = chain_work(side, side)
    build = launcher.build(Build(steps=ALL_STEPS, strict=True))
    return (compare_strict(kernel, build, work, launcher) for kernel in kernels)


def tables(side: int, launcher: Launcher) -> str:
    """The three tables as Markdown."""
    small = max(64, side // 4)
    lines = [
        f"{launcher.description}; {side} x {side} pixels a stage, {small} x {small} a choice; {date.today()}.",
        "",
        "Fast builds beside float64 with its running bound:",
        "",
        "| output | unit | largest bound | largest error | largest error / bound | outside | open | not finite |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in (*tolerance_rows(side, launcher), *stored_rows(side, launcher)):
        lines.append(
            f"| {row.label} | {row.unit} | {row.bound:.3g} | {row.error:.3g} | {row.ratio:.2f} | {row.outside} |"
            f" {row.open:.2%} | {row.lost:.2%} |"
        )
    lines += ["", "The same for every other choice, its output nearest to the bound:", ""]
    lines += ["| stage | choice | output | largest error / bound | outside | open |", "|---|---|---|---|---|---|"]
    for kernel, name, row in choice_rows(small, launcher):
        lines.append(f"| {kernel} | {name} | {row.label} | {row.ratio:.2f} | {row.outside} | {row.open:.2%} |")
    lines += ["", "Strict builds beside their twins in float32:", ""]
    lines += ["| kernel | values | different | largest difference, ulp | relative |", "|---|---|---|---|---|"]
    for kernel, values, different, ulps, relative in strict_rows(side, launcher):
        lines.append(f"| {kernel} | {values} | {different} | {ulps} | {relative:.1e} |")
    return "\n".join(lines) + "\n"


def put_between_marks(page: Path, name: str, text: str) -> None:
    """Replace what stands between the marks ``<!-- name -->`` and ``<!-- end of name -->`` of a page."""
    before, first, rest = page.read_text(encoding="utf-8").partition(f"<!-- {name} -->\n")
    _, last, after = rest.partition(f"<!-- end of {name} -->")
    if not first or not last:
        raise SystemExit(f"{page}: the marks of {name} are missing")
    page.write_text(before + first + "\n" + text + "\n" + last + after, encoding="utf-8")


def main() -> None:
    """Print the tables, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=1024, help="pixels a side (default: %(default)s, a million pixels)")
    parser.add_argument("--write", metavar="NAME", help=f"write between the marks NAME of {PAGE.name}")
    given = parser.parse_args()
    text = tables(given.side, DeviceLauncher())
    if given.write:
        put_between_marks(PAGE, given.write, text)
    else:
        print(text)


if __name__ == "__main__":
    main()
