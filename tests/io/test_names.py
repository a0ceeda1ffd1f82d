"""Numbers in the names of files, and the files that a name, a pattern or a list stands for."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.inputs.open import open_input
from cltaa.io.exr_write import write_image
from cltaa.io.names import Named, name_of, number_of, pattern_of, renumbered, selection_of
from cltaa.io.sequence import open_images
from tests.sequence_factory import write_images, write_sequence


def test_a_name_and_its_number() -> None:
    for name, number, sequence, seventh in [
        ("shot.0012.exr", 12, "shot", "shot.0007.exr"),
        ("shot_12.png", 12, "shot", "shot_07.png"),
        ("shot 0012.exr", 12, "shot", "shot 0007.exr"),
        ("shot3-1.exr", 1, "shot3", "shot3-7.exr"),
        ("0999.exr", 999, "", "0007.exr"),
        ("a\nb.123456789.exr", 123456789, "a\nb", "a\nb.000000007.exr"),
        ("shot.-001.exr", -1, "shot", "shot.0007.exr"),
        ("shot_-12.exr", -12, "shot", "shot_007.exr"),
        ("shot -003.exr", -3, "shot", "shot 0007.exr"),
        ("shot--003.exr", -3, "shot", "shot-0007.exr"),
        ("-0001.exr", -1, "", "00007.exr"),
        ("shot.1234567890.exr", None, "shot.1234567890", None),  # more digits than an int holds
        ("shot.-1234567890.exr", None, "shot.-1234567890", None),
        ("shot.exr", None, "shot", None),
        ("shot.0012.denoised.exr", None, "shot.0012.denoised", "shot.0007.denoised.exr"),  # only among its like
        ("x0012.take2.exr", 2, "x0012.take", "x0012.take7.exr"),
        ("x0012(1).exr", None, "x0012(1)", None),
        ("shot.0001.txt", None, "shot.0001", None),
    ]:
        path = Path("in") / name
        assert (number_of(path), name_of(path)) == (number, sequence), name
        assert renumbered(path, 7) == Path("in") / (seventh or name), name


def write_numbers(folder: Path, form: str, numbers: range) -> Path:
    """Pictures whose every value is 10 + the number."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        write_image(folder / form.format(number), {c: np.full((4, 6), 10 + number, np.float32) for c in "RGB"})
    return folder


@pytest.mark.parametrize(
    ("form", "numbers"),
    [
        ("shot.{:04d}.exr", range(-3, 3)),
        ("shot_{:d}.exr", range(-11, 2)),
        ("shot {:04d}.exr", range(-3, 0)),
        ("{:05d}.exr", range(-2, 2)),
        ("shot{:04d}.exr", range(-3, 2)),  # shot-003, which beside shot0000 is below it
        ("v2-{:04d}.exr", range(-2, 2)),
    ],
)
def test_numbers_below_0_are_read_in_order_of_time(form: str, numbers: range, tmp_path: Path) -> None:
    folder = write_numbers(tmp_path / "in", form, numbers)
    images = open_images(folder)
    assert images.numbers == tuple(numbers)
    assert [image[0, 0, 0] for image in images] == [10 + number for number in numbers]
    read = open_input(folder, frames=(numbers[0], numbers[1]))
    assert [frame.colour[0, 0, 0] for frame in read] == [10 + numbers[0], 10 + numbers[1]]


def test_a_command_takes_numbers_below_0(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_numbers(tmp_path / "in", "shot.{:04d}.exr", range(-3, 3))
    out = ["-o", str(tmp_path / "out"), "--device", "numpy", "--preview", str(tmp_path / "film.mp4")]
    assert main(["resolve", str(folder), *out, "--frames", "-2-1"]) == 0
    assert open_images(tmp_path / "out").numbers == (-2, -1, 0, 1)
    capsys.readouterr()
    compared = ["compare", str(tmp_path / "out"), str(folder), "--metrics", "mse"]
    assert main([*compared, "--frames", "-2--1", "--json"]) == 0
    assert [row["frame"] for row in json.loads(capsys.readouterr().out)["frames"]] == [-2, -1]


def test_a_gap_below_0_is_named(tmp_path: Path) -> None:
    folder = write_numbers(tmp_path / "in", "shot.{:04d}.exr", range(-3, 1))
    (folder / "shot.-002.exr").unlink()
    with pytest.raises(InputMissing, match=r"shot\.-002\.exr frame -2: the frame is missing"):
        open_images(folder)


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [("2-3#", [2, 3]), ("-2-1%04d", [-2, -1, 0, 1]), ("-3-9x3#", [-3, 0, 3]), ("1-9x2$F4", [1, 3])],
)
def test_a_pattern_may_say_which_frames(pattern: str, numbers: list[int], tmp_path: Path) -> None:
    folder = write_numbers(tmp_path / "in", "shot.{:04d}.exr", range(-3, 5))
    assert sorted(selection_of(folder / f"shot.{pattern}.exr").numbers.values()) == numbers
    with pytest.raises(InputMissing, match="no file has such a name"):
        selection_of(folder / "shot.7-9#.exr")


