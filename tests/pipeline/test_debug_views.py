"""The debug views against what is known of each pixel, and against what the fused kernel made of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.cli import main
from cltaa.core.debug import Reason, View, are_views, parse_views
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Camera, Frame, Image
from cltaa.io.exr_read import read_image
from cltaa.io.sequence import open_images
from cltaa.pipeline.debug import COLOURS, DebugViews, view_picture
from tests.core.standing import panned
from tests.sequence_factory import bits, make_camera, make_frame, write_sequence

ALL = tuple(View)


def flat_frame(index: int, **changes: object) -> Frame:
    """Random colours on a wall before a still camera, with no effect ruled out."""
    frame = make_frame(index, camera=make_camera(), effects=None)
    return replace(replace(frame, depth=np.full_like(frame.depth, 4.0)), **changes)  # type: ignore[arg-type]


def look(frames: list[Frame], preset: Preset | str = "default") -> dict[str, Image]:
    """Layers of the last frame."""
    resolver = Resolver(preset, "numpy")
    for frame in frames:
        resolver.resolve(frame)
    return DebugViews(resolver, ALL).layers()


def test_a_first_frame_has_no_history() -> None:
    layers = look([flat_frame(0)])
    assert (layers["debug.reject"] == Reason.NO_HISTORY).all()
    assert (layers["debug.count"] == 1).all()
    assert (layers["debug.clip"] == 0).all()
    cut = look([flat_frame(0), flat_frame(1, cut=True)])
    assert (cut["debug.reject"] == Reason.NO_HISTORY).all()


def test_what_came_into_view_was_off_screen() -> None:
    shift, first = 5, flat_frame(0)
    second = flat_frame(1, camera=panned(first.camera, shift, first.width))
    layers = look([first, second])
    off_screen = layers["debug.reject"] == Reason.OFF_SCREEN
    assert list(np.flatnonzero(off_screen.all(0))) == list(range(first.width - shift, first.width))
    assert (layers["debug.reject"][:, :-shift] == Reason.KEPT).all()
    assert (layers["debug.motion.u"] == shift).all()
    assert (layers["debug.motion.v"] == 0).all()


def test_another_surface_is_rejected_by_depth() -> None:
    moved = flat_frame(1)
    moved.depth[8:12, 10:20] = 9.0
    layers = look([flat_frame(0), moved])
    inside = layers["debug.reject"][9:11, 11:19]  # the pixels beside the edge follow the nearer surface
    assert (inside == Reason.DEPTH).all()
    assert (layers["debug.reject"][:7] == Reason.KEPT).all()
    assert (layers["debug.count"][9:11, 11:19] == 1).all()


def test_a_bad_texel_is_named() -> None:
    resolver = Resolver("default", "numpy")
    resolver.resolve(flat_frame(0))
    _, buffers = resolver.recurrent()
    with buffers["history"].mapped(write=True) as planes:
        planes[1, planes.shape[1] // 2, planes.shape[2] // 2] = np.nan
    resolver.resolve(flat_frame(1))
    reject = DebugViews(resolver, [View.REJECT]).layers()["debug.reject"]
    assert (reject == Reason.BAD_TEXEL).any()
    assert set(np.unique(reject)) == {Reason.KEPT, Reason.BAD_TEXEL}


def test_the_reactive_mask_is_named() -> None:
    mask = np.zeros_like(flat_frame(0).depth)
    mask[3:6], mask[10] = 1.0, 0.4
    reject = look([flat_frame(0, reactive=mask), flat_frame(1, reactive=mask)])["debug.reject"]
    assert (reject[3:6] == Reason.REACTIVE).all()
    assert (np.delete(reject, [3, 4, 5], axis=0) == Reason.KEPT).all()


def test_clip_is_how_far_the_history_was_moved() -> None:
    bright = flat_frame(0, colour=np.full_like(flat_frame(0).colour, 3.0))
    grey = flat_frame(1, colour=np.full_like(bright.colour, 0.5))
    clip = look([bright, grey], override(load_preset(), {"rectify": "clamp", "box": "extremes", "box_space": "rgb"}))
    assert np.allclose(clip["debug.clip"], np.sqrt(3) * 2.5, rtol=1e-6)
    assert (look([bright, grey], override(load_preset(), {"rectify": "none"}))["debug.clip"] == 0).all()


@pytest.mark.parametrize("preset", ["default", "vireo-source", "babylon-reproject-clamp", "filament"])
def test_views_agree_with_the_fused_kernel(preset: str) -> None:
    """Where history was dropped, the fused kernel counts one sample; where it was kept, more."""
    frames = [make_frame(index, motion=True, effects=None) for index in range(3)]
    resolver = Resolver(preset, "numpy")
    for frame in frames:
        resolver.resolve(frame)
    layers = DebugViews(resolver, ALL).layers()
    kept = layers["debug.reject"] == Reason.KEPT
    assert (layers["debug.count"][~kept] == 1).all()
    assert (layers["debug.count"][kept] > 1).all()
    assert kept.any()


def test_a_strict_device_shows_what_numpy_shows_and_looking_changes_nothing() -> None:
    both = override(load_preset("fast"), {"reject": "depth"})  # to be moved into a box, and to be dropped
    plain, watched, oracle = Resolver(both, strict=True), Resolver(both, strict=True), Resolver(both, "numpy")
    views, expected = DebugViews(watched, ALL), DebugViews(oracle, ALL)
    with pytest.raises(UsageError, match="nothing was resolved yet"):
        views.layers()
    for index in range(3):
        frame = make_frame(index, motion=True, alpha=True, reactive=True, effects=None)
        image = bits(watched.resolve(frame))
        assert np.array_equal(image, bits(plain.resolve(frame)))
        assert np.array_equal(image, bits(oracle.resolve(frame)))
        shown = views.layers()
    assert list(shown) == list(expected.layers())
    for name, layer in expected.layers().items():
        assert np.array_equal(bits(shown[name]), bits(layer)), name


def test_pictures_have_the_colours_of_the_page() -> None:
    reject = np.array([[float(reason) for reason in Reason]], np.float32)
    assert view_picture(View.REJECT, {"debug.reject": reject}).tolist() == [[list(COLOURS[r]) for r in Reason]]
    still = np.zeros((1, 1), np.float32)
    assert view_picture(View.MOTION, {"debug.motion.u": still, "debug.motion.v": still}).tolist() == [[[128] * 3]]
    few = view_picture(View.COUNT, {"debug.count": np.array([[0, 15, 2e6]], np.float32)}, 15)
    assert few.tolist() == [[[0] * 3, [255] * 3, [255] * 3]]
    assert view_picture(View.COUNT, {"debug.count": np.array([[0, 2e6]], np.float32)}).tolist() == [
        [[0] * 3, [255] * 3]
    ]
    page = (Path(__file__).parents[2] / "docs" / "debug-views.md").read_text(encoding="utf-8")
    for reason, colour in COLOURS.items():
        assert f"| {reason.value} | {reason.name.lower().replace('_', ' ')} | #{bytes(colour).hex()} |" in page


def test_the_command_writes_layers_and_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence = write_sequence(tmp_path / "capture", 3)
    arguments = ["resolve", str(sequence), "--device", "numpy", "--json", "-o"]
    assert main([*arguments, str(tmp_path / "plain")]) == 0
    capsys.readouterr()
    assert main([*arguments, str(tmp_path / "watched"), "--debug", "count,reject,motion,clip"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 3
    for plain, watched in zip(open_images(tmp_path / "plain"), open_images(tmp_path / "watched"), strict=True):
        assert np.array_equal(bits(plain), bits(watched))
    layers, _ = read_image(tmp_path / "watched" / "synthetic.0002.exr")
    names = {"debug.reject", "debug.count", "debug.motion.u", "debug.motion.v", "debug.clip"}
    assert names == {name for name in layers if name.startswith("debug.")}
    assert layers["debug.count"].max() > 1
    pictures = sorted(path.name for path in (tmp_path / "watched" / "debug").iterdir())
    assert pictures == [f"{view}.{number:04d}.png" for view in sorted(View) for number in range(3)]
    with Pillow.open(tmp_path / "watched" / "debug" / "reject.0000.png") as picture:
        assert np.unique(np.asarray(picture)).tolist() == [255]  # no history
    # The folder goes on only with the same views.
    assert main([*arguments, str(tmp_path / "watched")]) == 64
    assert "was begun with --debug clip,count,motion,reject, not without --debug;" in capsys.readouterr().err


def test_views_are_parsed_from_a_list() -> None:
    assert parse_views("motion, clip,motion") == (View.MOTION, View.CLIP)
    assert parse_views("") == ()
    with pytest.raises(UsageError, match="--debug: unknown view x; known views: reject, count, motion, clip"):
        parse_views("clip,x")
    assert are_views("reject,count")
    assert are_views("rejct")
    assert are_views("x,count")
    assert are_views("count," + 5000 * "x")
    assert not are_views("folder")
    assert not are_views("")


def test_a_folder_named_much_like_a_view_is_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert are_views("clips")
    (tmp_path / "clips").mkdir()
    monkeypatch.chdir(tmp_path)
    assert not are_views("clips")
    assert are_views("clip")


def test_a_gathering_preset_shows_what_it_found() -> None:
    shift, first = 5, flat_frame(0)
    second = flat_frame(1, camera=panned(first.camera, shift, first.width))
    layers = look([first, second], "gather-48")
    found = np.full(first.depth.shape, float(Reason.KEPT))
    found[:, -shift:] = Reason.OFF_SCREEN
    np.testing.assert_array_equal(layers["debug.reject"], found)
    np.testing.assert_array_equal(layers["debug.count"], np.where(found == Reason.KEPT, 2, 1))
    assert (layers["debug.motion.u"] == shift).all()
    assert (layers["debug.clip"] == 0).all()
    # Random colours differ from frame to frame: a box holds them (seen: 0.19).
    boxed = override(load_preset("gather-48"), {"rectify": "clamp", "illumination": "static"})
    again = look([first, second], boxed)
    assert (again["debug.clip"][:, :-shift] > 0).mean() > 0.1
    assert (again["debug.clip"][:, -shift:] == 0).all()
    assert (look([first], "gather-48")["debug.reject"] == Reason.NO_HISTORY).all()


@pytest.mark.parametrize(
    ("axis", "shift", "side"),
    [(0, -5, np.s_[:, :5]), (1, 5, np.s_[:5]), (1, -5, np.s_[-5:])],
    ids=["left", "top", "bottom"],
)
def test_a_gathering_preset_tells_what_was_off_screen_on_every_other_side(axis: int, shift: int, side: Any) -> None:
    first = flat_frame(0)
    clip = first.camera.view_to_clip.copy()
    clip[axis, 2] += 2 * shift / (first.width, first.height)[axis]
    found = np.full(first.depth.shape, float(Reason.KEPT))
    found[side] = Reason.OFF_SCREEN
    layers = look([first, flat_frame(1, camera=Camera(first.camera.world_to_view, clip))], "gather-48")
    np.testing.assert_array_equal(layers["debug.reject"], found)


def test_a_gathering_preset_says_what_came_into_view() -> None:
    first = flat_frame(0)
    second = flat_frame(1)
    second.depth[:, :9] = 40.0
    reasons = look([first, second], "gather-48")["debug.reject"]
    assert (reasons[:, :8] == Reason.DEPTH).all()
    assert (reasons[:, 10:] == Reason.KEPT).all()


def test_a_restart_leaves_no_picture_of_before(tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 3)
    arguments = ["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]
    assert main([*arguments, "--debug", "count,reject"]) == 0
    (tmp_path / "out" / "debug" / "mine.png").touch()
    assert main([*arguments, "--debug", "count", "--frames", "0-1", "--restart"]) == 0
    left = sorted(path.name for path in (tmp_path / "out" / "debug").iterdir())
    assert left == ["count.0000.png", "count.0001.png", "mine.png"]
