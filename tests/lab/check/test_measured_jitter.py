"""``cltaa check --jitter-file``: the jitter of a capture that lost it, and why it is not written."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.cli import main
from cltaa.frame import Frame, Image
from cltaa.inputs.side_file import read_side_file
from cltaa.io.sequence import open_images
from tests.inputs.foreign import side_text, write_blender, write_own
from tests.lab.check.conftest import Scene, sixteen
from tests.lab.check.mistakes import full_motion, motion_jittered

Change = Callable[[list[Frame]], list[Frame]]


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Frames of a scene, 16 of 160 x 90: of smaller ones the patterns are too fine to measure."""
    return sixteen(tmp_path_factory.mktemp("measured"), 160, 90)


def without_jitter(frames: list[Frame], folder: Path) -> Path:
    """Write ``frames`` from number 101 on, without the attribute of the jitter."""
    write_own(folder, [replace(frame, index=frame.index + 101) for frame in frames])
    for path in folder.glob("*.exr"):
        with OpenEXR.File(str(path)) as file:
            del file.header()["cltaa:jitterPx"]
            file.write(str(path.with_suffix(".new")))
        path.with_suffix(".new").replace(path)
    return folder


def resolved(folder: Path, output: Path, *options: str) -> Image:
    assert main(["resolve", str(folder), "-o", str(output), "--effects", "all", *options]) == 0
    return open_images(output).image(open_images(output).last)


@pytest.mark.parametrize("name", ["corridor", "roll"])
def test_a_capture_without_its_jitter(
    name: str, shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames, file = shot(name), tmp_path / "its jitter.json"
    stripped = without_jitter(frames, tmp_path / "stripped")
    assert main(["check", str(stripped), "--jitter-file", str(file)]) == 65  # for what is missing in the files
    said = capsys.readouterr().out.split("to resolve with it: ")[1].strip()
    found = read_side_file(file)
    assert [*found] == [*range(101, 117)]  # all frames, though the check looks at fewer
    true = np.array([frame.jitter_px for frame in frames])
    apart = np.abs(np.array([found[number].jitter_px for number in found]) - true)
    assert apart.max() <= 0.1  # px, as much as shifts of one picture may disagree; the worst seen is 0.070
    pasted = resolved(stripped, tmp_path / "measured", *shlex.split(said)[3:-2])
    right = resolved(write_own(tmp_path / "true", frames), tmp_path / "right")
    none = resolved(stripped, tmp_path / "none", "--profile", "cltaa", "--input", "jitter.source=none")
    # A result is a mean of samples. One placed wrong by e pixels changes its share of it by at most e_x + e_y of the
    # difference of neighbours, so all of them change it by at most the largest e of that.
    around = [np.roll(right, shift, (0, 1)) for shift in ((0, 1), (0, -1), (1, 0), (-1, 0))]
    slope = np.max(np.abs(np.array(around) - right), axis=0)
    error, without = (float(np.sqrt(((one - right) ** 2).mean())) for one in (pasted, none))
    assert error <= apart.sum(1).max() * float(np.sqrt((slope**2).mean()))
    assert error < without / 2


def undeclared(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, jitter_px=(0.0, 0.0)) for frame in frames]


def written(file: Path) -> np.ndarray:
    return np.array([side.jitter_px for side in read_side_file(file).values()])


