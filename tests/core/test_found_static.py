"""Where no change is found, one that comes after all is still followed; where all is static, more frames count."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.core.parameters import HistoryKind
from cltaa.core.plan import plan_frame
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from tests.core.standing import plans_of_equal_runs
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 24, 20
TWO = np.random.default_rng(7).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
FOUND = frozenset({Effect.DISOCCLUSION})
CHANGED = np.s_[4:16, 6:18]
PRESETS = pytest.mark.parametrize("name", ["default", "gather-8", "gather-48"])


def frame_of(index: int, light: float, found: frozenset[Effect] | None = FOUND) -> Frame:
    """A texture of two colours a pixel, either of which a sample may find, with a part of another ``light``."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=None)
    first = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    colour = np.where(first, TWO[0], TWO[1]).astype(np.float32)
    colour[CHANGED] *= np.float32(light)
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0), jitter_px=(0.0, 0.0), found=found)


def last(name: str, lights: list[float], found: frozenset[Effect] = FOUND) -> Image:
    preset = override(load_preset(name), {"current_filter": "none"})
    frames = (frame_of(index, light, found) for index, light in enumerate(lights))
    *_, image = Resolver(preset, "numpy").images(frames)
    return image


@PRESETS
def test_four_times_as_many_samples_count(name: str) -> None:
    error = np.sqrt(np.mean((last(name, [1.0] * 96) - TWO.mean(0)) ** 2))
    of_one_sample = np.sqrt(np.mean((TWO[0] - TWO[1]) ** 2)) / 2
    # A running mean of up to 24 samples is worth 47; 96 samples have 0.70 of its error, seen is 0.74.
    assert error < 0.85 * of_one_sample / 47**0.5


@pytest.mark.parametrize(
    ("name", "found"),
    [("default", FOUND), ("gather-8", FOUND), ("gather-48", FOUND), ("default", FOUND | {Effect.CAMERA})],
)
def test_light_that_changes_after_all_is_followed(name: str, found: frozenset[Effect]) -> None:
    image = last(name, [1.0] * 48 + [2.0] * 6, found)
    # Of a running mean of up to 24 samples, which nothing refutes, 0.78 of the change would be missing.
    assert (
        2.0 - np.mean(image[CHANGED]) / np.mean(TWO.mean(0)[CHANGED]) < 0.4
    )  # seen: 0.30, and 0.19 where the camera moves


def test_the_device_has_the_bits_of_the_oracle() -> None:
    lights = [1.0] * 4 + [2.0] * 4
    results = (Resolver("default", device, strict=True) for device in (None, "numpy"))
    ours, theirs = (list(each.images(frame_of(i, light) for i, light in enumerate(lights))) for each in results)
    assert np.array_equal(bits(np.array(ours)), bits(np.array(theirs)))


def test_a_plan_raises_no_limit_that_was_set() -> None:
    plan = plan_frame(override(load_preset(), {"largest_t": 1.0}), frame_of(0, 1.0), None)
    assert plan.settings.largest_t == 1.0


@pytest.mark.parametrize("name", ["default", "gather-8"])
@pytest.mark.parametrize(
    ("found", "largest"),
    [
        (FOUND, 2.5),
        (FOUND | {Effect.MOTION}, 2.5),
        (FOUND | {Effect.CAMERA, Effect.THIN}, 2.5),
        (FOUND | {Effect.MOTION, Effect.ILLUMINATION}, 2.0**50),
        (FOUND | {Effect.REACTIVE}, 2.0**50),
        (None, 2.0**50),
    ],
)
def test_a_lone_frame_shows_no_change_of_light_where_none_is_known(
    name: str, found: frozenset[Effect] | None, largest: float
) -> None:
    assert plan_frame(load_preset(name), frame_of(0, 1.0, found), None).settings.largest_t == largest


