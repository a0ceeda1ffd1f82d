"""A hold in a shot that can be split: its results continue each other, so a part that begins in it starts before it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cltaa
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.io.exr_write import write_frame
from cltaa.io.manifest import Manifest
from cltaa.io.sequence import open_sequence
from cltaa.pipeline.run import resolve_sequence
from cltaa.process import Stop
from tests.core.test_own_motion import frames as frames_with_vectors
from tests.pipeline.test_changed_inputs import forget, name
from tests.sequence_factory import digests, make_camera, make_frame, write_frames

FRAMES, MOVES = 16, (0, 1, 2, 3, 11, 12, 13)  # frames whose camera is not that of the frame before
GATHER = load_preset("gather-8")
PRESETS = {
    "behind": override(GATHER, {"history_frames": 2}),
    "ahead": override(GATHER, {"history_frames": 2, "look_ahead": 1}),
}
EFFECTS = {
    "camera": frozenset({Effect.CAMERA, Effect.DISOCCLUSION}),
    "own": frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.MOTION}),
}
OVER = pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)


def held(number: int, seed: int = 0) -> Frame:
    camera = make_camera((0.1 * sum(move <= number for move in MOVES), 0.0, 5.0))
    jitter = 0.1 * (number % 4), -0.1 * (number % 3)
    return make_frame(number, width=19, height=9, motion=True, camera=camera, jitter_px=jitter, seed=seed)


@pytest.fixture(scope="module", params=list(EFFECTS.values()), ids=list(EFFECTS))
def shot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("held")
    for number in range(FRAMES):
        write_frame(folder / name(number), replace(held(number), effects=request.param))
    return folder


@OVER
def test_any_number_of_jobs_writes_the_same_bytes(preset: cltaa.Preset, shot: Path, tmp_path: Path) -> None:
    cltaa.resolve(shot, tmp_path / "1", preset, "numpy")
    for jobs in (2, 3, 5, FRAMES):
        cltaa.resolve(shot, tmp_path / str(jobs), preset, "numpy", jobs=jobs)
        assert digests(tmp_path / str(jobs)) == digests(tmp_path / "1"), jobs


@OVER
def test_a_shot_may_begin_with_it(preset: cltaa.Preset, tmp_path: Path) -> None:
    frames = [replace(held(number + 4), index=number, effects=EFFECTS["own"]) for number in range(12)]
    write_frames(tmp_path / "in", frames)
    for jobs in (1, 4, 12):
        cltaa.resolve(tmp_path / "in", tmp_path / str(jobs), preset, "numpy", jobs=jobs)
        assert digests(tmp_path / str(jobs)) == digests(tmp_path / "1"), jobs


@OVER
def test_vectors_of_every_surface_are_dropped_alike_in_every_part(preset: cltaa.Preset, tmp_path: Path) -> None:
    """The camera of the frame before tells which: that of the first frame of a ring, too."""
    known = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.MOTION})
    write_frames(tmp_path / "in", (replace(frame, effects=known) for frame in frames_with_vectors(known)))
    for jobs in (1, 4, 12):
        cltaa.resolve(tmp_path / "in", tmp_path / str(jobs), preset, "numpy", jobs=jobs)
        assert digests(tmp_path / str(jobs)) == digests(tmp_path / "1"), jobs


@OVER
def test_one_frame_of_it_is_made_again_to_the_same_bytes(preset: cltaa.Preset, shot: Path, tmp_path: Path) -> None:
    cltaa.resolve(shot, tmp_path / "out", preset, "numpy")
    expected = digests(tmp_path / "out")
    for number in range(FRAMES):
        forget(tmp_path / "out", {number})
        assert cltaa.resolve(shot, tmp_path / "out", preset, "numpy").resolved == 1, number
        assert digests(tmp_path / "out") == expected, number


@pytest.mark.parametrize(
    ("preset", "changed", "remade"),
    [
        ("behind", 5, {*range(5, 11)}),  # what 11 and 12 are made from begins with 8
        ("behind", 2, {2, *range(3, 11)}),
        ("behind", 9, {9, 10, 11, 12}),
        ("behind", 11, {11, 12, 13, 14, 15}),
        ("ahead", 5, {*range(4, 11)}),
    ],
)
def test_all_that_continues_a_changed_frame_is_made_again(
    preset: str, changed: int, remade: set[int], shot: Path, tmp_path: Path
) -> None:
    frames, out = tmp_path / "in", tmp_path / "out"
    frames.mkdir()
    for path in shot.glob("*.exr"):
        (frames / path.name).write_bytes(path.read_bytes())
    cltaa.resolve(frames, out, PRESETS[preset], "numpy")
    before = Manifest(out).entries
    forget(out, {changed})
    write_frame(frames / name(changed), replace(held(changed, 99), effects=open_sequence(shot).effects))
    cltaa.resolve(frames, out, PRESETS[preset], "numpy")
    now = Manifest(out).entries
    assert {number for number in range(FRAMES) if before[name(number)] != now[name(number)]} == remade
    cltaa.resolve(frames, tmp_path / "whole", PRESETS[preset], "numpy")
    assert digests(out) == digests(tmp_path / "whole")


class Stopping(Resolver):
    """Asks ``stop`` to end the run at a frame."""

    stop, at = Stop(), 0

    def images(self, frames: Iterable[Frame], **how: Any) -> Iterator[Any]:
        def watched() -> Iterator[Frame]:
            for frame in frames:
                self.stop.requested = frame.index == self.at
                yield frame

        return super().images(watched(), **how)


@OVER
def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(preset: cltaa.Preset, shot: Path, tmp_path: Path) -> None:
    cltaa.resolve(shot, tmp_path / "whole", preset, "numpy")
    for at in (5, 7, 10, 11):
        resolver, out = Stopping(preset, "numpy"), tmp_path / str(at)
        resolver.stop, resolver.at = Stop(), at
        with pytest.raises(KeyboardInterrupt):
            resolve_sequence(open_sequence(shot), out, resolver, stopping=nullcontext(resolver.stop))
        report = cltaa.resolve(shot, out, preset, "numpy")
        assert 0 < report.resolved < FRAMES
        assert digests(out) == digests(tmp_path / "whole"), at


def test_a_run_goes_on_behind_an_earlier_state(shot: Path, tmp_path: Path) -> None:
    """Frames between that and the first missing one are resolved again, since each result continues the one before."""
    preset, out = PRESETS["behind"], tmp_path / "out"
    resolver = Stopping(preset, "numpy")
    resolver.stop, resolver.at = Stop(), 6
    with pytest.raises(KeyboardInterrupt):
        resolve_sequence(open_sequence(shot), out, resolver, stopping=nullcontext(resolver.stop))
    state = {path: path.read_bytes() for path in out.glob(".*") if path.is_file()}
    cltaa.resolve(shot, out, preset, "numpy")
    expected, manifest = digests(out), {Manifest(out).path: Manifest(out).path.read_bytes()}
    for path, content in (state | manifest).items():
        path.write_bytes(content)
    forget(out, {9})
    assert cltaa.resolve(shot, out, preset, "numpy").resolved == 1
    assert digests(out) == expected
