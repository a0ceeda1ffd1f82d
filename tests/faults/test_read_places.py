"""Names, places and settings of the machine that a program should not care about."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_sequence
from tests.sequence_factory import bits, make_frame, write_sequence

NAMES = {
    "spaces, a line feed, other scripts": " two  spaces, one\ntwo фильм-映画-🎬 ",
    "home": "~",
    "no UTF-8": os.fsdecode(b"\xff\xfe\x80"),
    "escape sequences and right to left": "\x1b[2J\x1b]0;title\x07\u202egpj.exe",
    "markup and a pattern": "[red]red[bold] [@click=x] %s %d {} $HOME `id` $(id) *?",
    "an address": "http:",
    "a pipe of FFmpeg": "pipe:1",
    "as long as can be": "n" * 255,
    "an option": "--help",
}


def sound_sequence(folder: Path) -> None:
    """Two frames with a reference, in which ``cltaa inspect`` finds no fault."""
    write_sequence(folder, 2, reference=True)
    for index in range(2):
        write_frame(folder / f"synthetic.{index:04d}.exr", make_frame(index, jitter_px=(0.0, 0.0)))


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES.keys())
def test_folder_of_any_name(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Every command that takes a folder takes this one, from inside its parent; nothing appears anywhere else."""
    monkeypatch.chdir(tmp_path)
    sound_sequence(Path(name))
    inside = Path(name) / "out"
    commands: list[list[str]] = [
        ["resolve", "--device", "numpy", "--json", "-o", str(inside), "--preview", str(Path(name) / "film.mp4"), "--"],
        ["compare", "--json", "--metrics", "mse", "--heatmap", str(inside / "maps"), "--"],
        ["compare", "--metrics", "mse", "--"],
        ["inspect", "--json", "--pixels", "--"],
        ["inspect", "--"],
    ]
    for command in commands:
        assert main([*command, name]) == 0
        said = capfd.readouterr()
        if "--json" in command:
            json.loads(said.out)
        for text in (said.out, said.err):
            assert text.replace("\n", "").isprintable(), command
    assert sorted(Path(name).joinpath("out").glob("*.exr"))
    assert (Path(name) / "film.mp4").stat().st_size > 0
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert main(["inspect", "--", f"{name}/nothing"]) == 66
    said = capfd.readouterr()
    assert said.err.count("\n") == 1
    assert said.err.strip("\n").isprintable()


# Of the first 123 characters each has two bytes: 246, and 9 of ".0000.exr".
@pytest.mark.parametrize("name", ["é" * 123, os.fsdecode(b"caf\xe9")], ids=["255 bytes", "no UTF-8"])
def test_odd_file_names_are_resolved(name: str, tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 2, name=name)
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    for number in range(2):
        channels, _ = read_image(tmp_path / "out" / f"{name}.{number:04d}.exr")
        assert np.isfinite(channels["R"]).all()


def run(arguments: list[str], environment: dict[str, str], before: str = "") -> str:
    """Run a command in a process of its own after some code ``before``, and return what it says."""
    code = f"{before}\nimport sys\nfrom cltaa.cli import main\nsys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def resolved(folder: Path, name: str) -> list[bytes]:
    return [bits(read_image(path)[0]["R"]).tobytes() for path in sorted((folder / name).glob("*.exr"))]


def test_a_decimal_comma_changes_no_bit(tmp_path: Path) -> None:
    """A German C library writes 0,5. Kernels are compiled from printed numbers; not a bit changes."""
    write_sequence(tmp_path / "in", 2)
    compiler = shutil.which("localedef")
    if compiler is None:
        pytest.skip("localedef, which makes the German locale, is not installed")
    target = tmp_path / "locales" / "de_DE"
    target.parent.mkdir()
    subprocess.run([compiler, "-i", "de_DE", "-f", "ISO-8859-1", str(target)], check=False, capture_output=True)
    german = {"LOCPATH": str(target.parent), "LC_ALL": "de_DE", "PYTHONUTF8": "0"}
    comma = "import locale; locale.setlocale(locale.LC_ALL, ''); assert locale.localeconv()['decimal_point'] == ','"
    run(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "comma")], german, comma)
    run(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "point")], {})
    assert len(resolved(tmp_path, "comma")) == 2
    assert resolved(tmp_path, "comma") == resolved(tmp_path, "point")


def test_umask_that_leaves_files_to_their_owner_alone(tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 2)
    command = ["resolve", "--device", "numpy", str(tmp_path / "in"), "-o", str(tmp_path / "out")]
    for _ in range(2):  # the second reads what the first left
        run(command, {}, "import os; os.umask(0o077)")
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "out").glob("*.exr")} == {0o600}


@pytest.mark.parametrize("locale", ["C", "xx_XX.nonsense"])
def test_a_locale_without_letters_ends_no_command(tmp_path: Path, locale: str) -> None:
    """What has no letter there is printed as an escape and ends nothing."""
    sound_sequence(tmp_path)
    ascii_only = {"LC_ALL": locale, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    assert "no problem found" in run(["inspect", str(tmp_path)], ascii_only)
    assert "mse" in run(["compare", str(tmp_path), "--metrics", "mse"], ascii_only)


def test_clock_that_jumps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time of day goes back by a year with every look at it, and the files come from the future."""
    write_sequence(tmp_path / "in", 3)
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    now = [time.time()]

    def jump() -> float:
        now[0] -= 365 * 86400
        return now[0]

    monkeypatch.setattr(time, "time", jump)
    for path in (tmp_path / "in").iterdir():
        os.utime(path, (2**33, 2**33))
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "again"), "--device", "numpy"]) == 0
    for path in (tmp_path / "out").glob("*.exr"):
        one, other = (read_image(folder / path.name)[0]["R"] for folder in (tmp_path / "out", tmp_path / "again"))
        np.testing.assert_array_equal(bits(one), bits(other))


def test_links_are_followed_and_relative_names_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(tmp_path / "real", 2)
    (tmp_path / "link").symlink_to("real", target_is_directory=True)
    monkeypatch.chdir(tmp_path / "link")
    assert [frame.index for frame in open_sequence(".")] == [0, 1]
    write_frame(Path("synthetic.0002.exr"), make_frame(2))
    assert len(open_sequence("../real")) == 3
