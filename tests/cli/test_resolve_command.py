"""``cltaa resolve`` and its neighbours ``presets`` and ``kernels``, called as a user calls them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cltaa.cli import main
from cltaa.commands.options import assigned
from cltaa.commands.presets import parameter_rows
from cltaa.core.presets import FIELDS, load_preset, preset_names
from cltaa.core.resolver import Resolver
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.preset_file import load_config
from cltaa.io.sequence import open_images, open_sequence
from tests.inputs.foreign import write_blender
from tests.sequence_factory import bits, make_frame, read_frame, write_sequence


def test_resolved_files_hold_what_the_resolver_returns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_sequence(tmp_path / "in", 4)
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out"), "--json"]) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert (outcome["frames"], outcome["width"], outcome["height"]) == (4, 37, 23)
    assert set(outcome["seconds"]) == {"read", "upload", "kernels", "read_back", "write", "whole"}
    resolver = Resolver()
    for frame in open_sequence(folder):
        assert frame.path is not None
        channels, attributes = read_image(tmp_path / "out" / frame.path.name)
        expected = resolver.resolve(frame)
        for position, name in enumerate("RGB"):
            assert np.array_equal(bits(channels[name]), bits(expected[..., position]))
        assert attributes["cltaa:preset"] == "default"
        assert attributes["cltaa:frame"] == frame.index


def test_what_resolved_is_named_with_all_that_was_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, config, out = write_sequence(tmp_path / "in", 2), tmp_path / "mine.toml", tmp_path / "out"
    command = ["resolve", str(folder), "-o", str(out), "--device", "numpy"]
    for text, more, name in (
        ("box_scale_static = 2.0", [], "mine.toml over default"),
        ("box_scale_static = 2.0", ["--preset", "fast"], "mine.toml over fast"),
        (
            'preset = "fast"',
            ["--preset", "gather-48", "--set", "box_scale_static=2"],
            "mine.toml over fast with box_scale_static=2",
        ),
    ):
        config.write_text(text)
        assert main([*command, "--restart", "--config", str(config), *more]) == 0
        assert f"2 frames, 37 x 23, preset {name}\n" in capsys.readouterr().out
        assert read_image(next(out.glob("*.exr")))[1]["cltaa:preset"] == name


def test_another_name_for_the_same_settings_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, config = write_sequence(tmp_path / "in", 2), tmp_path / "mine.toml"
    command = ["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy", "--set"]
    assert main([*command, "box_scale_static=2"]) == 0
    assert main([*command, "box_scale_static=2.0"]) == 0
    config.write_text("box_scale_static = 2.0")
    assert main([*command[:-1], "--config", str(config)]) == 0
    assert capsys.readouterr().out.count("2 frames finished already") == 2


def test_half_output_saturates(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 1)
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out"), "--half"]) == 0
    channels, _ = read_image(next((tmp_path / "out").glob("*.exr")))
    assert channels["R"].dtype == np.float16


def test_a_refusal_does_not_stand_in_the_way_of_the_mended_command(tmp_path: Path) -> None:
    folder, out = write_sequence(tmp_path / "in", 2), tmp_path / "out"
    record = folder / "sequence.json"
    command = ["resolve", str(folder), "-o", str(out), "--device", "numpy"]
    assert main([*command, "--compression", "dwaa"]) == 64
    record.write_text(json.dumps({"files": {"synthetic.0000.exr": 64 * "0"}}))  # refused when its pixels are read
    assert main([*command, "--half"]) == 65
    assert (out / "manifest.jsonl").exists()
    record.unlink()
    assert main([*command, "--preview", str(out / "film.mp4")]) == 0
    assert (out / "film.mp4").stat().st_size > 0


def test_a_film_that_cannot_be_is_refused_before_the_output_is_made(tmp_path: Path) -> None:
    folder, out = write_sequence(tmp_path / "in", 2), tmp_path / "new" / "out"
    command = ["resolve", str(folder), "-o", str(out), "--device", "numpy", "--preview"]
    for film, code in ((tmp_path / "x.png", 64), (out / "x.png", 64), (tmp_path / "no" / "x.mp4", 73), (tmp_path, 64)):
        assert main([*command, str(film)]) == code
        assert not (tmp_path / "new").exists()
    for film in (out / "film.mp4", tmp_path / "new" / "film.mp4"):  # in folders that the output makes
        assert main([*command, str(film)]) == 0
        assert film.stat().st_size > 0
    assert main([*command[:3], str(tmp_path / "a.mp4"), *command[4:], str(tmp_path / "a.mp4")]) == 64
    assert not (tmp_path / "a.mp4").exists()


def test_finished_frames_survive_a_bad_one(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 4)
    last = sorted(folder.glob("*.exr"))[-1]
    # Pixels that ZIP can pack carry its checksum; random ones are stored as they are, without.
    frame = read_frame(last)
    write_frame(last, replace(frame, colour=np.zeros_like(frame.colour), depth=np.ones_like(frame.depth)))
    data = bytearray(last.read_bytes())
    data[-20:-10] = bytes(10)
    last.write_bytes(data)
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out")]) == 65
    written = sorted((tmp_path / "out").glob("*.exr"))
    assert [path.name for path in written] == [path.name for path in sorted(folder.glob("*.exr"))[:3]]
    for path in written:
        read_image(path)


def test_a_number_of_set_is_read_as_python_reads_it() -> None:
    for text, key, value in [
        (".3", "disocclusion_blur", 0.3),
        (" 0.3 ", "disocclusion_blur", 0.3),
        ("+0.3", "disocclusion_blur", 0.3),
        ("1.", "disocclusion_blur", 1.0),
        ("3e-1", "disocclusion_blur", 0.3),
        ("+7", "history_frames", 7),
        ("7.", "history_frames", 7),
        ("none", "rectify", "none"),
    ]:
        preset = assigned(load_preset("gather-8"), (f"{key}={text}",))
        found = getattr(preset.choices if isinstance(value, str) else preset.settings, key)
        assert found == value, text
        assert type(found) is type(value) or isinstance(value, str), text


def test_printed_preset_is_a_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in preset_names():
        assert main(["presets", name]) == 0
        path = tmp_path / f"{name}.toml"
        path.write_text(capsys.readouterr().out)
        loaded, preset = load_config(path, load_preset()), load_preset(name)
        assert (loaded.choices, loaded.settings) == (preset.choices, preset.settings)
        assert (loaded.jitter, loaded.published) == (preset.jitter, preset.published)


def test_what_differs_between_presets_is_a_configuration_over_one_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, other in (("gather-48", "default"), ("karis", "fast"), ("default", "karis"), ("default", "default")):
        assert main(["presets", name, "--against", other]) == 0
        path = tmp_path / f"{name}.toml"
        path.write_text(capsys.readouterr().out)
        assert load_config(path, load_preset()).deciding() == load_preset(name).deciding()
    assert path.read_text() == 'preset = "default"\n'
    assert main(["presets", "gather-48", "--against", "default", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {"parameter": "illumination", "value": "window", "against": "test"} in rows
    assert main(["presets", "--against", "fast"]) == 64
    assert "cltaa presets NAME --against OTHER" in capsys.readouterr().err


def test_names_of_presets_are_whole_in_a_narrow_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["presets"]) == 0
    printed = capsys.readouterr().out
    assert set(preset_names()) <= {line.split(" ")[0] for line in printed.splitlines()}
    assert max(map(len, printed.splitlines())) <= 60


def test_every_parameter_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets", "--parameters", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["parameter"] for row in rows} == set(FIELDS)
    assert all(row["meaning"] for row in rows)
    meanings = {row["parameter"]: row["meaning"].rpartition(" [")[0] for row in rows}
    assert meanings["motion_px"].endswith(", in pixels a frame")
    assert not meanings["blend_weight"].endswith(", in 1")  # a number has no unit
    told = {row["parameter"]: row["value_meanings"] for row in rows if "value_meanings" in row}
    assert told["box"]["both"] == "the intersection of the two"
    assert told["on_camera_move"] == {}  # its words say it all


def test_every_parameter_of_a_preset_is_listed_with_what_it_sets(capsys: pytest.CaptureFixture[str]) -> None:
    preset = load_preset("karis")
    assert main(["presets", "karis", "--parameters", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    found = {row["parameter"]: row["value"] for row in rows}
    assert found == {**msgspec.to_builtins(preset.choices), **msgspec.to_builtins(preset.settings)}
    assert found != {row["parameter"]: row["default"] for row in rows}
    assert main(["presets", "karis", "--parameters"]) == 0
    said = capsys.readouterr().out
    assert f"rectify = {preset.choices.rectify.value}  (none, clamp" in said
    assert f"blend_weight = {preset.settings.blend_weight:g}  (" in said
    assert main(["presets", "karis", "--parameters", "--against", "fast"]) == 64
    assert "--against and --parameters are two lists" in capsys.readouterr().err


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_parameters_are_readable_in_any_terminal(
    columns: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["presets", "--parameters"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= int(columns)
    said = " ".join(" ".join(lines).split())
    for row in parameter_rows():
        assert f"{row['parameter']} = {row['default']} ({row['values']})" in said
        assert row["meaning"] in said
        for value, meaning in row.get("value_meanings", {}).items():
            assert f"{value}: {meaning}" in said
    assert "clip: along the line to the centre, extents floored" in said


def test_kernel_text_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["kernels", "--show", "resolve"]) == 0
    text = capsys.readouterr().out
    assert "__kernel void resolve_kernel" in text
    assert "typedef struct {" in text
    assert main(["kernels", "--show", "resolve", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["kernel"], told["text"]) == ("resolve", text)
    assert main(["kernels", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kernels"]["resolve"] == told["hash"]
    assert main(["kernels", "--show", "nonsense"]) == 64


def test_blender_frames_to_which_no_camera_fits_are_resolved_by_vectors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_blender(tmp_path / "in", [make_frame(index, motion=True, effects=None) for index in range(3)])
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    said = capsys.readouterr().err
    assert "profile blender: header attribute Software is Blender 5.0.1" in said
    assert "no matrices: vectors and depth may tell the camera" in said
    assert "no camera is fitted, vectors alone tell what moves (3 frames, " in said
    assert len(open_images(tmp_path / "out")) == 3


def test_nothing_but_still_colour_is_averaged(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pictures = [np.full((8, 8), 0.5, np.float32) + rng.normal(0, 0.01, (8, 8)).astype(np.float32) for _ in range(8)]
    (tmp_path / "in").mkdir()
    for index, picture in enumerate(pictures):
        write_image(tmp_path / "in" / f"a.{index:04d}.exr", dict.fromkeys("RGB", picture))
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    last = open_images(tmp_path / "out").image(7)[..., 0]
    assert np.std(last) < 0.7 * np.std(pictures[7])  # a mean of 8 would leave 0.35 of it, rectification a little more
