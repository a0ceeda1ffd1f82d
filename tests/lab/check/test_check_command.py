"""``cltaa check`` end to end: planted mistakes in files, what mends them, and that mended files are read right."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from cltaa.cli import main, root
from cltaa.inputs.open import open_input
from cltaa.inputs.profile import Profile
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_write import write_image
from cltaa.lab.check.hypotheses import Finding
from cltaa.lab.check.report import Report, check_folder
from tests.inputs.foreign import side_text, write_own
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, full_motion, motion
from tests.sequence_factory import write_sequence

# Mistakes that no way of reading mends: the numbers are lost, or were never there.
LOST = {"jitter-missing"}
# Others than these are mended in test_all_that_another_api_does_otherwise.
QUICK = ["depth-ray", "colour-encoded"]
MENDED = [*QUICK, *(pytest.param(name, marks=pytest.mark.big) for name in sorted({*MISTAKES} - {*QUICK} - LOST))]


@pytest.mark.parametrize("mistake", MENDED)
def test_the_profile_of_fix_reads_it_right(mistake: str, scene: Scene, tmp_path: Path) -> None:
    spoilt = MISTAKES[mistake].plant(scene(MISTAKES[mistake].scenes[0]))
    folder, fix = write_own(tmp_path / "sequence", spoilt), tmp_path / "fix.toml"
    assert main(["check", str(folder), "--fix", str(fix)]) == 65
    report, read = check_folder(folder, profile=str(fix))
    assert read.description == f"What cltaa check found in {folder}"  # and not what it began with
    assert [finding.name for finding in report.mistakes] == []
    assert len(list(open_input(folder, profile=str(fix)))) == len(spoilt)


def test_the_options_that_are_printed_are_the_ones_that_mend(scene: Scene, tmp_path: Path) -> None:
    write_own(tmp_path, MISTAKES["jitter-negated"].plant(scene("still")))
    done = CliRunner().invoke(root, ["check", str(tmp_path), "--json"])
    report = json.loads(done.stdout)
    assert done.exit_code == 65
    assert done.stderr.startswith("reading: ")
    assert [finding["option"] for finding in report["findings"] if finding["mistake"]] == ["--input jitter.scale=-1,-1"]
    assert report["options"] == "--profile cltaa --input jitter.scale=-1,-1"
    assert main(["check", str(tmp_path), *report["options"].split()]) == 0


def test_frames_are_so_many_or_from_one_to_another(scene: Scene, tmp_path: Path) -> None:
    """A frame that is missing before those that are asked for is nobody's mistake."""
    write_own(tmp_path, scene("still"))
    files = sorted(tmp_path.glob("*.exr"))
    numbers = [int(path.name.split(".")[-2]) for path in files]
    files[1].unlink()
    for given, looked_at, found in (
        (f"{numbers[2]}-{numbers[6]}", 5, []),
        (f"{numbers[0]}-{numbers[6]}", 6, ["frames-missing"]),
        ("5", 5, ["frames-missing"]),
    ):
        done = CliRunner().invoke(root, ["check", str(tmp_path), "--frames", given, "--json"])
        report = json.loads(done.stdout)
        assert [finding["name"] for finding in report["findings"] if finding["mistake"]] == found
        assert report["frames"] == looked_at


@pytest.mark.parametrize("mistake", ["jitter-negated", "jitter-y-flipped", "jitter-swapped"])
def test_a_jitter_from_the_corner_and_otherwise_wrong_is_read_right(mistake: str, scene: Scene, tmp_path: Path) -> None:
    right = scene("still")
    spoilt = [
        replace(frame, jitter_px=(frame.jitter_px[0] + 0.5, frame.jitter_px[1] + 0.5))
        for frame in MISTAKES[mistake].plant(right)
    ]
    _, mending = check_folder(write_own(tmp_path, spoilt))
    again = open_input(tmp_path, profile=mending)
    np.testing.assert_allclose([frame.jitter_px for frame in again], [frame.jitter_px for frame in right], atol=1e-12)


