"""Arguments of wrong kinds from a program: one line of cltaa's own that says what was expected."""

from __future__ import annotations

import pickle
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import cltaa as public
from cltaa.errors import CltaaError
from cltaa.errors import public as reported
from tests.inputs.foreign import write_colour
from tests.sequence_factory import make_frame, write_sequence

cltaa: Any = public  # whose types forbid what is tried here


def write_truth(sequence: Path) -> Path:
    """``sequence`` with its own frames for its truth."""
    shutil.copytree(sequence, sequence / "reference", ignore=shutil.ignore_patterns("reference"))
    return sequence


def copied(sequence: Path, name: str) -> Path:
    """A copy of ``sequence``, without a truth."""
    return Path(shutil.copytree(sequence, name, ignore=shutil.ignore_patterns("reference")))


def written(text: str) -> str:
    """The name of a TOML file with this text."""
    Path("a.toml").write_text(text)
    return "a.toml"


def resolved(sequence: Path) -> Any:
    """A resolver after a frame of ``sequence``."""
    resolver = cltaa.Resolver(device="numpy")
    resolver.resolve(cltaa.open(sequence).frame(0))
    return resolver


def own(**parts: Any) -> Any:
    """A preset that a program makes of its ``parts``."""
    return cltaa.Preset(**{"name": "own", "description": "", **parts})


def swapped() -> Any:
    """A frame whose camera has its projection for its view."""
    frame = make_frame()
    return cltaa.Frame(0, frame.colour, camera=cltaa.Camera(frame.camera.view_to_clip, frame.camera.world_to_view))