def names_of(named: Named) -> list[str]:
    return [path.name for path in selection_of(named).files or ()]


NAMINGS: dict[str, Callable[[Path], Named]] = {
    "folder": lambda folder: folder,
    "text": str,
    "hashes": lambda folder: folder / "synthetic.####.exr",
    "one hash": lambda folder: folder / "synthetic.#.exr",
    "printf": lambda folder: folder / "synthetic.%04d.exr",
    "printf without a width": lambda folder: folder / "synthetic.%d.exr",
    "at signs": lambda folder: folder / "synthetic.@@@@.exr",
    "houdini": lambda folder: folder / "synthetic.$F4.exr",
    "houdini in braces": lambda folder: folder / "synthetic.${F}.exr",
    "in angle brackets": lambda folder: folder / "synthetic.<F4>.exr",
    "in angle brackets without a width": lambda folder: folder / "synthetic.<F>.exr",
    "with its frames": lambda folder: folder / "synthetic.0-2#.exr",
    "glob": lambda folder: folder / "synth*.*.exr",
    "glob of digits": lambda folder: folder / "synthetic.000[0-9].exr",
    "glob of a folder": lambda folder: folder.parent / "i?" / "*.exr",
    "list": lambda folder: sorted(folder.glob("*.exr")),
    "list out of order": lambda folder: sorted(map(str, folder.glob("*.exr")), reverse=True),
    "list of patterns": lambda folder: [folder / "synthetic.000[01].exr", folder / "synthetic.0002.exr"],
}


def test_a_sequence_is_named_as_compositors_do(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 3, reference=True)
    for naming, name in NAMINGS.items():
        named = name(folder)
        sequence = open_input(named)
        assert (sequence.folder, sequence.name, sequence.numbers) == (folder, "synthetic", (0, 1, 2)), naming
        assert sequence.reference is not None, naming
        assert open_images(named).numbers == (0, 1, 2), naming
        other = open_input(named, assignments=["colour.channels=R G B"])
        assert (other.folder, other.numbers) == (folder, (0, 1, 2)), naming


