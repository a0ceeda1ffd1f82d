"""Figures of an accuracy measurement, SVG and PNG by matplotlib (extra ``bench``), and the table over all sequences."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import geometric_mean
from typing import Any, NamedTuple

from cltaa.errors import import_extra
from cltaa.io.atomic import atomic_path
from cltaa.lab.bench.accuracy.measurement import Accuracy, Measured, MeasuredSequence
from cltaa.lab.bench.variants import PRESETS
from cltaa.lab.judge.metrics import METRICS
from cltaa.lab.timing import Interval
from cltaa.printable import counted, literal, markdown

MOST = 2.0  # ratio to the default's error at which the colour scale ends, both ways


class Overall(NamedTuple):
    """A variant over all sequences: error and time over the default's, for each sequence and as geometric means."""

    variant: str
    errors: list[float | None]  # None if either of the two has no error
    error: float
    times: list[Interval]  # of the sequences that were not too noisy to rank
    rounding: float | None  # root mean square over the sequences
    best_of: int  # number of sequences on which no variant has less error

    @property
    def time(self) -> float | None:
        """The geometric mean of the times; None if every sequence was too noisy."""
        return geometric_mean(time.median for time in self.times) if self.times else None

    @property
    def error_range(self) -> tuple[float, float]:
        """The least and the greatest of the known errors; 1 without any."""
        there = [error for error in self.errors if error is not None] or [1.0]
        return min(there), max(there)


def overall(result: Accuracy, metric: str) -> list[Overall]:
    """Return every variant, least error first; ``metric`` must fall as the image gets better."""
    least = [min(cell.errors[metric].mean for cell in measured.cells) for measured in result.sequences]
    rows = []
    for place, variant in enumerate(result.variants):
        cells = [measured.cells[place] for measured in result.sequences]
        errors = [_ratio(measured, cell, metric) for measured, cell in zip(result.sequences, cells, strict=True)]
        times = [measured.cells[place].ratio for measured in result.sequences if not measured.noisy]
        best = sum(cell.errors[metric].mean <= value for cell, value in zip(cells, least, strict=True))
        apart = [cell.rounding.rms**2 for cell in cells if cell.rounding is not None]
        rounding = math.sqrt(math.fsum(apart) / len(apart)) if apart else None
        mean = geometric_mean([error for error in errors if error is not None] or [1.0])
        rows.append(Overall(variant.name, errors, mean, times, rounding, best))
    return sorted(rows, key=lambda row: row.error)


def table(result: Accuracy, metrics: Sequence[str]) -> str:
    """Return Markdown: a row for each variant, least error by the first metric first; then a row for each sequence."""
    every = {metric: {row.variant: row for row in overall(result, metric)} for metric in metrics}
    heads = ["variant", *(head for metric in metrics for head in (metric, "least to greatest", "best in"))]
    rows = []
    for variant, row in every[metrics[0]].items():
        texts = [variant]
        for own in (found[variant] for found in every.values()):
            texts += [f"{own.error:.3f}", "{:.3f} to {:.3f}".format(*own.error_range), str(own.best_of)]
        low, high = min((t.low for t in row.times), default=0.0), max((t.high for t in row.times), default=0.0)
        texts += ["too noisy to rank", "–"] if row.time is None else [f"{row.time:.3f}", f"{low:.3f} to {high:.3f}"]
        rows.append([*texts, "–" if row.rounding is None else f"{row.rounding:.1e}" if row.rounding else "0"])
    whole = markdown([*heads, "time", "95 % of every sequence within", "rounding"], rows)
    return f"{_about(result)}\n\n{whole}{by_sequence(result, metrics[0])}"


def by_sequence(result: Accuracy, metric: str) -> str:
    """Return Markdown with a row for each sequence: the default's error and time, then the ratios of every other
    preset; empty without another preset."""
    presets = [variant.name for variant in result.variants if variant.group == PRESETS]
    if not presets:
        return ""
    rows = []
    for measured in result.sequences:
        first = measured.cells[0]
        own = [f"{first.errors[metric].mean:.3g}", "noisy" if measured.noisy else f"{first.time.median:.3g}"]
        others = (_beside(measured, cell, metric) for cell in measured.cells if cell.variant in presets)
        rows.append([measured.name, *own, *others])
    base = result.variants[0].name
    heads = "sequence", f"{base}: {metric}", "ms a megapixel", *presets
    return f"\nBy sequence, {metric} and time of each preset over those of {literal(base)}:\n\n{markdown(heads, rows)}"


