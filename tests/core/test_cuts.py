"""Cuts that nobody declares are found where no depth refutes the history: the images are those of a declared cut."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa import Effect, Frame, Resolver
from cltaa.core.cuts import coarse_colours, looks_cut
from cltaa.io.exr_read import read_colour
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.folder import resolve_folder
from tests.sequence_factory import write_images

WIDTH, HEIGHT = 64, 36
CUT = 4  # the frame that begins the second shot


def shot(seed: int, index: int, pan: int = 0) -> Frame:
    """A frame of smooth random light with grain, moved by ``pan`` pixels."""
    random = np.random.default_rng(seed)
    coarse = random.lognormal(0.0, 1.0, (9, 16, 3))
    light = np.kron(coarse, np.ones((4, 4, 1)))
    grain = np.random.default_rng(index).uniform(0.8, 1.25, light.shape)
    return Frame(index=index, colour=(np.roll(light, pan, 1) * grain).astype(np.float32))


def lost(frame: Frame, columns: slice, value: float = np.nan) -> Frame:
    colour = frame.colour.copy()
    colour[:, columns] = value
    return replace(frame, colour=colour)


def two_shots() -> list[Frame]:
    return [shot(0 if index < CUT else 1, index) for index in range(CUT + 3)]


def resolved(frames: list[Frame], preset: str = "default", **options: Any) -> tuple[np.ndarray, list[int]]:
    with Resolver(preset, device="numpy", **options) as resolver:
        images = [image for frame in frames for image in resolver.feed(frame)] + resolver.flush()
        return np.array(images), list(resolver.cuts_found)


@pytest.mark.parametrize(("preset", "options"), [("default", {}), ("gather-8", {"look_ahead": 2})])
def test_what_is_found_is_what_a_declaration_makes(preset: str, options: dict[str, int]) -> None:
    frames = two_shots()
    declared = [replace(frame, cut=frame.index == CUT) for frame in frames]
    found, cuts = resolved(frames, preset, **options)
    assert cuts == [CUT]
    np.testing.assert_array_equal(found, resolved(declared, preset, **options)[0])


@pytest.mark.parametrize(
    "changed",
    [
        lambda frame: replace(frame, effects=frozenset({Effect.ILLUMINATION})),
        lambda frame: replace(
            frame, depth=np.full((HEIGHT, WIDTH), 2.0, np.float32), motion=np.zeros((HEIGHT, WIDTH, 2))
        ),
    ],
    ids=["declared", "with depth and vectors"],
)
def test_none_is_looked_for_where_history_is_refuted_otherwise(changed: Any) -> None:
    assert looks_cut(*(coarse_colours(frame) for frame in two_shots()[CUT - 1 : CUT + 1]))
    assert [coarse_colours(changed(frame)) for frame in two_shots()] == [()] * (CUT + 3)


def test_a_cut_is_found_in_files_without_depth_and_matrices(tmp_path: Path) -> None:
    frames, files = two_shots(), write_images(tmp_path / "colour", [frame.colour for frame in two_shots()])
    with Resolver() as resolver:
        expected = [resolver.resolve(frame) for frame in frames]
    for rows in (0, 8):
        output = tmp_path / f"{rows}"
        assert resolve_folder(files, output, effects="all", band_rows=rows).cuts_found == [CUT]
        found = [read_colour(output / f"image.{frame.index:04d}.exr") for frame in frames]
        np.testing.assert_array_equal(found, expected)


def test_a_published_resolve_is_left_as_it_is() -> None:
    assert resolved(two_shots(), "bevy")[1] == []


@pytest.mark.parametrize(
    "after",
    [
        shot(0, 1),
        shot(0, 1, pan=1),
        replace(shot(0, 1), colour=16.0 * shot(0, 1).colour),
        replace(shot(0, 1), colour=np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)),
        lost(shot(0, 1), slice(None)),
        lost(shot(0, 1), slice(20, 40)),
        lost(shot(0, 1), slice(20, 40), np.inf),
        lost(shot(1, 1), slice(6, None)),
        lost(replace(shot(0, 1), colour=np.full_like(shot(0, 1).colour, 0.5)), slice(20)),
        Frame(index=1, colour=np.random.default_rng(5).random((HEIGHT, WIDTH, 3), np.float32)),
    ],
    ids=["grain", "pan", "exposure", "plain", "nan", "nan tile", "infinite tile", "little left", "plain left", "noise"],
)
def test_a_continued_shot_is_no_cut(after: Frame) -> None:
    assert not looks_cut(coarse_colours(shot(0, 0)), coarse_colours(after))


@pytest.mark.parametrize("left", [0, 20])
def test_it_is_found_after_a_run_was_cut_short_too(tmp_path: Path, left: int) -> None:
    """Also where a tile of the last frame before is missing."""
    frames = two_shots()
    frames[CUT - 1] = lost(frames[CUT - 1], slice(left))
    whole, _ = resolved(frames)
    with Resolver(device="numpy") as first, Resolver(device="numpy") as second:
        for frame in frames[:CUT]:
            first.resolve(frame)
        Checkpoints(tmp_path, "key").save(first, "inputs")
        assert Checkpoints(tmp_path, "key").restore(second, dict.fromkeys(range(CUT), "inputs")) == CUT - 1
        np.testing.assert_array_equal(second.resolve(frames[CUT]), whole[CUT])
        assert list(second.cuts_found) == [CUT]
