"""``cltaa compare`` of other tools' files: how they are read, and what is told of what does not belong together."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.io.display import encoded
from cltaa.io.exr_write import write_image
from cltaa.io.manifest import file_sha256
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.judge.metrics import mean, measure
from tests.inputs.foreign import frames as foreign_frames
from tests.inputs.foreign import side_text, write_blender, write_colour, write_depth, write_own
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame, write_frames, write_images, write_sequence


def test_other_tools_files_are_judged_and_judge(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As truth, as what is judged, and as a sequence with its truth beside it, in a part a pass and as one image."""
    made, shot, truth = foreign_frames(3), tmp_path / "shot", tmp_path / "truth"
    write_blender(shot, made)
    write_blender(truth, [replace(frame, colour=frame.colour * np.float32(0.9)) for frame in made])
    plain = write_images(tmp_path / "plain", [frame.colour for frame in made], name="shot")
    assert run_json(capsys, plain, shot, "--metrics", "mse")["mean"]["mse"] == 0
    assert main(["compare", str(plain), str(truth), "--metrics", "mse"]) == 0
    said = capsys.readouterr().err
    told = "profile blender: header attribute Software is Blender 5.0.1; colour ViewLayer.Combined.R"
    assert f"B: {told} ViewLayer.Combined.G ViewLayer.Combined.B\n" in said
    judged = run_json(capsys, plain, truth, "--metrics", "mse", "--frames", "1-2")
    assert [row["frame"] for row in judged["frames"]] == [1, 2]
    assert judged["mean"]["mse"] > 0
    shutil.copytree(truth, shot / "reference")
    with_capture = run_json(capsys, plain, shot, "--metrics", "mse", "--video")
    assert with_capture["mean"] == with_capture["mean_one_sample"]
    assert [row["metrics"] for row in with_capture["frames"]][1:] == [row["metrics"] for row in judged["frames"]]
    assert run_json(capsys, shot, "--metrics", "mse")["mean"] == with_capture["mean"]
    (truth / "shot.0001.exr").unlink()
    assert "frame 1: no reference for this frame (found 0, 2)" in refusal_behind_notes(capsys, plain, truth)
    (shot / "shot.0002.exr").unlink()
    assert "frame 2: no single samples for this frame (found 0-1)" in refusal_behind_notes(capsys, plain, shot)