LIGHT = np.ones((8, 8, 3), np.float32)
CALLS: dict[str, tuple[Callable[[Any], object], str]] = {
    "no effect": (lambda _: cltaa.Effect("camra"), "^unknown effect camra; did you mean camera.$"),
    "an effect of None": (lambda _: cltaa.Effect(None), "^unknown effect None; known effects: camera, "),
    "a camera of one matrix": (lambda _: cltaa.Camera(np.eye(4)), "^Camera: missing .*'view_to_clip'; give world_to_"),
    "a camera by other names": (
        lambda _: cltaa.Camera(view=np.eye(4)),
        "^Camera takes no view; .*world_to_view, view_to_clip",
    ),
    "a camera swapped": (
        lambda _: cltaa.Resolver(device="numpy").resolve(swapped()),
        "camera.world_to_view has a wrong last row .*; it is a projection: are the two matrices swapped",
    ),
    "a sequence of a folder": (lambda seq: cltaa.FrameSequence(seq), "^FrameSequence: missing .*; cltaa.open.folder. "),
    "memory for no pixel": (
        lambda _: cltaa.Resolver(device="numpy").reserve(0, 8, alpha=False),
        "no size of frames .expected width and height from 1 on, found 0 x 8",
    ),
    "open nothing": (lambda _: cltaa.open(None), "no sequence is named .*found None"),
    "open a number": (lambda _: cltaa.inspect(3), "no sequence is named"),
    "frames as text": (lambda seq: cltaa.open(seq, frames="0-1"), "invalid range of frames .*found '0-1'"),
    "effects as a word": (lambda seq: cltaa.open(seq, effects="magic"), "no such declaration of effects"),
    "a frame beyond": (lambda seq: cltaa.open(seq).frame(9), r"frame 9: no such frame \(expected 0-1\)"),
    "a frame by text": (lambda seq: cltaa.open(seq).frame("0"), r"no such frame \(expected 0-1, found '0'\)"),
    "a frame by a float": (lambda seq: cltaa.open(seq).frame(1.0), r"no such frame .*found 1\.0"),
    "a preset of None": (lambda _: cltaa.load_preset(None), "the name of a preset must be text"),
    "no frames": (lambda seq: cltaa.check(seq, frames=0), "no frames to check"),
    "measure files": (lambda seq: cltaa.measure(seq, seq), "no image to measure"),
    "a metric's name": (lambda _: cltaa.measure(LIGHT, LIGHT, ["nope"]), "unknown metric nope"),
    "a plan of nothing": (lambda _: cltaa.plan("nowhere"), "nowhere: the folder is missing"),
    "a plan of no denoiser": (lambda seq: cltaa.plan(seq, denoise="optix"), "no such denoiser .*found 'optix'"),
    "no checkpoint": (lambda seq: cltaa.resolve(seq, "out", checkpoint_every=0), "invalid checkpoint interval"),
    "preview by text": (lambda seq: cltaa.resolve(seq, "out", preview="x.gif"), "a film must be an MP4"),
    "idle without follow": (lambda seq: cltaa.resolve(seq, "out", idle=3.0), "--idle needs --follow"),
    "an empty array of text": (
        lambda _: cltaa.Resolver(device="numpy").empty("big"),
        "empty: unusable shape .*'big'",
    ),
    "an empty array below 0": (lambda _: cltaa.Resolver(device="numpy").empty((-1, 2)), "empty: unusable shape"),
    "an array of 2^62": (lambda _: cltaa.Resolver(device="numpy").empty((2**62,)), "that memory can hold, found"),
    "no comparison": (lambda seq: cltaa.resolve(seq, "out", compare="diagonal"), "no such comparison"),
    "a PNG": (lambda _: cltaa.write_frame("x.png", make_frame()), "x.png: frames are written as EXR"),
    "a number for a path": (lambda _: cltaa.write_frame(3, make_frame()), "no frame to write .*found int, Frame"),
    "a frame of None": (lambda _: cltaa.write_frame("x.0000.exr", None), "found str, NoneType"),
    "resolve nothing": (lambda _: cltaa.resolve(None, "out"), "no sequence is named"),
    "resolve by a preset of None": (lambda seq: cltaa.resolve(seq, "out", None), "the name of a preset must be text"),
    "a layer by text": (lambda seq: cltaa.resolve(seq, "out", layers="foo"), "no such channel .*found foo"),
    "a layer by number": (lambda seq: cltaa.resolve(seq, "out", layers=3), "layers takes names .*found 3"),
    "a layer among names": (lambda seq: cltaa.resolve(seq, "out", layers=["Z", 3]), "layers takes names .*found 3"),
    "a view by number": (lambda seq: cltaa.resolve(seq, "out", debug=3), "debug takes names .*found 3"),
    "views in a list": (lambda seq: resolved(seq).debug(["reject", "cout"]), "debug: unknown view cout; did you mean"),
    "a metric by number": (lambda _: cltaa.measure(LIGHT, LIGHT, 3), "metrics takes names .*found 3"),
    "a metric among names": (lambda _: cltaa.measure(LIGHT, LIGHT, ["mse", 3]), "metrics takes names .*found 3"),
    "a film of a number": (lambda seq: cltaa.resolve(seq, "out", preview=3), "a film must be an MP4 .*found 3"),
    "bands by text": (lambda seq: cltaa.resolve(seq, "out", band_rows="8"), "rows in a band .*found '8'"),
    "when to save by text": (lambda seq: cltaa.resolve(seq, "out", checkpoint_every="8"), "interval .*found '8'"),
    "fireflies by text": (lambda seq: cltaa.resolve(seq, "out", fireflies="yes"), "^resolve: fireflies has no such"),
    "jitter of None": (
        lambda _: cltaa.Resolver(device="numpy").resolve(cltaa.Frame(0, LIGHT, jitter_px=None)),
        "jitter_px is no jitter .*found None",
    ),
    "a setting of None": (
        lambda _: cltaa.load_preset().replace(history_frames=None),
        r"history_frames has no such value .*found None",
    ),
    "a setting of one's own": (
        lambda _: cltaa.Resolver(own(settings=cltaa.Settings(blend_weight=-1.0))),
        "Resolver: blend_weight has no such value .expected 1e-06 to 1, found -1.0",
    ),
    "a ring of one's own": (
        lambda _: cltaa.Resolver(own(settings=cltaa.Settings(history_frames=1000))),
        "history_frames has no such value .expected 1 to 64 .whole., found 1000",
    ),
    "a choice of one's own": (
        lambda _: cltaa.Resolver(own(choices=cltaa.Choices(reject="foo"))),
        "Resolver: reject has no such value .expected none, depth, found foo",
    ),
    "no choices": (
        lambda _: cltaa.Resolver(own(choices=None)),
        "preset: choices is wrong .expected Choices",
    ),
    "a preset without a name": (lambda _: own(name=3), "preset: name is wrong .expected str, found 3"),
    "published by text": (lambda _: own(published="engine"), "preset: published is wrong .expected Published"),
    "a setting of numbers": (
        lambda _: cltaa.load_preset().replace(blend_weight=LIGHT),
        "blend_weight has no such value",
    ),
    "a setting of one's own, of numbers": (
        lambda _: cltaa.Resolver(own(settings=cltaa.Settings(blend_weight=LIGHT))),
        "Resolver: blend_weight has no such value",
    ),
    "a preset by a number": (lambda _: cltaa.load_preset().replace(3), "^Preset.replace: too many positional"),
    "NUL in a folder's name": (lambda seq: cltaa.resolve(seq, "a\0b"), "resolve: output can name no file .*a.x00b"),
    "NUL in a film's name": (lambda seq: cltaa.resolve(seq, "out", preview="\0.mp4"), "preview can name no file"),
    "NUL in a frame's name": (lambda _: cltaa.write_frame("\0.0000.exr", make_frame()), "path can name no file"),
    "NUL in a profile's name": (lambda seq: cltaa.open(seq, profile="\0.toml"), "profile can name no file"),
    "NUL in a side file's name": (lambda seq: cltaa.open(seq, side_file="\0"), "side_file can name no file"),
    "NUL in a preset's name": (lambda _: cltaa.load_preset("\0.toml"), "load_preset: named can name no file"),
    "half of a character": (lambda _: cltaa.open("\ud800"), "open: named can name no file"),
    "a long name": (lambda _: cltaa.open("x" * 5000), "the system refused: File name too long; give it a shorter name"),
    "a long name for results": (lambda seq: cltaa.resolve(seq, "x" * 5000), "the system refused: File name too long"),
    "a profile of numbers": (lambda seq: cltaa.open(seq, profile=LIGHT), "unknown profile"),
    "views of numbers": (lambda seq: cltaa.resolve(seq, "out", debug=LIGHT), "debug takes names"),
    "a denoiser of numbers": (lambda seq: cltaa.resolve(seq, "out", denoise=LIGHT), "no such denoiser"),
    "a path of numbers": (
        lambda _: cltaa.Resolver(device="numpy").resolve(cltaa.Frame(0, LIGHT, path=LIGHT)),
        "path is wrong .expected a path or None, found ndarray",
    ),
    "planar by numbers": (
        lambda _: [*cltaa.Resolver(device="numpy").images([make_frame()], planar=LIGHT)],
        "planar is a flag",
    ),
    "a side file of a number": (lambda seq: cltaa.open(seq, side_file=3), "no name of a side file .*found 3"),
    "an empty name": (lambda _: cltaa.open(""), "no sequence is named .*an empty name"),
    "a profile of None": (lambda seq: cltaa.open(seq, profile=None), "unknown profile None"),
    "no profile's file": (lambda seq: cltaa.open(seq, profile=Path("x.toml")), "x.toml: the file is missing"),
    "an assignment by text": (lambda seq: cltaa.open(seq, assignments="depth.scle=2"), "--input depth.scle=2: no such"),
    "a number for an assignment": (lambda seq: cltaa.open(seq, assignments=[5]), "assignments takes names .*found 5"),
    "assignments of None": (lambda seq: cltaa.check(seq, assignments=None), "assignments takes names .*found None"),
    "a side file to inspect": (lambda seq: cltaa.inspect(seq, side_file="no.txt"), "no.txt: the file is missing"),
    "a number to check by": (lambda seq: cltaa.check(seq, side_file=3), "no name of a side file .*found 3"),
    "reading by text": (lambda seq: cltaa.resolve(seq, "out", reading="x"), "reading holds arguments of .*found 'x'"),
    "images of None": (lambda _: [*cltaa.Resolver(device="numpy").images(None)], "no frames .*found None"),
    "images of a frame": (lambda _: [*cltaa.Resolver(device="numpy").images(make_frame())], "no frames .*found Frame"),
    "an array of foo": (lambda _: cltaa.Resolver(device="numpy").empty((2, 2), "foo"), "unusable shape or type.*'foo'"),
    "no device's name": (lambda _: cltaa.Resolver(device=""), "the name of a device is empty"),
    "no compression": (lambda seq: cltaa.resolve(seq, "out", compression=""), "unknown or lossy compression"),
    "restart by text": (lambda seq: cltaa.resolve(seq, "out", restart="no"), "restart is a flag .*found 'no'"),
    "halves by text": (lambda seq: cltaa.resolve(seq, "out", half="no"), "half is a flag .*found 'no'"),
    "verify by text": (lambda seq: cltaa.open(seq, verify="no"), "verify is a flag .*found 'no'"),
    "verify by text, of another tool": (
        lambda seq: cltaa.open(seq, assignments=["colour.alpha=none"], verify="no"),
        "verify is a flag .*found 'no'",
    ),
    "an id that fits no integer": (
        lambda _: cltaa.write_frame("x.0000.exr", cltaa.Frame(0, LIGHT, object_id=np.full((8, 8), 1e12))),
        "channel id: array is wrong .*whole numbers from 0",
    ),
    "strict by text": (lambda _: cltaa.Resolver(device="numpy", strict="no"), "strict is a flag .*found 'no'"),
    "pixels by text": (lambda seq: cltaa.inspect(seq, pixels="no"), "pixels is a flag .*found 'no'"),
    "halves of 1.5": (lambda _: cltaa.Resolver(device="numpy").feed(make_frame(), half=1.5), "half is a flag .*1.5"),
    "halves by text, flushed": (lambda _: cltaa.Resolver(device="numpy").flush(half="no"), "half is a flag .*'no'"),
    "when to stop by number": (
        lambda seq: cltaa.resolve(seq, "out", stopping=3),
        r"^resolve: stopping is wrong .expected AbstractContextManager.Stop. . None, found 3",
    ),
    "a build by text": (lambda _: cltaa.Resolver(device="numpy", build="x"), "no build .*measurement, found 'x'"),
    "rounds by text": (lambda seq: cltaa.plan(seq, rounds="x"), "invalid number of rounds .*found 'x'"),
    "rounds below 0": (lambda seq: cltaa.plan(seq, rounds=-1), "invalid number of rounds .*found -1"),
    "a frame by a list": (lambda seq: cltaa.open(seq).frame([0]), r"no such frame .*found \[0\]"),
    "frames of text": (lambda seq: cltaa.open(seq, frames=(0, "1")), "invalid range of frames .*found .0, '1'"),
    "a list for a compression": (
        lambda _: cltaa.write_frame("x.0000.exr", make_frame(), compression=["zip"]),
        "^write_frame: compression is wrong .expected str, found list",
    ),
    "an advance of None": (
        lambda seq: cltaa.inspect(seq, pixels=True, advance=3),
        "^inspect: advance is wrong .*found 3",
    ),
    "a step of 1.5 to inspect": (lambda seq: cltaa.inspect(seq, step=1.5), "the step between frames is wrong"),
    "a choice that is no text": (
        lambda _: cltaa.load_preset().replace(rectify="\udcff"),
        r"rectify has no such value .*found .udcff",
    ),
    "found effects by name": (
        lambda _: cltaa.Resolver(device="numpy").resolve(cltaa.Frame(0, LIGHT, found="camera")),
        "found effects are no set .*found str",
    ),
    "no colour to write": (
        lambda _: cltaa.write_frame("x.0000.exr", cltaa.Frame(0, None)),
        "colour is no array .expected one of the host, of numbers, found NoneType",
    ),
    "effects of None": (lambda seq: cltaa.open(seq, effects=None), "no such declaration of effects"),
    "effects in a list": (lambda seq: cltaa.open(seq, effects=["camera"]), "no such declaration of effects"),
    "a step by text": (lambda seq: cltaa.open(seq, step="1"), "the step between frames is wrong .*found '1'"),
    "a truth beyond": (lambda seq: cltaa.open(write_truth(seq)).reference.image(9), "frame 9: no such frame"),
    "stops by text": (lambda _: cltaa.measure(LIGHT, LIGHT, stops="1"), "stops are out of range .*found '1'"),
    "stops of NaN": (lambda _: cltaa.measure(LIGHT, LIGHT, stops=np.nan), "stops are out of range .*found nan"),
    "no pixels": (lambda _: cltaa.measure(LIGHT[:0], LIGHT[:0]), r"no linear light .*found float32 \[0, 8, 3\]"),
    "resolve to nowhere": (lambda seq: cltaa.resolve(seq, ""), "no folder for the results is named"),
    "resolve to None": (lambda seq: cltaa.resolve(seq, None), "no folder for the results is named .*found None"),
    "a list of folders": (lambda seq: cltaa.resolve([seq, "x"], "out"), "a list of files names something else"),
    "a view by text": (lambda seq: cltaa.resolve(seq, "out", debug="rejct"), "debug: unknown view rejct"),
    "bands of no rows": (
        lambda seq: cltaa.resolve(seq, "out", band_rows=-1),
        "invalid number of rows in a band .*found -1",
    ),
    "one depth": (lambda _: cltaa.Resolver().resolve(cltaa.Frame(0, LIGHT, np.float32(5))), "found one number"),
    "a long number": (lambda _: cltaa.write_frame("x.0.exr", make_frame(2**31)), "index does not fit attribute"),
    "a plan of effects of None": (lambda seq: cltaa.plan(seq, effects=None), "no such declaration of effects"),
    "a plan of a layer by text": (lambda seq: cltaa.plan(seq, layers="foo"), "no such channel .*found foo"),
    "no such argument": (
        lambda seq: cltaa.resolve(seq, "out", profil="x"),
        "resolve takes no profil; did you mean profile",
    ),
    "reading by no such argument": (lambda seq: cltaa.resolve(seq, "out", reading={"x": 1}), "reading takes no x"),
    "a resolver of its own": (lambda seq: cltaa.resolve(seq, "out", resolver=None), "resolve takes no resolver"),
    "how an open one is read": (
        lambda seq: cltaa.resolve(cltaa.open(seq), "out", profile="nuke"),
        "the sequence is open .*found profile.*give those to cltaa.open",
    ),
    "a view of nothing": (
        lambda _: cltaa.Resolver(device="numpy").debug("count"),
        r"nothing was resolved yet; call resolve\(\) first",
    ),
    "a table of settings": (
        lambda _: cltaa.load_preset(written("[settings]\nblend_weight = 1")),
        "keys stand at the top",
    ),
    "metrics of numbers": (
        lambda _: cltaa.measure(LIGHT, LIGHT, LIGHT),
        "metrics takes names .*several, found ndarray.$",
    ),
    "metrics of one number": (
        lambda _: cltaa.measure(LIGHT, LIGHT, np.array(3)),
        "metrics takes names .*found ndarray",
    ),
    "no metrics": (lambda _: cltaa.measure(LIGHT, LIGHT, metrics=[]), "no metric is named .expected mse"),
    "metrics of a blank": (lambda _: cltaa.measure(LIGHT, LIGHT, metrics=[" "]), "no metric is named .expected mse"),
    "no truth": (
        lambda seq: cltaa.measure(LIGHT, cltaa.open(copied(seq, "b")).reference),
        "expected an array, found NoneType.; the reference of a sequence without truth is None",
    ),
    "a truth for its image": (
        lambda seq: cltaa.measure(LIGHT, cltaa.open(write_truth(copied(seq, "a"))).reference),
        r"found ImageSequence.; take one of its images: .image.frame.",
    ),
    "look-ahead by text": (
        lambda _: cltaa.Resolver("gather-8", look_ahead="4"),
        "look_ahead is wrong .expected a whole number, found '4'",
    ),
    "another number in a frame's name": (
        lambda _: cltaa.write_frame("frame.0007.exr", make_frame(0)),
        "frame.0007.exr: the file name has another number than the frame .expected 0, found 7",
    ),
    "negative depth to write": (
        lambda _: cltaa.write_frame("x.0000.exr", cltaa.Frame(0, LIGHT, depth=-LIGHT[..., 0])),
        "depth is no distance anywhere .*found -1 to -1.; it is positive before the camera: depth=-depth",
    ),
    "no film": (
        lambda seq: cltaa.resolve(seq, "out", compare="side"),
        "comparison side needs a film; name it: preview",
    ),
}


