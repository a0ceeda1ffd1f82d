"""Frames that are missing, double, no files, or of another size: refused by name, or a new history; never blended."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.resolver import Resolver
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame
from cltaa.io.manifest import file_sha256
from cltaa.io.sequence import open_sequence
from tests.faults.runs import arguments, unprivileged
from tests.sequence_factory import bits, make_frame, write_frames, write_sequence

SIZES = ((9, 7), (9, 8), (8, 7), (37, 23), (7, 9), (10, 7), (1, 1))  # columns, rows


def frame_path(folder: Path, number: int) -> Path:
    return folder / f"synthetic.{number:04d}.exr"


def record(folder: Path) -> None:
    """A sequence.json that lists what is there, as a capture writes it."""
    files = {path.name: file_sha256(path) for path in sorted(folder.glob("*.exr"))}
    (folder / "sequence.json").write_text(json.dumps({"files": files}))


def test_what_goes_on_without_a_frame_is_named_with_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The two words that help are options of two commands, and those who ran another are told of which."""
    folder, judge = write_sequence(tmp_path / "in", 5), ["--metrics", "mse"]
    frame_path(folder, 1).unlink()
    cure = "or go on without it by cltaa resolve --gaps reset or cltaa compare --frames A-B\n"
    assert main(["compare", str(folder), str(folder), *judge]) == 66
    assert capsys.readouterr().err.endswith(cure)
    assert main(["tune", str(folder), "--budget", "9ms", "-o", str(tmp_path / "best.toml")]) == 66
    assert capsys.readouterr().err.endswith(cure)
    assert main(["compare", str(folder), str(folder), *judge, "--frames", "2-4"]) == 0
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset")) == 0
    assert main(["inspect", str(frame_path(folder, 0)), str(frame_path(folder, 3)), "--plan"]) == 66
    assert "synthetic.0001.exr frame 1: the frame is missing; capture" in capsys.readouterr().err
    assert main(["inspect", str(frame_path(folder, 2)), str(frame_path(folder, 4)), "--plan"]) == 66
    said = f"{frame_path(folder, 3)} frame 3: the frame is not among the files named; name it too, or go on"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("missing", [[3], [1], [4], [2, 3], [1, 3], [1, 2, 3, 4]])
def test_gap_is_refused_or_begins_anew(tmp_path: Path, missing: list[int], capsys: pytest.CaptureFixture[str]) -> None:
    """Behind a gap every frame is, to the bit, what it is when the sequence begins there."""
    folder, count = write_sequence(tmp_path / "in", 6, width=9, height=7, motion=True), 6
    for number in missing:
        frame_path(folder, number).unlink()
    assert main(arguments(folder, tmp_path / "refused")) == 66
    assert f"synthetic.{missing[0]:04d}.exr frame {missing[0]}: the frame is missing" in capsys.readouterr().err
    assert not (tmp_path / "refused").exists()
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset")) == 0
    present = [number for number in range(count) if number not in missing]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.exr")) == [
        frame_path(folder, number).name for number in present
    ]
    for number in present:
        if number - 1 in missing:
            resolver = Resolver(device="numpy")
        frame = make_frame(number, width=9, height=7, motion=True)
        if number == 0:
            resolver = Resolver(device="numpy")
        expected = resolver.resolve(frame)
        channels, _ = read_image(frame_path(tmp_path / "out", number))
        assert all(np.array_equal(bits(channels[c]), bits(expected[..., place])) for place, c in enumerate("RGB"))


