"""``cltaa inspect`` from the outside: facts of a sound sequence, of results, and every problem of a bad one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from cltaa.cli import main
from cltaa.frame import Camera, Effect, Frame
from tests.inputs.foreign import side_text, write_blender
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame, write_frames, write_images

OFFSETS = ((0.25, 0.125), (-0.25, 0.25), (0.0, -0.375))  # mean (0, 0)


def sound(index: int, **changes: Any) -> Frame:
    """Frame of a sequence that declares all that happens in it."""
    return make_frame(index, **{"jitter_px": OFFSETS[index % 3], **changes})


def findings(capsys: pytest.CaptureFixture[str], folder: Path, *options: str, code: int = 65) -> Any:
    assert main(["inspect", str(folder), "--json", *options]) == code
    captured = capsys.readouterr()
    assert captured.err == ""
    return json.loads(captured.out)


def problems(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> str:
    found = findings(capsys, folder, *options)["problems"]
    assert len(found) == 1, found
    return str(found[0])


def test_every_fact_of_a_sequence_is_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    effects = frozenset({Effect.CAMERA, Effect.MOTION, Effect.CUT, Effect.EXPOSURE})
    changes = {"motion": True, "effects": effects}
    frames = [sound(i, cut=i == 5, exposure=2.0 if i > 6 else 1.0, **changes) for i in range(2, 10)]
    write_frames(tmp_path, frames)
    truth = [frame.colour for frame in frames]
    write_images(tmp_path / "reference", truth, name="synthetic", first=2, samples=64)
    found = findings(capsys, tmp_path, code=0)
    assert found["problems"] == []
    assert (found["first"], found["last"], found["frames"]) == (2, 9, 8)
    assert (found["width"], found["height"], found["compression"]) == (WIDTH, HEIGHT, "zip")
    assert found["channels"] == dict.fromkeys(["B", "G", "R", "Z", "backward.u", "backward.v"], "float")
    assert found["effects"] == ["camera", "cut", "exposure", "motion"]
    assert found["jitter"] == {"period": 3, "mean_px": [0.0, 0.0], "largest_px": 0.375}
    assert found["camera"] == "moves"
    assert (found["cuts"], found["exposures"]) == ([5], [1.0, 2.0])
    assert found["reference"] == {"frames": 8, "samples": 64}
    assert found["disk_bytes"] == sum(path.stat().st_size for path in tmp_path.rglob("*.exr"))
    assert found["statistics"] == {}


def test_the_camera_s_motion_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    still = [sound(i, camera=make_camera(), effects=frozenset()) for i in range(3)]
    assert findings(capsys, write_frames(tmp_path / "still", still), code=0)["camera"] == "still"
    zoom = [sound(i, camera=make_camera(aspect=1 + i / 10)) for i in range(3)]
    assert findings(capsys, write_frames(tmp_path / "zoom", zoom), code=0)["camera"] == "zooms"
    shift = make_camera().view_to_clip.copy()
    shift[0, 2] += 0.01  # of the centre, as by jitter that was left in it
    shifted = [sound(0, camera=make_camera()), sound(1, camera=Camera(make_camera().world_to_view, shift))]
    assert findings(capsys, write_frames(tmp_path / "shift", shifted), code=0)["camera"] == "shifts"
    flat = [sound(i, camera=Camera(np.eye(4), np.diag([1, 1, -0.02, 1.0])), effects=None) for i in range(3)]
    found = findings(capsys, write_frames(tmp_path / "flat", flat), code=0)
    assert found["orthographic"]
    assert found["effects"] is None


def test_pixels_are_counted_only_when_asked(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    frames = [sound(i) for i in range(3)]
    frames[1].colour[4, 5] = (np.nan, 7.5, -np.inf)
    write_frames(tmp_path, frames)
    assert findings(capsys, tmp_path, code=0)["statistics"] == {}
    found = findings(capsys, tmp_path, "--pixels")
    pixels = 3 * WIDTH * HEIGHT
    assert found["statistics"]["G"]["highest"] == 7.5
    assert found["statistics"]["R"]["nan"] == 1
    assert found["statistics"]["B"]["infinite"] == 1
    assert found["statistics"]["Z"] | {"lowest": 0, "highest": 0} == {
        "lowest": 0,
        "highest": 0,
        "nan": 0,
        "infinite": 3 * WIDTH,
        "zero": 0,
        "count": pixels,
    }
    assert found["problems"] == [
        f"frame 1: 1 of {WIDTH * HEIGHT} pixels is without a usable sample: x 5, y 4",
        *(f"channel {name}: 1 of {pixels} values are not finite" for name in "BR"),
    ]


@pytest.mark.parametrize(
    ("channel", "value", "message"),
    [
        ("depth", -1.0, "frame 1: depth is negative in 1 of 851 pixels: counts as the sky"),
        ("depth", 0.0, "channel Z: depth 0 is not in front of the camera"),
        ("depth", np.nan, "frame 1: depth is NaN in 1 of 851 pixels: counts as the sky"),
        ("alpha", 1.5, "leaves 0 to 1"),
        ("motion", np.inf, "frame 1: motion is infinite in 1 of 851 pixels: history is dropped there"),
    ],
)
def test_unusable_pixels_are_problems(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, channel: str, value: float, message: str
) -> None:
    effects = frozenset({Effect.ALPHA, Effect.MOTION})
    kept: dict[str, Any] = {"alpha": True, "motion": True, "effects": effects, "jitter_px": (0.0, 0.0)}
    frames = [make_frame(index, **kept) for index in range(2)]
    getattr(frames[1], channel)[3, 3] = value
    found = findings(capsys, write_frames(tmp_path, frames), "--pixels")["problems"]
    assert any(message in problem for problem in found)


def test_an_orthographic_camera_may_have_surfaces_behind_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    flat = Camera(np.eye(4), np.diag([0.5, 0.5, -0.01, 1.0]))
    frame = make_frame(camera=flat, jitter_px=(0.0, 0.0))
    frame.depth[3, 3] = -1.0
    own, other = tmp_path / "own", tmp_path / "other"
    own.mkdir()
    assert findings(capsys, write_frames(own, [frame]), "--pixels", code=0)["problems"] == []
    write_blender(other, [frame])
    (tmp_path / "camera.txt").write_text(side_text([frame]))
    assert main(["inspect", str(other), "--camera", str(tmp_path / "camera.txt"), "--pixels"]) == 0
    assert "no problem found" in capsys.readouterr().out


def test_motion_that_is_never_needed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    still = replace(
        make_frame(motion=True, effects=frozenset({Effect.MOTION}), jitter_px=(0.0, 0.0)),
        motion=np.zeros((HEIGHT, WIDTH, 2), np.float32),
    )
    found = findings(capsys, write_frames(tmp_path, [still]), "--pixels")["problems"]
    assert found == [f"channel backward.{axis}: all zero; nothing moves, so the channel is not needed" for axis in "uv"]


def test_every_problem_is_listed_at_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(i) for i in range(9)])
    for number in (3, 4, 6):
        (tmp_path / f"synthetic.{number:04d}.exr").unlink()
    path = tmp_path / "synthetic.0007.exr"
    path.write_bytes(path.read_bytes()[:-1])
    (tmp_path / "synthetic.0008.exr").rename(tmp_path / "synthetic.0009.exr")
    found = findings(capsys, tmp_path)["problems"]
    for message in (
        "frames missing: 3-4, 6, 8",
        "synthetic.0007.exr: the file is truncated",
        "cltaa:frame of frame 9",
    ):
        assert sum(message in problem for problem in found) == 1, found


def test_the_same_in_many_frames_is_one_problem(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, map(sound, (0, 1, 2, 5)))
    for number in (1, 2, 5):
        path = tmp_path / f"synthetic.{number:04d}.exr"
        path.write_bytes(b"")
    found = findings(capsys, tmp_path)["problems"]
    assert len(found) == 2, found
    assert found[1].endswith(
        "synthetic.0001.exr: the file is empty (expected an EXR image); write it again; the same in frames 2, 5"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"alpha": True}, "effect alpha is there but not declared"),
        ({"motion": True}, "effect motion is there but not declared"),
        ({"reactive": True}, "effect reactive is there but not declared"),
        ({"effects": frozenset()}, "effect camera is there but not declared"),
        ({"jitter_px": (0.25, 0.0)}, "jitter is not centred: its mean shifts the image by up to 0.25 pixels"),
    ],
)
def test_undeclared_effects_are_problems(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    assert problems(capsys, write_frames(tmp_path, [sound(i, **changes) for i in range(3)])) == message


def test_undeclared_cuts_and_exposures_are_problems(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(i, cut=i == 2, exposure=1.0 + i) for i in range(3)])
    found = findings(capsys, tmp_path)["problems"]
    assert found == [f"effect {name} is there but not declared" for name in ("cut", "exposure")]


def test_frames_that_differ_are_problems(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    size = write_frames(tmp_path / "size", [sound(i, width=WIDTH + (i == 2)) for i in range(3)])
    assert problems(capsys, size) == "size of frame 2 differs from that of frame 0"
    declared = frozenset({Effect.CAMERA, Effect.ALPHA})
    channels = write_frames(tmp_path / "channels", [sound(i, alpha=i > 0, effects=declared) for i in range(3)])
    assert problems(capsys, channels) == "channels of frames 1-2 differ from those of frame 0"
    effects = write_frames(tmp_path / "effects", [sound(i, effects=declared if i == 1 else None) for i in range(3)])
    assert problems(capsys, effects) == "other effects than the first are declared by frame 1"


def test_lossy_compression_and_half_motion_are_problems(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(i, motion=True, effects=frozenset({Effect.CAMERA, Effect.MOTION})) for i in range(3)])
    for path in tmp_path.iterdir():
        file = OpenEXR.File(str(path), separate_channels=True)
        header = {k: v for k, v in file.header().items() if k != "channels"} | {"compression": OpenEXR.DWAA_COMPRESSION}
        halves = {"backward.u", "backward.v"}
        channels = {
            name: channel.pixels.astype(np.float16 if name in halves else np.float32)
            for name, channel in file.channels().items()
        }
        OpenEXR.File(header, channels).write(str(path))
    found = findings(capsys, tmp_path)["problems"]
    assert found[0] == "compression dwaa loses precision; depth and motion need all of it"
    assert [problem.split(":")[0] for problem in found[1:]] == [
        f"channel backward.{axis} is half precision" for axis in "uv"
    ]


def test_a_reference_that_does_not_fit_is_a_problem(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    frames = [sound(i) for i in range(4)]
    write_frames(tmp_path, frames)
    write_images(tmp_path / "reference", [frame.colour[:, 1:] for frame in frames[:2]], name="synthetic")
    assert findings(capsys, tmp_path)["problems"] == [
        "reference missing for frames 2-3",
        f"reference is {WIDTH - 1} x {HEIGHT}, frames {WIDTH} x {HEIGHT}",
    ]
    (tmp_path / "reference" / "synthetic.0000.exr").write_bytes(b"")
    assert "the file is empty" in problems(capsys, tmp_path)


def test_the_text_states_the_facts_and_the_problems(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(i) for i in range(6)])
    assert main(["inspect", str(tmp_path), "--pixels"]) == 0
    out = capsys.readouterr().out
    for words in ("6: 0 to 5", f"{WIDTH} x {HEIGHT}", "repeats after 3", "moves, perspective", "no problem found"):
        assert words in out
    (tmp_path / "synthetic.0002.exr").unlink()
    assert main(["inspect", str(tmp_path)]) == 65
    assert "✗ frames missing: 2" in capsys.readouterr().out


def test_gap_of_half_a_billion_frames_is_reported_at_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A name may hold any number; the numbers between must not be counted out in memory."""
    write_frames(tmp_path, [sound(0)])
    (tmp_path / "synthetic.0000.exr").rename(tmp_path / "synthetic.500000000.exr")
    write_frames(tmp_path, [sound(0), sound(1)])
    found = findings(capsys, tmp_path)["problems"]
    assert found[0] == "frames missing: 2-499999999"


