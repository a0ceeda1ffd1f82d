"""Looking ahead: the samples of later frames are gathered as those of earlier ones are, to the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, UsageError
from cltaa.frame import Effect, Frame, Image
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.test_resolve import hard_frames
from tests.sequence_factory import bits, make_camera, make_frame

KEPT, AHEAD = 3, 4
MOVING = frozenset({Effect.MOTION, Effect.DISOCCLUSION})
HALF = np.float32(0.5)


def looking(**changes: object) -> Preset:
    values: dict[str, object] = {"history_frames": KEPT, "look_ahead": AHEAD, "current_filter": "none", **changes}
    return override(load_preset("gather-8+8"), values)


def images(frames: Sequence[Frame], preset: Preset, device: str | None = None, **options: Any) -> list[Image]:
    return list(Resolver(preset, device, **options).images(frames))


def same(ones: Sequence[Image], others: Sequence[Image]) -> bool:
    return all(np.array_equal(bits(one), bits(other)) for one, other in zip(ones, others, strict=True))


def sliding(index: int, by: tuple[float, float]) -> Frame:
    """A wall before a still camera that moves on its own by as much a frame, drawn from a texture of its own."""
    height, width = 23, 37
    y, x = np.mgrid[:height, :width].astype(np.float32)
    u, v = x - np.float32(by[0] * index), y - np.float32(by[1] * index)
    colour = np.stack([1 + HALF * np.sin(u), 1 + HALF * np.cos(v), 1 + HALF * np.sin(u + v)], axis=-1)
    return replace(
        make_frame(index, camera=make_camera(), effects=MOVING, jitter_px=(0.25 - 0.125 * (index % 4), 0.0)),
        colour=colour.astype(np.float32),
        depth=np.full((height, width), 4, np.float32),
        motion=np.broadcast_to(np.array([-by[0], -by[1]], np.float32), (height, width, 2)).copy(),
    )


class Waiting(NumpyLauncher):
    """A launcher that knows whether what it was given was waited for."""

    waited = True

    def run(self, *given: Any, **named: Any) -> Any:
        self.waited = False
        return super().run(*given, **named)

    def finish(self) -> None:
        self.waited = True


def test_an_image_is_whole_when_it_is_given() -> None:
    launcher = Waiting()
    resolver = Resolver(looking(), launcher)
    waited = [launcher.waited for _ in resolver.images(make_frame(index) for index in range(AHEAD + 1))]
    assert waited == [True] * (AHEAD + 1)


@pytest.mark.parametrize("ahead", [0, 1])
def test_kernels_know_of_later_frames_where_there_are_some(ahead: int) -> None:
    resolver = Resolver(looking(look_ahead=ahead), "numpy")
    assert len([*resolver.images(make_frame(index) for index in range(3))]) == 3
    assert resolver.last is not None
    assert resolver.last.build.steps.look_ahead == (ahead > 0)


def test_every_image_comes_once_and_in_order() -> None:
    resolver, frames = Resolver(looking(), "numpy"), [make_frame(index) for index in range(7)]
    ready = [resolver.feed(frame) for frame in frames]
    assert [len(some) for some in ready] == [0] * AHEAD + [1] * 3
    last = resolver.flush()
    assert (len(last), resolver.flush()) == (AHEAD, [])
    assert same([image for some in ready for image in some] + last, images(frames, looking(), "numpy"))


@pytest.mark.parametrize(("ahead", "device"), [(0, "numpy"), (AHEAD, None)])
def test_frames_that_are_only_kept_are_gathered_as_if_they_had_been_resolved(ahead: int, device: str | None) -> None:
    frames = [replace(frame, effects=None) for frame in hard_frames(33, 21, count=10)]
    frames[5] = replace(frames[5], cut=True)
    preset = looking(look_ahead=ahead, recursion="none")
    whole, resolver = images(frames, preset, device, strict=True), Resolver(preset, device, strict=True)
    for first in (4, 6, 8):  # the last frame kept, or one of them, is the cut
        resolver.reset()
        for frame in frames[first - KEPT : first]:
            resolver.keep(frame)
        assert same(list(resolver.images(frames[first:])), whole[first:])


def test_no_frame_is_only_kept_where_none_are_gathered_or_some_wait() -> None:
    with pytest.raises(UsageError, match=r"so none is only kept; call resolve\(\) or feed\(\)"):
        Resolver("fast", "numpy").keep(make_frame())
    resolver = Resolver(looking(), "numpy")
    resolver.feed(make_frame())
    with pytest.raises(UsageError, match=r"frames are still waiting for later ones; call flush\(\)"):
        resolver.keep(make_frame(1))


@pytest.mark.parametrize(
    ("changes", "moving"),
    [({}, True), ({}, False), ({"reject": "none"}, False)],
)
def test_the_strict_kernel_is_its_twin(changes: dict[str, object], moving: bool) -> None:
    frames = [sliding(index, (1.25, -0.5)) for index in range(7)] if moving else list(hard_frames(33, 21, count=7))
    preset = looking(**changes)
    assert same(images(frames, preset, strict=True), images(frames, preset, "numpy"))


def test_the_first_frame_with_those_ahead_is_the_last_one_of_the_sequence_backwards() -> None:
    # The same samples by the same displacements, in the same order: nothing but the way they are numbered differs.
    cameras = [make_camera((0.07 * index, 0.02 * index, 5.0 - 0.1 * index)) for index in range(AHEAD + 1)]
    effects = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.SKY})
    frames = [make_frame(index, camera=camera, effects=effects) for index, camera in enumerate(cameras)]
    backwards = [replace(frame, index=index) for index, frame in enumerate(reversed(frames))]
    first, *_ = images(frames, looking(), "numpy")
    *_, last = images(backwards, looking(look_ahead=0, history_frames=AHEAD), "numpy")
    assert same([first], [last])
    assert not same([first], [frames[0].colour])


@pytest.mark.parametrize("by", [(1.25, -0.5), (-2.5, 1.75)])
def test_own_motion_is_followed_ahead_as_it_is_back(by: tuple[float, float]) -> None:
    frames = [sliding(index, by) for index in range(AHEAD + 1)]
    assert all(frame.motion is not None for frame in frames)
    backwards = [
        replace(frame, index=index, motion=-frame.motion)  # type: ignore[operator]
        for index, frame in enumerate(reversed(frames))
    ]
    first, *_ = images(frames, looking(recursion="none"), "numpy")
    *_, last = images(backwards, looking(look_ahead=0, history_frames=AHEAD, recursion="none"), "numpy")
    assert same([first], [last])


def test_look_ahead_follows_a_disc_that_turns_and_grows() -> None:
    """A disc turns by 0.1 and grows by 2 % a frame: the samples ahead that are taken lie where the fixed point says."""
    height, width, turn = 41, 41, 1.02 * np.exp(-0.1j)
    y, x = np.mgrid[:height, :width] - 20.0
    here = x + 1j * y

    def disc(index: int) -> Frame:
        own = here / turn**index  # where on the disc each sample lies
        back = here / turn - here
        motion = np.stack([back.real, back.imag], axis=-1).astype(np.float32)
        colour = np.stack([1 + 0.02 * own.real, 1 + 0.02 * own.imag, np.full_like(x, 1)], axis=-1)
        frame = make_frame(index, width=width, height=height, camera=make_camera(), effects=MOVING, jitter_px=(0, 0))
        depth = np.full((height, width), 4, np.float32)
        return replace(frame, colour=colour.astype(np.float32), depth=depth, motion=motion)

    frames = [disc(index) for index in range(AHEAD + 1)]
    first, *_ = images(frames, looking(weighting="none"), "numpy")
    # The motion of a texel half a pixel off is wrong by 0.1 x 0.5 pixels in a step, so that the four steps' samples
    # stand at most 0.2 pixels from where they are taken to be, of a slope of 0.02 a pixel.
    middle = np.hypot(x, y) < 12
    assert np.abs(first - frames[0].colour)[middle].max() < 0.2 * 0.02 * 1.5
    assert (bits(first) != bits(frames[0].colour)).any(axis=-1)[middle].mean() > 0.9


def test_what_sets_out_later_is_not_taken_for_what_stands() -> None:
    still = replace(sliding(0, (0.0, 0.0)), motion=np.full((23, 37, 2), np.nan, np.float32))
    gone = [replace(sliding(index, (1.0, 0.0)), colour=still.colour + 5) for index in range(1, AHEAD + 1)]
    first, *_ = images([still, *gone], looking(weighting="none"), "numpy")
    assert same([first], [still.colour])


def test_a_thing_that_comes_to_rest_is_lost_ahead() -> None:
    moving = sliding(0, (1.0, 0.0))
    rests = replace(sliding(1, (0.0, 0.0)), motion=np.full((23, 37, 2), np.nan, np.float32), colour=moving.colour + 5)
    first, *_ = images([moving, rests], looking(weighting="none"), "numpy")
    assert same([first], [moving.colour])


@pytest.mark.parametrize(
    "change", [{"cut": True}, {"index": 9}, {"alpha": True}, {"motion": True}, {"width": 45, "height": 31}]
)
def test_nothing_crosses_a_break(change: dict[str, Any]) -> None:
    before = [make_frame(index) for index in range(5)]
    start = change.pop("index", 5)
    after = [make_frame(index + start, **(change if index == 0 or "cut" not in change else {})) for index in range(4)]
    whole = images([*before, *after], looking(), "numpy")
    assert same(whole[:5], images(before, looking(), "numpy"))
    alone = [replace(after[0], cut=True), *after[1:]]  # as the first of a film, not of all
    assert same(whole[5:], images(alone, looking(), "numpy"))


def test_exposure_and_alpha_ahead_are_brought_to_now() -> None:
    effects = frozenset({Effect.EXPOSURE, Effect.ALPHA})
    frames = [
        replace(
            make_frame(0, camera=make_camera(), alpha=True, effects=effects),
            index=index,
            exposure=2.0**index,
            colour=np.full((23, 37, 3), 2.0**index, np.float32),
            alpha=np.full((23, 37), 0.25, np.float32),
        )
        for index in range(6)
    ]
    for index, image in enumerate(images(frames, looking(), "numpy")):
        assert (image[..., :3] == 2.0**index).all()
        assert (image[..., 3] == np.float32(0.25)).all()


def test_a_recurrent_resolve_with_look_ahead_gives_the_same_images() -> None:
    frames = [make_frame(index, camera=make_camera(), effects=frozenset({Effect.SKY})) for index in range(6)]
    assert same(images(frames, looking(), "numpy"), images(frames, looking(look_ahead=0), "numpy"))


def test_a_frame_that_is_wrong_leaves_those_that_wait() -> None:
    frames, resolver = [make_frame(index) for index in range(4)], Resolver(looking(), "numpy")
    assert [resolver.feed(frame) for frame in frames] == [[]] * 4
    with pytest.raises(DataError):
        resolver.feed(replace(frames[0], index=4, jitter_px=(40.0, 0.0)))
    assert same(resolver.flush(), images(frames, looking(), "numpy"))


def test_reset_forgets_those_that_wait() -> None:
    resolver = Resolver(looking(), "numpy")
    resolver.feed(make_frame(0))
    resolver.reset()
    assert resolver.flush() == []


def test_what_cannot_look_ahead_says_so() -> None:
    with pytest.raises(UsageError, match="preset default keeps no frames, so it cannot look ahead; take one that"):
        Resolver("default", look_ahead=2)
    with pytest.raises(UsageError, match=r"look_ahead has no such value \(expected 0 to 64"):
        Resolver("gather-8", look_ahead=-1)
    with pytest.raises(UsageError, match=r"preset gather-8 looks ahead, and its image .* comes later; .*feed\(\)"):
        Resolver("gather-8", look_ahead=2).resolve(make_frame(0))


def test_without_it_feed_is_resolve() -> None:
    fed, resolved = Resolver("gather-8", "numpy"), Resolver("gather-8", "numpy")
    frames = [make_frame(index) for index in range(3)]
    assert same([fed.feed(frame)[0] for frame in frames], [resolved.resolve(frame) for frame in frames])
    assert fed.flush() == []


def test_a_number_that_comes_twice_is_refused_at_once() -> None:
    frames, resolver = [make_frame(index) for index in range(6)], Resolver(looking(), "numpy")
    ready = [image for frame in frames[:2] for image in resolver.feed(frame)]
    with pytest.raises(UsageError, match="index is 1 twice in a row"):
        resolver.feed(frames[1])
    ready += [image for frame in frames[2:] for image in resolver.feed(frame)]
    assert same([*ready, *resolver.flush()], images(frames, looking(), "numpy"))


def test_nothing_is_shown_of_an_image_after_another_frame_came() -> None:
    """The other frame's channels lie where those of the image were."""
    resolver = Resolver(looking(look_ahead=1), "numpy")
    for index in range(2):
        resolver.feed(make_frame(index))
    assert resolver.debug("motion")
    resolver.feed(make_frame(2, cut=True))
    with pytest.raises(UsageError, match="nothing was resolved yet"):
        resolver.debug("motion")


def test_a_ring_does_not_mind_that_the_step_changes() -> None:
    """A frame that is missing, and said to be, leaves those before where they are."""
    frames, preset = [make_frame(index) for index in range(10)], looking(look_ahead=2)
    numbered = [replace(frame, index=frame.index + (frame.index > 4)) for frame in frames]
    numbered[5] = replace(numbered[5], step=2)
    assert same(images(numbered, preset, "numpy"), images(frames, preset, "numpy"))
    gathered, expected = (Resolver("gather-8", "numpy") for _ in range(2))
    for one, other in zip(numbered, frames, strict=True):
        assert np.array_equal(bits(gathered.resolve(one)), bits(expected.resolve(other)))