@pytest.mark.parametrize("factor", [-4.0, 3.0])
def test_vectors_of_any_size_are_mended_at_once(factor: float, scene: Scene, tmp_path: Path) -> None:
    spoilt = motion(factor * np.eye(2))(full_motion(scene("pan")))
    report, mending = check_folder(write_own(tmp_path, spoilt))
    name = f"motion-scaled-{1 / abs(factor):.3g}" + "-negated" * (factor < 0)
    assert [finding.name for finding in report.mistakes] == [name]
    assert mending.motion.scale == (1 / factor, 1 / factor)
    assert check_folder(tmp_path, profile=mending)[0].mistakes == []


def test_findings_that_undo_each_other_come_to_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second would lead back to the first reading, which has been tried."""
    turned = finding("camera-y-flipped", True, fix={"camera": {"flip_y": True}})
    monkeypatch.setattr("cltaa.lab.check.report.check_frames", lambda *_, **__: [turned])
    report, mending = check_folder(write_sequence(tmp_path, 2))
    assert [found.name for found in report.mistakes] == ["camera-y-flipped"]
    assert mending.camera.flip_y


def test_what_a_wrong_depth_hides_is_found_too(scene: Scene, tmp_path: Path) -> None:
    """Depth of half the size leaves so much behind that a flipped jitter is not seen; both are mended."""
    flipped = MISTAKES["jitter-y-flipped"].plant(scene("corridor"))
    write_own(tmp_path, [replace(frame, depth=np.asarray(frame.depth / 2, np.float32)) for frame in flipped])
    report, mending = check_folder(tmp_path)
    assert [finding.name for finding in report.mistakes] == ["depth-scaled", "jitter-y-flipped"]
    assert mending.jitter.scale == (1.0, -1.0)
    assert report.options.endswith(f"--input depth.scale={mending.depth.scale:g} --input jitter.scale=1,-1")
    again, _ = check_folder(tmp_path, assignments=shlex.split(report.options)[3::2])
    assert again.mistakes == []


def test_all_that_another_api_does_otherwise_is_named_at_once(scene: Scene, tmp_path: Path) -> None:
    """Row vectors, a left-handed world, reversed depth, vectors in NDC and a jitter that is the picture's offset."""
    frames = full_motion(scene("corridor"))
    for name in ("depth-device-reversed", "motion-units-ndc", "jitter-negated", "camera-transposed-left-handed"):
        frames = MISTAKES[name].plant(frames)
    folder, fix = tmp_path / "sequence", tmp_path / "fix.toml"
    write_own(folder, frames)
    done = CliRunner().invoke(root, ["check", str(folder), "--fix", str(fix), "--json"])
    found = [finding["name"] for finding in json.loads(done.stdout)["findings"] if finding["mistake"]]
    assert found[0] == "camera-transposed-left-handed"
    assert {"motion-units-ndc", "jitter-negated"} < set(found)
    assert check_folder(folder, profile=str(fix))[0].mistakes == []


def test_what_is_printed(scene: Scene, tmp_path: Path) -> None:
    write_own(tmp_path, MISTAKES["depth-ray"].plant(scene("still")))
    done = CliRunner().invoke(root, ["check", str(tmp_path)])
    assert "✗ depth-ray" in done.stdout
    assert "--input depth.kind=ray" in done.stdout
    assert "of the pixels that tell" in done.stdout


