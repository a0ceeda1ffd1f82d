"""Frames of other tools are measured as cltaa's own: the same pixels, otherwise written, have the same scores."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cltaa.cli import main
from cltaa.commands.bench_accuracy import print_accuracy
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.frame import Frame, parse_effects
from cltaa.inputs.open import Reading, readings
from cltaa.lab.bench.accuracy.measurement import Accuracy, tasks_of, yardstick_errors
from cltaa.lab.bench.cases import REDRAWN
from cltaa.lab.bench.cells import Judging, run, task_of
from cltaa.lab.bench.variants import ladder
from cltaa.lab.timing import timed_numbers
from cltaa.lab.tune import key_of
from tests.inputs.foreign import frames, side_text, write_blender, write_own
from tests.sequence_factory import write_frames, write_sequence

COUNT = 4
VARIANTS = ladder(load_preset("fast"))[:1]
JUDGING = Judging(metrics=("mse",))


@pytest.fixture
def made() -> list[Frame]:
    return frames(COUNT)


@pytest.fixture
def own(made: list[Frame], tmp_path: Path) -> Path:
    return with_truth(write_own, tmp_path / "own", made)


@pytest.fixture
def shot(made: list[Frame], tmp_path: Path) -> Path:
    """The same as another tool writes it, with matrices and jitter beside it."""
    folder = with_truth(write_blender, tmp_path / "shot", made)
    (folder / "camera.txt").write_text(side_text(made))
    return folder


def with_truth(write: Any, folder: Path, made: list[Frame]) -> Path:
    """Frames, a truth, a yardstick and frames drawn again, all written by ``write``."""
    write(folder, made)
    for name, gain in (("reference", 0.8), ("reference-2", 0.9), (REDRAWN, 0.7)):
        write(folder / name, [replace(frame, colour=frame.colour * np.float32(gain)) for frame in made])
    return folder


def judged(capsys: pytest.CaptureFixture[str], folder: Path, work: Path, *options: str) -> Any:
    arguments = ["bench", "quality", "--sequence", str(folder), "--preset", "fast", "--settled", "1"]
    assert main([*arguments, "--work", str(work), "--device", "numpy", "--json", *options]) == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_quality_is_that_of_the_same_frames(
    own: Path, shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    expected, _ = judged(capsys, own, tmp_path / "work")
    camera = ["--camera", str(shot / "camera.txt")]
    found, said = judged(capsys, shot, tmp_path / "work", *camera, "--pictures", str(tmp_path / "pictures"))
    assert found["rows"][0]["presets"] == expected["rows"][0]["presets"]
    assert f"{shot}: profile blender: header attribute Software is Blender 5.0.1; channels: " in said
    assert "read by profile blender" in found["about"]
    assert "read by profile cltaa" in expected["about"]
    assert expected["about"].startswith("1 given sequence, ")
    assert (tmp_path / "pictures" / "fast.png").is_file()


def test_a_folder_that_one_stands_in_has_its_name(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shot)
    found, _ = judged(capsys, Path(), tmp_path / "work", "--camera", "camera.txt")
    assert (found["rows"][0]["key"], found["rows"][0]["scene"]) == ("shot", "shot")


def test_what_is_kept_counts_for_one_way_of_reading(shot: Path, tmp_path: Path) -> None:
    """Whatever is otherwise: a profile of the same name, the side file, a frame or the truth that was rendered anew."""
    profile, side = tmp_path / "shot.toml", shot / "camera.txt"
    reading = Reading(profile=str(profile), side_file=str(side))
    vectors = 'profile = "blender"\n[motion]\nscale = [1, 1]\n'
    keys: set[str] = set()

    def keep(text: str) -> None:
        profile.write_text(text)
        found = []
        for _ in range(2):
            sequence = reading.open(shot)
            path = task_of(sequence, VARIANTS, "numpy", reading=reading, judging=JUDGING).path(tmp_path, VARIANTS[0])
            found.append({str(path), key_of(sequences=[sequence])})
        assert found[0] == found[1]
        assert found[0].isdisjoint(keys)
        keys.update(found[0])

    keep('profile = "blender"\n')
    keep(vectors)
    side.write_text(side.read_text().replace("jitter_px 0.3 ", "jitter_px 0.2 "))
    keep(vectors)
    anew = [replace(frame, colour=frame.colour * np.float32(0.75)) for frame in frames(COUNT)]
    write_blender(shot / "reference", anew)
    keep(vectors)
    write_blender(shot, anew)
    keep(vectors)


def test_errors_and_yardsticks_are_those_of_the_same_frames(own: Path, shot: Path) -> None:
    (expected,) = tasks_of([own], VARIANTS, "numpy", JUDGING)
    (task,) = tasks_of([shot], VARIANTS, "numpy", JUDGING, Reading(side_file=str(shot / "camera.txt")))
    assert run(task)["fast"].errors == run(expected)["fast"].errors
    assert yardstick_errors(task.open(), ("mse",)) == yardstick_errors(expected.open(), ("mse",))
    assert timed_numbers(task.open()) == [COUNT - 2, COUNT - 1]


def test_what_is_asked_for_speaks_of_other_tools_files(own: Path, shot: Path, tmp_path: Path) -> None:
    asked = Reading(profile="{}/shot.toml", assignments=("motion.scale=1,1",), side_file="{}/camera.txt", step=2)
    theirs = Reading(profile=f"{shot}/shot.toml", assignments=asked.assignments, side_file=f"{shot}/camera.txt", step=2)
    assert readings([own, shot], asked) == {own: Reading(step=2), shot: theirs}
    judged_by = Reading(effects="none", truth="{}/truth")  # which is said of all
    assert readings([own, shot], judged_by)[own] == Reading(effects="none", truth=f"{own}/truth")
    assert readings([own], Reading(profile="{}.toml")) == {
        own: Reading(profile=f"{own}.toml")
    }  # where there is no other
    other = write_blender(tmp_path / "other", frames(2))
    with pytest.raises(
        UsageError, match=r"side\.txt: --camera is of one sequence \(found 2 sequences\); write \{\} for"
    ):
        readings([own, shot, other], Reading(side_file="side.txt"))
    assert readings([own, shot], Reading(side_file="side.txt"))[shot] == Reading(side_file="side.txt")


def test_a_truth_may_lie_elsewhere(own: Path, shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a folder of its own or that of a capture; numbers and sizes are compared with the frames', as ever."""
    camera = ["--camera", str(shot / "camera.txt")]
    expected, _ = judged(capsys, shot, tmp_path / "work", *camera)
    (shot / "reference").rename(tmp_path / "truth")
    arguments = ["bench", "quality", "--sequence", str(shot), "--preset", "fast", "--work", str(tmp_path / "work")]
    assert main([*arguments, *camera]) == 66
    assert "say by --truth DIR where it is" in capsys.readouterr().err
    for place in ("{}/../truth", str(own)):
        found, _ = judged(capsys, shot, tmp_path / "work", *camera, "--truth", place)
        assert found["rows"] == expected["rows"]
    reading = Reading(side_file=camera[1], truth=str(tmp_path / "truth"))
    (task,) = tasks_of([shot], VARIANTS, "numpy", JUDGING, reading)
    (other,) = tasks_of([shot], VARIANTS, "numpy", JUDGING, Reading(side_file=camera[1], truth=str(own)))
    assert task.path(tmp_path, VARIANTS[0]) != other.path(tmp_path, VARIANTS[0])
    assert run(task)["fast"].errors == run(other)["fast"].errors
    assert reading.open(shot).select(1, 2).reference is not None
    for wrong, code, words in (
        (tmp_path / "nowhere", 66, f"{tmp_path / 'nowhere'}"),
        (write_sequence(tmp_path / "late", COUNT, first=2), 66, "is missing (found 2-5); capture it again"),
        (write_sequence(tmp_path / "away", COUNT, first=9), 66, "no frame number in common: number them alike"),
    ):
        assert main([*arguments, *camera, "--truth", str(wrong)]) == code
        assert words in capsys.readouterr().err