def test_pixels_are_held_against_the_record(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_frames(tmp_path, [sound(i) for i in range(4)])
    (tmp_path / "sequence.json").write_text(json.dumps({"files": {"synthetic.0002.exr": "0" * 64}}))
    findings(capsys, tmp_path, code=0)  # headers alone do not tell
    assert "synthetic.0002.exr: the content is not what was recorded" in problems(capsys, tmp_path, "--pixels")
    (tmp_path / "sequence.json").write_text("{")
    assert "sequence.json: not readable as JSON" in problems(capsys, tmp_path, "--pixels")


@pytest.mark.parametrize("options", [(), ("--pixels",), ("--profile", "cltaa", "--input", "depth.scale=1")])
def test_frames_are_so_many_or_from_one_to_another(
    options: tuple[str, ...], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As for the other commands; what is damaged or missing beside them is no problem of theirs."""
    write_frames(tmp_path, [sound(index) for index in (2, 3, 4, 5, 6, 9)])
    (tmp_path / "synthetic.0009.exr").write_bytes(b"not EXR")
    for given in ("3-5", "4"):
        found = findings(capsys, tmp_path, "--frames", given, *options, code=0)
        assert (found["first"], found["last"], found["frames"]) == ((3, 5, 3) if given == "3-5" else (2, 5, 4))
    assert "0009" in findings(capsys, tmp_path, *options)["problems"][-1]
    assert main(["inspect", str(tmp_path), "--frames", "3-8", *options]) == 64
    assert "frame 8: no such frame" in capsys.readouterr().err


def test_inspect_finds_no_problem_in_resolved_frames(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    effects = frozenset({Effect.CAMERA, Effect.MOTION, Effect.HDR})
    write_frames(tmp_path / "in", [sound(i, effects=effects, motion=True) for i in range(4)])
    command = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy", "--preset", "basic"]
    assert main(command) == 0
    capsys.readouterr()
    for more in ([], ["--pixels"]):
        found = findings(capsys, tmp_path / "out", *more, code=0)
        assert (found["resolved_by"], found["problems"], found["idle"]) == ("basic", [], [])
    for command in (
        ["check", str(tmp_path / "out")],
        ["resolve", str(tmp_path / "out"), "-o", str(tmp_path / "twice")],
    ):
        assert main(command) == 64
        said = capsys.readouterr().err
        assert (
            "these are results of cltaa resolve (found preset basic); name the folder that they were made from" in said
        )


def test_what_a_resolve_wrote_beside_the_layers_of_another_tool_is_a_result(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Its own colour is resolved, the layer that it was made from and depth and vectors lie beside it."""
    write_blender(tmp_path / "in", [make_frame(i, motion=True, effects=None) for i in range(3)])
    write_frames(tmp_path / "own", [sound(i) for i in range(3)])
    for folder, options in (("in", []), ("own", ["--layers", "all"])):
        command = ["resolve", str(tmp_path / folder), "-o", str(tmp_path / f"{folder}-out"), "--device", "numpy"]
        assert main([*command, *options]) == 0
        capsys.readouterr()
        for more in ([], ["--pixels"]):
            found = findings(capsys, tmp_path / f"{folder}-out", *more, code=0)
            assert (found["resolved_by"], found["problems"]) == ("default", [])
        profile = [] if folder == "own" else ["--profile", "blender"]
        for command in (
            ["check", str(tmp_path / f"{folder}-out")],
            ["resolve", str(tmp_path / f"{folder}-out"), "-o", str(tmp_path / "twice")],
            ["resolve", str(tmp_path / f"{folder}-out"), "-o", str(tmp_path / "twice"), *profile],
            ["inspect", str(tmp_path / f"{folder}-out"), "--plan", *profile],
        ):
            assert main(command) == 64
            assert "these are results of cltaa resolve (found preset default)" in capsys.readouterr().err