def test_names_that_a_shell_takes_apart_come_out_whole(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = MISTAKES["jitter-negated"].plant(scene("still"))
    monkeypatch.chdir(tmp_path)
    folder = "./-in"
    side, profile, fix = (tmp_path / name for name in ("my camera.txt", "my own.toml", "to mend.toml"))
    write_own(Path(folder), frames)
    side.write_text(side_text(frames))
    profile.write_text('profile = "cltaa"')
    given = ["--profile", str(profile), "--input", "depth.channels=Z,it's", "--input", "jitter.attribute=where in it"]
    words = ["check", folder, "--camera", str(side), *given]
    report = json.loads(CliRunner().invoke(root, [*words, "--json"]).stdout)
    assert main(["check", folder, *shlex.split(report["options"])]) == 0
    assert shlex.split(report["options"])[4:] == [
        "--input",
        "depth.channels=Z,it's",
        "--input",
        "jitter.attribute=where in it",
        "--input",
        "jitter.scale=-1,-1",
    ]
    (last,) = CliRunner().invoke(root, [*words, "--fix", str(fix)]).stdout.splitlines()[-1:]
    told = shlex.split(last.removeprefix("to read it right: "))  # the side file is no part of the profile of --fix
    assert told == ["cltaa", "resolve", folder, "--profile", str(fix), "--camera", str(side), "-o", "OUT"]
    assert main([*told[1:], "--frames", "2", "--device", "numpy"]) == 0
    assert len([*(tmp_path / "OUT").glob("*.exr")]) == 2


def test_a_terminal_shows_that_the_check_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """After the frames are read, too: of large ones it takes longer to judge them."""
    folder = write_sequence(tmp_path, 2)
    main(["check", str(folder)])
    assert "checking" not in capsys.readouterr().err  # in a log
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    main(["check", str(folder)])
    assert "checking" in capsys.readouterr().err


@pytest.mark.parametrize(("pixels", "name"), [(np.float16, "depth-half"), (np.float32, None)])
def test_half_precision_depth(pixels: type, name: str | None, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for index in range(3):
        channels = {c: rng.random((32, 32)).astype(np.float32) ** 4 * 3 for c in "RGB"}
        depth: Pixels = np.linspace(2, 9, 1024).reshape(32, 32).astype(pixels)
        planes: dict[str, Pixels] = {**channels, "Z": depth}
        write_image(tmp_path / f"a.{index:04d}.exr", planes)
    report, _ = check_folder(tmp_path)
    assert (name in [finding.name for finding in report.mistakes]) == (name is not None)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 7), (2, 1)])
def test_images_of_a_single_row_or_column(width: int, height: int, tmp_path: Path) -> None:
    write_sequence(tmp_path, 4, width=width, height=height, motion=True)
    assert main(["check", str(tmp_path)]) in (0, 65)


def said_of(
    report: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *options: str
) -> list[str]:
    """What is printed of a report, which decides the exit code."""
    found = Report(
        folder="my shot", frames=1, reading=[], findings=[], unverifiable=[], options="--profile nuke", profile={}
    )
    found = msgspec.structs.replace(found, **report)
    monkeypatch.setattr("cltaa.commands.check.check_folder", lambda *_, **__: (found, Profile()))
    assert main(["check", "my shot", *options]) == (65 if found.mistakes else 0)
    return capsys.readouterr().out.splitlines()


def finding(name: str, mistake: bool, **more: Any) -> Finding:
    return Finding(name=name, mistake=mistake, confidence=0.756, what="it is wrong", evidence="seen", **more)


NOTE = finding("note", False)


def test_each_finding_is_said_with_its_sign_its_confidence_and_what_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mended = finding("jitter-negated", True, fix={"jitter": {"scale": (-1, -1)}}, option="--input jitter.scale=-1,-1")
    report = {"reading": ["how", "more", "and no more"], "findings": [mended, NOTE], "unverifiable": ["the motion"]}
    assert said_of(report, monkeypatch, capsys) == [
        "how",
        "more",
        "✗ jitter-negated (76%): it is wrong",
        "    seen",
        "    --input jitter.scale=-1,-1",
        "· note (76%): it is wrong",
        "    seen",
        "? cannot tell the motion",
        "to read it right: cltaa resolve 'my shot' --profile nuke -o OUT",
    ]
    # The profile of --fix says all but what no profile does.
    fixed = said_of(report, monkeypatch, capsys, "--fix", "mended.toml", "--step", "3", "--camera", "c.txt")
    assert fixed[-1] == "to read it right: cltaa resolve 'my shot' --profile mended.toml --step 3 --camera c.txt -o OUT"


def test_what_no_way_of_reading_mends_is_not_said_to_be_mended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_of({"findings": [finding("jitter-missing", True)]}, monkeypatch, capsys)
    assert said == ["✗ jitter-missing (76%): it is wrong", "    seen"]


@pytest.mark.parametrize(("frames", "many"), [(1, "1 frame"), (12, "12 frames")])
def test_notes_are_no_mistakes(
    frames: int, many: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_of({"frames": frames, "findings": [NOTE]}, monkeypatch, capsys)
    assert said[-1] == f"✓ no mistake found in {many}"


def test_a_profile_that_cannot_be_written_is_reported_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.commands.check.check_folder", lambda *_, **__: pytest.fail("it looked"))
    assert main(["check", str(tmp_path), "--fix", str(tmp_path / "nowhere" / "fix.toml")]) == 73
