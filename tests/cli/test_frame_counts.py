"""Commands on one frame, and on one more than each looks at: what counts frames is wrong there first."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cltaa.cli import main
from cltaa.inputs.intake import first_frames
from cltaa.lab.check.jitter import MOST_FRAMES
from cltaa.lab.check.report import FRAMES
from tests.inputs.foreign import write_colour, write_depth
from tests.sequence_factory import make_frame, write_sequence

MOST = max(FRAMES, MOST_FRAMES) + 1


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("counts")
    return {
        count: write_sequence(folder / str(count), count, reference=True, motion=True, width=20, height=12)
        for count in (1, FRAMES + 1, MOST)
    }


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    """The answer as JSON of a command that may find mistakes, as it does in random numbers."""
    assert main([*arguments, "--json"]) in (0, 65)
    said = capsys.readouterr()
    assert "error" not in said.err
    found = json.loads(said.out)
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize(
    ("count", "asked", "seen"),
    [
        (1, [], 1),
        (1, ["--frames", "1"], 1),
        (FRAMES + 1, [], FRAMES),
        (MOST, ["--frames", str(MOST)], MOST),
        (MOST, ["--frames", "3-3"], 1),
    ],
)
def test_check_counts_the_frames(
    folders: dict[int, Path], count: int, asked: list[str], seen: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(capsys, "check", str(folders[count]), *asked)["frames"] == seen


@pytest.mark.parametrize("count", [1, MOST])
def test_inspect_counts_the_frames(folders: dict[int, Path], count: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(capsys, "inspect", str(folders[count]), "--pixels")["frames"] == count
    assert answer(capsys, "inspect", str(folders[count]), "--plan", "--device", "numpy")["kernels"] == 1


@pytest.mark.parametrize("count", [1, MOST])
def test_resolve_and_compare_count_the_frames(
    folders: dict[int, Path], count: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence, output = str(folders[count]), str(tmp_path / "out")
    assert (
        answer(capsys, "resolve", sequence, "-o", output, "--device", "numpy", "--preset", "basic")["frames"] == count
    )
    frames = answer(capsys, "compare", output, sequence, "--metrics", "mse", "--video")["frames"]
    assert isinstance(frames, list)
    assert [row["frame"] for row in frames] == [*range(count)]


@pytest.fixture
def passes(tmp_path: Path) -> Path:
    """Passes in files of their own, of which the depth begins a frame early, as a simulation's does."""
    frames = [make_frame(index) for index in range(4)]
    write_depth(tmp_path / "passes", frames)
    return write_colour(tmp_path / "passes", frames[1:], "beauty")


def test_a_count_is_of_frames_that_can_be_read(
    passes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not of the numbers that any file has."""
    asked, output = (str(passes), "--frames", "2"), tmp_path / "out"
    assert answer(capsys, "inspect", *asked)["frames"] == 2
    assert answer(capsys, "resolve", *asked, "-o", str(output), "--device", "numpy", "--preset", "basic")["frames"] == 2
    assert [path.name for path in sorted(output.glob("*.exr"))] == ["beauty.0001.exr", "beauty.0002.exr"]
    colour_alone = ("--input", "depth.channels=none")
    assert answer(capsys, "inspect", *asked, *colour_alone)["frames"] == 2
    (passes / "beauty.0000.exr").write_bytes((passes / "beauty.0001.exr").read_bytes())
    (passes / "depth.0000.exr").unlink()
    assert answer(capsys, "inspect", *asked)["frames"] == 2
    assert first_frames(passes, 2) == (1, 2)
    assert first_frames(passes, 2, assignments=colour_alone[1:]) == (0, 1)


def test_fewer_frames_than_are_asked_for_are_told(folders: dict[int, Path], capsys: pytest.CaptureFixture[str]) -> None:
    for line in ("inspect {} --frames 99", "compare {} --frames 99 --metrics mse"):
        assert main(line.format(folders[1]).split()) in (0, 65)
        assert f"cltaa: warning: {folders[1]}: of the first 99 frames only 1 exist\n" in capsys.readouterr().err, line
