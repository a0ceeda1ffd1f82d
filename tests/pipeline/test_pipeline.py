"""A sequence through the resolver: when its state is saved, what is let go, and what its times hold."""

from __future__ import annotations

import gc
import time
import weakref
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.core.build import Storage
from cltaa.core.planes import Block
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, DeviceLost, UsageError
from cltaa.frame import Effect, Frame
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.sequence import FrameSequence, open_sequence
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.run import resolve_sequence, stage_rows
from tests.sequence_factory import make_frame, write_frames, write_sequence

FRAMES = 7


@pytest.mark.parametrize("every", [1, 2, 3, 8])
def test_the_state_is_saved_after_every_so_many_frames(
    every: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved: list[int] = []
    monkeypatch.setattr(
        Checkpoints, "save", lambda _, resolver, *_made_from: saved.append(resolver.recurrent()[0].index)
    )
    sequence = open_sequence(write_sequence(tmp_path / "in", FRAMES, width=9, height=7))
    resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy"), checkpoint_every=every)
    assert saved == [*range(every - 1, FRAMES, every)]


def test_frames_after_the_last_missing_one_are_not_resolved(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "in", FRAMES, width=9, height=7))
    resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy"))
    (tmp_path / "out" / "synthetic.0002.exr").unlink()
    resolver = Resolver(device="numpy")
    assert resolve_sequence(sequence, tmp_path / "out", resolver).resolved == 1
    assert resolver.recurrent()[0].index == 2


class Watched(Resolver):
    """Remembers what it was asked to reserve, whether with alpha, and ends where it is told to."""

    def __init__(self, failing: BaseException | None = None) -> None:
        super().__init__(device="numpy")
        self.reserved: list[bool] = []
        self.failing = failing

    def reserve(self, width: int, height: int, *, alpha: bool, half: bool = False) -> None:
        self.reserved.append(alpha)
        super().reserve(width, height, alpha=alpha, half=half)

    def resolve(self, frame: Frame, **options: Any) -> Any:
        failing, self.failing = self.failing, None if frame.index == 4 else self.failing
        if failing is not None and frame.index == 4:
            raise failing
        return super().resolve(frame, **options)


@pytest.mark.parametrize("effects", ["auto", "all", frozenset({Effect.ALPHA}), frozenset({Effect.CAMERA})])
def test_memory_is_reserved_for_what_is_resolved(effects: Any, tmp_path: Path) -> None:
    write_frames(tmp_path, (make_frame(number, width=9, height=7, alpha=True) for number in range(2)))
    resolver = Watched()
    resolve_sequence(open_sequence(tmp_path), tmp_path / "out", resolver, effects=effects)
    assert resolver.reserved == [effects != frozenset({Effect.CAMERA})]


def test_a_run_that_goes_on_reserves_nothing(tmp_path: Path) -> None:
    """What it needs was allocated to be filled with the state; new memory would have none."""
    sequence = open_sequence(write_sequence(tmp_path / "in", FRAMES, width=9, height=7))
    with pytest.raises(KeyboardInterrupt):
        resolve_sequence(sequence, tmp_path / "out", Watched(KeyboardInterrupt()), checkpoint_every=2)
    resolver = Watched()
    assert resolve_sequence(sequence, tmp_path / "out", resolver).resolved == FRAMES - 4
    assert resolver.reserved == []


def test_a_device_that_is_lost_is_opened_once_more(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "in", FRAMES, width=9, height=7))
    resolver = Watched(DeviceLost("gone"))
    before = resolver.launcher
    assert resolve_sequence(sequence, tmp_path / "out", resolver).resolved == FRAMES
    assert resolver.launcher is not before