def test_what_is_wrong_outside_the_frames_asked_for_does_not_count(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gap, a damaged file and another size before and behind them."""
    folder = write_sequence(tmp_path / "in", 8, width=9, height=7)
    write_sequence(tmp_path / "whole", 8, width=9, height=7)
    frame_path(folder, 1).unlink()
    frame_path(folder, 6).write_bytes(b"")
    write_sequence(folder, 1, first=7, width=8, height=7)
    assert main(arguments(folder, tmp_path / "out", "--frames", "3-5")) == 0
    assert main(arguments(tmp_path / "whole", tmp_path / "sound", "--frames", "3-5")) == 0
    for number in (3, 4, 5):
        ours, theirs = (read_image(frame_path(tmp_path / name, number))[0] for name in ("out", "sound"))
        assert np.array_equal(bits(ours["G"]), bits(theirs["G"]))
    capsys.readouterr()
    assert main(["compare", str(folder), str(tmp_path / "sound"), "--frames", "4-5", "--metrics", "psnr"]) == 0
    assert main(arguments(folder, tmp_path / "refused", "--frames", "0-5")) == 66
    assert "synthetic.0001.exr frame 1: the frame is missing" in capsys.readouterr().err
    assert main(arguments(folder, tmp_path / "refused", "--frames", "1-5")) == 64
    assert "frame 1: no such frame (expected 0, 2-7)" in capsys.readouterr().err


@pytest.mark.parametrize(("first", "step"), [(1, 7), (0, 2)])
@pytest.mark.parametrize("preset", ["default", "gather-8"])
def test_numbers_that_lie_apart_are_one_history(
    tmp_path: Path, first: int, step: int, preset: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """To the bit that of the same frames under numbers without a gap, and under their own names. So few frames are
    kept that two would share a place, were it theirs by number."""
    count, apart, chosen = 5, tmp_path / "apart", ("--preset", preset, "--set", "history_frames=3")
    whole = write_sequence(tmp_path / "whole", count, width=9, height=7, motion=True)
    write_frames(apart, (replace(frame, index=first + step * frame.index) for frame in open_sequence(whole)))
    assert main(arguments(apart, tmp_path / "refused", *chosen)) == 66
    told = f"frame {first + 1}: the frame is missing; the frames are {step} apart: --step {step} takes each as"
    assert told in capsys.readouterr().err
    assert main(arguments(apart, tmp_path / "out", *chosen, "--step", str(step))) == 0
    assert main(arguments(whole, tmp_path / "one", *chosen)) == 0
    for number in range(count):
        ours, theirs = (
            read_image(frame_path(tmp_path / name, at))[0]["G"]
            for name, at in (("out", first + step * number), ("one", number))
        )
        assert np.array_equal(bits(ours), bits(theirs))
    assert main(["compare", str(tmp_path / "out"), str(tmp_path / "out"), "--metrics", "mse"]) == 0
    shutil.copytree(tmp_path / "out", apart / "reference")
    assert main(["compare", str(tmp_path / "out"), str(apart), "--metrics", "mse"]) == 0
    capsys.readouterr()
    main(["inspect", str(apart)])
    assert f"those there are {step} apart: --step {step}" in " ".join(capsys.readouterr().out.split())
    main(["inspect", str(apart), "--step", str(step)])
    assert "missing" not in capsys.readouterr().out
    frame_path(apart, first + 2 * step).unlink()
    assert main(arguments(apart, tmp_path / "gap", *chosen, "--step", str(step))) == 66
    assert f"frame {first + 2 * step}: the frame is missing; capture" in capsys.readouterr().err
    assert main(arguments(whole, tmp_path / "gap", *chosen, "--step", "3")) == 65
    assert (
        "frame 1: the frame number lies between two steps (expected every 3. frame from 0 on)"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("number", [0, 3])
def test_first_and_last_frame_are_missed_where_the_capture_lists_them(
    tmp_path: Path, number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_sequence(tmp_path / "in", 4, width=9, height=7)
    record(folder)
    frame_path(folder, number).unlink()
    assert main(arguments(folder, tmp_path / "out")) == 66
    assert f"frame {number}: the frame is missing; capture or render it again, or go" in capsys.readouterr().err
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset")) == 0
    assert len(list((tmp_path / "out").glob("*.exr"))) == 3


def empty(path: Path) -> None:
    path.write_bytes(b"")


def folder_instead(path: Path) -> None:
    path.unlink()
    path.mkdir()


def dangling(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.with_name("nowhere"))


def in_a_circle(path: Path) -> None:
    path.unlink()
    path.symlink_to(path)


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def doubled(path: Path) -> None:
    shutil.copy(path, path.with_name(path.name.replace(".000", ".")))


def other_number(path: Path) -> None:
    shutil.copy(path, path.with_name("saved"))
    write_frame(path.with_name("saved.0009.exr"), make_frame(9, width=9, height=7))
    path.with_name("saved.0009.exr").rename(path)


@pytest.mark.parametrize("gaps", ["error", "reset"])
@pytest.mark.parametrize(
    ("damage", "codes"),
    [
        (empty, {65}),
        (folder_instead, {65, 66}),
        (dangling, {66}),
        (in_a_circle, {66, 74}),
        (pipe, {65, 66}),
        (doubled, {65}),
        (other_number, {65}),
    ],
)
def test_what_is_no_frame_is_refused_by_name(
    tmp_path: Path, damage: Callable[[Path], None], codes: set[int], gaps: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only a frame that is not there at all is a gap, or a link to one that is not."""
    folder = write_sequence(tmp_path / "in", 4, width=9, height=7)
    damage(frame_path(folder, 2))
    if damage is dangling and gaps == "reset":
        codes = {0}
    assert main(arguments(folder, tmp_path / "out", "--gaps", gaps)) in codes
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("cltaa: error: ")]
    assert len(said) == (codes != {0})
    assert all("synthetic.2.exr" in line or "synthetic.0002.exr" in line for line in said)