@pytest.mark.parametrize(
    ("found", "limit", "filtered"),
    [(None, 24.0, 8.0), (FOUND, 96.0, 1.0), (FOUND | {Effect.MOTION}, 24.0, 8.0), (FOUND | {Effect.CAMERA}, 24.0, 8.0)],
)
def test_the_history_grows_and_the_filter_fades_only_where_all_is_found_static(
    found: frozenset[Effect] | None, limit: float, filtered: float
) -> None:
    plan = plan_frame(load_preset("default"), frame_of(0, 1.0, found), None)
    assert (plan.settings.sample_limit, plan.settings.filter_samples) == (limit, filtered)


@pytest.mark.parametrize(("name", "gathers"), [("gather-48", False), ("gather-8+8", True), ("gather-24+24", True)])
def test_only_frames_ahead_keep_the_ring_where_all_is_found_static(name: str, gathers: bool) -> None:
    plan = plan_frame(load_preset(name), frame_of(0, 1.0), None)
    assert (plan.choices.history is HistoryKind.FRAMES) == gathers


def test_what_holds_more_frames_is_taken_where_all_is_found_static() -> None:
    """A ring of 9 frames, 4 of them ahead, has more than the history of the first 7, 8 of 9 being level; it shrinks
    towards the end."""
    preset = override(load_preset("gather-8+8"), {"history_frames": 4, "look_ahead": 4})
    frames = [frame_of(index, 1.0) for index in range(16)]
    images = list(Resolver(preset, "numpy").images(frames))
    ring = list(Resolver(override(preset, {"recursion": "none", "filter_samples": 1.0}), "numpy").images(frames))
    mean = list(Resolver("gather-8", "numpy").images(frames))
    taken = [[np.array_equal(bits(one), bits(other[k])) for other in (ring, mean)] for k, one in enumerate(images)]
    assert taken == [[True, False]] * 7 + [[False, True]] * 9
    ours = list(Resolver(preset, strict=True).images(frames))
    assert np.array_equal(bits(np.array(ours)), bits(np.array(images)))


def test_the_frames_of_a_history_are_counted_over_a_checkpoint() -> None:
    preset = override(load_preset("gather-8+8"), {"history_frames": 4, "look_ahead": 4})
    resolver, goes_on = Resolver(preset, "numpy"), Resolver(preset, "numpy")
    frames = [frame_of(index, 1.0) for index in range(14)]
    expected = list(Resolver(preset, "numpy").images(frames))
    for frame in frames[:10]:
        resolver.feed(frame)
    past, memory = resolver.recurrent()
    assert past.held == 6
    for name, buffer in goes_on.restore(past).items():
        with buffer.mapped(write=True) as there, memory[name].mapped(write=False) as here:
            there[...] = here
    *_, image = goes_on.images(frames[6:])
    assert np.array_equal(bits(image), bits(expected[-1]))


def jittered(index: int, period: int) -> Frame:
    return replace(frame_of(index, 1.0), jitter_px=(0.01 * (index % period), 0.0))


@pytest.mark.parametrize("period", [1, 8, 16, 17])
def test_a_history_of_few_positions_keeps_the_whole_filter(period: int, tmp_path: Path) -> None:
    """It is as a resumed run has it."""
    plans = plans_of_equal_runs("default", [jittered(index, period) for index in range(20)], tmp_path)
    expected_samples = 2.0**20 if 1 < period <= 16 else 1.0
    assert [plan.settings.filter_samples for plan in plans] == 2 * [expected_samples]


@pytest.mark.parametrize("name", ["default", "gather-8"])
@pytest.mark.parametrize(("effect", "samples"), [(Effect.MOTION, 8.0), (Effect.CAMERA, 8.0), (None, 2.0)])
def test_few_positions_change_no_filter_but_that_of_a_static_scene(
    name: str, effect: Effect | None, samples: float
) -> None:
    frame, preset = jittered(8, 8), override(load_preset(name), {"filter_samples": samples})
    found = replace(frame, found=FOUND | ({effect} if effect else set()))
    before = [jittered(index, 8).jitter_px for index in range(8)]
    plan = plan_frame(preset, found, make_camera((1.0, 0.0, 5.0)), jitters=before)
    moving = samples / 4 if name == "gather-8" else samples  # no light is known to change
    assert plan.settings.filter_samples == (moving if effect else 2.0**20)
