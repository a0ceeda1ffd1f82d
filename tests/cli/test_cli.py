"""The command line as a user meets it: help, completion, exit codes and one-line errors."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from cltaa import __version__, cli, errors
from tests.sequence_factory import write_sequence

# Nothing that draws or computes may be imported to show help: it must work, and quickly, where those are not installed.
HEAVY = ("pyopencl", "OpenGL", "pyrender", "pyglet", "trimesh", "scipy", "skimage", "flip_evaluator", "av")


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "cltaa.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | environment)


def test_help_needs_nothing_heavy() -> None:
    """Nor does the help of any command, one after another in one process."""
    code = f"""
import sys
from contextlib import suppress
from cltaa.cli import COMMANDS, main
for command in ("", *COMMANDS):
    assert main([*command.split(), "--help"]) == 0
    assert not set({HEAVY!r}) & set(sys.modules), command
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("", *cli.COMMANDS):
        assert f"Usage: cltaa {command}".strip() in done.stdout


def test_resolve_needs_no_extra(tmp_path: Path) -> None:
    # None in sys.modules makes an import fail as if the package were not installed.
    folder = write_sequence(tmp_path / "in", 2)
    extras = ("OpenGL", "pyrender", "trimesh", "scipy", "skimage", "flip_evaluator", "av")
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({extras!r}));"
        "from cltaa.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    arguments = [sys.executable, "-c", code, "resolve", str(folder), "-o", str(tmp_path / "out")]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_help_lists_every_command_with_its_line() -> None:
    printed = run("--help", COLUMNS="120").stdout
    for name, entry in cli.COMMANDS.items():
        assert re.search(rf"^  {name}\s+{re.escape(entry.summary)}$", printed, re.MULTILINE)


def test_version_is_that_of_the_project() -> None:
    assert run("--version").stdout == f"cltaa, version {__version__}\n"


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_each_shell_gets_a_completion_script(shell: str) -> None:
    done = run(_CLTAA_COMPLETE=f"{shell}_source")
    assert done.returncode == 0
    assert "_CLTAA_COMPLETE" in done.stdout


def completed(words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], shell: str) -> list[str]:
    """What a shell offers behind these words of a line, the last of which is begun."""
    asked = {"_CLTAA_COMPLETE": f"{shell}_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    for name, value in asked.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 0
    return [line for line in capsys.readouterr().out.splitlines() if line]


@pytest.mark.parametrize("asked", ["bsh_source", "bash", "bash_complete"])
def test_a_wrong_word_for_completion_is_reported(
    asked: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_CLTAA_COMPLETE", asked)
    assert cli.main([]) == 64
    told = (
        f"cltaa: error: _CLTAA_COMPLETE={asked} asks for no completion (expected bash_source, fish_source, zsh_source)"
    )
    assert capsys.readouterr().err == told + "\n"


def test_names_are_completed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for words, offered in [
        ("cltaa resolve x --preset bab", "babylon-reproject-clamp"),
        ("cltaa presets ka", "karis"),
        ("cltaa bench kernels --preset ka", "karis"),
        ("cltaa capture spi", "spinner"),
        ("cltaa profiles bl", "blender"),
        ("cltaa resolve x --profile bl", "blender"),
        ("cltaa kernels --show gather_w", "gather_windows"),
        ("cltaa bench quality --scene spi", "spinner"),
        ("cltaa demo --scene spi", "spinner"),
    ]:
        lines = completed(words, monkeypatch, capsys, "bash")
        assert f"plain,{offered}" in lines, words
        assert all(line.startswith(f"plain,{words.split()[-1]}") for line in lines), words


@pytest.mark.parametrize(("option", "files"), [("--preset", []), ("--profile", ["file,"]), ("--device", [])])
def test_a_name_that_begins_none_may_be_of_a_file_where_one_can_be(
    option: str, files: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert completed(f"cltaa resolve x {option} zz", monkeypatch, capsys, "bash") == [f"{each}zz" for each in files]


def test_commands_are_completed_with_their_summary(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = completed("cltaa re", monkeypatch, capsys, "zsh")
    assert lines == ["plain", "resolve", cli.COMMANDS["resolve"].summary]


def test_unknown_command_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["nonsense"]) == 2
    assert capsys.readouterr().err == "cltaa: error: No such command 'nonsense'; see cltaa --help\n"


@pytest.mark.parametrize(
    ("words", "group", "meant"), [("relsove x -o y", "cltaa", "resolve"), ("bench qualty", "cltaa bench", "quality")]
)
def test_the_nearest_command_is_suggested_for_a_misspelt_one(
    words: str, group: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(words.split()) == 2
    assert capsys.readouterr().err.endswith(f". Did you mean '{meant}'?; see {group} --help\n")


def test_the_package_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "cltaa", "--help"], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("Usage: cltaa [OPTIONS]")


def test_debug_shows_the_traceback_wherever_it_stands(tmp_path: Path) -> None:
    words = ["inspect", str(tmp_path / "nowhere")]
    for arguments in (["--debug", *words], [*words, "--debug"]):
        with pytest.raises(errors.InputMissing):
            cli.main(arguments)


def run_main_raising(monkeypatch: pytest.MonkeyPatch, error: BaseException, *arguments: str) -> int:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(cli.root, "main", fail)
    return cli.main([*arguments] or ["inspect"])


def test_every_error_class_ends_with_its_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    classes = errors.CltaaError.__subclasses__()
    assert sorted(c.exit_code for c in classes) == [64, 65, 66, 69, 70, 73, 74, 75]
    for error_class in classes:
        error = error_class("went\nwrong", path="a.exr", frame=3, expected=1, found=2, cure="do this")
        assert run_main_raising(monkeypatch, error) == error_class.exit_code
        line = "cltaa: error: a.exr frame 3: went wrong (expected 1, found 2); do this\n"
        assert capsys.readouterr().err == line


def test_an_extra_left_out_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main_raising(monkeypatch, ModuleNotFoundError("no", name="trimesh")) == errors.UsageError.exit_code
    assert "trimesh is not installed; run: pip install 'cltaa[all]'" in capsys.readouterr().err
    assert run_main_raising(monkeypatch, ModuleNotFoundError("no", name="cltaa.gone")) == errors.InternalError.exit_code


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ZeroDivisionError("division by zero"), 70, "ZeroDivisionError: division by zero; this is a fault of cltaa"),
        (MemoryError(), 75, "memory ran out; use smaller frames or a machine with more memory"),
        (
            OSError(28, "No space left on device", "x"),
            74,
            "x: the system refused: No space left on device; free some space and run again",
        ),
        (RecursionError("too\ndeep \x1b[2J"), 70, r"RecursionError: too deep \x1b[2J"),
    ],
)
def test_what_nobody_expected_is_one_line_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, code: int, words: str
) -> None:
    assert run_main_raising(monkeypatch, error) == code
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    with pytest.raises(type(error)):
        cli.main(["inspect", "--debug"])


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_a_stream_that_is_closed_ends_nothing(closed: str, tmp_path: Path) -> None:
    """Nor does what is printed find its way into a file that took the stream's number."""
    folder, out, whole = write_sequence(tmp_path / "in", 2), tmp_path / "out", tmp_path / "whole"
    arguments = f"resolve {folder} --device numpy -o "
    command = f"{sys.executable} -m cltaa.cli {arguments} {out} {closed}"
    assert subprocess.run(["sh", "-c", command], check=False).returncode == 0
    assert cli.main([*arguments.split(), str(whole)]) == 0
    for path in sorted(whole.glob("*.exr")):
        assert (out / path.name).read_bytes() == path.read_bytes()


