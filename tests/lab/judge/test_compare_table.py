"""``cltaa compare --table``: results of several sequences beside ours, each as it is judged alone."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from cltaa.cli import main
from cltaa.commands.compare import print_entries
from cltaa.io.exr_write import write_frame, write_image
from cltaa.lab.judge.entries import means_of
from cltaa.lab.judge.metrics import parse_metrics
from tests.inputs.foreign import frames as foreign_frames
from tests.inputs.foreign import side_text, write_blender, write_own
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import make_frame, write_sequence

FRAMES = 4
METRICS = ("--metrics", "mse,psnr")


@pytest.fixture
def sequences(tmp_path: Path) -> list[Path]:
    return [write_sequence(tmp_path / name, FRAMES, reference=True, seed=seed) for seed, name in enumerate(("a", "b"))]


@pytest.fixture
def entry(tmp_path: Path, sequences: list[Path]) -> Path:
    """The single samples of both sequences, as an engine would send them."""
    folder = tmp_path / "mine"
    for sequence in sequences:
        (folder / sequence.name).mkdir(parents=True)
        for path in sequence.glob("*.exr"):
            (folder / sequence.name / path.name).symlink_to(path)
    (folder / "entry.toml").write_text('name = "Mine"\nmilliseconds = 1.5\n')
    return folder


def words(*paths: Path | str) -> list[str]:
    return [str(path) for path in paths]


def test_each_row_is_what_compare_says_of_it_alone(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path
) -> None:
    assert main(["compare", "--table", *words(entry, *sequences, "--json", "--ours", "basic", *METRICS)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(row["sequence"], row["entry"]) for row in told["means"]] == [
        ("mean of 2 sequences", "Mine"),
        ("mean of 2 sequences", "basic"),
    ]
    rows = {(row["sequence"], row["entry"]): row for row in told["table"]}
    mses = [rows[name, "Mine"]["mean"]["mse"] for name in "ab"]
    assert told["means"][0]["mean"]["mse"] == pytest.approx(sum(mses) / 2, rel=1e-15)
    assert list(rows) == [("a", "Mine"), ("a", "basic"), ("b", "Mine"), ("b", "basic")]
    assert rows["a", "Mine"]["milliseconds"] == 1.5
    alone = run_json(capsys, entry / "a", sequences[0], "--video", *METRICS)
    assert rows["a", "Mine"]["mean"] == alone["mean"]
    assert rows["a", "Mine"]["video"] == alone["video"]
    assert rows["a", "basic"]["mean"] != rows["a", "Mine"]["mean"]


def test_each_column_is_explained_below(capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path) -> None:
    capture = sequences[0]
    several = words("--video", capture, entry / "a", capture)
    for told in (words("--table", entry, capture, "--ours", "basic"), several):
        assert main(["compare", *told, *METRICS]) == 0
        printed = capsys.readouterr().out
        heads = [head for head in re.findall(r"([a-z]+) [↑↓]", printed) if head != "ms"]  # which the entry itself says
        assert {"mse", "flicker", "samples"} <= {*heads}
        assert heads == re.findall(r"^  ([a-z]+): ", printed, re.MULTILINE)


def test_our_presets_read_a_sequence_as_asked(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The same frames, as cltaa and as another tool writes them, have the same scores."""
    made = foreign_frames(FRAMES)
    scores = {}
    for name, write in (("own", write_own), ("shot", write_blender)):
        folder = tmp_path / name
        write(folder, made)
        write(folder / "reference", [replace(frame, colour=frame.colour * np.float32(0.8)) for frame in made])
        camera = tmp_path / "camera.txt"
        camera.write_text(side_text(made))
        asked = ("--ours", "default", *METRICS, "--camera", str(camera))
        assert main(["compare", "--table", str(folder), "--json", *asked]) == 0
        (row,) = json.loads(capsys.readouterr().out)["table"]
        scores[name] = row["mean"], row["video"]
    assert scores["shot"] == scores["own"]


