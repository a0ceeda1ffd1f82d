"""``cltaa bench accuracy``: errors in both axes, times, what is kept, and other ways to run the tasks."""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cltaa.bench.distribution import load, path_of, run_all, save
from cltaa.bench.ladder import ladder
from cltaa.bench.programs import Program, dearest_first, programs_needed, programs_of
from cltaa.bench.variant_errors import Errors, Rounding, Task, run_task
from cltaa.bench.variant_times import enlarged
from cltaa.build import Real, Storage
from cltaa.cli import main
from cltaa.device import Device
from cltaa.errors import DataError, InputMissing
from cltaa.exr import write_frame
from cltaa.launch import DeviceLauncher
from cltaa.presets import load_preset, override, preset_names
from cltaa.resolve import Resolver
from cltaa.shape import Shape
from cltaa.sources import open_sequence
from cltaa.timed_resolve import resolve_job, timed_frames
from tests.kernels.test_resolve import hard_frames
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_camera, make_frame, write_images, write_sequence

FRAMES = 4


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four small frames, a truth, and a yardstick of two samples whose time is known."""
    folder = write_sequence(tmp_path_factory.mktemp("bench") / "seq", FRAMES, reference=True)
    truth = [np.full((23, 37, 3), 0.3 + number / 100, np.float32) for number in range(FRAMES)]
    write_images(folder / "reference-2", truth, name="synthetic")
    return folder


def task(sequence: Path, place: int = 0, **changes: object) -> Task:
    variant = msgspec.structs.replace(ladder(load_preset())[place], **changes)
    return Task(sequence=str(sequence), variant=variant, device=None, metrics=("mse",), rounding_frames=3)


def test_rounding_is_that_of_the_numbers(sequence: Path) -> None:
    single = run_task(task(sequence)).rounding
    half = run_task(task(sequence, storage=Storage.HALF)).rounding
    assert single is not None
    assert half is not None
    # Half an ulp of the storage each frame, relative to the image: 2^-25 and 2^-12, and a few of them.
    assert 22.0 < single.bits < 26.5  # seen: 24.6
    assert 10.0 < half.bits < 13.5  # seen: 11.9
    assert len(single.frames) == 3
    # Doubles throughout but for the count of samples, which stays in float: what is left is its rounding, in weights.
    double = run_task(task(sequence, storage=Storage.DOUBLE, real=Real.DOUBLE)).rounding
    assert double is not None
    assert double.bits > single.bits + 2.0
    assert single.largest >= max(single.frames)


def test_the_double_twin_is_the_same_algorithm(sequence: Path) -> None:
    # If the twin computed anything else, strict float would be further away than rounding can explain.
    for place, variant in enumerate(ladder(load_preset())):
        if variant.group in {"history_filter", "neighbourhood", "rectify"}:
            rounding = run_task(task(sequence, place)).rounding
            assert rounding is not None
            assert rounding.bits > 20.0, variant.name


def test_error_is_that_against_the_truth(sequence: Path) -> None:
    found = run_task(task(sequence))
    assert len(found.frames["mse"]) == FRAMES
    assert found.frames["mse"][0] > 0.01  # random colour against grey
    assert found.pictures["picture"].startswith(b"\x89PNG")


def test_a_sequence_without_truth_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputMissing, match="no truth to measure against"):
        run_task(task(write_sequence(tmp_path / "bare", 2)))


def test_a_key_tells_tasks_apart(sequence: Path, tmp_path: Path) -> None:
    first = task(sequence)
    other = msgspec.structs.replace(first, metrics=("flip",))
    assert first.key() == task(sequence).key()
    assert len({first.key(), other.key(), task(sequence, strict=True).key(), task(tmp_path).key()}) == 4


def test_a_key_tells_devices_apart(sequence: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = set()
    for wish in ("one", "another"):  # by the variable, where the task names none
        monkeypatch.setenv("CLTAA_DEVICE", wish)
        keys |= {msgspec.structs.replace(task(sequence), device=device).key() for device in (None, "0")}
    assert len(keys) == 3


def test_results_come_back_as_they_were(sequence: Path, tmp_path: Path) -> None:
    errors = Errors(
        frames={"mse": [0.1, 1 / 3]}, rounding=Rounding(rms=1e-9, largest=1e-8, frames=[1e-9]), pictures={"p": b"\0x"}
    )
    assert load(task(sequence), tmp_path) is None
    save(task(sequence), errors, tmp_path)
    assert load(task(sequence), tmp_path) == errors
    path_of(task(sequence), tmp_path).write_bytes(b"\xc1")
    with pytest.raises(DataError, match="not the result of a task"):
        load(task(sequence), tmp_path)


def test_spawned_processes_find_the_same(sequence: Path, tmp_path: Path) -> None:
    tasks = [task(sequence), task(sequence, storage=Storage.HALF)]
    for folder, jobs in (("one", 1), ("two", 2)):
        assert {each.key() for each in run_all(tasks, tmp_path / folder, jobs=jobs)} == {each.key() for each in tasks}
    for each in tasks:
        assert load(each, tmp_path / "one") == load(each, tmp_path / "two")


def test_command(sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "accuracy", str(sequence), "-o", str(tmp_path), "--only", "storage", "--rounds", "3"]
    arguments += ["--metrics", "mse,psnr", "--rounding-frames", "2", "--patience", "0", "--pixels", "3000"]
    assert main([*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((tmp_path / "accuracy.json").read_text())
    (measured,) = result["sequences"]
    kept_in = ["half", "half-stochastic", "double"]
    assert [cell["variant"] for cell in measured["cells"]] == ["default", *(f"storage: {kind}" for kind in kept_in)]
    assert [yard["samples"] for yard in measured["yardstick"]] == [1, 2]
    assert measured["cells"][0]["ratio"]["median"] == 1.0
    assert measured["timed_pixels"] == 2 * 37 * 2 * 23
    assert set(measured["stages"]) >= {"upload", "resolve", "extend_edges", "read back"}
    for cell in measured["cells"]:
        assert cell["errors"]["mse"]["p5"] <= cell["errors"]["mse"]["mean"] <= cell["errors"]["mse"]["largest"]
        assert len(cell["errors"]["psnr"]["frames"]) == FRAMES
    if measured["noisy"]:
        assert not any(cell["dominated_by"] for cell in measured["cells"])
    rows = list(csv.DictReader((tmp_path / "accuracy.csv").read_text().splitlines()))
    assert [row["group"] for row in rows] == ["default", *["storage"] * 3, *["supersampling"] * 2]
    assert float(rows[0]["mse"]) == measured["cells"][0]["errors"]["mse"]["mean"]

    finished = {path: path.stat().st_mtime_ns for path in (tmp_path / "tasks").iterdir()}
    assert main(arguments) == 0
    assert "default" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "tasks").iterdir()} == finished


def test_a_render_farm_gets_one_line_a_task(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["bench", "accuracy", str(sequence), "-o", str(tmp_path), "--only", "reject", "--rounding-frames", "0"]
    monkeypatch.setattr("sys.argv", ["cltaa", *arguments, "--list"])
    assert main([*arguments, "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-2:] for line in lines] == [["--task", "0"], ["--task", "1"]]
    assert all(line.startswith("cltaa bench accuracy ") for line in lines)
    assert "--list" not in lines[0]
    assert main(lines[1].split()[1:]) == 0
    assert len(list((tmp_path / "tasks").iterdir())) == 1
    assert main([*arguments, "--task", "2"]) == 64
    assert main([*arguments[:-4], "--only", "colour"]) == 64
    assert main([*arguments[:-4], "--variant", "colour"]) == 64


def test_what_draws_the_report_is_missed_before_the_work(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    assert main(["bench", "accuracy", str(sequence), "-o", str(tmp_path), "--only", "reject"]) == 64
    assert "pip install 'cltaa[bench]'" in capsys.readouterr().err
    assert not (tmp_path / "tasks").exists()


def test_a_limit_of_time_leaves_whole_sequences_out(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    other = write_sequence(tmp_path / "other", 3, reference=True)
    options = ["-o", str(tmp_path / "out"), "--only", "reject", "--rounds", "3", "--rounding-frames", "0", "--json"]
    options += ["--metrics", "mse", "--patience", "0", "--pixels", "1"]
    assert main(["bench", "accuracy", str(other), *options, "--time-limit", "1e-9"]) == 75
    assert "no sequence was finished within 1e-09 s" in capsys.readouterr().err
    assert main(["bench", "accuracy", str(other), *options, "--jobs", "2"]) == 0
    assert json.loads(capsys.readouterr().out)["missing"] == []
    monkeypatch.setattr("cltaa.bench.accuracy.ERRORS_SHARE", 0.0)  # no error is begun
    both = ["bench", "accuracy", str(sequence), str(other), *options]
    assert main([*both, "--time-limit", "600"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["missing"] == ["seq"]
    assert [measured["name"] for measured in result["sequences"]] == ["other"]
    assert "left out" in (tmp_path / "out" / "index.html").read_text()
    assert main(both) == 0  # goes on: what was timed is not timed again
    again = json.loads(capsys.readouterr().out)
    assert again["missing"] == []
    assert again["sequences"][1] == result["sequences"][0]
    assert again["environment"]["units"] == DeviceLauncher(None).device.cl_device.max_compute_units
    before = set((tmp_path / "out" / "times").iterdir())
    monkeypatch.setattr("cltaa.bench.accuracy.processors", lambda: 77)  # what was timed on others is no answer here
    assert main(both) == 0
    assert len(set((tmp_path / "out" / "times").iterdir()) - before) == 2


def built(launcher: DeviceLauncher) -> set[Program]:
    return {Program(kernel=kernel, build=build) for kernel, build in launcher._kernels}


@pytest.mark.parametrize("one_size", [False, True])
def test_what_is_built_first_is_all_that_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_size: bool
) -> None:
    shape = Shape(lanes=1, rows=5, group=(8, 1), one_size=one_size)
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    folder = write_sequence(tmp_path / "seq", 4, reference=True, motion=one_size)
    for number in range(4):  # the camera stands from the second on: the last two frames alone do not tell that it moved
        camera = make_camera((0.1 * min(number, 1), 0.0, 5.0), WIDTH / HEIGHT)
        frame = make_frame(
            number, camera=camera, effects=frozenset(), motion=one_size, alpha=one_size, reactive=one_size
        )
        write_frame(folder / f"synthetic.{number:04d}.exr", frame)
    every = [task(folder, choices=load_preset(name).choices) for name in ("t0", "t3-200", "t5")]
    planned = programs_of(every, DeviceLauncher(None), 3000)
    run = set[Program]()
    for each in every:
        launcher = DeviceLauncher(None)
        monkeypatch.setattr("cltaa.bench.variant_errors.opened", lambda _, own=launcher: own)
        run_task(each)
        frames = [enlarged(frame, 2) for frame in timed_frames(open_sequence(folder))]
        resolve_job("timed", each.variant.resolver(launcher), frames)
        run |= built(launcher)
    assert planned == run


def test_a_program_of_many_sequences_is_built_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, same = (write_sequence(tmp_path / name, 3, reference=True) for name in ("one", "same"))
    moving = write_sequence(tmp_path / "moving", 3, reference=True, motion=True)
    of_two = [task(folder, place) for folder in (one, same) for place in (0, 1)]
    found: set[Program] = set()
    assert list(programs_needed(of_two, DeviceLauncher(None), None, found)) == [str(one), str(same)]
    assert found == programs_of([task(one, place) for place in (0, 1)], DeviceLauncher(None))
    assert found < found | programs_of([task(moving)], DeviceLauncher(None))
    in_order = dearest_first(found)
    assert set(in_order) == found
    assert in_order[-1].kernel == "extend_edges"
    cache = tmp_path / "cache"
    monkeypatch.setenv("POCL_CACHE_DIR", str(cache))
    arguments = ["bench", "accuracy", str(one), str(same), "-o", str(tmp_path / "out"), "--variant", "t0"]
    assert main([*arguments, "--jobs", "2", "--build-only"]) == 0
    count = int(capsys.readouterr().out.split()[0])
    assert len(list((cache / "locks").iterdir())) == count
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("preset", ["t4", "t5"])
def test_what_is_timed_gathers_from_as_many_frames_as_it_keeps(preset: str) -> None:
    few = override(load_preset(preset), {"frames_kept": 3})
    *_, frame, last = hard_frames(count=5)
    _, image = resolve_job("job", Resolver(few), [frame, last])
    resolver = Resolver(few)
    for ago in (3, 2, 1, 0):
        resolver.resolve(dataclasses.replace(frame, index=frame.index - ago))
    assert (bits(image) == bits(resolver.resolve(last))).all()
    fresh = Resolver(few)
    fresh.resolve(frame)
    assert (bits(image) != bits(fresh.resolve(last))).any()


def test_every_rung_has_its_twin_in_double(tmp_path: Path) -> None:
    # Whatever is added to the choices or the presets must run on the ladder, in both axes.
    folder = write_sequence(tmp_path / "seq", 3, reference=True)
    for variant in ladder(load_preset(), [load_preset(name) for name in preset_names()]):
        run = Task(sequence=str(folder), variant=variant, device="numpy", metrics=("mse",), rounding_frames=2)
        rounding = run_task(run).rounding
        assert rounding is not None
        assert rounding.bits > (10.0 if variant.storage is not Storage.FLOAT else 20.0), variant.name


def test_what_is_finished_outlives_an_error(sequence: Path, tmp_path: Path) -> None:
    bare = write_sequence(tmp_path / "bare", 1)
    tasks = [task(sequence), *(task(bare, name=str(number)) for number in range(3))]
    with pytest.raises(InputMissing):
        list(run_all(tasks, tmp_path / "out", jobs=2))
    assert load(tasks[1], tmp_path / "out") is None


def test_an_enlarged_frame_moves_as_far_in_pictures() -> None:
    frame = make_frame(1, motion=True, alpha=True)
    large = enlarged(frame, 3)
    assert (large.width, large.height) == (3 * frame.width, 3 * frame.height)
    np.testing.assert_array_equal(large.colour[1::3, 1::3], frame.colour)
    assert large.motion is not None
    assert frame.motion is not None
    np.testing.assert_array_equal(large.motion[::3, ::3], 3 * frame.motion)
    assert large.alpha is not None
    assert large.alpha.shape == large.depth.shape