@pytest.mark.parametrize("naming", ["folder", "in capitals", "hashes", "glob of a folder", "list"])
def test_every_command_takes_a_naming(naming: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 3, reference=True)
    write_images(folder, [np.zeros((23, 37, 3), np.float32)] * 2, name="beside")
    if naming in ("folder", "in capitals"):
        for path in folder.glob("beside.*"):
            path.unlink()
    suffix = ".EXR" if naming == "in capitals" else ".exr"
    for path in [*folder.glob("syn*.*"), *folder.glob("reference/*.exr")]:
        path.rename(path.with_suffix(suffix))
    named = NAMINGS.get(naming, str)(folder)
    words = [str(named)] if isinstance(named, str | Path) else [str(path) for path in selection_of(named).files or ()]
    words = [word for word in words if "beside" not in word]
    if naming == "glob of a folder":
        words = [str(folder.parent / "i?" / "syn*.exr")]
    assert main(["inspect", *words, "--json"]) == 65  # whose jitter is not centred
    assert json.loads(capsys.readouterr().out)["frames"] == 3
    out = tmp_path / "out"
    assert main(["resolve", *words, "-o", str(out), "--device", "numpy"]) == 0
    assert [path.name for path in sorted(out.glob(f"*{suffix}"))] == [f"synthetic.000{n}{suffix}" for n in range(3)]
    capsys.readouterr()
    assert main(["check", *words, "--json"]) in (0, 65)
    assert json.loads(capsys.readouterr().out)["frames"] == 3
    assert main(["compare", str(out), *words, "--json", "--metrics", "mse"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (len(told["frames"]), told["reference"]) == (3, str(folder / "reference"))


def test_a_file_is_a_sequence_of_one_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 3)
    second = folder / "synthetic.0001.exr"
    assert open_input(second).numbers == open_images(second).numbers == (1,)
    (folder / "synthetic.0002.exr").rename(tmp_path / "alone.exr")
    write_images(tmp_path / "still", [np.ones((4, 6, 3), np.float32)])
    still = next((tmp_path / "still").glob("*.exr")).rename(tmp_path / "still" / "still.exr")
    assert open_input(still).numbers == open_images(still).numbers == (0,)
    assert main(["resolve", str(still), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    assert [path.name for path in (tmp_path / "out").glob("*.exr")] == ["still.exr"]
    assert main(["inspect", str(tmp_path / "out" / "still.exr")]) == 0
    capsys.readouterr()


def test_a_pattern_chooses_one_of_several_sequences(tmp_path: Path) -> None:
    write_sequence(tmp_path, 2)
    write_sequence(tmp_path, 3, name="other")
    with pytest.raises(DataError, match="several sequences") as caught:
        open_images(tmp_path)
    (told,) = shlex.split(str(caught.value).split("such as ")[1].split(";")[0])
    assert told == str(tmp_path / "other.####.exr") == str(pattern_of(tmp_path / "other.0001.exr"))
    assert open_images(told).numbers == (0, 1, 2)
    assert open_input(tmp_path / "synthetic.%04d.exr").numbers == (0, 1)


def test_files_of_several_folders_are_sets_of_one_sequence(tmp_path: Path) -> None:
    write_numbers(tmp_path / "beauty", "x.{:04d}.exr", range(2))
    for number in range(2):
        (tmp_path / "depth").mkdir(exist_ok=True)
        write_image(tmp_path / "depth" / f"x.{number:04d}.exr", {"Z": np.full((4, 6), 3, np.float32)})
    write_numbers(tmp_path / "albedo", "x.{:04d}.exr", range(2))
    for depth in (tmp_path / "depth", tmp_path / "beauty" / ".." / "depth"):
        read = open_input([tmp_path / "beauty" / "x.####.exr", depth / "x.####.exr"])
        assert [frame.depth[0, 0] for frame in read] == [3, 3]
        assert any(line.endswith("depth depth.Z") for line in read.notes)


def test_what_stands_under_a_name_goes_before_a_pattern(tmp_path: Path) -> None:
    assert open_images(write_numbers(tmp_path / "take [1]", "x#1.{:04d}.exr", range(2))).numbers == (0, 1)
    assert names_of(tmp_path / "take [1]" / "x#1.0001.exr") == ["x#1.0001.exr"]
    assert len(names_of(tmp_path / "take [1]" / "x?1.*.exr")) == 2  # its folder is none of the pattern
    assert len(names_of(tmp_path / "t*k**[[]1]" / "*.exr")) == 2
    write_numbers(tmp_path / "take [1]" / "beauty [x]", "y.{:04d}.exr", range(2))
    assert open_images(tmp_path / "take [1]" / "b*" / "y.####.exr").numbers == (0, 1)


def test_a_file_in_capitals_is_a_frame_beside_others(tmp_path: Path) -> None:
    write_images(tmp_path, [np.zeros((4, 6, 3), np.float32)] * 3)
    for path in tmp_path.glob("*.0001.exr"):
        path.rename(path.with_suffix(".EXR"))
    assert open_images(tmp_path).numbers == (0, 1, 2)
    (named,) = tmp_path.glob("*.EXR")
    assert open_images(named).numbers == open_images(pattern_of(named)).numbers == (1,)


def test_the_sign_and_the_width_of_a_pattern_count(tmp_path: Path) -> None:
    write_numbers(tmp_path, "shot{:04d}.exr", range(-3, 0))
    assert open_images(tmp_path / "shot####.exr").numbers == (-3, -2, -1)
    assert open_images(tmp_path / "shot-###.exr").numbers == (1, 2, 3)
    assert names_of(tmp_path / "shot%02d.exr") == ["shot-001.exr", "shot-002.exr", "shot-003.exr"]
    with pytest.raises(InputMissing, match=f"no file has such a name; name the folder .*: {tmp_path}"):
        selection_of(tmp_path / "shot#####.exr")


@pytest.mark.parametrize("tail", [".denoised", "_left eye", "_oidn.scho\u0308n"])
def test_words_may_follow_the_number(tail: str, tmp_path: Path) -> None:
    write_numbers(tmp_path, "x.{:04d}" + tail + ".exr", range(3))
    for number in ("####", "%04d", "$F4", "@@@@", "*", "0-2#"):
        assert len(names_of(tmp_path / f"x.{number}{tail}.exr")) == 3
    for named in (tmp_path, tmp_path / f"x.####{tail}.exr"):
        images = open_images(named)
        assert (images.name, images.numbers) == (f"x{tail}", (0, 1, 2))
        assert [image[0, 0, 0] for image in images] == [10, 11, 12]
    (tmp_path / f"x.0001{tail}.exr").unlink()
    with pytest.raises(InputMissing, match=re.escape(f"x.0001{tail}.exr frame 1: the frame is missing")):
        open_images(tmp_path)


def test_few_digits_before_words_are_a_number_where_a_pattern_says_so(tmp_path: Path) -> None:
    """Else it is three cameras that are numbered."""
    write_numbers(tmp_path, "cam{:d}_final.exr", range(9, 12))
    with pytest.raises(InputMissing, match="no frames in the folder") as caught:
        open_images(tmp_path)
    (pattern,) = re.findall("or name them by a pattern: (.*)$", str(caught.value))
    assert open_images(*shlex.split(pattern)).numbers == (9, 10, 11)
    assert open_images(tmp_path / "cam#_final.exr").numbers == (9, 10, 11)
    assert open_images(tmp_path / "cam##_final.exr").numbers == (10, 11)


def test_files_with_words_behind_a_number_are_no_frames_beside_those_without(tmp_path: Path) -> None:
    """As a denoiser leaves its own beside those that it read."""
    write_numbers(tmp_path, "x.{:04d}.exr", range(2))
    write_numbers(tmp_path, "x.{:04d}.denoised.exr", range(2))
    with pytest.raises(DataError, match=r"several sequences in one folder .*such as \S+/x\.####\.exr"):
        open_images(tmp_path)
    read = open_input(tmp_path, assignments=["colour.channels=R G B"])
    assert read.name == "x"
    ignored = "ignored, for they are not numbered as the frames are: x.0000.denoised.exr, x.0001.denoised.exr"
    assert ignored in read.notes
    assert names_of(tmp_path / "x.####.exr") == ["x.0000.exr", "x.0001.exr"]
    named = tmp_path / "x.####.denoised.exr"
    assert names_of(named) == ["x.0000.denoised.exr", "x.0001.denoised.exr"]
    assert open_images(named).numbers == (0, 1)
    (tmp_path / "x.0001.denoised.exr").unlink()  # as while the denoiser is at work
    assert open_input(tmp_path, assignments=["colour.channels=R G B"]).numbers == (0, 1)


@pytest.mark.parametrize(
    ("colour", "depth", "patterns"),
    [("rgb.{}.exr", "d.{}.depth.exr", ["rgb.####.exr", "d.####.depth.exr"]), ("{}_rgb.exr", "{}_depth.exr", ["."])],
    ids=["named", "found"],
)
def test_words_of_a_pass_may_stand_behind_its_number(
    colour: str, depth: str, patterns: list[str], tmp_path: Path
) -> None:
    write_numbers(tmp_path, colour.format("{:04d}"), range(2))
    for number in range(2):
        write_image(tmp_path / depth.format(f"{number:04d}"), {"Z": np.full((4, 6), 3, np.float32)})
    read = open_input([tmp_path / pattern for pattern in patterns])
    assert [(frame.colour[0, 0, 0], frame.depth[0, 0]) for frame in read] == [(10, 3), (11, 3)]


@pytest.mark.parametrize(
    ("form", "numbers", "name"),
    [
        ("s_{:04d}_1920x1080", range(3), "s_1920x1080"),
        ("{:04d}_1920x1080_final", range(1, 4), "1920x1080_final"),
        ("frame ({:d})", range(9, 12), "frame ()"),
        ("s.{:04d}.v002", range(3), "s.v002"),
        ("shot_v02_{:04d}_linear2", range(-1, 2), "shot_v02_linear2"),
        ("{:04d}_v2", range(3), "v2"),
        ("s_{:04d}_a2b", range(3), "s_a2b"),
    ],
)
def test_the_number_that_varies_is_that_of_the_frame(form: str, numbers: range, name: str, tmp_path: Path) -> None:
    folder = write_numbers(tmp_path / "in", form + ".exr", numbers)
    for named in (folder, folder / (re.sub(r"\{.*\}", "#", form) + ".exr")):
        for opened in (open_images, open_input):
            read = opened(named)
            assert (read.name, read.numbers) == (name, tuple(numbers))
        assert [image[0, 0, 0] for image in open_images(named)] == [10 + number for number in numbers]
    gap = folder / f"{form.format(numbers[1])}.exr"
    gap.unlink()
    with pytest.raises(InputMissing, match=re.escape(f"{gap} frame {numbers[1]}: the frame is missing")):
        open_images(folder)


@pytest.mark.parametrize("copy", ["s.0001~", "s.0001 (1)", "s.0001 - Copy", "s.0001 - Copy (2)", "s.0001 copy 2"])
def test_a_copy_beside_its_frame_is_none(copy: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_numbers(tmp_path / "in", "s.{:04d}.exr", range(3))
    (folder / f"{copy}.exr").write_bytes(b"")
    for opened in (open_images, open_input):
        read = opened(folder)
        assert (read.name, read.numbers) == ("s", (0, 1, 2))
    assert main(["inspect", str(folder)]) == 0
    assert f"not numbered as the frames are: {copy}.exr" in capsys.readouterr().out


@pytest.mark.parametrize("names", [("cam9_v2", "cam11_v2"), ("frame", "frame (1)"), ("a_0001_0002x", "a_0003_0004x")])
def test_numbers_that_may_be_others_are_not_taken_for_those_of_frames(names: tuple[str, ...], tmp_path: Path) -> None:
    for name in names:
        write_numbers(tmp_path, name + ".exr", range(1))
    with pytest.raises((DataError, InputMissing), match=r"several sequences|no frames in the folder") as caught:
        open_images(tmp_path)
    assert "by a pattern" not in str(caught.value)


def test_the_first_frame_of_each_of_several_shots_has_its_number_last(tmp_path: Path) -> None:
    for shot in (10, 20):
        write_numbers(tmp_path, f"shot{shot:04d}_a.{{:04d}}.exr", range(1, 2))
    with pytest.raises(DataError, match="several sequences in one folder"):
        open_images(tmp_path)


@pytest.mark.parametrize(
    ("named", "error", "words"),
    [
        ("nowhere", InputMissing, "the folder is missing"),
        ("nowhere.0001.exr", InputMissing, "the file is missing"),
        ("nowhere/x.####.exr", InputMissing, "no file has such a name; check the name"),
        ("x.[z-a].exr", UsageError, "no such pattern"),
        ([], UsageError, "no file is named"),
        (b"in", UsageError, "no sequence is named"),
        ("in\0", UsageError, "NUL in its name"),
        (["in", "in"], UsageError, "a list of files names something else"),
        (["in/x.0001.exr", "nowhere"], UsageError, "the file is missing"),
    ],
)
def test_what_names_nothing(
    named: Named, error: type[CltaaError], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_numbers(tmp_path / "in", "x.{:04d}.exr", range(2))
    monkeypatch.chdir(tmp_path)
    for opened in (open_images, open_input):
        with pytest.raises(error, match=words):
            opened(named)


def test_the_files_that_a_shell_lists_are_compared_as_sequences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two = (write_numbers(tmp_path / name, "x.{:04d}.exr", range(3)) for name in ("a", "b"))
    listed = [str(path) for folder in (one, two) for path in sorted(folder.iterdir())]
    assert main(["compare", *listed, "--metrics", "mse", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["frames"]) == 3
    assert main(["compare", listed[0], listed[1], "--metrics", "mse-linear", "--json"]) == 0  # two pictures
    assert json.loads(capsys.readouterr().out)["mean"]["mse-linear"] == 1.0
