"""A capture on disk: content, bit-identity, and what a second run does."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import cltaa_capture
import cltaa_datasets
from cltaa.errors import DataError, OutputError, StorageError, UsageError
from cltaa.frame import Effect, Image
from cltaa.io import streams
from cltaa.io.exr_read import read_colour, read_image
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_sequence
from cltaa_capture import manifest, sequence
from cltaa_capture.jitter import Offsets, jitter_sequence
from cltaa_capture.sequence import Request, capture_sequence
from cltaa_datasets.scene import Instant
from tests.datasets.gltf_writer import Writer
from tests.sequence_factory import digests

FRAMES = 3


def request(folder: Path, scene: str = "conveyor") -> Request:  # which is built in no time, and has motion
    return Request(scene, folder, frames=FRAMES, width=48, height=27, jitter="halton:2", reference=4)


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished capture; tests that change it work on a capture of their own."""
    folder = tmp_path_factory.mktemp("captured")
    capture_sequence(request(folder))
    return folder


def test_a_capture_is_a_sequence(tmp_path: Path) -> None:
    capture_sequence(request(tmp_path, "occluder"))
    found = open_sequence(tmp_path)
    assert (found.name, len(found), found.width, found.height) == ("occluder", FRAMES, 48, 27)
    assert found.effects == frozenset({Effect.MOTION, Effect.DISOCCLUSION})
    assert found.reference is not None
    offsets = jitter_sequence("halton:2")
    for index, (frame, truth) in enumerate(zip(found, found.reference, strict=True)):
        assert frame.jitter_px == tuple(offsets[index % 2])
        assert frame.motion is not None
        assert np.isfinite(frame.motion).any()
        assert np.isnan(frame.motion).any()
        assert (frame.alpha, frame.reactive, frame.object_id, frame.normal) == (None, None, None, None)
        assert np.abs(truth - frame.colour).mean() < 0.1  # the same instant
        assert not np.array_equal(truth, frame.colour)


def test_sequence_json_has_the_settings_and_a_hash_of_every_file(captured: Path) -> None:
    content = json.loads((captured / "sequence.json").read_text())
    assert content["files"] == digests(captured)
    assert len(content["files"]) == 2 * FRAMES
    asked = {"scene": "conveyor", "seed": 0, "width": 48, "height": 27, "jitter": "halton:2", "reference": 4}
    assert {key: content["settings"][key] for key in asked} == asked
    assert content["effects"] == "motion"
    assert content["versions"]["opengl"]


def test_one_seed_gives_one_sequence_and_another_seed_another(captured: Path, tmp_path: Path) -> None:
    capture_sequence(request(tmp_path / "same"))
    capture_sequence(replace(request(tmp_path / "other"), seed=1))
    assert digests(tmp_path / "same") == digests(captured)
    other = digests(tmp_path / "other")
    assert all(other[name] != digest for name, digest in digests(captured).items())


def test_a_scene_without_motion_writes_no_motion(tmp_path: Path) -> None:
    capture_sequence(replace(request(tmp_path, "corridor"), reference=0))
    channels, _ = read_image(tmp_path / "corridor.0001.exr")
    assert set(channels) == {"R", "G", "B", "Z"}
    assert not (tmp_path / "reference").exists()


def test_a_second_run_keeps_what_is_finished_and_mends_what_is_not(tmp_path: Path, captured: Path) -> None:
    capture_sequence(request(tmp_path))
    (tmp_path / "conveyor.0001.exr").unlink()
    with (tmp_path / "reference" / "conveyor.0002.exr").open("r+b") as stream:
        stream.seek(-1, 2)
        stream.write(b"?")
    (tmp_path / ".conveyor.0001.exr.tmp.999999999").touch()  # left by a killed process
    untouched = (tmp_path / "conveyor.0000.exr").stat().st_mtime_ns
    again = capture_sequence(request(tmp_path))
    assert (again.drawn, again.kept, again.supersampled) == (1, 2, 1)
    assert digests(tmp_path) == digests(captured)
    assert (tmp_path / "conveyor.0000.exr").stat().st_mtime_ns == untouched
    assert not list(tmp_path.glob(".*tmp*"))


