"""What a search for settings is after: the least error within a time, or the least time for an error."""

from __future__ import annotations

import math

import msgspec

from cltaa.errors import UsageError
from cltaa.judging.metrics import METRICS, named_metrics

STEEPNESS = 4  # how fast a candidate gets worse beyond the limit


class Goal(msgspec.Struct, frozen=True, kw_only=True):
    """What is wanted: the least ``metric`` within ``budget_ms`` a frame, or the least time with ``target`` of it."""

    metric: str
    budget_ms: float | None = None
    target: float | None = None

    def score(self, error: float, milliseconds: float) -> float:
        """What is minimised: the one, made worse by how far the other is beyond its limit."""
        if self.budget_ms is not None:
            return error * max(1.0, milliseconds / self.budget_ms) ** STEEPNESS
        assert self.target is not None
        return milliseconds * max(1.0, error / self.target) ** STEEPNESS

    def reached(self, error: float, milliseconds: float) -> bool:
        """Whether the limit is kept."""
        return milliseconds <= self.budget_ms if self.budget_ms is not None else error <= (self.target or 0.0)


def parse_goal(budget: str | None, target: str | None, metric: str) -> Goal:
    """The goal of ``--budget 5ms`` or ``--target flip=0.02``; raises UsageError for anything else."""
    if (budget is None) == (target is None):
        raise UsageError("one of --budget and --target is needed", expected="--budget 5ms, or --target flip=0.02")
    name, _, number = (target or "").partition("=")
    text = number if target is not None else (budget or "").removesuffix("ms").strip()
    name = name.strip() if target is not None else metric
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value > 0 and math.isfinite(value)):
        raise UsageError("no goal", expected="--budget 5ms, or --target flip=0.02", found=target or budget)
    if name not in METRICS or METRICS[name].higher_is_better:
        falling = [metric.name for metric in METRICS.values() if not metric.higher_is_better]
        raise UsageError("no metric to minimise", expected=", ".join(falling), found=name)
    named_metrics([name])  # missed now, and not after sequences were read and kernels built
    return Goal(metric=name, **({"target": value} if target is not None else {"budget_ms": value}))