def test_the_film_shows_the_frames_of_this_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the folder holds more."""
    shown: list[tuple[int, ...]] = []
    monkeypatch.setattr("cltaa.pipeline.run.write_video", lambda _, images, **__: shown.append(images.numbers))
    sequence = open_sequence(write_sequence(tmp_path / "in", FRAMES, width=16, height=16))
    for part in (sequence, sequence.select(0, 2)):
        resolve_sequence(part, tmp_path / "out", Resolver(device="numpy"), preview=tmp_path / "film.mp4")
    assert shown == [sequence.numbers, (0, 1, 2)]


def test_other_layers_are_another_result(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "in", 2, width=9, height=7))
    resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy"), layers=("Z",))
    with pytest.raises(UsageError, match="was begun with --layers Z, not without --layers;"):
        resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy"))


@pytest.mark.parametrize(
    ("storage", "half", "saturated"), [(Storage.FLOAT, False, 0), (Storage.HALF, False, 1), (Storage.FLOAT, True, 1)]
)
def test_pixels_that_were_repaired_or_fit_no_half_are_counted(
    storage: Storage, half: bool, saturated: int, tmp_path: Path
) -> None:
    frame = make_frame(0, width=9, height=7)
    frame.colour[2, 3], frame.colour[4, 6] = np.nan, 1e5
    write_frame(tmp_path / "a.0000.exr", frame)
    unfiltered = override(load_preset(), {"current_filter": "none"})
    resolver = Resolver(unfiltered, device="numpy", storage=storage)
    outcome = resolve_sequence(open_sequence(tmp_path), tmp_path / "out", resolver, half=half)
    assert (outcome.repaired, outcome.saturated) == (1, saturated)


def test_times_hold_the_last_image_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def slowly(*given: Any, **named: Any) -> None:
        time.sleep(0.05)
        write_image(*given, **named)

    monkeypatch.setattr("cltaa.io.streams.write_image", slowly)
    sequence = open_sequence(write_sequence(tmp_path / "in", 1, width=9, height=7))
    seconds = resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy")).seconds
    assert 0.05 <= seconds.write <= seconds.whole


def test_times_are_those_of_each_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = count()  # a second between each look and the next
    monkeypatch.setattr("cltaa.core.resolver.perf_counter", lambda: next(clock))
    sequence = open_sequence(write_sequence(tmp_path / "in", 2, width=9, height=7))
    began = time.perf_counter()
    seconds = resolve_sequence(sequence, tmp_path / "out", Resolver(device="numpy")).seconds
    assert 2 * seconds.whole <= time.perf_counter() - began
    told = dict(stage_rows(seconds))
    assert [told[name] for name in ("upload", "kernels", "read back")] == [1e3] * 3


def test_each_frame_is_let_go_once_it_is_resolved(tmp_path: Path) -> None:
    """Its memory is what a later one is decoded into; a device that shares it holds it until it is told."""
    sequence = open_sequence(write_sequence(tmp_path / "in", 3, width=45, height=27))
    held: list[bool] = []

    class Holding(Resolver):
        def resolve(self, frame: Any, **options: Any) -> Any:
            self.block = weakref.ref(block_of(frame.colour))
            return super().resolve(frame, **options)

        def release(self) -> None:
            held.append(self.block() is not None)
            super().release()

    resolver = Holding("accumulate", "pthread")
    resolver.resolve(sequence.frame(0))
    gc.collect()
    assert resolver.block() is not None
    resolver.release()
    gc.collect()
    assert resolver.block() is None
    resolve_sequence(sequence, tmp_path / "out", resolver)
    assert held == [True] * 4


def block_of(array: Any) -> Block:
    """The memory that an array lies in."""
    while isinstance(array, np.ndarray):
        array = array.base
    assert isinstance(array, Block)
    return array


@pytest.mark.parametrize("in_place", [True, False])
def test_a_file_rewritten_while_it_is_read_gives_no_recorded_result(
    in_place: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the hash of the new file would stand beside what was made from the old one, for every later run."""
    folder, whole = write_sequence(tmp_path / "in", 3), FrameSequence.frame_and_file
    anew = folder / "synthetic.0001.exr"
    (folder / "sequence.json").unlink(missing_ok=True)  # whose hashes would tell

    def then_drawn(self: FrameSequence, number: int, kept: Any) -> Any:
        read = whole(self, number, kept)
        if number == 1:
            write_frame(tmp_path / "other.exr", make_frame(1, seed=5))
            content = (tmp_path / "other.exr").read_bytes()
            anew.write_bytes(content) if in_place else (tmp_path / "other.exr").replace(anew)
        return read

    with monkeypatch.context() as patch:
        patch.setattr(FrameSequence, "frame_and_file", then_drawn)
        with pytest.raises(DataError, match=r"synthetic.0001.exr frame 1: a file changed while it was read; run again"):
            resolve_sequence(open_sequence(folder), tmp_path / "out", Resolver(device="numpy"), progress=False)
    resolve_sequence(open_sequence(folder), tmp_path / "out", Resolver(device="numpy"), progress=False)
    resolve_sequence(open_sequence(folder), tmp_path / "whole", Resolver(device="numpy"), progress=False)
    name = anew.name
    assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