def test_frames_of_one_size_are_judged_by_a_truth_that_changes_its_size(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As of a dynamic resolution; the refusal of all frames tells how."""
    frames = [make_frame(number, height=rows) for number, rows in enumerate((12, 12, 16, 16))]
    images = [frame.colour for frame in frames]
    ours, truth = (write_images(tmp_path / name, images) for name in ("ours", "truth"))
    captures = [write_images(tmp_path / "theirs", images), write_frames(tmp_path / "own", frames, "image")]
    for capture in captures:
        write_images(capture / "reference", images)
        write_images(capture / "reference-2", images)
    damaged = truth / "image.0001.exr"
    damaged.write_bytes(damaged.read_bytes()[:-5])
    for of_two in (truth, truth / "image.2-3#.exr", *captures):
        alike = run_json(capsys, ours, of_two, "--metrics", "mse", "--frames", "2-3")
        assert (alike["mean"]["mse"], len(alike["frames"])) == (0, 2)
    write_images(truth, images)
    cure = "--frames A-B or a pattern x.A-B#.exr chooses frames of one size"
    assert cure in refusal(capsys, 65, ours, truth)


def test_pictures_that_are_encoded_are_decoded(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """What a program of one's own wrote as it shows it: R, G and B too, and beside files of cltaa's own."""
    capture = write_sequence(tmp_path / "capture", 2, reference=True)
    images = [image.copy() for image in open_images(capture / "reference")]
    write_images(capture / "reference", images, name="synthetic", samples=64)
    mine = write_images(tmp_path / "mine", [encoded(image) for image in images])
    assert run_json(capsys, mine, capture, "--metrics", "mse")["mean"]["mse"] > 0.05
    asked = ("--metrics", "mse", "--input", "colour.encoding=srgb")
    assert run_json(capsys, mine, capture, *asked)["mean"]["mse"] < 1e-12  # rounded twice
    assert run_json(capsys, mine, capture, *asked, "--frames", "1")["mean"]["mse"] < 1e-12
    assert run_json(capsys, mine / "image.0001.exr", mine / "image.0001.exr", *asked)["mean"]["mse"] == 0
    assert "unknown profile nonsense" in refusal(capsys, 64, mine, capture, "--profile", "nonsense")
    frames = write_images(tmp_path / "shot", [frame.colour for frame in open_sequence(capture)], name="synthetic")
    write_images(frames / "reference", [encoded(image) for image in images], name="synthetic")
    assert run_json(capsys, mine, frames, *asked)["mean"]["mse"] == 0


def test_pictures_whose_channels_must_be_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grey = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    for folder in ("grey", "shot", "shot/reference"):
        (tmp_path / folder).mkdir()
        write_image(tmp_path / folder / "a.0001.exr", {"Y": grey})
    plain = write_images(tmp_path / "plain", [np.stack([grey] * 3, -1)], first=1)
    assert "--input colour.channels='Y Y Y'" in refusal(capsys, 65, plain, tmp_path / "grey")
    named = ("--metrics", "mse", "--input", "colour.channels=Y Y Y")
    assert run_json(capsys, plain, tmp_path / "grey", *named)["mean"]["mse"] == 0
    assert run_json(capsys, plain, tmp_path / "shot", *named)["mean_one_sample"]["mse"] == 0


def test_channels_that_are_named_are_read_beside_plain_ones(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Where the files have them; a result of cltaa keeps such channels as layers, and is judged by its own colour."""
    grey = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    for folder, light, alpha in (("a", 0.5, 0.25), ("b", 1.0, 0.25), ("plain", 0.5, 0.25)):
        (tmp_path / folder).mkdir()
        layers = {} if folder == "plain" else {f"diffuse.{name}": light * grey for name in "RGB"}
        plain = dict.fromkeys("RGB", 0.5 * grey) | {"A": np.full_like(grey, alpha)}
        for number in (1, 2):
            write_image(tmp_path / folder / f"x.{number:04d}.exr", plain | layers)
    named = ("--metrics", "mse", "--input", "colour.channels=diffuse.R diffuse.G diffuse.B")
    a, b, plain_one = (tmp_path / name for name in ("a", "b", "plain"))
    assert run_json(capsys, a, b, "--metrics", "mse")["mean"]["mse"] == 0
    expected = pytest.approx(np.square(0.5 * grey, dtype=np.float64).mean(), rel=1e-12)  # sums in another order
    assert run_json(capsys, a, b, *named)["mean"]["mse"] == expected
    assert run_json(capsys, plain_one, b, *named)["mean"]["mse"] == expected
    (tmp_path / "own.toml").write_text('[colour]\nchannels = [["diffuse.R", "diffuse.G", "diffuse.B"]]\n')
    by_profile = ("--metrics", "mse", "--profile", str(tmp_path / "own.toml"))
    assert run_json(capsys, a, b, *by_profile)["mean"]["mse"] == expected
    assert run_json(capsys, plain_one, plain_one, *by_profile)["mean"]["mse"] == 0
    assert "alpha" in run_json(capsys, a, b, "--metrics", "mse")
    assert "alpha" not in run_json(capsys, a, b, "--metrics", "mse", "--input", "colour.alpha=none")
    nowhere = ("--input", "colour.channels=nope.R nope.G nope.B")
    assert "no colour channels" in refusal(capsys, 65, a, b, *nowhere)
    assert "nope.A: no such channels" in refusal(capsys, 64, a, b, "--input", "colour.alpha=nope.A")


def test_a_truth_needs_only_the_colour(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Also where options name the depth, the vectors or the mask of the frames."""
    grey = np.full((3, 4), 0.5, np.float32)
    combined = {f"ViewLayer.Combined.{name}": grey for name in "RGB"}
    others = {"MyZ": grey, "MyU": grey, "MyV": grey, "MyMask": grey}
    for folder, channels in (("shot", combined | others), ("shot/reference", combined)):
        (tmp_path / folder).mkdir()
        for number in (1, 2):
            write_image(tmp_path / folder / f"x.{number:04d}.exr", channels, {"Software": "Blender"})
    plain = write_images(tmp_path / "plain", [np.stack([grey] * 3, -1)] * 2, first=1)
    named = [("depth.channels", "MyZ"), ("motion.channels", "MyU MyV"), ("colour.reactive", "MyMask")]
    options = [word for key, value in named for word in ("--input", f"{key}={value}")]
    for truth in (tmp_path / "shot", tmp_path / "shot" / "reference"):
        assert run_json(capsys, plain, truth, "--metrics", "mse", *options)["mean"]["mse"] == 0


def refusal_behind_notes(capsys: pytest.CaptureFixture[str], *arguments: Path) -> str:
    assert main(["compare", *map(str, arguments)]) == 66
    return capsys.readouterr().err


def warnings(capsys: pytest.CaptureFixture[str], *arguments: Path) -> list[str]:
    assert main(["compare", *map(str, arguments), "--metrics", "mse", "--json"]) == 0
    captured = capsys.readouterr()
    said = [line for line in captured.err.splitlines() if "warning: " in line]
    told: list[str] = json.loads(captured.out)["warnings"]
    assert said == [f"cltaa: warning: {warning}" for warning in told]
    return told


def test_other_primaries_are_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grey = make_frame().colour
    rec709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    acescg = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    for name, stated in (("unsaid", None), ("a", rec709), ("rounded", (*rec709[:6], 0.313, 0.329)), ("b", acescg)):
        (tmp_path / name).mkdir()
        attributes = {} if stated is None else {"chromaticities": stated}
        write_image(tmp_path / name / "x.0000.exr", {c: grey[..., i] for i, c in enumerate("RGB")}, attributes)
    assert "different primaries" in warnings(capsys, tmp_path / "a", tmp_path / "b")[0]
    assert warnings(capsys, tmp_path / "a", tmp_path / "rounded") == []
    assert warnings(capsys, tmp_path / "a", tmp_path / "unsaid") == []


def test_another_scene_is_told_by_what_files_say(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """By names, then cameras, then what a result was made from; never by pixels, and nothing where nothing is known."""
    made = write_sequence(tmp_path / "made", 2, reference=True)
    other_seed = write_sequence(tmp_path / "seed", 2, reference=True, seed=1)
    for folder in (made, other_seed):
        files = {path.name: file_sha256(path) for path in sorted(folder.glob("*.exr"))}
        (folder / "sequence.json").write_text(json.dumps({"files": files}))
    frames = [make_frame(index, camera=make_camera((9.0, index, 5.0))) for index in range(2)]
    for name, scene in (("moved", "synthetic"), ("elsewhere", "spinner")):
        write_frames(tmp_path / name, (replace(frame, scene=scene) for frame in frames))
    assert main(["resolve", str(made), "-o", str(tmp_path / "resolved"), "--device", "numpy"]) == 0
    capsys.readouterr()
    resolved = tmp_path / "resolved"
    assert warnings(capsys, resolved, made) == []
    assert warnings(capsys, made) == []
    assert warnings(capsys, resolved, made / "reference") == []
    assert warnings(capsys, tmp_path / "elsewhere", made) == ["A shows scene spinner and B scene synthetic"]
    assert warnings(capsys, tmp_path / "moved", made) == ["A and B are seen by different cameras in frames 0-1"]
    assert "resolved from other frames than those of B" in warnings(capsys, resolved, other_seed)[0]


NO_TRUTH = (
    "which has no truth in a folder reference/: the figures are no errors; capture it with --reference 64, or render"
    " the truth there, with many samples a pixel"
)
NO_TRUTH_ITSELF = "B is itself a result of cltaa resolve and no truth: the figures are no errors; name the truth last"


def test_cameras_are_compared_in_each_frame_that_is_judged(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Two paths of a camera may begin at one place, as those of one scene at two frame rates do."""
    for name, speed in (("slow", 1.0), ("fast", 2.0)):
        cameras = [make_camera((speed * (index >= 2), 0.0, 5.0)) for index in range(4)]
        write_frames(tmp_path / name, (make_frame(index, camera=its) for index, its in enumerate(cameras)))
    pair = tmp_path / "slow", tmp_path / "fast"
    assert warnings(capsys, *pair) == ["A and B are seen by different cameras in frames 2-3"]
    assert run_json(capsys, *pair, "--frames", "0-1", "--metrics", "mse")["warnings"] == []


def test_two_pictures_of_two_frames_are_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    made, other = write_sequence(tmp_path / "a", 2), write_sequence(tmp_path / "b", 2)
    said = ["A is frame 0 and B frame 1: name two pictures of one frame"]
    assert warnings(capsys, made / "synthetic.0000.exr", other / "synthetic.0001.exr") == said
    (made / "synthetic.0001.exr").rename(tmp_path / "best2.exr")  # whatever it is called
    assert warnings(capsys, tmp_path / "best2.exr", other / "synthetic.0001.exr") == []


@pytest.mark.parametrize("swapped", ["test", "truth/reference", "truth/reference-2"])
def test_frames_under_each_others_names_are_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, swapped: str
) -> None:
    grey = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    write_sequence(tmp_path / "truth", 3)
    for folder in ("test", "truth/reference", "truth/reference-2"):
        (tmp_path / folder).mkdir()
        for name, number in enumerate((0, 2, 1) if folder == swapped else (0, 1, 2)):
            write_image(
                tmp_path / folder / f"synthetic.{name:04d}.exr", dict.fromkeys("RGB", grey), {"cltaa:frame": number}
            )
    said = refusal(capsys, 65, tmp_path / "test", tmp_path / "truth")
    place = tmp_path / swapped / "synthetic.0001.exr"
    assert f"{place}: the file name and attribute cltaa:frame disagree (expected 1, found 2)" in said
    assert main(["compare", *map(str, (tmp_path / "test", tmp_path / "truth")), "--frames", "0-0"]) == 0


def test_frames_that_are_no_truth_are_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """What a resolve changed in its own input is no error of it, and single samples are nobody's truth."""
    own, dump = write_sequence(tmp_path / "own", 2), tmp_path / "dump"
    write_blender(dump, foreign_frames(2))
    other = write_sequence(tmp_path / "other", 2, seed=1)
    for name, source in (("own", own), ("dump", dump)):
        out = tmp_path / f"{name}-resolved"
        assert main(["resolve", str(source), "-o", str(out), "--device", "numpy"]) == 0
        capsys.readouterr()
        assert warnings(capsys, out, source) == [f"A was resolved from the frames of B, {NO_TRUTH}"]
    assert warnings(capsys, other, own) == []  # nothing says what these are
    (own / "sequence.json").write_text("{}")
    assert warnings(capsys, other, own) == [f"B is a capture of one sample a pixel, {NO_TRUTH}"]
    for test in (own, dump):  # as where the two are named the wrong way round
        assert warnings(capsys, test, tmp_path / f"{test.name}-resolved") == [NO_TRUTH_ITSELF]


def write_region(folder: Path, images: list[np.ndarray]) -> Path:
    """All but two columns on the left and a row below of ``images``, with their place in the display window."""
    folder.mkdir()
    windows = ((2, 0, WIDTH - 1, HEIGHT - 2), (0, 0, WIDTH - 1, HEIGHT - 1))
    for number, image in enumerate(images):
        planes = {name: np.ascontiguousarray(image[:-1, 2:, place]) for place, name in enumerate("RGB")}
        write_image(folder / f"a.{number:04d}.exr", planes, windows=windows)
    return folder


def test_a_region_is_judged_against_the_same_region_of_a_capture(
    capsys: pytest.CaptureFixture[str], capture: Path, resolved: Path, tmp_path: Path
) -> None:
    """Beside its single samples and its yardsticks there."""
    sequence, halfway = open_sequence(capture), open_images(resolved)
    assert sequence.reference is not None
    for number, truth in enumerate(sequence.reference):
        for samples, share in ((2, 0.7), (16, 0.1)):
            image = truth + np.float32(share) * (sequence.frame(number).colour - truth)
            image[:, :2] = 7  # beside the region
            write_images(capture / f"reference-{samples}", [image], name="synthetic", first=number)
    part = write_region(tmp_path / "part", list(halfway))
    found = run_json(capsys, part, capture)
    truths = [image[:-1, 2:] for image in sequence.reference]
    singles = [frame.colour[:-1, 2:] for frame in sequence]
    expected = mean(measure(sample, truth) for sample, truth in zip(singles, truths, strict=True))
    assert found["mean_one_sample"] == pytest.approx(expected, rel=1e-12)
    # Errors fall with the square of the share: half of it lies between 0.7 of two samples and 0.1 of sixteen.
    assert found["equal_quality_samples"]["method"] == "measured"
    assert 2 < found["equal_quality_samples"]["samples"] < 16
    refused = refusal_after_note(capsys, part, capture, "--video")
    assert "--video judges whole pictures only" in refused
    assert f"(expected {WIDTH} x {HEIGHT}, found {WIDTH - 2} x {HEIGHT - 1} " in refused
    refused = refusal_after_note(capsys, part, resolved, capture)
    assert f"{resolved}: what it shares with B is another region than what {part} does" in refused


def refusal_after_note(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The last line on standard error of what is refused."""
    assert main(["compare", *map(str, arguments)]) == 64
    return capsys.readouterr().err.splitlines()[-1]


def test_buffers_of_several_names_in_one_folder_are_read_by_a_profile(
    capsys: pytest.CaptureFixture[str], capture: Path, tmp_path: Path
) -> None:
    dump, made = tmp_path / "dump", [*open_sequence(capture)]
    write_colour(dump, made, "color")
    write_depth(dump, made, channels="R")
    assert main(["compare", str(dump), str(capture), "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert found["mean"] == found["mean_one_sample"]
    assert "colour color.R color.G color.B" in said.err


def test_a_truth_that_a_resolve_wrote_is_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    capture = write_sequence(tmp_path / "capture", 2)
    assert main(["resolve", str(capture), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    capsys.readouterr()
    shutil.copytree(tmp_path / "out", capture / "reference")
    for arguments in ([capture], [tmp_path / "out", capture]):
        (warning,) = run_json(capsys, *arguments)["warnings"]
        assert "reference, was written by a resolve: capture it again" in warning
    assert run_json(capsys, tmp_path / "out", capture / "reference")["warnings"] == [NO_TRUTH_ITSELF]


@pytest.mark.parametrize("own", [False, True])
def test_options_that_read_the_frames_differently_from_the_resolve_are_reported(
    own: bool, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """By B's depth, vectors and matrices --video follows things: read as planes and in pixels, they lead elsewhere."""
    made, dump, out = foreign_frames(3), tmp_path / "dump", tmp_path / "out"
    (write_own if own else write_blender)(dump, made)
    write_colour(dump / "reference", made, name=next(dump.glob("*.exr")).name.partition(".")[0])
    side = tmp_path / "camera.txt"
    side.write_text(side_text(made))
    options = ("--camera", str(side), *(() if own else ("--input", "motion.scale=-1,1")))
    assert main(["resolve", str(dump), "-o", str(out), "--device", "numpy", *options]) == 0
    asked = ["compare", str(out), str(dump), "--metrics", "mse"]
    for given, told in (((), 1), (options[:2], not own), (options[2:], 1), (options, 0)):
        capsys.readouterr()
        assert main([*asked, *given, "--video"]) == 0
        said = capsys.readouterr().err
        assert said.count("warning: A was resolved from B as other options read it: give --profile") == told
        assert ("B: profile" in said) is (not own or given != ())
        assert "A: " not in said  # files of cltaa's own
        assert ("no matrices: " in said) is (not own and "--camera" not in given)
    assert main(asked) == 0  # the colour is the same either way
    assert "warning" not in capsys.readouterr().err
