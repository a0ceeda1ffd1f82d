"""Effects that nobody declares: found in frames of a formula, a textured wall that a camera looks at."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import cltaa
from cltaa.errors import DataError, OutputError, UsageError
from cltaa.frame import Effect, Frame
from cltaa.inputs.found import BLOCK, LEAST_SPAN, PLACES, SPAN, TILE, Found, find_effects
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.manifest import Manifest
from cltaa.io.numbered import OnBreak
from cltaa.io.sequence import FrameSequence, open_sequence
from cltaa.lab.inspect.plan import plan
from cltaa.pipeline.folder import resolve_folder
from cltaa_capture.jitter import jitter_sequence
from tests.sequence_factory import make_camera, write_frames

WIDTH, HEIGHT, FRAMES, DISTANCE = 144, 96, 3 * SPAN, 4.0
JITTER = jitter_sequence("halton:8")
Array = NDArray[np.float64]
Change = Callable[[Frame, Array, int], Frame]  # of a frame, its pixels' places on the wall, its number


def wall(index: int, *, pan: float = 0.0) -> tuple[Frame, Array]:
    """Frame ``index`` of a wall under a camera that has moved by ``pan`` a frame, and where it was sampled, [H, W]."""
    jitter, camera = JITTER[index % len(JITTER)], make_camera((pan * index, 0.0, DISTANCE), WIDTH / HEIGHT)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    across = DISTANCE * ((x + jitter[0]) / WIDTH * 2 - 1) / camera.view_to_clip[0, 0] + pan * index
    up = DISTANCE * (1 - (y + jitter[1]) / HEIGHT * 2) / camera.view_to_clip[1, 1]
    shade = 0.4 + 0.15 * np.sin(31 * across) * np.sin(23 * up) + 0.1 * np.sign(np.sin(9 * across + 5 * up))
    colour = np.repeat(shade[..., None], 3, -1).astype(np.float32)
    depth = np.full((HEIGHT, WIDTH), DISTANCE, np.float32)
    return Frame(index, colour, depth, camera, (float(jitter[0]), float(jitter[1]))), across


def drawn(
    folder: Path, change: Change | None = None, *, frames: int = FRAMES, pan: float = 0.0, **opening: Any
) -> FrameSequence:
    made = (wall(index, pan=pan) for index in range(frames))
    changed = (frame if change is None else change(frame, across, frame.index) for frame, across in made)
    return open_sequence(write_frames(folder, changed, "wall"), **opening)


def lit(frame: Frame, light: Array | float) -> Frame:
    return replace(frame, colour=(frame.colour * np.asarray(light)[..., None]).astype(np.float32))


def a_shadow(frame: Frame, across: Array, index: int) -> Frame:
    return lit(frame, np.where(across < -2.4 + 0.1 * index, 0.5, 1.0))


def a_wire(frame: Frame, across: Array, _index: int) -> Frame:
    wires = np.abs(across - np.round(across)) < 0.008  # a third of a pixel
    return replace(
        lit(frame, np.where(wires, 0.3, 1.0)), depth=np.where(wires, DISTANCE / 2, DISTANCE).astype(np.float32)
    )


def a_lattice(frame: Frame, across: Array, index: int) -> Frame:
    """Bars of several pixels half as far away, past which the camera slides."""
    at = (across + 0.06 * index) / 2
    bars = np.abs(at - np.round(at / 0.7) * 0.7) < 0.05
    return replace(
        lit(frame, np.where(bars, 0.3, 1.0)), depth=np.where(bars, DISTANCE / 2, DISTANCE).astype(np.float32)
    )


def moving(speed: float, late: int = 0) -> Change:
    def change(frame: Frame, _across: Array, index: int) -> Frame:
        motion = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        motion[:8, :8, 0] = speed if index >= late else 0.0
        return replace(frame, motion=motion)

    return change


def noisy(frame: Frame, _across: Array, index: int) -> Frame:
    """As a path tracer's few samples are."""
    return lit(frame, np.random.default_rng(index).gamma(2.0, 0.5, (HEIGHT, WIDTH)))


