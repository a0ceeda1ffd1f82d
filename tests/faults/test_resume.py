"""A resolve that is interrupted or refused: finished frames stay, and the same command finishes the rest."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from cltaa.cli import main
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.manifest import Manifest
from cltaa.pipeline.checkpoint import SLOTS
from tests.faults.runs import (
    FRAMES,
    PATIENCE,
    arguments,
    check_after_fault,
    check_finished,
    prepare,
    start_held,
)
from tests.inputs.foreign import frames, write_colour
from tests.sequence_factory import make_frame, write_sequence


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    return prepare(tmp_path_factory.mktemp("whole"))


def finish(folder: Path, output: Path, expected: dict[str, str]) -> None:
    assert main(arguments(folder, output)) == 0
    check_finished(output, expected)


def begun(folder: Path, output: Path, frames: int) -> None:
    """Resolve until ``frames`` images are there, then interrupt."""
    go = output.with_name("go")
    process = start_held(folder, output, go, frames)
    process.send_signal(signal.SIGINT)
    go.touch()
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 130


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_that_is_ignored_stays_ignored(
    tmp_path: Path, whole: tuple[Path, dict[str, str]], number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As nohup and the shell ask for, for what runs in the background."""
    write = Manifest.append

    def interrupted(*given: Any) -> None:
        os.kill(os.getpid(), number)
        write(*given)

    monkeypatch.setattr(Manifest, "append", interrupted)
    earlier = signal.signal(number, signal.SIG_IGN)
    try:
        assert main(arguments(whole[0], tmp_path / "out")) == 0
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, earlier)
    check_finished(tmp_path / "out", whole[1])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_with_130_and_a_checkpoint(tmp_path: Path, number: signal.Signals) -> None:
    count = 20
    folder, expected = prepare(tmp_path, count)
    output = tmp_path / "out"
    process = start_held(folder, output, tmp_path / "go", 5)
    process.send_signal(number)
    (tmp_path / "go").touch()
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert said.splitlines()[-1].startswith("cltaa: interrupted")
    kept = check_after_fault(output, expected)
    assert 5 <= kept < count
    assert any((output / name).exists() for name in SLOTS)
    for _ in range(2):  # the second finds each frame after the one that it continues, across the break too
        finish(folder, output, expected)


def test_another_version_of_the_code_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, output = write_sequence(tmp_path / "in", 2, width=9, height=7), tmp_path / "out"
    assert main(arguments(folder, output)) == 0
    begun = Manifest(output).settings
    assert begun is not None
    (output / "manifest.jsonl").unlink()
    earlier = {key: value for key, value in begun["build"].items() if key != "stride"}  # newer code has a key more
    Manifest(output).begin({**begun, "code_sha256": "0" * 64, "build": earlier})
    assert main(arguments(folder, output)) == 64
    assert "was begun with another version of cltaa's code; name another folder" in capsys.readouterr().err
    assert main([*arguments(folder, output), "--effects", "all"]) == 64
    assert "was begun with --effects auto, not with --effects all;" in capsys.readouterr().err