@pytest.mark.parametrize(
    ("name", "matrices", "held"), [("corridor", True, 0.0), ("corridor", True, 1.0), ("roll", False, 0.0)]
)
def test_vectors_that_fill_the_picture(
    name: str, matrices: bool, held: float, shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What they contain of the jitter is mended too. Without matrices, those of the frames between lead farther back
    than one frame."""
    frames, file = full_motion(shot(name)), tmp_path / "jitter.json"
    write = write_own if matrices else write_blender
    folder = write(tmp_path / "in", undeclared(motion_jittered(held)(frames)))
    assert main(["check", str(folder), "--jitter-file", str(file)]) == 65
    true = np.array([frame.jitter_px for frame in frames])
    assert np.abs(written(file) - true).max() <= 0.1  # px, as above
    said = capsys.readouterr().out.split("to resolve with it: ")[1].splitlines()[0]
    assert (f"--input motion.jittered={held:g} " in said) == bool(held)


@pytest.mark.parametrize("held", [1.0, -1.0])
def test_jitter_in_the_vectors_of_a_camera_that_stands(
    held: float, shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As Blender's EEVEE writes them, without matrices: it is measured as without the vectors."""
    frames, plain, file = full_motion(shot("still")), tmp_path / "plain.json", tmp_path / "jitter.json"
    bare = write_blender(tmp_path / "bare", undeclared([replace(frame, motion=None) for frame in frames]))
    folder = write_blender(tmp_path / "in", undeclared(motion_jittered(held)(frames)))
    for where, output in ((bare, plain), (folder, file)):
        assert main(["check", str(where), "--jitter-file", str(output)]) == 65
    np.testing.assert_allclose(written(file), written(plain), rtol=0, atol=0.02)  # the worst seen is 0.013
    assert f"--input motion.jittered={held:g} " in capsys.readouterr().out.split("to resolve with it: ")[2]


@pytest.mark.parametrize("held", [1.0, -1.0])
def test_jitter_in_vectors_is_not_told_from_a_camera_without_matrices(
    held: float, shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_blender(tmp_path / "in", undeclared(motion_jittered(held)(full_motion(shot("corridor")))))
    assert main(["check", str(folder), "--jitter-file", str(tmp_path / "jitter.json")]) == 65
    said = capsys.readouterr().err.splitlines()[-1]
    assert "the jitter is not measured: the vectors go to and fro: by jitter or by the camera (expected " in said
    assert said.endswith("; give matrices and depth, which tell")


def test_the_rest_of_a_side_file_is_kept_and_frames_are_those_asked_for(
    shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = [replace(frame, jitter_px=(0.0, 0.0), exposure=2.0) for frame in shot("corridor")]
    folder, side, file = write_own(tmp_path / "in", frames), tmp_path / "camera.txt", tmp_path / "jitter.json"
    side.write_text(side_text(frames))
    asked = ["--camera", str(side), "--frames", "4-15", "--jitter-file", str(file), "--fix", str(tmp_path / "fix.toml")]
    main(["check", str(folder), *asked])
    given, found = read_side_file(side), read_side_file(file)
    assert [*found] == [*range(4, 16)]
    for number, values in found.items():
        assert str(values._replace(jitter_px=None)) == str(given[number]._replace(jitter_px=None))
        assert values.jitter_px != given[number].jitter_px
    said = capsys.readouterr().out.split("to resolve with it: ")[1].splitlines()[0]
    assert said == f"cltaa resolve {folder} --profile {tmp_path / 'fix.toml'} --camera {file} --frames 4-15 -o OUT"
    main(["check", str(folder), *asked, "--json"])
    assert f"cltaa resolve {folder} {json.loads(capsys.readouterr().out)['options']} -o OUT" == said


def resting(frames: list[Frame]) -> list[Frame]:
    return [replace(frames[0], index=frame.index) for frame in frames]


def drifting(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, colour=np.roll(frame.colour, frame.index, axis=1)) for frame in resting(frames)]


def cut(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, cut=frame.index == 8) for frame in frames]


def first_three(frames: list[Frame]) -> list[Frame]:
    return frames[:3]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (resting, "the pixels show no jitter"),
        (drifting, "the shifts of the picture fit no jitter"),
        (cut, "some frames match none of the others"),
        (first_three, "too few pairs of frames show their shift"),
    ],
)
def test_why_it_is_not_measured(
    change: Change, why: str, shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file = write_own(tmp_path / "in", change(shot("corridor"))), tmp_path / "jitter.json"
    assert main(["check", str(folder), "--jitter-file", str(file)]) == 65
    told = capsys.readouterr()
    assert told.err.splitlines()[-1].startswith(f"cltaa: error: {folder}: the jitter is not measured: {why} (expected ")
    assert "no-motion-vectors (99%)" in told.out  # the report, which the error refers to
    assert not file.exists()
    assert main(["check", str(folder), "--jitter-file", str(file), "--json"]) == 65
    assert [*json.loads(capsys.readouterr().out)] == ["error", "exit_code"]


def test_without_matrices_the_check_does_not_lead_back_to_itself(
    shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = ["--input", "camera.source=none", "--input", "jitter.source=none"]
    folder = write_own(tmp_path / "in", shot("corridor"))
    assert main(["check", str(folder), *without, "--jitter-file", str(tmp_path / "jitter.json")]) == 65
    assert "; give matrices and depth if the camera moves, mend what else cltaa check finds" in capsys.readouterr().err


def test_what_can_hold_no_measured_jitter(shot: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(write_own(tmp_path / "in", shot("corridor")))
    for options, why in (
        (["--jitter-file", "j.csv"], "--jitter-file writes JSON (expected FILE.json, found j.csv)"),
        (
            ["--jitter-file", str(tmp_path / "j.json"), "--input", "jitter.source=projection"],
            "the matrices hold the jitter already",
        ),
    ):
        assert main(["check", folder, *options]) == 64
        assert why in capsys.readouterr().err


def test_the_mean_is_taken_as_zero(shot: Scene, tmp_path: Path) -> None:
    folder, file = write_own(tmp_path / "in", shot("corridor")), tmp_path / "jitter.json"
    assert main(["check", str(folder), "--jitter-file", str(file)]) == 0
    frames = json.loads(file.read_text())["frames"]
    assert np.mean([frame["jitter_px"] for frame in frames.values()], axis=0) == pytest.approx([0, 0], abs=1e-12)
