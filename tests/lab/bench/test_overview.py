"""Many sequences in one table."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from cltaa.core.presets import load_preset
from cltaa.lab.bench.accuracy.measurement import Accuracy, Measured, MeasuredSequence, spread
from cltaa.lab.bench.accuracy.report import overall, table, write_report
from cltaa.lab.bench.cells import Rounding
from cltaa.lab.bench.variants import ladder
from cltaa.lab.timing import Environment, Interval

VARIANTS = ladder(load_preset())[:3]


def at(value: float) -> Interval:
    return Interval(median=value, low=0.99 * value, high=1.01 * value)


def cell(place: int, error: float, time: float) -> Measured:
    rounding = Rounding(rms=1e-8 * (place + 1), largest=1e-6, frames=[1e-8])
    return Measured(
        variant=VARIANTS[place].name,
        errors={"mse": spread("mse", [error, error])},
        rounding=rounding,
        time=at(time),
        ratio=at(time),
    )


def sequence(
    name: str, errors: tuple[float, float, float], *, noisy: bool = False, slower: float = 1.0
) -> MeasuredSequence:
    cells = [cell(place, error, slower * (1.0 + place)) for place, error in enumerate(errors)]
    return MeasuredSequence(
        name=name,
        folder=name,
        frames=[0, 1],
        width=37,
        height=23,
        effects="",
        cells=cells,
        yardstick=[],
        noisy=noisy,
        control=at(1.0),
        floor=0.1,
        truth_noise=None,
        mean_noise=None,
        stages={"resolve": 1.0},
    )


def accuracy(*sequences: MeasuredSequence) -> Accuracy:
    where = Environment(
        date="",
        system="",
        cpu="",
        cores=2,
        cpu_flags=[],
        load_before=0.0,
        load_after=0.0,
        device="",
        libraries={},
        kernels_sha256="",
        options=[],
    )
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


def test_times_of_noise_count_for_nothing() -> None:
    quiet, noise = sequence("one", (1.0, 4.0, 0.5)), sequence("two", (2.0, 2.0, 1.0), noisy=True, slower=7.0)
    assert [row.time for row in overall(accuracy(quiet, noise), "mse")] == pytest.approx([3.0, 1.0, 2.0])
    text = table(accuracy(quiet, noise), ["mse"])
    assert "without those that were too noisy to rank: two." in text
    assert "| 2.000 | 1.980 to 2.020 |" in text
    assert {row.time for row in overall(accuracy(noise), "mse")} == {None}
    assert table(accuracy(noise), ["mse"]).count("too noisy to rank | –") == 3


def test_each_sequence_has_the_presets_in_a_row() -> None:
    """Error and time over the default's; what is no preset stands in the table above alone."""
    still, noise = sequence("still", (2.0, 1.0, 5.0)), sequence("noise", (0.0, 1.0, 5.0), noisy=True)
    result = accuracy(still, noise)
    assert "By sequence" not in table(result, ["mse"])
    preset = msgspec.structs.replace(VARIANTS[1], group="preset")
    text = table(msgspec.structs.replace(result, variants=[VARIANTS[0], preset, VARIANTS[2]]), ["mse"])
    rows = text.split("By sequence, mse and time of each preset over those of default:\n\n")[1].splitlines()
    assert rows[0] == f"| sequence | default: mse | ms a megapixel | {preset.name} |"
    assert rows[2:] == ["| still | 2 | 1 | 0.50, 2 |", "| noise | 0 | noisy | –, noisy |"]


def test_no_name_breaks_the_table() -> None:
    """Neither that of what all is compared with, nor of a sequence, in the table or in the text around it."""
    odd = msgspec.structs.replace(VARIANTS[0], name="a<b>|c")
    result = accuracy(sequence("a<b>|c", (1.0, 4.0, 0.5)), sequence("noise<b>|c", (1.0, 4.0, 0.5), noisy=True))
    variants = [odd, msgspec.structs.replace(VARIANTS[1], group="preset"), VARIANTS[2]]
    text = table(msgspec.structs.replace(result, variants=variants), ["mse"])
    assert "a&lt;b&gt;&#124;c" in text
    assert "<" not in text
    assert {line.count("|") for line in text.splitlines() if line} == {0, 5, 8}


def test_a_sequence_without_error_counts_for_nothing() -> None:
    worst = overall(accuracy(sequence("one", (0.0, 4.0, 0.0)), sequence("two", (2.0, 8.0, 1.0))), "mse")[-1]
    assert worst.errors == [None, 4.0]
    assert worst.error == pytest.approx(4.0)


def test_a_report_keeps_no_table_of_the_one_before(tmp_path: Path) -> None:
    one = sequence("one", (1.0, 4.0, 0.5))
    errors = {"psnr": spread("psnr", [30.0, 30.0])}
    cells = [msgspec.structs.replace(each, errors=errors) for each in one.cells]
    falling = accuracy(one)
    rising = msgspec.structs.replace(falling, metrics=["psnr"], sequences=[msgspec.structs.replace(one, cells=cells)])
    files = {"accuracy.json", "accuracy.csv", "index.html", "notes.md"}
    for name in ("notes.md", "overview.md"):
        (tmp_path / name).write_text("the user's own")
    write_report(rising, tmp_path, "page")
    assert (tmp_path / "overview.md").read_text() == "the user's own"
    write_report(falling, tmp_path, "page")
    assert (tmp_path / "overview.md").read_text() == table(falling, ["mse"])
    write_report(rising, tmp_path, "page")
    assert {path.name for path in tmp_path.iterdir()} == files