# What a program calls, an argument that it does not take, and what is said instead of a bare TypeError.
UNKNOWN: list[tuple[Callable[..., Any], str, str]] = [
    (cltaa.open, "profil", "open takes no profil; did you mean profile?"),
    (cltaa.open, "camera", "open takes no camera; did you mean side_file?"),
    (cltaa.resolve, "camera", "resolve takes no camera; did you mean side_file?"),
    (cltaa.check, "input", "check takes no input; did you mean assignments?"),
    (cltaa.check, "frame", "check takes no frame; did you mean frames?"),
    (cltaa.inspect, "pixel", "inspect takes no pixel; did you mean pixels?"),
    (cltaa.plan, "presett", "plan takes no presett; did you mean preset?"),
    (cltaa.measure, "metric", "measure takes no metric; did you mean metrics?"),
    (cltaa.resolve, "presett", "resolve takes no presett; did you mean preset?"),
    (cltaa.write_frame, "compresion", "write_frame takes no compresion; did you mean compression?"),
    (cltaa.load_preset, "nme", "load_preset takes no nme; did you mean named?"),
    (cltaa.Frame, "color", "Frame takes no color; did you mean colour?"),
    (cltaa.Resolver, "lookahead", "Resolver takes no lookahead; did you mean look_ahead?"),
    (cltaa.Resolver(device="numpy").resolve, "outt", "Resolver.resolve takes no outt; did you mean out?"),
    (cltaa.Resolver(device="numpy").images, "halff", "Resolver.images takes no halff; did you mean half?"),
    (cltaa.Resolver(device="numpy").feed, "halff", "Resolver.feed takes no halff; did you mean half?"),
    (cltaa.Resolver(device="numpy").flush, "halff", "Resolver.flush takes no halff; did you mean half?"),
]