def test_a_width_of_nothing_is_no_width(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "0")
    assert cli.main(["presets"]) == 0
    assert "default" in capsys.readouterr().out


def test_a_closed_output_pipe_ends_without_a_message() -> None:
    """``cltaa presets --parameters | head -1`` says nothing about broken pipes."""
    command = f"{sys.executable} -m cltaa.cli presets --parameters --json | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("141\n", "")


@pytest.mark.parametrize("stderr", ["closed pipe", "full pipe", "/dev/full"])
def test_work_goes_on_where_nobody_reads_its_progress(tmp_path: Path, stderr: str) -> None:
    folder, out = write_sequence(tmp_path / "in", 2), tmp_path / "out"
    reading, writing = os.pipe()
    if stderr == "full pipe":
        os.set_blocking(writing, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writing, bytes(2**12))
    else:
        os.close(reading)
    with Path("/dev/full").open("w") as full:
        unread = full if stderr == "/dev/full" else writing
        command = [sys.executable, "-m", "cltaa.cli", "resolve", str(folder), "-o", str(out), "--device", "numpy"]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=unread, check=False)
        failed = subprocess.run([*command[:3], "inspect", "nowhere"], stderr=unread, check=False)
    os.close(writing)
    assert done.returncode == 0
    assert json.loads((out / "resolve.json").read_text())["outcome"]["resolved"] == 2
    assert failed.returncode == errors.InputMissing.exit_code


def test_an_answer_onto_a_full_disk_exits_with_74() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "cltaa.cli", "presets", "--json"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (74, 1), done.stderr
    assert "No space left on device" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "line"),
    [
        ("inspect nowhere --json", 66, "nowhere: the folder is missing"),
        ("inspect --json nowhere --colour", 2, "No such option"),
        ("compare --json", 2, "Missing argument"),
    ],
)
def test_with_json_an_error_is_a_document_too(
    arguments: str, code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments.split()) == code
    told = capsys.readouterr()
    answer = json.loads(told.out)
    assert answer["exit_code"] == code
    assert line in answer["error"]
    assert told.err == f"cltaa: error: {answer['error']}\n"


def test_json_behind_two_dashes_is_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["inspect", "--", "--json"]) == 66
    assert capsys.readouterr().out == ""


def test_debug_behind_two_dashes_is_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["inspect", "--", "--debug"]) == errors.InputMissing.exit_code
    assert "--debug" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "goes_on"),
    [
        ("resolve x -o y", True),
        ("raycast fog -o y", True),
        ("--debug bench quality", True),
        ("bench kernels", False),
        ("compare x y", False),
    ],
)
def test_an_interrupt_ends_with_130(
    command: str, goes_on: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main_raising(monkeypatch, KeyboardInterrupt(), *command.split()) == 130
    more = "; what was finished is kept, run the same again to go on" if goes_on else ""
    assert capsys.readouterr().err == f"cltaa: interrupted{more}\n"