def test_a_run_that_was_cut_short_goes_on(tmp_path: Path, captured: Path) -> None:
    def stop(done: int, _: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        capture_sequence(request(tmp_path), stop)
    done = json.loads((tmp_path / "sequence.json").read_text())["files"]
    assert len(done) == 4  # two frames, two references: what was being written is finished and listed
    again = capture_sequence(request(tmp_path))
    assert (again.drawn, again.kept) == (1, 2)
    assert digests(tmp_path) == digests(captured)


def test_a_failed_write_keeps_what_came_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, *arguments: object, **options: object) -> None:
        if "0001" in path.name:
            raise StorageError("writing failed: No space left on device", path=path)
        write_image(path, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(streams, "write_image", full)
    with pytest.raises(StorageError, match="No space left"):
        capture_sequence(request(tmp_path))
    assert "conveyor.0000.exr" in json.loads((tmp_path / "sequence.json").read_text())["files"]
    assert not (tmp_path / "conveyor.0001.exr").exists()


def test_a_picture_beyond_the_scene_is_refused(tmp_path: Path) -> None:
    """Its sky is declared by nothing: walls and floors end at the sides of a very wide picture."""
    with pytest.raises(UsageError, match=r"frame 0 shows sky, .*; use a less wide --size, or fewer --frames"):
        capture_sequence(replace(request(tmp_path), width=64, height=8))
    assert not list(tmp_path.rglob("*.exr"))


def test_frames_may_be_added(tmp_path: Path) -> None:
    capture_sequence(replace(request(tmp_path), frames=1))
    more = capture_sequence(request(tmp_path))
    assert (more.drawn, more.kept) == (FRAMES - 1, 1)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"seed": 2}, "--seed 0, not with --seed 2"),
        ({"width": 50}, "--size 48x27, not with --size 50x27"),
        ({"jitter": "none"}, "--jitter halton:2, not with --jitter none"),
        ({"reference": 8}, "--reference 4, not with --reference 8"),
        ({"scene": "still", "reference": 0}, "another scene"),
    ],
)
def test_another_setting_is_refused_by_name(captured: Path, change: dict[str, object], named: str) -> None:
    before = digests(captured)
    with pytest.raises(UsageError, match=f"was begun with {named}.*--restart"):
        capture_sequence(replace(request(captured), **change))  # type: ignore[arg-type]
    assert digests(captured) == before


def test_other_code_is_another_setting(captured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence, "code_sha256", lambda: "0" * 64)
    with pytest.raises(UsageError, match=r"by another version of capture or scenes, .*; name another folder"):
        capture_sequence(request(captured))