def test_an_argument_that_nobody_takes_is_named_with_the_nearest(tmp_path: Path) -> None:
    for call, name, line in UNKNOWN:
        given: tuple[object, ...] = (LIGHT, LIGHT) if call is cltaa.measure else (tmp_path, tmp_path)
        with pytest.raises(CltaaError, match=f"^{re.escape(line)}"):
            call(*given[: 2 if call in (cltaa.measure, cltaa.resolve) else 1], **{name: 1})
    with pytest.raises(CltaaError, match=r"^check: missing a required argument: 'named'"):
        cltaa.check()


def test_a_type_error_of_the_call_itself_stays_one() -> None:
    @reported("faulty")
    def faulty(number: int) -> None:
        raise TypeError(f"of the call with {number}")

    with pytest.raises(TypeError, match="of the call with 3"):
        faulty(number=3)


def refusal(name: str, sequence: Path) -> str:
    with pytest.raises(CltaaError) as caught:
        CALLS[name][0](sequence)
    return str(caught.value)


def test_a_wrong_use_is_reported_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sequence = write_sequence(tmp_path / "in", 2)
    for name, (_, line) in CALLS.items():
        told = refusal(name, sequence)
        assert re.search(line, told), name
        assert "\n" not in told, name


def test_what_check_returns_reads_the_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The profile itself, where it is of another tool's too, and what options it stands for."""
    monkeypatch.chdir(tmp_path)
    folder = write_sequence(tmp_path / "in", 3)
    assignments = ["depth.scale=2"]
    report, profile = cltaa.check(folder, assignments=assignments)
    expected = cltaa.open(folder, assignments=assignments).frame(1).depth
    np.testing.assert_array_equal(cltaa.open(folder, profile=profile).frame(1).depth, expected)
    again, same = cltaa.check(folder, profile=profile)
    assert (again.options, same) == (report.options, profile)
    assert cltaa.inspect(folder, profile=profile).profile == "cltaa"
    whole = cltaa.resolve(folder, tmp_path / "out", device="numpy", profile=profile, frames=(0, 1), effects="all")
    assert whole.frames == 2
    beside = cltaa.resolve(cltaa.open(folder, profile=profile), tmp_path / "all", device="numpy", effects="all")
    assert beside.frames == 3
    # Of sound frames of cltaa's own it is that of their own reader.
    _, sound = cltaa.check(folder)
    assert type(cltaa.open(folder, profile=sound)) is type(cltaa.open(folder))
    # One that comes with no name is told by what it says.
    Path("engine.toml").write_text('profile = "cltaa"\n[depth]\nscale = 2.0')
    options = cltaa.check(folder, profile="engine.toml")[0].options
    assert options == "--profile engine.toml"
    named = cltaa.check(folder, profile=replace(profile, name="engine"))[0].options
    assert named == "--profile cltaa --input depth.scale=2"


