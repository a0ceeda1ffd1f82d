"""``cltaa resolve --budget-ms``: the best that is known to be fast enough, and why."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from cltaa.cli import main
from cltaa.core.backend import launcher_for
from cltaa.core.build import Storage
from cltaa.core.presets import load_preset
from cltaa.errors import DataError, UsageError
from cltaa.lab.bench.accuracy.budget import Candidate, Remembered, choose, path_for, remember
from cltaa.lab.bench.accuracy.ladder import Variant, ladder
from cltaa.lab.bench.accuracy.results import Accuracy, Cell, MeasuredSequence, spread
from cltaa.lab.bench.environment import environment
from cltaa.lab.timing import Interval
from tests.sequence_factory import write_sequence

DEVICE = "a device of this test"


def write_remembered(device: str, rows: list[tuple[int, float, float]], *, noisy: bool = False) -> list[Variant]:
    """Remember variants of the ladder as (place, ms a megapixel, error over the default's)."""
    every = ladder(load_preset())
    candidates = [Candidate(variant=every[place], ms_per_megapixel=ms, error=error) for place, ms, error in rows]
    remembered = Remembered(
        device=device, date="now", metric="mse", sequences=["here"], noisy=noisy, candidates=candidates
    )
    path = path_for(device)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.encode(remembered))
    return [every[place] for place, _, _ in rows]


def test_the_least_error_that_fits() -> None:
    slow, middle, fast = write_remembered(DEVICE, [(0, 10.0, 1.0), (1, 5.0, 1.5), (2, 1.0, 3.0)])
    assert choose(DEVICE, 20.0, 1920, 1080).variant == middle  # 2.07 megapixels: 20.7, 10.4 and 2.1 ms
    assert choose(DEVICE, 20.8, 1920, 1080).variant == slow
    assert choose(DEVICE, 3.0, 1920, 1080).variant == fast
    why = choose(DEVICE, 20.0, 1920, 1080).why
    assert "10.4 of 20 ms" in why
    assert "1.500 times the mse of default" in why
    assert "best of 2 that fit of 3" in why
    assert "noisy" not in why


def test_noise_is_said() -> None:
    write_remembered(DEVICE, [(0, 1.0, 1.0)], noisy=True)
    assert "noisy" in choose(DEVICE, 5.0, 100, 100).why


def test_nothing_known_nothing_fast_enough_nothing_readable() -> None:
    with pytest.raises(UsageError, match=r"nothing was measured on another device yet.*measure first"):
        choose("another device", 5.0, 100, 100)
    write_remembered(DEVICE, [(0, 10.0, 1.0)])
    with pytest.raises(UsageError, match=r"no known variant is fast enough \(expected 20\.7 ms or more, found 20 ms"):
        choose(DEVICE, 20.0, 1920, 1080)
    path_for(DEVICE).write_text("{")
    with pytest.raises(DataError, match="not a measurement"):
        choose(DEVICE, 20.0, 1920, 1080)