@pytest.mark.parametrize("changed", ["sheet.obj", "sheet.mtl", "sheet.png", "sheet.gltf", "sheet.bin"])
def test_a_model_that_changed_is_named(changed: str, tmp_path: Path) -> None:
    PIL.Image.new("L", (2, 2)).save(tmp_path / "sheet.png")
    (tmp_path / "sheet.mtl").write_text("newmtl red\nmap_Kd sheet.png\n")
    (tmp_path / "sheet.obj").write_text("mtllib sheet.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    writer = Writer(nodes=[{"mesh": 0}], buffers=[{"uri": "sheet.bin"}])
    writer.json["meshes"] = [{"primitives": [writer.square()]}]
    (tmp_path / "sheet.bin").write_bytes(writer.blob)
    (tmp_path / "sheet.gltf").write_text(json.dumps(writer.json))
    model = tmp_path / ("sheet.gltf" if changed in ("sheet.gltf", "sheet.bin") else "sheet.obj")
    drawn = Request(f"file:{model}", tmp_path / "out", frames=1, width=16, height=9)
    capture_sequence(drawn)
    assert capture_sequence(drawn).kept == 1
    if changed == "sheet.png":
        PIL.Image.new("L", (2, 2), 99).save(tmp_path / changed)
    else:
        (tmp_path / changed).write_bytes((tmp_path / changed).read_bytes() + b"\n")
    with pytest.raises(UsageError, match="was begun with another content of the model; name another folder"):
        capture_sequence(drawn)


@pytest.mark.parametrize("spelled", [{"motion": "turntable"}, {"scene": "file:sheet.obj"}], ids=str)
def test_a_setting_spelled_otherwise_is_no_other_setting(
    spelled: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    drawn = replace(request(tmp_path / "out", f"file:{tmp_path / 'sheet.obj'}"), frames=1)
    capture_sequence(drawn)
    monkeypatch.chdir(tmp_path)
    assert capture_sequence(replace(drawn, **spelled)).kept == 1  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="was begun with --motion turntable, not with --motion orbit"):
        capture_sequence(replace(drawn, motion="orbit"))


def test_fewer_frames_than_were_begun_forget_none(tmp_path: Path) -> None:
    capture_sequence(request(tmp_path))
    record = json.loads((tmp_path / "sequence.json").read_text())
    del record["files"]["conveyor.0002.exr"]  # as a kill may leave it
    (tmp_path / "sequence.json").write_text(json.dumps(record))
    capture_sequence(replace(request(tmp_path), frames=1))
    assert json.loads((tmp_path / "sequence.json").read_text())["frames"] == FRAMES


def test_what_does_not_run_is_no_other_code() -> None:
    code = "def f(x):\n    return x + 1\n"
    told = '"""A module."""\n\n\ndef f(x):  # adds\n    """Add one."""\n    return (\n        x + 1\n    )\n'
    assert manifest.what_runs(code) == manifest.what_runs(told)
    assert manifest.what_runs(code) != manifest.what_runs(code.replace("1", "2"))
    scene = "@register('pan', 'A camera turns', (Effect.CAMERA,))\ndef pan(): ...\n"
    assert manifest.what_runs(scene) == manifest.what_runs(scene.replace("turns", "pans"))
    assert manifest.what_runs(scene) != manifest.what_runs(scene.replace("CAMERA", "MOTION"))
    assert manifest.what_runs("class A:\n    'what it is'\n") == manifest.what_runs("class A:\n    'and is not'\n")


def test_the_sum_over_the_code_is_the_same_in_every_python() -> None:
    """What 3.11, 3.12 and 3.13 gave: a capture goes on where it stopped when Python was renewed in between."""
    code = (
        "import a.b as c\n\n\n@c.d\nclass A(c.E, f=1):\n    x: int = -1_0\n\n"
        "    async def g(self, /, *y, z=None, **w) -> 'str':\n        def h(): ...\n"
        "        match w:\n            case {'é': [1.5, *_]} | None if z:\n"
        "                return f'{z!r:>{x}} {{}} é' 'k'\n"
        "        return [i async for i in (lambda: y)() if not i]\n"
    )
    assert hashlib.sha256(manifest.what_runs(code)).hexdigest()[:16] == "4a7ddfe3d494b332"


def test_what_draws_uses_nothing_that_the_sum_over_the_code_leaves_out() -> None:
    left_out = [name.removesuffix(".py").replace("/", ".") for name in manifest.NOT_DRAWING]
    for package in (cltaa_capture, cltaa_datasets):
        folder = Path(package.__file__ or "").parent
        for path in folder.rglob("*.py"):
            name = path.relative_to(folder.parent).as_posix()
            if name not in (*manifest.NOT_DRAWING, "cltaa_capture/sequence.py"):  # the sequence keeps the record
                assert not [other for other in left_out if other in path.read_text(encoding="utf-8")], name


def test_restart_deletes_only_the_files_of_the_capture(tmp_path: Path) -> None:
    capture_sequence(request(tmp_path))
    paintings = [tmp_path / "painting.0001.exr", tmp_path / "reference" / "painting.0001.exr"]
    for painting in paintings:
        painting.write_bytes(b"precious")
    record = json.loads((tmp_path / "sequence.json").read_text())
    del record["files"]["conveyor.0002.exr"]  # as a kill may leave it
    (tmp_path / "sequence.json").write_text(json.dumps(record))
    capture_sequence(replace(request(tmp_path), frames=1, seed=5, reference=0, restart=True))
    assert [path.read_bytes() for path in paintings] == [b"precious"] * 2
    assert [path.name for path in sorted(tmp_path.glob("conveyor.*"))] == ["conveyor.0000.exr"]


def test_a_restart_that_was_killed_can_be_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture_sequence(request(tmp_path))
    again = replace(request(tmp_path), frames=1, seed=5, reference=0, restart=True)
    unlink = Path.unlink

    def killed(path: Path, missing_ok: bool = False) -> None:
        if path.name == "conveyor.0001.exr":
            raise KeyboardInterrupt
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", killed)
    with pytest.raises(KeyboardInterrupt):
        capture_sequence(again)
    monkeypatch.undo()
    assert capture_sequence(again).drawn == 1
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["conveyor.0000.exr", "sequence.json"]


@pytest.mark.parametrize(("restart", "record"), [(False, None), (True, None), (True, "{")])
def test_files_of_another_origin_are_left_alone(tmp_path: Path, restart: bool, record: str | None) -> None:
    """Also where a record is damaged, so that nobody knows which files are the capture's."""
    stranger = tmp_path / "render.0001.exr"
    stranger.write_bytes(b"precious")
    if record is not None:
        (tmp_path / "sequence.json").write_text(record)
    with pytest.raises(UsageError, match=r"holds EXR files of another origin .*; choose an empty folder"):
        capture_sequence(replace(request(tmp_path), restart=restart))
    assert stranger.read_bytes() == b"precious"
    stranger.unlink()
    assert capture_sequence(replace(request(tmp_path), restart=restart)).drawn == FRAMES


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"format": 99, "settings": {}, "files": {}}', '{"format": 1, "settings": {}, "files": {}}']
)
def test_a_damaged_manifest_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "sequence.json").write_text(content)
    with pytest.raises(DataError, match=r"sequence\.json: cannot be resumed from .*; use --restart to begin anew"):
        capture_sequence(request(tmp_path))