def test_a_preset_in_a_file_is_loaded_and_resolves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name = written('preset = "fast"\nblend_weight = 0.25')
    assert cltaa.load_preset(name).settings.blend_weight == 0.25
    assert cltaa.load_preset(Path(name)).choices == cltaa.load_preset("fast").choices
    report = cltaa.resolve(write_sequence(tmp_path / "in", 2), tmp_path / "out", name, device="numpy")
    assert report.preset == "a.toml over fast"


def test_a_single_assignment_may_be_text(tmp_path: Path) -> None:
    for name in ("", "reference"):
        write_colour(tmp_path / name, [make_frame(number) for number in range(2)])
    sequence = cltaa.open(tmp_path, assignments="colour.encoding=srgb")
    assert np.array_equal(sequence.reference.image(1), sequence.frame(1).colour)


def test_a_frame_of_wrong_arrays_can_be_printed() -> None:
    assert repr(cltaa.Frame(0, None, depth=[1.0])) == "Frame(0: no image, depth)"


def test_metrics_are_named() -> None:
    assert cltaa.measure(LIGHT, LIGHT, ["mse"]) == {"mse": 0.0}
    assert cltaa.measure(LIGHT, LIGHT, "mse,psnr").keys() == {"mse", "psnr"}


def test_a_list_of_files_is_resolved(tmp_path: Path) -> None:
    files = sorted(write_sequence(tmp_path / "in", 3).glob("*.exr"))
    assert cltaa.resolve(files, tmp_path / "out", debug="count").resolved == 3


def test_a_sequence_whose_header_was_read_is_pickled(tmp_path: Path) -> None:
    sequence = cltaa.open(write_sequence(tmp_path / "in", 2))
    _ = sequence.attributes  # which reads the header
    assert pickle.loads(pickle.dumps(sequence)).frame(1).index == 1