def test_declared_effects_are_those_of_a_capture(
    made: list[Frame], shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No other tool declares them, and with every step on a resolve is another one: luminance weights, for one."""
    declared = "camera,disocclusion"
    captured = (replace(frame, motion=None, effects=parse_effects(declared)) for frame in made)
    write_frames(tmp_path / "capture", captured)
    camera = ["--camera", str(shot / "camera.txt")]
    truth = ["--truth", str(shot)]
    named, _ = judged(capsys, shot, tmp_path / "work", *camera)
    expected, _ = judged(capsys, tmp_path / "capture", tmp_path / "work", *truth, "--effects", "auto")
    found, said = judged(capsys, shot, tmp_path / "work", *camera, "--effects", declared)
    assert found["rows"][0]["presets"] == expected["rows"][0]["presets"]
    assert found["rows"] != named["rows"]
    assert f"effects {declared}, as asked" in said
    assert f"effects {declared}, as asked" in found["read"]["shot"]
    everything, _ = judged(capsys, tmp_path / "capture", tmp_path / "work", *truth, "--effects", "all")
    assert everything["rows"][0]["presets"]["fast"] != expected["rows"][0]["presets"]["fast"]
    arguments = ["bench", "quality", "--sequence", str(shot), "--preset", "fast", "--work", str(tmp_path / "work")]
    assert main([*arguments, "--effects", declared]) == 64
    expected = capsys.readouterr().err
    assert "without matrices the vectors alone tell what moves (found effects camera,disocclusion)" in expected
    assert main(["resolve", str(shot), "-o", str(tmp_path / "out"), "--effects", declared]) == 64
    assert expected in capsys.readouterr().err
    assert main([*arguments[:2], "--scene", "occluder", "--camera", "camera.txt"]) == 64
    assert "are of frames that are there; name them: --sequence" in capsys.readouterr().err


def test_frames_that_were_drawn_again_are_complete(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (shot / REDRAWN / f"shot.{COUNT - 1:04d}.exr").unlink()
    arguments = ["bench", "quality", "--sequence", str(shot), "--preset", "fast", "--settled", "1", "--device", "numpy"]
    assert main([*arguments, "--work", str(tmp_path / "work")]) == 66
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.endswith(
        "frame 3: this frame was not drawn again (found 0-2); draw them all again, or take the folder away"
    )


def test_tune_reads_by_a_profile(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.lab.tune.LADDER", ("fast",))  # the others take long on NumPy
    arguments = ["tune", str(shot), "--budget", "9999ms", "--trials", "2", "--device", "numpy", "--preset", "fast"]
    arguments += ["--camera", str(shot / "camera.txt"), "-o", str(tmp_path / "t.toml"), "--json"]
    assert main(arguments) == 0
    said = capsys.readouterr()
    (task,) = tasks_of([shot], VARIANTS, "numpy", JUDGING, Reading(side_file=str(shot / "camera.txt")))
    assert json.loads(said.out)["start"]["error"] == pytest.approx(np.mean(run(task)["fast"].errors["mse"]), rel=1e-12)
    assert said.err.startswith(f"{shot}: profile blender: ")


@pytest.mark.parametrize("command", [["quality", "--sequence"], ["accuracy"]])
def test_what_cannot_be_read_is_told_as_resolve_tells_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    folder = write_blender(tmp_path / "shot", frames(2))
    work = ["--work" if command[0] == "quality" else "-o", str(tmp_path / "work")]
    for options, code, words in (
        (["--profile", "nuke"], 65, "no colour"),
        (["--input", "motion.channels=u v"], 64, "--input motion.channels=u v: no such channels"),
        ([], 66, "no truth to measure against"),
    ):
        resolve = ["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy", *options]
        assert main(resolve) == (code if options else 0)
        expected = capsys.readouterr().err.splitlines()[-1]
        assert main(["bench", *command, str(folder), *work, *options]) == code
        said = capsys.readouterr().err.splitlines()[-1]
        assert words in said
        assert said == expected or not options


def test_accuracy_in_words_and_pictures(shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "accuracy", str(shot), "-o", str(tmp_path), "--only", "basic", "--preset", "fast"]
    arguments += ["--rounds", "3"]
    arguments += ["--patience", "0", "--pixels", "1", "--rounding-frames", "1", "--camera", str(shot / "camera.txt")]
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr()
    print_accuracy(msgspec.json.decode((tmp_path / "accuracy.json").read_bytes(), type=Accuracy))
    assert "        all │" in capsys.readouterr().out  # bits right: a first frame is not rounded
    (measured,) = json.loads(said.out)["sequences"]
    assert [yard["samples"] for yard in measured["yardstick"]] == [1, 2]
    assert measured["profile"] == "blender"
    assert f"{shot}: profile blender: " in said.err
    assert "data:image" in (tmp_path / "index.html").read_text()
