"""All sequences of an accuracy measurement together: what each step does to the error of each, as figure and table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import geometric_mean
from typing import Any, NamedTuple

from cltaa.bench.accuracy.results import Accuracy, Cell, MeasuredSequence
from cltaa.printable import counted
from cltaa.timing import Interval

MOST = 2.0  # times the default's error at which the colours end, both ways


class Overall(NamedTuple):
    """A variant over all sequences: error and time over the default's, one a sequence and their geometric means."""

    variant: str
    errors: list[float | None]  # None where either of the two has no error at all
    error: float
    times: list[Interval]  # of the sequences that were not too noisy to rank
    rounding: float | None  # root mean square over the sequences
    best_of: int  # sequences in which nothing has less error

    @property
    def time(self) -> float | None:
        """The geometric mean of the times; None where every sequence was too noisy."""
        return geometric_mean(time.median for time in self.times) if self.times else None

    @property
    def error_range(self) -> tuple[float, float]:
        """The least and the greatest of the errors that there are; 1 without any."""
        there = [error for error in self.errors if error is not None] or [1.0]
        return min(there), max(there)


def overall(result: Accuracy, metric: str) -> list[Overall]:
    """Every variant, least error first; ``metric`` is one whose values fall as the image gets better."""
    least = [min(cell.errors[metric].mean for cell in measured.cells) for measured in result.sequences]
    rows = []
    for place, variant in enumerate(result.variants):
        cells = [measured.cells[place] for measured in result.sequences]
        errors = [_ratio(measured, cell, metric) for measured, cell in zip(result.sequences, cells, strict=True)]
        times = [measured.cells[place].ratio for measured in result.sequences if not measured.noisy]
        best = sum(cell.errors[metric].mean <= value for cell, value in zip(cells, least, strict=True))
        mean = geometric_mean([error for error in errors if error is not None] or [1.0])
        rows.append(Overall(variant.name, errors, mean, times, _rounding(cells), best))
    return sorted(rows, key=lambda row: row.error)


def table(result: Accuracy, metrics: Sequence[str]) -> str:
    """Markdown, a row a variant, least error by the first of ``metrics`` first."""
    every = {metric: {row.variant: row for row in overall(result, metric)} for metric in metrics}
    heads = ["variant"]
    for metric in metrics:
        heads += [metric, "least to greatest", "best in"]
    heads += ["time", "95 % of every sequence within", "rounding"]
    lines = [_about(result), "", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for variant, row in every[metrics[0]].items():
        texts = [variant]
        for rows in every.values():
            own = rows[variant]
            texts += [f"{own.error:.3f}", "{:.3f} to {:.3f}".format(*own.error_range), str(own.best_of)]
        low, high = min((t.low for t in row.times), default=0.0), max((t.high for t in row.times), default=0.0)
        texts += ["too noisy to rank", "–"] if row.time is None else [f"{row.time:.3f}", f"{low:.3f} to {high:.3f}"]
        texts.append("–" if row.rounding is None else f"{row.rounding:.1e}" if row.rounding else "0")
        lines.append(f"| {' | '.join(texts)} |")
    return "\n".join(lines) + "\n"


def _about(result: Accuracy) -> str:
    noisy = [measured.name for measured in result.sequences if measured.noisy]
    without = f" Times without those that were too noisy to rank: {', '.join(noisy)}." if noisy else ""
    where, base = result.environment, result.variants[0].name
    over = counted(len(result.sequences), "sequence")
    return (
        f"{where.hardware}; {where.cpu}; {where.date} UTC. Multiples of those of {base}, geometric means"
        f" over {over}; rounding is the relative rms distance from float64.{without}"
    )


def overview_figure(pyplot: Any, result: Accuracy, metric: str) -> Any:
    """Sequences across, variants down: blue where a step has less error than the default there, red where more."""
    rows, names = overall(result, metric), [measured.name for measured in result.sequences]
    size = (3.2 + 0.27 * len(names), 1.2 + 0.17 * len(rows))
    figure, axes = pyplot.subplots(figsize=size)
    span = math.log2(MOST)
    shown = [[math.nan if ratio is None else math.log2(ratio) for ratio in row.errors] for row in rows]
    image = axes.imshow(shown, cmap="RdBu_r", vmin=-span, vmax=span, aspect="auto")
    axes.set_facecolor("#bbbbbb")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=6)
    axes.set_yticks(range(len(rows)), [f"{row.variant}  {row.error:.3f}" for row in rows], fontsize=6)
    axes.set_title(f"{metric} over that of {result.variants[0].name} (behind each name: geometric mean)", fontsize=8)
    bar = figure.colorbar(image, ax=axes, ticks=[-span, 0, span], shrink=0.5)
    bar.ax.set_yticklabels([f"1/{MOST:g} and less", "the same", f"{MOST:g} and more"], fontsize=6)
    return figure


def _ratio(measured: MeasuredSequence, cell: Cell, metric: str) -> float | None:
    base, own = measured.cells[0].errors[metric].mean, cell.errors[metric].mean
    return own / base if base > 0 and own > 0 else None


def _rounding(cells: list[Cell]) -> float | None:
    found = [cell.rounding.rms for cell in cells if cell.rounding is not None]
    return math.sqrt(math.fsum(value**2 for value in found) / len(found)) if found else None
