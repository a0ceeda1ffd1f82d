"""``cltaa compare --table``: results of several sequences beside ours, each as it is judged alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.commands.compare import print_entries
from cltaa.lab.judge.metrics import parse_metrics
from tests.lab.judge.test_compare_command import refusal, run_json
from tests.sequence_factory import write_sequence

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
    rows = {(row["sequence"], row["entry"]): row for row in json.loads(capsys.readouterr().out)["table"]}
    assert list(rows) == [("a", "Mine"), ("a", "basic"), ("b", "Mine"), ("b", "basic")]
    assert rows["a", "Mine"]["milliseconds"] == 1.5
    alone = run_json(capsys, entry / "a", sequences[0], "--video", *METRICS)
    assert rows["a", "Mine"]["mean"] == alone["mean"]
    assert rows["a", "Mine"]["video"] == alone["video"]
    assert rows["a", "basic"]["mean"] != rows["a", "Mine"]["mean"]


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
    assert said.err.splitlines()[-1] == "cltaa: warning: not judged: a: 1 frame that not all have"


@pytest.mark.parametrize(("frames", "judged"), [("2", [0, 1]), ("1-2", [1, 2])])
def test_frames_are_the_first_ones_or_a_range(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, frames: str, judged: list[int]
) -> None:
    options = ("--json", "--ours", "", "--frames", frames, *METRICS)
    assert main(["compare", "--table", *words(entry, sequences[0], *options)]) == 0
    assert [row["frames"] for row in json.loads(capsys.readouterr().out)["table"]] == [judged]


def test_a_sequence_that_one_stands_in_goes_by_its_folder(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(sequences[0])
    assert main(["compare", "--table", *words(entry, ".", "--ours", "", "--frames", "2", *METRICS)]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == "cltaa: warning: not judged: a: 2 frames that not all have"


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
        (("--table", "{wrong}", "{a}"), 65, "no facts of an entry"),
        (("--table", "--heatmap", "x", "{entry}", "{a}"), 64, "--heatmap does not go with --table"),
        (("--film", "x", "{entry}", "{a}"), 64, "--film goes with --table; add --table"),
    ],
)
def test_what_is_no_table_is_refused(
    capsys: pytest.CaptureFixture[str],
    sequences: list[Path],
    entry: Path,
    tmp_path: Path,
    said: list[str],
    code: int,
    why: str,
) -> None:
    (tmp_path / "empty").mkdir()
    wrong = tmp_path / "wrong"
    (wrong / "a").mkdir(parents=True)
    (wrong / "entry.toml").write_text('milliseconds = "fast"\n')
    twin = write_sequence(tmp_path / "other" / "a", 1, reference=True)
    write_sequence(tmp_path / "late" / "a", 1, first=90)
    places = {"twin": twin, "late": tmp_path / "late"} | {
        "entry": entry,
        "a": sequences[0],
        "empty": tmp_path / "empty",
        "wrong": wrong,
    }
    assert why in refusal(capsys, code, *(word.format(**places) for word in said))


def test_vdp_says_what_to_install(
    capsys: pytest.CaptureFixture[str], sequences: list[Path], entry: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pycvvdp", None)
    said = refusal(capsys, 64, "--table", "--cvvdp", str(entry), str(sequences[0]))
    assert "pip install 'cltaa[vdp]'" in said
