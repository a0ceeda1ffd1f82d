"""Sequences on disk that are resolved with later frames: names, goes on after a stop, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.build import Steps
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError
from cltaa.frame import Effect, Image
from cltaa.io.sequence import open_images, open_sequence
from cltaa.pipeline.checkpoint import SLOTS
from cltaa.pipeline.memory import DevicePlanes, of_sequence
from cltaa.pipeline.run import resolve_sequence
from tests.sequence_factory import bits, make_camera, make_frame, write_frames, write_sequence

FRAMES, AHEAD = 9, 2
LOOKING: Preset = override(load_preset("gather-8+8"), {"history_frames": 2, "look_ahead": AHEAD})


def resolver() -> Resolver:
    return Resolver(LOOKING, "numpy")


def written(folder: Path) -> list[Image]:
    return list(open_images(folder))


def same(ones: list[Image], others: list[Image]) -> bool:
    return all(np.array_equal(bits(one), bits(other)) for one, other in zip(ones, others, strict=True))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "in", FRAMES, width=9, height=7)


def test_each_image_is_written_under_the_name_of_its_frame(folder: Path, tmp_path: Path) -> None:
    sequence, output = open_sequence(folder), tmp_path / "out"
    report = resolve_sequence(sequence, output, resolver())
    assert (report.frames, report.resolved) == (FRAMES, FRAMES)
    assert sorted(path.name for path in output.glob("*.exr")) == [path.name for path in sequence.files]
    assert same(written(output), list(resolver().images(sequence)))


@pytest.mark.parametrize("lost", [[0], [4], [8], [2, 6]])
def test_what_is_missing_is_made_again_to_the_same_bits(lost: list[int], folder: Path, tmp_path: Path) -> None:
    sequence, output = open_sequence(folder), tmp_path / "out"
    resolve_sequence(sequence, output, resolver())
    expected = {path.name: path.read_bytes() for path in output.glob("*.exr")}
    for number in lost:
        (output / f"synthetic.{number:04d}.exr").unlink()
    again = resolve_sequence(sequence, output, resolver())
    assert again.resolved == len(lost)
    assert {path.name: path.read_bytes() for path in output.glob("*.exr")} == expected


def test_a_stopped_run_goes_on_to_the_same_bits_without_a_checkpoint(folder: Path, tmp_path: Path) -> None:
    sequence, output, whole = open_sequence(folder), tmp_path / "out", tmp_path / "whole"
    resolve_sequence(sequence, whole, resolver())

    class Stopped(Resolver):
        left = 4

        def _next(self, **options: Any) -> Image:
            self.left -= 1
            if self.left < 0:
                raise KeyboardInterrupt
            return super()._next(**options)

    with pytest.raises(KeyboardInterrupt):
        resolve_sequence(sequence, output, Stopped(LOOKING, "numpy"), checkpoint_every=1)
    assert 1 <= len(list(output.glob("*.exr"))) <= 4
    assert not any((output / name).exists() for name in SLOTS)
    resolve_sequence(sequence, output, resolver())
    assert same(written(output), written(whole))


def test_where_the_whole_past_is_asked_for_a_run_goes_on_from_the_first_frame(tmp_path: Path) -> None:
    output = tmp_path / "out"
    # Declared to stand still: the plain mean of all samples.
    still: dict[str, Any] = {"camera": make_camera(), "effects": frozenset({Effect.SKY})}
    made = (make_frame(number, width=9, height=7, **still) for number in range(FRAMES))
    sequence = open_sequence(write_frames(tmp_path / "in", made))
    resolve_sequence(sequence, output, resolver())
    before = written(output)
    (output / "synthetic.0008.exr").unlink()
    resolve_sequence(sequence, output, resolver())
    assert same(written(output), before)


def test_a_sequence_that_has_grown_is_refused(folder: Path, tmp_path: Path) -> None:
    resolve_sequence(open_sequence(folder), tmp_path / "out", resolver())
    write_sequence(folder, 1, first=FRAMES, width=9, height=7)
    with pytest.raises(UsageError, match=r"was begun with --frames to 8, not with --frames to 9;.*--restart"):
        resolve_sequence(open_sequence(folder), tmp_path / "out", resolver())


def test_results_that_wait_hold_their_layers(folder: Path) -> None:
    sequence = open_sequence(folder)
    causal, ahead = (
        of_sequence(sequence, DevicePlanes(Steps(), look_ahead=look_ahead), {"a": "float", "b": "half"})
        for look_ahead in (0, 2)
    )
    assert ahead.layers - causal.layers == 2 * (4 + 2) * 9 * 7
    assert msgspec.structs.replace(ahead, layers=0) == msgspec.structs.replace(causal, layers=0)


def test_the_command_takes_frames_ahead_and_says_where_it_cannot(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["resolve", str(folder), "--device", "numpy", "--look-ahead", "8", "-o", str(tmp_path / "out")]
    assert main([*command, "--preset", "gather-8"]) == 0
    assert same(written(tmp_path / "out"), [*Resolver("gather-8+8", "numpy").images(open_sequence(folder))])
    capsys.readouterr()
    assert main([*command, "--restart"]) == 64
    assert capsys.readouterr().err == (
        "cltaa: error: preset default with look_ahead=8 keeps no frames, so it cannot look ahead; take one that "
        "gathers, as gather-8+8\n"
    )