def test_other_settings_device_and_inputs_are_refused_by_name(
    tmp_path: Path, whole: tuple[Path, dict[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, expected = tmp_path / "in", whole[1]
    write_sequence(folder, FRAMES, width=9, height=7, motion=True)
    output = tmp_path / "out"
    begun(folder, output, 3)
    kept = check_after_fault(output, expected)
    capsys.readouterr()
    gamma = load_preset().settings.box_scale_static
    other, read_by = gamma + 0.25, "--profile, --input or --camera"
    for more, difference in (
        (
            ["--set", f"box_scale_static={other}"],
            f"preset default, not default with box_scale_static={other}: "
            f"box_scale_static (expected {other}, found {gamma})",
        ),
        (["--preset", "fast"], "preset default, not fast: accumulate (expected exponential, found count)"),
        (["--preset", "gather-8+8"], "preset default, not gather-8+8: "),
        (["--device", "0"], "--device NumPy (float32 oracle), not with --device "),
        (["--half"], "out --half, not with --half;"),
        (["--effects", "all"], "--effects auto, not with --effects all;"),
        (["--storage", "half"], "--storage float, not with --storage half;"),
        (["--frames", "1-6"], "--frames from 0, not with --frames from 1;"),
        (["--layers", "Z,R"], "out --layers, not with --layers Z,R;"),
        (["--input", "depth.scale=2"], f"out {read_by}, not with {read_by};"),
    ):
        assert main([*arguments(folder, output), *more]) == 64
        assert f"was begun with{difference}" in capsys.readouterr().err.replace("begun with ", "begun with")
    write_frame(folder / "synthetic.0001.exr", make_frame(1, width=9, height=7, motion=True, seed=1))
    assert main(arguments(folder, output)) == 65
    assert "synthetic.0001.exr frame 1: the input is not the one" in capsys.readouterr().err
    assert check_after_fault(output, expected) == kept


def test_a_preset_whose_name_nothing_tells_is_refused_by_what_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, output, config = (
        write_sequence(tmp_path / "in", 2, width=9, height=7),
        tmp_path / "out",
        tmp_path / "a.toml",
    )
    command = [*arguments(folder, output), "--config", str(config)]
    config.write_text("box_scale_static = 2")
    assert main(command) == 0
    config.write_text("box_scale_static = 3")
    assert main(command) == 64  # the same name, of another content
    assert "was begun with another box_scale_static (expected 3.0, found 2.0)" in capsys.readouterr().err
    (output / "synthetic.0000.exr").write_bytes(b"damaged")
    assert main([*arguments(folder, output)]) == 64
    assert "was begun with another box_scale_static (expected " in capsys.readouterr().err


def test_another_way_to_read_is_refused_as_a_user_types_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without the names that a profile itself tries; another description of a profile changes no bit."""
    made, output, profile = frames(), tmp_path / "out", tmp_path / "mine.toml"
    for name in ("day", "night"):
        write_colour(tmp_path / "in", made, name)
    asked = ["--input", "colour.channels=day.R day.G day.B"]
    assert main([*arguments(tmp_path / "in", output), *asked]) == 0
    assert main([*arguments(tmp_path / "in" / "day.####.exr", output)]) == 64
    said = "was begun with --input colour.channels='day.R day.G day.B', not without --input; name another folder"
    assert said in capsys.readouterr().err
    assert main([*arguments(tmp_path / "in" / "night.####.exr", output)]) == 64
    assert "was begun with another sequence (expected night, found day); name another folder" in capsys.readouterr().err
    for frame in made:  # whose headers show another effect
        planes = dict.fromkeys("RGBA", frame.colour[..., 0])
        write_image(tmp_path / "in" / f"dusk.{frame.index:04d}.exr", planes)
    assert main([*arguments(tmp_path / "in" / "dusk.####.exr", output)]) == 64
    assert "was begun with another sequence (expected dusk, found day); name another folder" in capsys.readouterr().err
    write_colour(tmp_path / "one", made)
    by_mine = [*arguments(tmp_path / "one", tmp_path / "as I said"), "--profile", str(profile)]
    profile.write_text('profile = "parts"\ndescription = "first"')
    assert main(by_mine) == 0
    profile.write_text('profile = "parts"\ndescription = "second"\ntelling = ["depth.Z"]')
    assert main(by_mine) == 0
    profile.write_text('profile = "parts"\n[motion]\nscale = [1, -1]')
    assert main(by_mine) == 64
    assert "begun with --input motion.scale=1,1, not with --input motion.scale=1,-1;" in capsys.readouterr().err


def test_restart_begins_anew(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    folder, expected = whole
    output = tmp_path / "out"
    begun(folder, output, 3)
    assert main(arguments(folder, output, "--half", "--frames", "0-1", "--restart")) == 0
    assert sorted(path.name for path in output.glob("*.exr")) == ["synthetic.0000.exr", "synthetic.0001.exr"]
    assert main(arguments(folder, output, "--restart")) == 0
    check_finished(output, expected)


def test_restart_forgets_the_state_after_other_inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that ends before its first checkpoint must not leave those of the run before it to the next."""

    def refused(*_: Any, **__: Any) -> None:
        raise DataError("wrong")

    folder, output = write_sequence(tmp_path / "in", FRAMES, width=9, height=7), tmp_path / "out"
    begun(folder, output, 3)
    assert any((output / name).exists() for name in SLOTS)
    monkeypatch.setattr(Resolver, "resolve", refused)
    assert main(arguments(folder, output, "--restart")) == 65
    assert not any((output / name).exists() for name in SLOTS)


def test_frames_of_another_origin_are_not_mixed(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    output = tmp_path / "out"
    write_sequence(output, 1)
    assert main(arguments(whole[0], output)) == 64
    assert sorted(path.name for path in output.iterdir()) == ["synthetic.0000.exr"]
    assert main(arguments(whole[0], output, "--restart")) == 0
    check_finished(output, whole[1])


def test_only_what_is_missing_is_made(
    tmp_path: Path, whole: tuple[Path, dict[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, expected = whole
    output = tmp_path / "out"
    assert main(arguments(folder, output)) == 0
    stamps = {path.name: path.stat().st_mtime_ns for path in output.glob("*.exr")}
    (output / "synthetic.0003.exr").unlink()
    (output / "synthetic.0004.exr").write_bytes(b"changed")
    capsys.readouterr()
    assert main([*arguments(folder, output), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["resolved"] == 2
    check_finished(output, expected)
    touched = [path.name for path in output.glob("*.exr") if path.stat().st_mtime_ns != stamps[path.name]]
    assert sorted(touched) == ["synthetic.0003.exr", "synthetic.0004.exr"]
    assert main([*arguments(folder, output), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["resolved"] == 0


def test_sequence_may_grow(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    folder, expected = whole
    output = tmp_path / "out"
    assert main(arguments(folder, output, "--frames", "0-3")) == 0
    finish(folder, output, expected)


def test_second_process_on_one_folder_is_refused(tmp_path: Path) -> None:
    folder, expected = prepare(tmp_path, 20)
    output = tmp_path / "out"
    process = start_held(folder, output, tmp_path / "go", 2)
    assert main(arguments(folder, output)) == 73
    process.send_signal(signal.SIGTERM)
    (tmp_path / "go").touch()
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    finish(folder, output, expected)


def test_stale_temporaries_go(tmp_path: Path, whole: tuple[Path, dict[str, str]]) -> None:
    output = tmp_path / "out"
    output.mkdir()
    # A process that runs has the number of the one that was killed: this very one, as in a container.
    (output / f".synthetic.0002.exr.tmp.{os.getpid()}").write_bytes(b"half")
    (output / ".synthetic.0003.exr.tmp.1").write_bytes(b"half")
    finish(whole[0], output, whole[1])