@pytest.mark.parametrize("sample_alpha", [False, True])
def test_alpha_is_judged_where_both_have_it(
    sample_alpha: bool, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Of each test, and of the single samples beside several."""
    folder = tmp_path / "a"
    (folder / "reference").mkdir(parents=True)
    for number in range(2):
        frame = make_frame(number, alpha=sample_alpha)
        write_frame(folder / f"x.{number:04d}.exr", frame)
        half = np.full(frame.depth.shape, 0.5, np.float32)
        write_image(folder / "reference" / f"x.{number:04d}.exr", dict.fromkeys("RGBA", half))
    for name in ("mine", "theirs"):
        (tmp_path / name / "a").mkdir(parents=True)
        for path in folder.glob("*.exr"):
            shutil.copy(path, tmp_path / name / "a")
    options = ("--ours", "basic", *METRICS)
    assert main(["compare", "--table", *words(tmp_path / "mine", folder), "--json", *options]) == 0
    mine, basic = json.loads(capsys.readouterr().out)["table"]
    alone = run_json(capsys, tmp_path / "mine" / "a", folder, *METRICS)
    assert ("alpha" in mine, "alpha" in basic) == (sample_alpha, sample_alpha)
    assert mine.get("alpha") == alone.get("alpha")
    several = (tmp_path / "mine" / "a", tmp_path / "theirs" / "a", folder)
    for asked in (["--table", *words(tmp_path / "mine", folder), *options], [*words(*several), *METRICS]):
        assert main(["compare", *asked]) == 0
        said = capsys.readouterr().out
        assert ("alpha ↓" in said) == sample_alpha
        assert not sample_alpha or f"{alone['alpha']['mse'] ** 0.5:.4f}" in said


def test_means_of_alpha_are_those_of_its_squared_error_and_its_worst() -> None:
    values = [{"mse": 0.1, "worst": 0.5, "psnr-white": 20.0}, {"mse": 0.3, "worst": 0.9, "psnr-white": 20.0}]
    rows = [{"sequence": name, "entry": "e", "alpha": each} for name, each in zip("ab", values, strict=True)]
    (mean,) = means_of(rows)
    assert mean["alpha"] == {"mse": 0.2, "worst": 0.9, "psnr-white": pytest.approx(20.0)}
    assert "alpha" not in means_of([rows[0], {"sequence": "b", "entry": "e"}])[0]
    assert means_of(rows[:1]) == []  # one sequence is its own mean


@pytest.mark.parametrize("asked", [False, True])
def test_what_jod_means_is_said_where_it_was_asked_for(asked: bool, capsys: pytest.CaptureFixture[str]) -> None:
    row = {"sequence": "a", "entry": "Mine", "mean": {"mse": 0.25}, **({"cvvdp": 9.87} if asked else {})}
    print_entries([row], parse_metrics("mse"), cvvdp=asked)
    said = capsys.readouterr().out
    assert ("JOD" in said, "9.87" in said, "cvvdp" in said) == (asked, asked, asked)


def test_frames_that_one_lacks_are_judged_of_none(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path
) -> None:
    next((entry / "a").glob("*.0001.exr")).unlink()
    assert main(["compare", "--table", *words(entry, *sequences, "--json", "--ours", "basic", *METRICS)]) == 0
    said = capsys.readouterr()
    rows = {(row["sequence"], row["entry"]): row for row in json.loads(said.out)["table"]}
    assert [rows["a", name]["frames"] for name in ("Mine", "basic")] == [[0, 2, 3]] * 2
    assert "video" not in rows["a", "basic"]
    assert "video" in rows["b", "basic"]
    assert said.err.splitlines()[-1] == "cltaa: warning: a: not judged: frame 1, which not all have"
    assert json.loads(said.out)["warnings"] == ["a: not judged: frame 1, which not all have"]


@pytest.mark.parametrize(("frames", "judged"), [("1", [0]), ("2", [0, 1]), ("1-2", [1, 2]), ("3-3", [3])])
def test_frames_are_the_first_ones_or_a_range(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, frames: str, judged: list[int]
) -> None:
    options = ("--json", "--ours", "", "--frames", frames, *METRICS)
    assert main(["compare", "--table", *words(entry, sequences[0], *options)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["frames"] for row in found["table"]] == [judged]
    alone = run_json(capsys, entry / "a", sequences[0], "--frames", f"{judged[0]}-{judged[-1]}", *METRICS)
    assert [row["mean"] for row in found["table"]] == [alone["mean"]]
    assert found["warnings"] == []  # all have what is asked for


def test_a_sequence_that_one_stands_in_goes_by_its_folder(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(sequences[0])
    assert main(["compare", "--table", *words(entry, ".", "--json", "--ours", "", "--frames", "2", *METRICS)]) == 0
    assert [row["sequence"] for row in json.loads(capsys.readouterr().out)["table"]] == ["a"]


def test_what_compare_doubts_the_table_doubts(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path
) -> None:
    truth = sequences[0] / "reference"
    shutil.rmtree(truth)
    assert main(["resolve", *words(sequences[1], "-o", truth, "--preset", "basic")]) == 0
    assert main(["compare", "--table", *words(entry, sequences[0], "--ours=", *METRICS)]) == 0
    assert f"cltaa: warning: a: Mine: the truth of B, {truth}, was written by a resolve" in capsys.readouterr().err


def test_pictures_beside_an_entrys_frames_are_not_judged(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path
) -> None:
    asked = ["compare", "--table", *words(entry, sequences[0], "--json", "--ours=", *METRICS)]
    assert main(asked) == 0
    alone = json.loads(capsys.readouterr().out)["table"]
    for path in list((entry / "a").glob("*.exr")):
        Image.new("RGB", (37, 23)).save(path.with_suffix(".png"))
    assert main(asked) == 0
    assert json.loads(capsys.readouterr().out)["table"] == alone


def test_a_preset_of_ours_may_be_a_file_anywhere(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text('preset = "basic"\n')
    ours = f"basic,{mine}"
    assert main(["compare", "--table", *words(entry, sequences[0], "--json", "--ours", ours, *METRICS)]) == 0
    _, ours_row, mine_row = json.loads(capsys.readouterr().out)["table"]
    assert mine_row["mean"] == ours_row["mean"]


@pytest.mark.parametrize(("option", "code"), [("--verify", 65), ("--no-verify", 0)])
def test_our_presets_read_what_is_not_verified_either(sequences: list[Path], option: str, code: int) -> None:
    (sequences[0] / "sequence.json").write_text(json.dumps({"files": {"synthetic.0002.exr": 64 * "0"}}))
    assert main(["compare", "--table", *words(sequences[0], "--ours", "accumulate", option, *METRICS)]) == code


def test_an_entry_of_a_region_is_refused(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path
) -> None:
    for path in sorted((entry / "a").iterdir()):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            kept = {name: channel.pixels[4:, 4:].copy() for name, channel in file.channels().items()}
            window = {"dataWindow": (np.array([4, 4], np.int32), np.array([36, 22], np.int32))}
            path.unlink()  # a link
            OpenEXR.File(file.header() | window, kept).write(str(path))
    said = refusal(capsys, 65, "--table", str(entry), str(sequences[0]), "--ours=")
    assert "a: an entry shows another region than the sequence" in said


def test_a_name_is_shown_to_the_letter(capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path) -> None:
    (entry / "entry.toml").write_text('name = "[red]x[/red]"\n')
    assert main(["compare", "--table", *words(entry, sequences[0], "--ours=", *METRICS)]) == 0
    assert "[red]x[/red]" in capsys.readouterr().out


def test_a_film_shows_entries_ours_and_the_truth_at_twice_the_size(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, tmp_path: Path
) -> None:
    av = pytest.importorskip("av", reason="films need the extra video")
    films = tmp_path / "films"
    options = ("--ours", "basic", "--film", films, *METRICS)
    assert main(["compare", "--table", *words(entry, *sequences, *options)]) == 0
    assert "mean of 2 sequences" in capsys.readouterr().out
    assert sorted(path.name for path in films.iterdir()) == ["a.mp4", "b.mp4"]
    with av.open(str(films / "a.mp4")) as film:
        stream = film.streams.video[0]
        shown = sum(1 for _ in film.decode(stream))
        assert shown == FRAMES
        assert stream.width > 3 * 2 * 37


@pytest.mark.parametrize(
    ("said", "code", "why"),
    [
        (
            ("--table", "{entry}"),
            64,
            "no captured sequence among the folders (expected ENTRY... SEQUENCE..., a SEQUENCE with its truth in "
            "reference/); make one: cltaa capture corridor",
        ),
        (("--table", "{empty}", "{a}"), 66, "an entry of none of the sequences"),
        (("--table", "{entry}", "{a}", "{twin}"), 64, "--table: two sequences are called a; name their folders apart"),
        (("--table", "{late}", "{a}", "--ours="), 66, "the entries of a have no frame in common"),
        (("--table", "{late}", "{a}", "--ours=", "--frames", "2-3"), 66, "the entries of a have no frame in common"),
        (
            ("--table", "{late}", "{a}", "--ours", "basic"),
            66,
            "the entries of a have no frame in common (found late 90)",
        ),
        (("--table", "{entry}", "{a}", "--frames", "7-9"), 64, "{a} frame 7: no such frame (expected 0-3)"),
        (("--table", "{entry}", "{a}", "--frames", "3-2"), 64, "{a}: the range of frames is empty (found 3-2)"),
        (("--table", "{a}", "--ours="), 64, "{a}: no entry to judge on this sequence; name one, or presets of ours"),
        (("--table", "{late}", "{a}", "{b}", "--ours="), 64, "{b}: no entry to judge on this sequence"),
        (("--table", "{entry}", "{twice}", "{a}"), 64, "--table: two entries are called Mine; give one another name"),
        (("--table", "{basic}", "{a}", "--ours", "basic"), 64, "--table: two entries are called basic"),
        (("--table", "{entry}", "{a}", "--ours", "basic,fats"), 64, "unknown preset fats; did you mean fast?"),
        (
            ("--table", "{mixed}", "{a}"),
            65,
            "{mixed}/a: several sequences in one folder (found x, y); leave the frames of one",
        ),
        (("--table", "--heatmap", "x", "{entry}", "{a}"), 64, "--heatmap does not go with --table"),
        (("--film", "x", "{entry}", "{a}"), 64, "--film goes with --table; add --table"),
    ],
)
def test_what_is_no_table_is_refused(
    capsys: pytest.CaptureFixture[str],
    entry: Path,
    tmp_path: Path,
    said: list[str],
    code: int,
    why: str,
) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("twice", "basic"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a").symlink_to(entry / "a")
    (tmp_path / "twice" / "entry.toml").symlink_to(entry / "entry.toml")
    for name in ("x", "y"):
        write_sequence(tmp_path / "mixed" / "a", 1, name=name)
    twin = write_sequence(tmp_path / "other" / "a", 1, reference=True)
    write_sequence(tmp_path / "late" / "a", 1, first=90)
    places = {name: tmp_path / name for name in ("late", "a", "b", "empty", "twice", "basic", "mixed")}
    places |= {"twin": twin, "entry": entry}
    assert why.format(**places) in refusal(capsys, code, *(word.format(**places) for word in said))


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ('milliseconds = "fast"', "milliseconds has no such value (expected a number above 0, found fast)"),
        ("milliseconds = -1", "milliseconds has no such value (expected a number above 0, found -1)"),
        (f"milliseconds = 1{400 * '0'}", "milliseconds has no such value (expected a number above 0, found 1000"),
        ("milliseconds = nan", "milliseconds has no such value (expected a number above 0, found nan)"),
        ("name = 3", "name has no such value (expected a text in quotes, found 3)"),
        ('nmae = "x"', "unknown key nmae; did you mean name?"),
        ("name =", "not TOML: "),
    ],
)
def test_facts_that_are_none_are_refused(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, said: str, why: str
) -> None:
    (entry / "entry.toml").write_text(f"{said}\n")
    assert f"{entry}/entry.toml: {why}" in refusal(capsys, 65, "--table", str(entry), str(sequences[0]))


def test_vdp_says_what_to_install(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pycvvdp", None)
    said = refusal(capsys, 64, "--table", "--cvvdp", str(entry), str(sequences[0]))
    assert "pip install 'cltaa[vdp]'" in said
