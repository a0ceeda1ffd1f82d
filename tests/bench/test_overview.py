"""Many sequences in one figure and one table."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltaa.bench.environment import Environment
from cltaa.bench.errors_of import Rounding
from cltaa.bench.ladder import ladder
from cltaa.bench.overview import overall, table
from cltaa.bench.plots import write_plots
from cltaa.bench.results import Accuracy, Cell, Measured, spread
from cltaa.bench.timing import Interval
from cltaa.presets import load_preset

VARIANTS = ladder(load_preset())[:3]


def at(value: float) -> Interval:
    return Interval(median=value, low=0.99 * value, high=1.01 * value)


def cell(place: int, error: float, time: float) -> Cell:
    rounding = Rounding(rms=1e-8 * (place + 1), largest=1e-6, frames=[1e-8])
    return Cell(
        variant=VARIANTS[place].name, errors={"mse": spread([error, error])}, rounding=rounding, wall=at(time),
        device=None, least=time, ratio=at(time), dominated_by={},
    )  # fmt: skip


def sequence(name: str, errors: tuple[float, float, float], *, noisy: bool = False) -> Measured:
    cells = [cell(place, error, 1.0 + place) for place, error in enumerate(errors)]
    return Measured(
        name=name, folder=name, frames=[0, 1], width=37, height=23, effects="", cells=cells, yardstick=[], noisy=noisy,
        control=at(1.0), floor=0.1, truth_noise=None, mean_noise=None, stages={"resolve": 1.0},
    )  # fmt: skip


def accuracy(*sequences: Measured) -> Accuracy:
    where = Environment(
        date="", system="", cpu="", cores=2, cpu_flags=[], load_before=0.0, load_after=0.0, device="", libraries={},
        kernels_sha256="", options=[],
    )  # fmt: skip
    return Accuracy(environment=where, metrics=["mse"], rounds=3, variants=VARIANTS, sequences=list(sequences))


def test_errors_are_geometric_means_over_the_default() -> None:
    result = accuracy(sequence("one", (1.0, 4.0, 0.5)), sequence("two", (2.0, 2.0, 1.0)))
    best, default, worst = overall(result, "mse")
    assert [row.variant for row in (best, default, worst)] == [VARIANTS[place].name for place in (2, 0, 1)]
    assert (best.error, default.error, worst.error) == pytest.approx((0.5, 1.0, 2.0))
    assert (best.best_of, default.best_of, worst.best_of) == (2, 0, 0)
    assert worst.errors == [4.0, 1.0]
    assert (best.time, default.time) == pytest.approx((3.0, 1.0))
    assert best.rounding == pytest.approx(3e-8)


def test_nothing_is_said_of_times_where_any_is_noise() -> None:
    result = accuracy(sequence("one", (1.0, 4.0, 0.5)), sequence("two", (2.0, 2.0, 1.0), noisy=True))
    assert {row.time for row in overall(result, "mse")} == {None}
    assert table(result, "mse").count("too noisy to rank") == 3


def test_a_sequence_without_error_counts_for_nothing() -> None:
    worst = overall(accuracy(sequence("one", (0.0, 4.0, 0.0)), sequence("two", (2.0, 8.0, 1.0))), "mse")[-1]
    assert worst.errors == [None, 4.0]
    assert worst.error == pytest.approx(4.0)


def test_the_figure_is_drawn_for_several_sequences_alone(tmp_path: Path) -> None:
    one, two = sequence("one", (1.0, 4.0, 0.5)), sequence("two", (0.0, 2.0, 1.0))
    assert "overview.png" not in {path.name for path in write_plots(accuracy(one), tmp_path)}
    assert {"overview.png", "overview.svg"} <= {path.name for path in write_plots(accuracy(one, two), tmp_path)}
    assert (tmp_path / "overview.png").read_bytes().startswith(b"\x89PNG")