def test_resolve_takes_it_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence = write_sequence(tmp_path / "seq", 2)
    own = launcher_for(None).description
    places = {variant.name: place for place, variant in enumerate(ladder(load_preset()))}
    (half,) = write_remembered(own, [(places["storage: half"], 1.0, 1.1)])
    assert half.storage is Storage.HALF
    assert main(["resolve", str(sequence), "-o", str(tmp_path / "out"), "--budget-ms", "4", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["preset"] == "storage: half"
    assert "storage: half: 0.000851 of 4 ms a frame" in captured.err
    (tmp_path / "x.toml").write_text("box_scale_static = 2.0\n")
    for chosen in (["--config", str(tmp_path / "x.toml")], ["--preset", "basic"]):
        assert main(["resolve", str(sequence), "-o", str(tmp_path / "o"), "--budget-ms", "4", *chosen]) == 64
        assert "--budget-ms chooses the preset itself" in capsys.readouterr().err
    command = ["resolve", str(sequence), "-o", str(tmp_path / "o"), "--budget-ms", "4", "--set", "box_scale_static=2"]
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["preset"] == "storage: half with box_scale_static=2"
    path_for(own).unlink()


def test_a_measurement_is_remembered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path_for(launcher_for(None).description).unlink(missing_ok=True)  # of another test, and perhaps larger
    sequence = write_sequence(tmp_path / "seq", 3, reference=True)
    arguments = ["bench", "accuracy", str(sequence), "-o", str(tmp_path / "report"), "--pixels", "1"]
    arguments += ["--pictured", "0"]
    arguments += ["--variant", "build: strict", "--variant", "dilation: closest"]
    arguments += ["--preset", "basic"]  # whose kernels are built soonest
    assert main([*arguments, "--rounds", "3", "--patience", "0", "--rounding-frames", "0", "--metrics", "mse"]) == 0
    capsys.readouterr()
    remembered = msgspec.json.decode(path_for(launcher_for(None).description).read_bytes(), type=Remembered)
    assert [row.variant.name for row in remembered.candidates] == ["basic", "dilation: closest"]
    assert remembered.candidates[0].error == 1.0
    assert remembered.sequences == ["seq"]


def measured(sequences: int, size: int, variants: int, date: str) -> Accuracy:
    """A measurement of so many sequences of square frames, of the first variants of the ladder."""
    interval = Interval(median=1.0, low=1.0, high=1.0)
    errors = {"mse": spread("mse", [0.1])}
    names = ladder(load_preset())[:variants]
    cells = [
        Cell(
            variant=variant.name,
            errors=errors,
            rounding=None,
            wall=interval,
            device=None,
            least=1.0,
            ratio=interval,
            dominated_by={},
        )
        for variant in names
    ]
    one = MeasuredSequence(
        name="seq",
        folder="seq",
        frames=[0],
        width=size,
        height=size,
        effects="",
        cells=cells,
        yardstick=[],
        noisy=False,
        control=interval,
        floor=1.0,
        truth_noise=None,
        mean_noise=None,
        stages={},
    )
    place = msgspec.structs.replace(environment(f"{DEVICE} too", 0.0), date=date)
    return Accuracy(environment=place, metrics=["mse"], rounds=3, variants=names, sequences=[one] * sequences)


def test_a_smaller_measurement_does_not_take_the_place_of_a_larger_one() -> None:
    path = path_for(f"{DEVICE} too")
    path.unlink(missing_ok=True)

    def kept() -> str:
        return msgspec.json.decode(path.read_bytes(), type=Remembered).date

    assert remember(measured(3, 32, 3, "first")) is None
    for less, told in (
        ((1, 32, 3), "1 sequence where 3 are kept, measured first; delete"),
        ((9, 32, 2), "2 variants where 3 are kept"),
        ((9, 16, 3), "256 pixels where 1024 are kept"),
        ((1, 16, 3), "1 sequence where 3 are kept and 256 pixels where 1024 are kept"),
    ):
        assert told in (remember(measured(*less, "later")) or "")
        assert kept() == "first"
    assert remember(measured(3, 32, 3, "again")) is None
    assert kept() == "again"
    path.write_text("{")  # damaged, or of another version
    assert remember(measured(1, 8, 1, "anew")) is None
    assert kept() == "anew"


def test_a_measurement_by_a_score_alone_is_told_and_not_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence = write_sequence(tmp_path / "seq", 3, reference=True)
    arguments = ["bench", "accuracy", str(sequence), "-o", str(tmp_path / "report"), "--variant", "basic"]
    arguments += ["--preset", "basic", "--pixels", "1", "--pictured", "0"]
    kept = path_for(launcher_for(None).description)
    before = kept.read_bytes() if kept.exists() else b""
    assert main([*arguments, "--rounds", "3", "--patience", "0", "--rounding-frames", "0", "--metrics", "psnr"]) == 0
    said = capsys.readouterr()
    assert "look at" in said.out
    assert "not kept for resolve --budget-ms" in said.err
    assert (kept.read_bytes() if kept.exists() else b"") == before