def a_belt(frame: Frame, across: Array, index: int) -> Frame:
    return replace(noisy(frame, across, index), motion=np.ones((HEIGHT, WIDTH, 2), np.float32))


def a_lid(frame: Frame, _across: Array, index: int) -> Frame:
    """For a frame it covers half of the wall, but for what a lamp lights of each tile."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    bare = np.maximum(y % TILE, x % TILE) < TILE // 3
    there = (index == SPAN - 1) & (x < WIDTH // 2)
    depth = np.where(there & ~bare, DISTANCE / 2, DISTANCE).astype(np.float32)
    return replace(lit(frame, np.where(there, 3.0, 1.0)), depth=depth)


def lost(rows: slice, columns: slice, *, scene: Change | None = None) -> Change:
    """Colour and depth of these pixels are missing in one frame."""

    def change(frame: Frame, across: Array, index: int) -> Frame:
        frame = frame if scene is None else scene(frame, across, index)
        if index == 1:
            frame.colour[rows, columns], frame.depth[rows, columns] = np.nan, np.nan
        return frame

    return change


def a_reflection(frame: Frame, across: Array, index: int) -> Frame:
    """Stripes that move over the wall by a pixel in three frames, and change the mean of no block."""
    return lit(frame, 1 + 0.5 * np.sin(12.0 * across - 0.2 * index))


def stars(frame: Frame, across: Array, index: int) -> Frame:
    return replace(a_reflection(frame, across, index), depth=np.full_like(frame.depth, np.inf))


def a_body(frame: Frame, _across: Array, index: int) -> Frame:
    """It covers a tile, of another grey in the second span than in the first, since it moves."""
    motion = np.full((HEIGHT, WIDTH, 2), np.nan, np.float32)
    motion[:TILE, :TILE] = 0.5, 0.0
    light = np.ones((HEIGHT, WIDTH))
    light[:TILE, :TILE] = 1.6 if index >= SPAN else 0.6
    return replace(lit(frame, light), motion=motion)


def a_shadow_alone(frame: Frame, across: Array, index: int) -> Frame:
    """As for a composite: black, and transparent elsewhere."""
    alpha = np.where(across < -2.4 + 0.1 * index, 0.5, 0.0).astype(np.float32)
    return replace(lit(frame, 0.0), alpha=alpha)


STANDING = {Effect.DISOCCLUSION}  # which nothing disproves
CASES: dict[str, tuple[Change | None, float, set[Effect]]] = {
    "standing light": (None, 0.0, STANDING),
    "standing light, a camera that slides": (None, 0.03, STANDING | {Effect.CAMERA}),
    "light that dims by 1 % in 16 frames": (lambda f, _, i: lit(f, 1 - 0.01 * i / 16), 0.0, STANDING),
    "light that dims by 20 % in 16 frames": (
        lambda f, _, i: lit(f, 1 - 0.2 * i / 16),
        0.0,
        STANDING | {Effect.ILLUMINATION},
    ),
    "a shadow": (a_shadow, 0.0, STANDING | {Effect.ILLUMINATION}),
    "a shadow, a camera that slides": (a_shadow, 0.03, STANDING | {Effect.ILLUMINATION, Effect.CAMERA}),
    "a shadow on a transparent ground": (a_shadow_alone, 0.0, STANDING | {Effect.ILLUMINATION, Effect.ALPHA}),
    "a reflection": (a_reflection, 0.0, STANDING | {Effect.ILLUMINATION}),
    "a reflection, a camera that slides": (a_reflection, 0.03, STANDING | {Effect.ILLUMINATION, Effect.CAMERA}),
    "stars that move over the sky": (stars, 0.0, STANDING | {Effect.SKY, Effect.THIN}),
    "a body that moves": (a_body, 0.0, STANDING | {Effect.MOTION}),
    "vectors that are zero": (moving(0.0), 0.0, STANDING),
    "vectors": (moving(1.0), 0.0, STANDING | {Effect.MOTION}),
    "vectors of the last frames": (moving(1.0, FRAMES - 3), 0.0, STANDING | {Effect.MOTION}),
    "a lamp that is on in every second frame": (
        lambda f, _, i: lit(f, 1 + 2.0 * (i % 2)),
        0.0,
        STANDING | {Effect.ILLUMINATION},
    ),
    "a lamp that is on for eight frames": (
        lambda f, _, i: lit(f, 1 + (i // 8 == 1)),
        0.0,
        STANDING | {Effect.ILLUMINATION},
    ),
    "noise": (noisy, 0.0, STANDING | {Effect.NOISE}),
    "noise, a camera that slides": (noisy, 0.03, STANDING | {Effect.CAMERA, Effect.NOISE}),
    "noise, on a belt that carries all of the wall": (a_belt, 0.0, STANDING | {Effect.MOTION}),
    "a tile without samples": (lost(slice(20, 60), slice(30, 70)), 0.0, STANDING),
    "a frame without samples": (lost(slice(None), slice(None)), 0.0, STANDING),
    "noise, a frame without samples": (
        lost(slice(None), slice(None), scene=noisy),
        0.0,
        STANDING | {Effect.NOISE},
    ),
    "wires": (a_wire, 0.0, STANDING | {Effect.THIN}),
    "a lattice, a camera that slides": (a_lattice, 0.06, STANDING | {Effect.CAMERA, Effect.THIN}),
    "a lamp that lights the little that is seen for a frame": (a_lid, 0.0, STANDING),
    "highlights": (lambda f, _, _i: lit(f, 40.0), 0.0, STANDING | {Effect.HDR}),
    "sky": (
        lambda f, _, _i: replace(f, depth=f.depth + np.float32(np.inf)),
        0.0,
        STANDING | {Effect.SKY, Effect.THIN},
    ),
    "exposure": (
        lambda f, _, i: replace(lit(f, 2.0 ** (i % 2)), exposure=2.0 ** (i % 2)),
        0.0,
        STANDING | {Effect.EXPOSURE},
    ),
    "alpha": (lambda f, _, _i: replace(f, alpha=np.ones_like(f.depth)), 0.0, STANDING | {Effect.ALPHA}),
    "a mask": (lambda f, _, _i: replace(f, reactive=np.zeros_like(f.depth)), 0.0, STANDING | {Effect.REACTIVE}),
}


@pytest.mark.parametrize("case", CASES)
def test_what_shows_is_found_and_nothing_else(tmp_path: Path, case: str) -> None:
    change, pan, expected = CASES[case]
    assert find_effects(drawn(tmp_path / "wall", change, pan=pan)).effects == expected


@pytest.mark.parametrize("axis", [0, 1])
def test_jitter_over_even_slopes_is_no_noise(tmp_path: Path, axis: int) -> None:
    """Light is looked up between the samples, which over a slope is exact; a block holds as much of rise as of fall."""

    def zigzag(frame: Frame, _across: Array, _index: int) -> Frame:
        place = np.mgrid[:HEIGHT, :WIDTH][axis] + frame.jitter_px[1 - axis]
        return lit(replace(frame, colour=np.ones_like(frame.colour)), 0.2 + 0.05 * np.abs(place % BLOCK - BLOCK / 2))

    (noise,) = [each for each in find_effects(drawn(tmp_path / "wall", zigzag)).evidence if each.effect is Effect.NOISE]
    assert noise.why == "light scatters in time by 0.00 of the steps of texture"


UNKNOWN = {Effect.THIN, Effect.ILLUMINATION}


def test_vectors_of_the_camera_alone_are_no_motion(tmp_path: Path) -> None:
    def of_camera(frame: Frame, _across: Array, index: int) -> Frame:
        pixels = 0.03 * frame.camera.view_to_clip[0, 0] / DISTANCE * WIDTH / 2 if index else 0.0
        return replace(frame, motion=np.broadcast_to(np.array([pixels, 0.0], np.float32), (HEIGHT, WIDTH, 2)).copy())

    found = find_effects(drawn(tmp_path / "wall", of_camera, pan=0.03))
    assert found.effects == STANDING | {Effect.CAMERA}


def test_few_frames_tell_nothing_of_light(tmp_path: Path) -> None:
    few = 3 * LEAST_SPAN
    assert find_effects(drawn(tmp_path / "few", frames=few)).effects == STANDING
    assert find_effects(drawn(tmp_path / "fewer", frames=few - 1)).effects == STANDING | {Effect.ILLUMINATION}
    assert find_effects(drawn(tmp_path / "one", frames=1)).effects == STANDING | UNKNOWN


def shots(*lengths: int, light: float = 1.0) -> tuple[int, Change]:
    """Frames in shots of these lengths, each of another light, which changes by a factor in the middle of each."""
    begins = [0, *np.cumsum(lengths)]

    def change(frame: Frame, _across: Array, index: int) -> Frame:
        shot = int(np.searchsorted(begins, index, "right")) - 1
        late = index >= begins[shot] + lengths[shot] // 2
        return replace(lit(frame, (1.0 + shot / 2) * (light if late else 1.0)), cut=index in begins)

    return int(begins[-1]), change


@pytest.mark.parametrize(
    ("lengths", "light", "expected"),
    [
        ((5, 3 * LEAST_SPAN, 7), 1.0, STANDING),
        ((3 * LEAST_SPAN,) * 6, 1.0, STANDING),
        ((4, 3 * LEAST_SPAN), 1.5, STANDING | {Effect.ILLUMINATION}),
        ((3 * LEAST_SPAN,) * 6, 1.5, STANDING | {Effect.ILLUMINATION}),
        ((3 * LEAST_SPAN - 1,) * 6, 1.0, STANDING | {Effect.ILLUMINATION}),  # too short to tell
    ],
)
def test_light_is_compared_within_shots(
    tmp_path: Path, lengths: tuple[int, ...], light: float, expected: frozenset[Effect]
) -> None:
    frames, change = shots(*lengths, light=light)
    assert find_effects(drawn(tmp_path / "wall", change, frames=frames)).effects == expected | {Effect.CUT}


def test_frames_of_which_none_can_be_read_tell_nothing(tmp_path: Path) -> None:
    sequence = drawn(tmp_path / "wall")
    for path in sequence.paths:
        path.write_bytes(path.read_bytes()[:-200] + bytes(200))
    found = find_effects(sequence)
    assert found.effects == STANDING | UNKNOWN | {Effect.HDR, Effect.SKY}
    assert "no frame can be read" in found.line


def test_a_frame_that_cannot_be_read_tells_nothing(tmp_path: Path) -> None:
    sequence = drawn(tmp_path / "wall")
    for lost, tells in ((SPAN - LEAST_SPAN, True), (SPAN - LEAST_SPAN + 1, False)):  # of the first span
        for path in sequence.paths[:lost]:
            path.write_bytes(path.read_bytes()[:-200] + bytes(200))
        found = find_effects(sequence)
        assert found.effects == STANDING | (frozenset() if tells else {Effect.ILLUMINATION})
        assert found.frames == FRAMES - lost


def test_a_long_sequence_is_looked_at_in_a_bounded_number_of_frames(tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    found = find_effects(
        drawn(tmp_path / "wall", frames=3 * FRAMES + 7), lambda done, total: steps.append((done, total))
    )
    assert found.frames == 2 * SPAN * PLACES
    assert steps[-1] == (found.frames, found.frames)


@pytest.mark.parametrize("degrees", [30.0, 120.0])  # into the same view, and beyond what lies behind it
def test_a_camera_that_leaps_may_be_a_cut_so_that_light_is_tested(tmp_path: Path, degrees: float) -> None:
    def turned(frame: Frame, _across: Array, index: int) -> Frame:
        view = frame.camera.world_to_view.copy()
        angle = np.radians(degrees * (index >= 12))
        view[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        return replace(frame, camera=replace(frame.camera, world_to_view=view))

    found = find_effects(drawn(tmp_path / "wall", turned))
    assert found.effects >= STANDING | {Effect.CUT, Effect.ILLUMINATION, Effect.CAMERA}


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 3), (23, 400), (24, 24)])
def test_small_pictures_keep_what_they_cannot_tell(tmp_path: Path, height: int, width: int) -> None:
    def cropped(frame: Frame, _across: Array, _index: int) -> Frame:
        return replace(
            frame,
            colour=frame.colour[:1, :1] * np.ones((height, width, 1), np.float32),
            depth=np.full((height, width), DISTANCE, np.float32),
        )

    found = find_effects(drawn(tmp_path / "wall", cropped)).effects
    assert found >= STANDING | {Effect.ILLUMINATION}
    assert (Effect.THIN in found) == (height < 24)


def test_small_pictures_tell_nothing_of_noise(tmp_path: Path) -> None:
    # Texture that is finer than a pixel scatters as noise does.
    def smaller(frame: Frame, across: Array, index: int) -> Frame:
        told = noisy(frame, across, index)
        return replace(told, colour=told.colour[:80], depth=told.depth[:80])

    assert Effect.NOISE in find_effects(drawn(tmp_path / "large", noisy)).effects
    assert Effect.NOISE not in find_effects(drawn(tmp_path / "small", smaller)).effects


@pytest.mark.parametrize(("frames", "told"), [(4, False), (5, True)])  # whose second span has 3, and 4
def test_four_frames_of_a_place_tell_of_noise(tmp_path: Path, frames: int, told: bool) -> None:
    assert (Effect.NOISE in find_effects(drawn(tmp_path / "wall", noisy, frames=frames)).effects) == told


def test_every_frame_tells_of_highlights_even_of_small_pictures(tmp_path: Path) -> None:
    def late(frame: Frame, _across: Array, index: int) -> Frame:
        return replace(frame, colour=frame.colour[:9] * (1 + 99 * (index == 7)), depth=frame.depth[:9])

    assert Effect.HDR in find_effects(drawn(tmp_path / "wall", late)).effects


@pytest.mark.parametrize("pan", [0.6, 6.0])  # little is seen in both spans, and nothing
def test_a_fast_camera_that_sees_little_twice_tells_nothing_of_light(tmp_path: Path, pan: float) -> None:
    found = find_effects(drawn(tmp_path / "wall", pan=pan))
    assert Effect.ILLUMINATION in found.effects
    assert "too little is seen" in next(each.why for each in found.evidence if each.effect is Effect.ILLUMINATION)


def test_bad_numbers_and_another_size_tell_nothing(tmp_path: Path) -> None:
    def bad(frame: Frame, _across: Array, index: int) -> Frame:
        colour, depth = frame.colour.copy(), frame.depth.copy()
        colour[0, :4, 0], depth[0, :2] = (np.nan, np.inf, -1.0, 3e38), np.nan  # missing samples, all of them
        frame = replace(frame, colour=colour, depth=depth)
        return frame if index < SPAN + LEAST_SPAN - 1 else replace(frame, colour=colour[:48], depth=depth[:48])

    drawn_so = drawn(tmp_path / "wall", bad, on_resize=OnBreak.RESET)
    assert find_effects(drawn_so).effects == STANDING | {Effect.ILLUMINATION}


def test_files_without_depth_keep_what_only_depth_tells(tmp_path: Path) -> None:
    def flat(frame: Frame, _across: Array, _index: int) -> Frame:
        return replace(frame, depth=np.full_like(frame.depth, np.inf))

    assert find_effects(drawn(tmp_path / "wall", flat, pan=0.03)).effects >= STANDING | UNKNOWN | {Effect.CAMERA}


def test_files_without_matrices_keep_every_step_of_a_camera(tmp_path: Path) -> None:
    for index in range(FRAMES):
        frame, _ = wall(index)
        planes = dict(zip("RGBZ", (*np.moveaxis(frame.colour, -1, 0), frame.depth), strict=True))
        write_image(tmp_path / f"wall.{index:04d}.exr", planes, {})
    assert find_effects(cltaa.open(tmp_path)).effects == STANDING | UNKNOWN | {Effect.CAMERA}


def found_in(folder: Path, out: Path | None = None) -> Found:
    report = resolve_folder(folder, out or folder.parent / "out", device="numpy", band_rows=0)
    assert report.found is not None
    return report.found


def test_a_resolve_finds_effects_and_goes_on_with_those_that_it_began_with(tmp_path: Path) -> None:
    sequence = drawn(tmp_path / "wall", frames=3)
    before = found_in(sequence.folder)
    assert before.effects == STANDING | {Effect.ILLUMINATION}
    frame, _ = wall(3)
    write_frame(sequence.folder / "wall.0003.exr", lit(frame, 40.0))  # of which the begun resolve knew nothing
    after = found_in(sequence.folder)
    assert after == before  # with the evidence of then


def test_headers_that_show_more_than_a_run_was_begun_with_end_it(tmp_path: Path) -> None:
    sequence = drawn(tmp_path / "wall", frames=3)
    found_in(sequence.folder)
    frame, _ = wall(3)
    write_frame(sequence.folder / "wall.0003.exr", replace(frame, exposure=2.0))
    with pytest.raises(UsageError, match=r"not begun with \(expected (?!exposure).*, found exposure"):
        found_in(sequence.folder)


def test_whoever_cannot_write_hears_so_before_effects_are_sought(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = drawn(tmp_path / "wall", frames=3)
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("cltaa.pipeline.folder.find_effects", lambda *_: pytest.fail("frames were looked at"))
    with pytest.raises(OutputError, match="file"):
        found_in(sequence.folder, tmp_path / "file")


def test_a_folder_in_which_nothing_was_finished_tells_nothing(tmp_path: Path) -> None:
    sequence, out = drawn(tmp_path / "wall", a_shadow), tmp_path / "out"
    record = sequence.folder / "sequence.json"
    record.write_text(json.dumps({"files": {sequence.path(0).name: 64 * "0"}}))
    with pytest.raises(DataError):
        found_in(sequence.folder)
    assert Manifest(out).settings is not None
    record.unlink()
    assert found_in(drawn(tmp_path / "other" / "wall").folder, out).effects == STANDING


def test_a_followed_sequence_resumes_as_a_plain_resolve_and_back(tmp_path: Path) -> None:
    folder, out = drawn(tmp_path / "wall").folder, tmp_path / "out"
    resolve_folder(folder, out, device="numpy", band_rows=0, follow=True, reading={"frames": (0, 4)})
    assert resolve_folder(folder, out, device="numpy", band_rows=0).found is None
    plain = tmp_path / "plain"
    resolve_folder(folder, plain, device="numpy", band_rows=0, reading={"frames": (0, 20)})
    report = resolve_folder(
        folder, plain, device="numpy", band_rows=0, follow=True, reading={"frames": (0, FRAMES - 1)}
    )
    assert report.found is not None
    assert report.frames == FRAMES


def test_a_sequence_stays_as_it_was_opened(tmp_path: Path) -> None:
    sequence = drawn(tmp_path / "wall")
    resolve_folder(sequence, tmp_path / "out", device="numpy", band_rows=0)
    plan(sequence, device="numpy", rounds=0)
    assert sequence.found is None


@pytest.mark.parametrize(("preset", "gathered"), [("gather-8", False), ("gather-48", False), ("gather-24+24", True)])
def test_where_all_stands_a_running_mean_replaces_a_ring_without_many_frames_ahead(
    tmp_path: Path, preset: str, gathered: bool
) -> None:
    for name, pan, expected in (("standing", 0.0, gathered), ("sliding", 0.03, True)):
        sections = plan(drawn(tmp_path / name, pan=pan), preset, "numpy", rounds=0).sections
        assert {step.name: step.on for step in sections[-1].steps}["gathering"] == expected


def test_what_is_found_is_no_promise(tmp_path: Path) -> None:
    """No plain mean rests on it: depth and light still refute what changes after all."""
    sections = plan(drawn(tmp_path / "wall"), device="numpy", rounds=0).sections
    steps = {step.name: step for step in sections[-1].steps}
    assert steps["rejection"].on
    assert steps["illumination change"].on
    why = "none of illumination, motion and reactive is found, nor thin with a camera: only a change that lasts counts"
    assert steps["illumination change"].why == why