def _beside(measured: MeasuredSequence, cell: Measured, metric: str) -> str:
    ratio = _ratio(measured, cell, metric)
    time = "noisy" if measured.noisy else f"{cell.ratio.median:.3g}"
    return f"{'–' if ratio is None else f'{ratio:.2f}'}, {time}"


def _about(result: Accuracy) -> str:
    noisy = [measured.name for measured in result.sequences if measured.noisy]
    without = f" Times without those that were too noisy to rank: {', '.join(noisy)}." if noisy else ""
    where, base = result.environment, result.variants[0].name
    over = counted(len(result.sequences), "sequence")
    return literal(
        f"{where.hardware}; {where.cpu}; {where.date} UTC. Multiples of those of {base}, geometric means"
        f" over {over}; rounding is the relative rms distance from float64.{without}"
    )


def overview_figure(pyplot: Any, result: Accuracy, metric: str) -> Any:
    """Draw sequences across and variants down: blue for less error than the default there, red for more."""
    rows, names = overall(result, metric), [measured.name for measured in result.sequences]
    size = (3.2 + 0.27 * len(names), 1.2 + 0.17 * len(rows))
    figure, axes = pyplot.subplots(figsize=size)
    span = math.log2(MOST)
    shown = [[math.nan if ratio is None else math.log2(ratio) for ratio in row.errors] for row in rows]
    image = axes.imshow(shown, cmap="RdBu_r", vmin=-span, vmax=span, aspect="auto")
    axes.set_facecolor("#bbbbbb")
    axes.set_xticks(range(len(names)), [*map(plain, names)], rotation=90, fontsize=6)
    axes.set_yticks(range(len(rows)), [f"{plain(row.variant)}  {row.error:.3f}" for row in rows], fontsize=6)
    axes.set_title(
        f"{metric} over that of {plain(result.variants[0].name)} (behind each name: geometric mean)", fontsize=8
    )
    bar = figure.colorbar(image, ax=axes, ticks=[-span, 0, span], shrink=0.5)
    bar.ax.set_yticklabels([f"1/{MOST:g} and less", "the same", f"{MOST:g} and more"], fontsize=6)
    return figure


def _ratio(measured: MeasuredSequence, cell: Measured, metric: str) -> float | None:
    base, own = measured.cells[0].errors[metric].mean, cell.errors[metric].mean
    return own / base if base > 0 and own > 0 else None


FORMATS = ("svg", "png")
DOTS_AN_INCH = 150
CROWDED = 1e3  # from this ratio of its ends on, an axis labels only powers of ten
FRONT, BEATEN, SAMPLES, LIMIT = "#0b62c4", "#a3a6ad", "#16784a", "#b4500a"


def import_pyplot() -> Any:
    """Import pyplot for drawing into files only; raises UsageError that says what to install."""
    pyplot: Any = import_extra("matplotlib.pyplot", package="matplotlib", extra="bench", purpose="drawing plots")
    pyplot.switch_backend("agg")
    return pyplot


def plain(name: str) -> str:
    """Return a name for matplotlib, which reads what stands between two dollars as a formula."""
    return name.replace("$", r"\$")


def write_plots(result: Accuracy, output: Path, pictured: int | None = None) -> Iterator[Path]:
    """Write ``front-<sequence>``, and for several sequences ``overview``; yield the paths.

    The first ``pictured`` sequences get their own plots; None: all. Raises UsageError without matplotlib.
    """
    pyplot = import_pyplot()
    for name, figure in _figures(pyplot, result, result.metrics[0], pictured):
        for suffix in FORMATS:
            path = output / f"{name}.{suffix}"
            with atomic_path(path) as temporary:
                figure.savefig(temporary, format=suffix, dpi=DOTS_AN_INCH, bbox_inches="tight")
            yield path
        pyplot.close(figure)


def _figures(pyplot: Any, result: Accuracy, metric: str, pictured: int | None) -> Iterator[tuple[str, Any]]:
    weight = result.variants[0].settings.blend_weight
    for measured in result.sequences[:pictured]:
        yield f"front-{measured.name}", front_figure(pyplot, measured, metric, weight)
    if len(result.sequences) > 1 and not METRICS[metric].higher_is_better:
        yield "overview", overview_figure(pyplot, result, metric)


