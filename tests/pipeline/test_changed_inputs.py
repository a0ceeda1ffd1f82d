"""A frame without a result may be rendered anew between two runs: no result of the earlier content stays."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

import pytest

from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.io.exr_write import write_frame
from cltaa.io.manifest import Entry, Manifest
from cltaa.pipeline.checkpoint import SLOTS, Checkpoints
from cltaa.pipeline.folder import resolve_folder
from cltaa.pipeline.output import Written
from tests.sequence_factory import digests, make_frame, write_sequence

FRAMES = 10
NUMPY: dict[str, Any] = {"device": "numpy", "compression": "none"}
GATHER = load_preset("gather-8")
PRESETS = {
    "recurrent": load_preset("default"),
    "behind": override(GATHER, {"history_frames": 2, "recursion": "none"}),
    "ahead": override(GATHER, {"history_frames": 2, "look_ahead": 1, "recursion": "none"}),
}


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "in", FRAMES, width=9, height=7)


def name(number: int) -> str:
    return f"synthetic.{number:04d}.exr"


def recorded_again(folder: Path, entries: dict[str, Entry]) -> None:
    manifest = Manifest(folder)
    assert manifest.settings is not None
    manifest.begin(manifest.settings)
    for each, entry in entries.items():
        manifest.append(each, entry)


def forget(folder: Path, numbers: Collection[int]) -> None:
    """Leave the folder as a kill does before the results of these frames are recorded."""
    recorded_again(folder, {n: e for n, e in Manifest(folder).entries.items() if n not in map(name, numbers)})


@pytest.mark.parametrize(
    ("preset", "remade"),
    [("recurrent", {*range(4, FRAMES)}), ("behind", {4, 5, 6, 7, 8}), ("ahead", {3, 4, 5, 6, 7, 8})],
)
def test_results_of_an_earlier_content_are_made_again(
    preset: str, remade: set[int], shot: Path, tmp_path: Path
) -> None:
    """Exactly those that may depend on the frame: with its old content no finished frame is made again."""
    used: Preset = PRESETS[preset]
    options: dict[str, Any] = {**NUMPY, "effects": "all"}
    resolve_folder(shot, tmp_path / "out", used, **options)
    forget(tmp_path / "out", {4, 5})
    assert resolve_folder(shot, tmp_path / "out", used, **options).resolved == 2
    forget(tmp_path / "out", {4, 5})
    write_frame(shot / name(5), make_frame(5, width=9, height=7, seed=99))
    write_frame(shot / name(4), make_frame(4, width=9, height=7, seed=99))
    again = resolve_folder(shot, tmp_path / "out", used, jobs=2 if preset != "recurrent" else None, **options)
    assert again.resolved == len(remade)
    resolve_folder(shot, tmp_path / "whole", used, **options)
    assert digests(tmp_path / "out") == digests(tmp_path / "whole")


def test_a_second_stop_does_not_hide_what_was_made_from_the_earlier_content(shot: Path, tmp_path: Path) -> None:
    """The frame is finished by then, and the one behind it not yet made again."""
    resolve_folder(shot, tmp_path / "out", **NUMPY)
    before = Manifest(tmp_path / "out").entries[name(5)]
    forget(tmp_path / "out", {4})
    write_frame(shot / name(4), make_frame(4, width=9, height=7, seed=99))
    old = (tmp_path / "out" / name(5)).read_bytes()
    resolve_folder(shot, tmp_path / "out", **NUMPY)
    expected = digests(tmp_path / "out")
    (tmp_path / "out" / name(5)).write_bytes(old)
    recorded_again(tmp_path / "out", {**Manifest(tmp_path / "out").entries, name(5): before})
    assert resolve_folder(shot, tmp_path / "out", **NUMPY).resolved == 1
    assert digests(tmp_path / "out") == expected


def test_results_of_an_earlier_version_which_do_not_say_what_made_them_are_made_again(
    shot: Path, tmp_path: Path
) -> None:
    resolve_folder(shot, tmp_path / "out", **NUMPY)
    expected = digests(tmp_path / "out")
    entries = Manifest(tmp_path / "out").entries
    recorded_again(tmp_path / "out", {each: entry._replace(made_from=None) for each, entry in entries.items()})
    assert resolve_folder(shot, tmp_path / "out", **NUMPY).resolved == FRAMES
    assert digests(tmp_path / "out") == expected


def test_a_state_is_saved_once_the_frames_before_it_are_written(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else both slots could be newer than the first missing frame, and a rerun would begin with the first one."""
    now, save, unwritten = Written.now, Checkpoints.save, list[int]()

    def slow(*given: Any, **facts: Any) -> Written:
        time.sleep(0.02)
        return now(*given, **facts)

    def saved(slots: Checkpoints, resolver: Resolver, *made_from: str) -> None:
        unwritten.append(resolver.recurrent()[0].index + 1 - len(Manifest(tmp_path / "out").entries))
        save(slots, resolver, *made_from)

    monkeypatch.setattr(Written, "now", slow)
    monkeypatch.setattr(Checkpoints, "save", saved)
    resolve_folder(shot, tmp_path / "out", checkpoint_every=1, **NUMPY)
    assert unwritten == [0] * FRAMES


def test_a_state_of_other_inputs_is_not_restored_and_leaves_its_slot(tmp_path: Path) -> None:
    slots, resolver = Checkpoints(tmp_path, "key"), Resolver(device="numpy")
    for number in range(2):
        resolver.resolve(make_frame(number))
        slots.save(resolver, f"made from {number}")
    assert slots.restore(resolver, {0: "made from 0", 1: "made from others"}) == 0
    assert [each for each in SLOTS if (tmp_path / each).exists()] == [SLOTS[0]]
    assert slots.restore(resolver, {}) is None  # not even frame 0 is finished
    assert list(tmp_path.iterdir()) == []
