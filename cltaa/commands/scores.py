"""What a comparison found, as numbers by name and as the cells of a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cltaa.lab.judge.comparison import Comparison, truth_samples
from cltaa.lab.judge.equal_quality import equal_quality
from cltaa.lab.judge.metrics import Metric, mean
from cltaa.lab.judge.one_pass import Found, Judged, alpha_of
from cltaa.lab.judge.video_scores import SCORES

Values = Mapping[str, float]
BOUNDS = {None: "", "at least": "≥ ", "at most": "≤ "}


def value_cells(values: Values, metrics: tuple[Metric, ...]) -> list[str]:
    """The metrics of a row."""
    return ["identical" if math.isinf(v) else format(v, m.form) for m in metrics for v in (values[m.name],)]


def sample_cell(result: Mapping[str, Any]) -> str:
    """The equal-quality samples as a cell."""
    equal = result.get("equal_quality_samples")
    if equal is None:
        return "–"
    return "identical" if math.isinf(equal["samples"]) else f"{BOUNDS[equal['bound']]}{equal['samples']:.1f}"


def head(metric: Metric) -> str:
    """A metric as the head of a column."""
    return f"{metric.name} {'↑' if metric.higher_is_better else '↓'}"


def video_cells(values: Values) -> list[str]:
    """The scores of moving pictures of a row."""
    return ["–" if math.isnan(v) else format(v, s.form) for s in SCORES for v in (values[s.name],)]


def summary_of(comparison: Comparison, judged: Judged, found: Found, metrics: tuple[Metric, ...]) -> dict[str, Any]:
    """What is said of one test; the single samples stand beside it unless it is they."""
    single = None if comparison.of_itself else found.one_sample
    rows = [
        {"frame": number, "metrics": values}
        for number, values in zip(comparison.test.numbers, judged.metrics, strict=True)
    ]
    result: dict[str, Any] = {
        "definitions": {metric.name: metric.title for metric in metrics},
        "mean": mean(judged.metrics),
        "frames": rows,
    }
    if single is not None:
        _add(rows, "one_sample", single.metrics)
        result["mean_one_sample"] = mean(single.metrics)
        mse, one_sample_mse = (result[name]["mse"] for name in ("mean", "mean_one_sample"))
        if one_sample_mse > 0:  # a picture that one sample gets right has no such number
            equal = equal_quality(mse, one_sample_mse, found.yardsticks, truth_samples(comparison.reference))
            result["equal_quality_samples"] = equal._asdict()
    if judged.alpha:
        _add(rows, "alpha", judged.alpha)
        result["alpha"] = alpha_of(judged)
        if single is not None and single.alpha:
            result["alpha_one_sample"] = alpha_of(single)
    if judged.total is not None:
        _add(rows, "video", judged.video)
        result["definitions"] |= {score.name: score.title for score in SCORES}
        result["video"] = judged.total.scores()
        if single is not None and single.total is not None:
            result["video_one_sample"] = single.total.scores()
    return result


def _add(rows: list[dict[str, Any]], name: str, values: list[dict[str, float]]) -> None:
    for row, value in zip(rows, values, strict=True):
        row[name] = value