@pytest.mark.parametrize(("scene", "references"), [("charts", 1), ("conveyor", FRAMES)])
def test_a_reference_is_drawn_where_something_has_changed(
    scene: str, references: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cltaa_capture.render import SceneRenderer  # here: it binds OpenGL to its platform

    draw, drawn = SceneRenderer.draw_reference, []

    def counted(renderer: SceneRenderer, now: Instant, offsets: Offsets) -> Image:
        drawn.append(draw(renderer, now, offsets))
        return drawn[-1]

    monkeypatch.setattr(SceneRenderer, "draw_reference", counted)
    capture_sequence(request(tmp_path, scene))
    assert len(drawn) == references
    for index in range(FRAMES):
        found = read_colour(tmp_path / "reference" / f"{scene}.{index:04d}.exr")
        np.testing.assert_array_equal(found, drawn[min(index, references - 1)][..., :3])


def test_a_yardstick_is_drawn_later_and_its_time_is_kept(tmp_path: Path) -> None:
    asked = replace(request(tmp_path), frames=2)
    capture_sequence(asked)
    times = json.loads((tmp_path / "sequence.json").read_text())["seconds_a_frame"]
    assert list(times) == ["1", "4"]
    again = capture_sequence(replace(asked, yardstick=(2, 4)))
    assert (again.drawn, again.kept, again.supersampled) == (0, 2, 4)
    content = json.loads((tmp_path / "sequence.json").read_text())
    assert len(content["files"]) == 2 * 4
    seconds = content["seconds_a_frame"]
    assert list(seconds) == ["1", "2", "4"]
    assert seconds["1"] == times["1"]  # drawn in the first run
    assert all(value > 0 for value in seconds.values())
    for name in ("conveyor.0000.exr", "conveyor.0001.exr"):  # four samples are four samples
        expected, found = (read_colour(tmp_path / folder / name) for folder in ("reference", "reference-4"))
        np.testing.assert_array_equal(found, expected)
    capture_sequence(replace(asked, seed=1, restart=True))
    assert not (tmp_path / "reference-2").exists()


def test_a_truth_of_one_sample_leaves_the_time_of_the_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa_capture.sequence.perf_counter", iter((0.0, 1.0, 0.0, 100.0)).__next__)
    capture_sequence(replace(request(tmp_path), frames=1, reference=1))
    assert json.loads((tmp_path / "sequence.json").read_text())["seconds_a_frame"] == {"1": 1.0}


def test_second_capture_into_one_folder_is_refused(tmp_path: Path) -> None:
    def meanwhile(done: int, _: int) -> None:
        if done == 1:
            with pytest.raises(OutputError, match="another process is writing into the folder"):
                capture_sequence(request(tmp_path))

    assert capture_sequence(request(tmp_path), meanwhile).drawn == FRAMES


@pytest.mark.parametrize("folder", [".", "reference", "reference-2"])
def test_what_a_killed_capture_left_goes(tmp_path: Path, folder: str) -> None:
    """Also where a process that runs has the number of the one that was killed: this very one, as in a container."""
    left = tmp_path / folder / f".conveyor.0009.exr.tmp.{os.getpid()}"
    left.parent.mkdir(exist_ok=True)
    left.write_bytes(b"half")
    capture_sequence(request(tmp_path))
    assert not left.exists()