def front_figure(pyplot: Any, measured: MeasuredSequence, metric: str, weight: float) -> Any:
    """Draw error against time: left with supersampling and the limits, right the named variants alone.

    ``weight`` is that of the exponential mean whose noise is drawn.
    """
    figure, (wide, near) = pyplot.subplots(1, 2, figsize=(10, 4.6))
    cells = _drawn(measured, metric)
    for axes in (wide, near):
        for cell in cells:
            time, error, beaten = cell.time, cell.errors[metric], metric in cell.dominated_by
            above = error.p95 - error.mean if math.isfinite(error.p95) else 0
            frames = [[max(error.mean - error.p5, 0)], [max(above, 0)]] if axes is wide else None
            axes.errorbar(
                time.median,
                error.mean,
                xerr=[[max(time.median - time.low, 0)], [max(time.high - time.median, 0)]],
                yerr=frames,
                fmt="o",
                ms=4,
                lw=0.7,
                color=BEATEN if beaten else FRONT,
            )
        if cells:
            axes.set_xscale("log")
        if cells and not METRICS[metric].higher_is_better:
            axes.set_yscale("log")
        axes.grid(visible=True, which="major", lw=0.3)
        axes.tick_params(labelsize=7)
    _limits(wide, measured, metric, weight)
    wide.set(xlabel="ms a megapixel, added to drawing one sample", ylabel=f"{metric} against the truth")
    near.set(xlabel="ms a megapixel", title="the variants alone")
    near.margins(x=0.2)  # room for names to the right of the points
    ticker: Any = importlib.import_module("matplotlib.ticker")
    for axis in (near.xaxis, near.yaxis):
        axis.set_major_formatter("{x:g}")
        if axis.get_scale() == "log":
            least, most = axis.get_view_interval()
            room = axis is near.yaxis or most < CROWDED * least
            axis.set_minor_formatter("{x:g}" if room else ticker.NullFormatter())
            axis.set_minor_locator(ticker.LogLocator(subs=(2, 5) if axis is near.xaxis else range(2, 10)))
    near.tick_params(which="minor", labelsize=6)
    _name_points(near, measured, metric)
    wide.set_title(plain(measured.name) + (" (times too noisy to rank)" if measured.noisy else ""))
    return figure


def _drawn(measured: MeasuredSequence, metric: str) -> list[Measured]:
    """Return the cells that can be drawn: zero error has no logarithm and an infinite PSNR."""
    falling = not METRICS[metric].higher_is_better
    means = [cell.errors[metric].mean for cell in measured.cells]
    there = [math.isfinite(mean) and (mean > 0 or not falling) for mean in means]
    return [cell for cell, drawn in zip(measured.cells, there, strict=True) if drawn]


def _limits(axes: Any, measured: MeasuredSequence, metric: str, weight: float) -> None:
    """Draw supersampling, the floor of time and the noise levels, with a legend."""
    yards = [(row.added, row.errors[metric].mean, row.samples) for row in measured.yardstick if row.added]
    if yards:
        named = "supersampling, by its drawing time"
        axes.plot([x for x, _, _ in yards], [y for _, y, _ in yards], "D--", ms=4, lw=0.8, color=SAMPLES, label=named)
        for x, y, samples in yards:
            place = {"textcoords": "offset points", "xytext": (-5, -8), "ha": "right"}
            axes.annotate(f"{samples}×", (x, y), fontsize=6, color=SAMPLES, **place)
    axes.axvline(measured.floor, color=LIMIT, ls=":", lw=1, label="floor: the least bytes at the speed of a copy")
    noises = (
        (measured.mean_noise, "--", f"noise of an exponential mean, weight {weight:g}"),
        (measured.truth_noise, "-.", "noise of the truth itself"),
    )
    for level, style, named in noises if metric == "mse" else ():
        if level:
            axes.axhline(level, color=LIMIT, ls=style, lw=1, label=f"{named}: {level:.2g}")
    axes.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)


def _name_points(axes: Any, measured: MeasuredSequence, metric: str) -> None:
    """Label the default, then the points that no variant dominates, unless labels overlap."""
    taken: list[Any] = []
    axes.figure.canvas.draw()  # makes the scales final
    default = measured.cells[0].variant
    for cell in sorted(_drawn(measured, metric), key=lambda cell: (cell.variant != default, cell.errors[metric].mean)):
        if metric in cell.dominated_by and cell.variant != default:
            continue
        at = cell.time.median, cell.errors[metric].mean
        name = axes.annotate(plain(cell.variant), at, textcoords="offset points", xytext=(5, 3), fontsize=6)
        box = name.get_window_extent()
        if any(box.overlaps(other) for other in taken):
            name.remove()
        else:
            taken.append(box)