def test_an_unreadable_frame_exits_with_66_and_writes_nothing(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 3, width=9, height=7)
    frame_path(folder, 1).chmod(0)
    code, said = unprivileged(arguments(folder, tmp_path / "out"))
    assert (code, "synthetic.0001.exr: the file cannot be read: permission denied" in said) == (66, True), said
    assert not (tmp_path / "out").exists()


def test_an_unwritable_output_exits_with_73_and_stays_empty(tmp_path: Path) -> None:
    folder, output = write_sequence(tmp_path / "in", 3, width=9, height=7), tmp_path / "out"
    output.mkdir(mode=0o555)
    code, said = unprivileged(arguments(folder, output))
    assert (code, str(output) in said) == (73, True), said
    assert list(output.iterdir()) == []


@pytest.mark.parametrize("size", SIZES[1:])
def test_change_of_size_is_refused_or_begins_anew(
    tmp_path: Path, size: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_sequence(tmp_path / "in", 2, width=SIZES[0][0], height=SIZES[0][1])
    write_sequence(folder, 2, first=2, width=size[0], height=size[1])
    write_sequence(folder, 1, first=4, width=SIZES[0][0], height=SIZES[0][1])
    assert main(arguments(folder, tmp_path / "refused")) == 65
    assert "synthetic.0002.exr frame 2: size differs (expected 9 x 7, found " in capsys.readouterr().err
    assert (
        main(arguments(folder, tmp_path / "film", "--on-resize", "reset", "--preview", str(tmp_path / "a.mp4"))) == 64
    )
    assert main(arguments(folder, tmp_path / "out", "--on-resize", "reset")) == 0
    for number, columns, rows in ((0, *SIZES[0]), (2, *size), (4, *SIZES[0])):
        channels, _ = read_image(frame_path(tmp_path / "out", number))
        expected = Resolver(device="numpy").resolve(make_frame(number, width=columns, height=rows))
        assert np.array_equal(bits(channels["G"]), bits(expected[..., 1]))
    channels, _ = read_image(frame_path(tmp_path / "out", 3))
    assert channels["R"].shape == (size[1], size[0])


def test_gap_that_is_filled_later_is_no_silent_mixture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Frames behind the gap began anew; once the gap is filled they would have to be others."""
    folder = write_sequence(tmp_path / "in", 4, width=9, height=7)
    aside = frame_path(folder, 1).rename(tmp_path / "aside")
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset")) == 0
    aside.rename(frame_path(folder, 1))
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset")) == 65
    assert "frame 2: another frame lies before this one than did (expected 0, found 1)" in capsys.readouterr().err
    assert main(arguments(folder, tmp_path / "out", "--gaps", "reset", "--restart")) == 0
