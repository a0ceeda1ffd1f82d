"""Many sequences in one figure and one table."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cltaa.cli import main
from cltaa.core.presets import load_preset
from cltaa.errors import DataError
from cltaa.lab.bench.accuracy import figures
from cltaa.lab.bench.accuracy.figures import import_pyplot, overall, table, write_plots
from cltaa.lab.bench.accuracy.measurement import Accuracy, Measured, MeasuredSequence, spread
from cltaa.lab.bench.accuracy.report import read_report, write_report
from cltaa.lab.bench.cells import Rounding
from cltaa.lab.bench.variants import ladder
from cltaa.lab.timing import Environment, Interval

VARIANTS = ladder(load_preset())[:3]


@pytest.fixture
def svg_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each figure once."""
    monkeypatch.setattr("cltaa.lab.bench.accuracy.figures.FORMATS", ("svg",))


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


def test_the_figure_is_drawn_for_several_sequences_alone(tmp_path: Path) -> None:
    one, two = sequence("one", (1.0, 4.0, 0.5)), sequence("two", (0.0, 2.0, 1.0))
    assert not list(write_plots(accuracy(one), tmp_path, 0))
    assert [path.name for path in write_plots(accuracy(one, two), tmp_path, 0)] == ["overview.svg", "overview.png"]
    assert (tmp_path / "overview.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("svg_alone")
@pytest.mark.parametrize(("metric", "wrong"), [("mse", 0), ("mse", 1), ("psnr", 0), ("psnr", 3)])
def test_what_errs_nowhere_has_no_place_on_a_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, metric: str, wrong: int
) -> None:
    """Nor does it warn, which tests take for an error: where none errs, where one does, where all do in some frames."""
    one = sequence("one", (1.0, 4.0, 0.5))
    none, some = {"mse": (0.0, 0.0), "psnr": (math.inf, math.inf)}, {"mse": (0.0, 0.1), "psnr": (math.inf, 20.0)}
    cells = [
        msgspec.structs.replace(cell, errors={metric: spread(metric, (some if place < wrong else none)[metric])})
        for place, cell in enumerate(one.cells)
    ]
    result = msgspec.structs.replace(accuracy(msgspec.structs.replace(one, cells=cells)), metrics=[metric])
    drawn = []
    draw = figures.front_figure

    def kept(*given: Any) -> Any:
        drawn.append(draw(*given))
        return drawn[0]

    monkeypatch.setattr(figures, "front_figure", kept)
    assert len(list(write_plots(result, tmp_path))) == 1
    assert len(drawn[0].axes[0].containers) == wrong


def test_the_variants_alone_have_numbers_between_the_powers_of_ten() -> None:
    """All of error, of which they seldom have two powers; of time as many as have room."""
    figure = figures.front_figure(import_pyplot(), sequence("one", (1.0, 4.0, 0.5)), "mse", 0.1)
    near = figure.axes[1]
    times, errors = ({f"{place:g}"[-1] for place in axis.get_minorticklocs()} for axis in (near.xaxis, near.yaxis))
    assert (times, errors) == ({*"25"}, {*"23456789"})


@pytest.mark.usefixtures("svg_alone")
def test_a_report_keeps_nothing_of_the_one_before(tmp_path: Path) -> None:
    one, two = sequence("one", (1.0, 4.0, 0.5)), sequence("two", (0.0, 2.0, 1.0))
    (tmp_path / "index.html").touch()
    write_report(accuracy(one), tmp_path, 0)
    assert (tmp_path / "index.html").exists()  # a page that no report left
    write_report(accuracy(one, two), tmp_path, pages={"index.html": "one, two"})
    assert (tmp_path / "overview.md").is_file()
    (tmp_path / "notes.md").touch()
    write_report(accuracy(two), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "front-two.svg",
        "accuracy.json",
        "accuracy.csv",
        "overview.md",
        "notes.md",
    }


@pytest.mark.parametrize("text", ["{", "[" * 100_000])
def test_a_file_that_is_no_report_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "accuracy.json").write_text(text)
    with pytest.raises(DataError, match=r"accuracy\.json: not the numbers of a report"):
        read_report(tmp_path)


@pytest.mark.usefixtures("svg_alone")
def test_reports_of_one_device_become_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = accuracy(sequence("one", (1.0, 4.0, 0.5))), accuracy(sequence("two", (2.0, 2.0, 1.0)))
    folders = [report(tmp_path / name, result) for name, result in (("a", one), ("b", two))]
    assert main(["bench", "overview", *folders, "-o", str(tmp_path / "both"), "--pictured", "1"]) == 0
    text = capsys.readouterr().out
    assert text == table(accuracy(*one.sequences, *two.sequences), ["mse"])
    assert text == (tmp_path / "both" / "overview.md").read_text()
    assert [measured.name for measured in read_report(tmp_path / "both").sequences] == ["one", "two"]
    names = {path.name for path in (tmp_path / "both").iterdir()}
    assert {"overview.svg", "accuracy.csv"} <= names
    assert {name for name in names if name.startswith("front-")} == {"front-one.svg"}
    assert main(["bench", "overview", folders[0], "-o", str(tmp_path / "alone"), "--pictured", "0"]) == 0
    assert (tmp_path / "alone" / "overview.md").read_text() == table(one, ["mse"])


def test_reports_that_cannot_be_one_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = accuracy(sequence("one", (1.0, 4.0, 0.5))), accuracy(sequence("two", (2.0, 2.0, 1.0)))
    elsewhere = msgspec.structs.replace(two, environment=msgspec.structs.replace(two.environment, device="another"))
    threads = msgspec.structs.replace(two, environment=msgspec.structs.replace(two.environment, units=1))
    changed = msgspec.structs.replace(two, variants=[msgspec.structs.replace(each, strict=True) for each in VARIANTS])
    results = enumerate((one, elsewhere, one, threads, changed))
    folders = [report(tmp_path / str(place), result) for place, result in results]
    for wrong, words in (
        (folders[1], "another device than in"),
        (folders[2], "the sequence one is in two reports"),
        (folders[3], "another number of compute units than in"),
        (folders[4], f"other parameters of {VARIANTS[0].name} than in {folders[0]}; measure both with the same"),
    ):
        assert main(["bench", "overview", folders[0], wrong, "-o", str(tmp_path / "out")]) == 65
        assert words in capsys.readouterr().err
    rising = report(tmp_path / "rising", msgspec.structs.replace(one, metrics=["psnr"]))
    assert main(["bench", "overview", rising, "-o", str(tmp_path / "out")]) == 64
    assert "no error to compare by: no metric that falls with it (found psnr)" in capsys.readouterr().err
    (tmp_path / "1" / "accuracy.json").write_text("{}")
    assert main(["bench", "overview", folders[1], "-o", str(tmp_path / "out")]) == 65
    assert main(["bench", "overview", str(tmp_path / "none"), "-o", str(tmp_path / "out")]) == 66
    assert not (tmp_path / "out").exists()


def report(folder: Path, result: Accuracy) -> str:
    folder.mkdir()
    (folder / "accuracy.json").write_bytes(msgspec.json.encode(result))
    return str(folder)
