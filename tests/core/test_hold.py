"""A hold: the camera of a moving shot stands for a while, so its frames are planned as in a shot in which it stands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from cltaa.core.parameters import HistoryKind, Illumination, Recursion
from cltaa.core.plan import Plan, plan_frame
from cltaa.core.presets import load_preset, override
from cltaa.core.record import Past, frames_held
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame, Image
from tests.core.standing import panned
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 24, 20
TWO = np.random.default_rng(3).uniform(0.2, 0.6, (2, HEIGHT, 4 * WIDTH, 3))
FOUND = frozenset({Effect.DISOCCLUSION})
OWN = FOUND | {Effect.MOTION}
WALK = 6  # frames that the camera moves by a pixel each before it stands
GATHERS = pytest.mark.parametrize("name", ["gather-8", "gather-8+8"])


def places(hold: int, after: int = 0) -> list[int]:
    """Pixels by which the camera has moved: it walks, stands for ``hold`` frames more, and walks on."""
    return [*range(WALK), *[WALK - 1] * hold, *range(WALK, WALK + after)]


def seen(index: int, moved: int, effects: frozenset[Effect] = FOUND) -> Frame:
    """A texture of two colours a pixel, either of which a sample may find, from a camera that moved by whole pixels."""
    camera = panned(make_camera(), moved, WIDTH)
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=camera, effects=None, jitter_px=(0.0, 0.0))
    part = np.s_[:, WIDTH - moved : 2 * WIDTH - moved]
    found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    colour = np.where(found, TWO[0][part], TWO[1][part]).astype(np.float32)
    depth = np.full_like(frame.depth, 5.0)
    return replace(frame, colour=colour, depth=depth, found=effects | {Effect.CAMERA})


def error(image: Image, moved: int) -> float:
    """Root mean square where the texture was in view from the start."""
    part = np.s_[:, WIDTH - moved : 2 * WIDTH - moved]
    return float(np.sqrt(np.mean((image - TWO.mean(0)[part])[:, WALK:-WALK] ** 2)))


def planned(name: str, frame: Frame, previous: Camera | None) -> Plan:
    return plan_frame(load_preset(name), frame, previous)


@pytest.mark.parametrize("effects", [FOUND, OWN, OWN | {Effect.ILLUMINATION}], ids=["nothing", "own", "light"])
@pytest.mark.parametrize("name", ["default", "gather-8", "gather-8+8", "gather-48"])
def test_the_plan_is_that_of_a_standing_camera(name: str, effects: frozenset[Effect]) -> None:
    """What is declared of the whole shot promises nothing of its history, which a moving camera saw. A ring without
    frames ahead may hold more than that history, so it is kept beside it."""
    frame = seen(1, 0, effects)
    standing = planned(name, replace(frame, found=effects), frame.camera)
    if standing.choices.history is HistoryKind.ACCUMULATED and name != "default":
        choices = msgspec.structs.replace(
            standing.choices,
            history=HistoryKind.FRAMES,
            recursion=Recursion.STANDING,
            illumination=Illumination.STATIC,
        )
        standing = standing._replace(choices=choices)
    declared = replace(frame, found=None, effects=frame.found)
    for each in (frame, declared):
        plan = planned(name, each, frame.camera)
        assert plan[:3] == standing[:3]
        assert any("known" in reason.why for reason in plan.reasons)


@pytest.mark.parametrize("name", ["default", "gather-8"])
def test_other_frames_are_planned_for_a_moving_camera(name: str) -> None:
    frame, elsewhere = seen(1, 0), make_camera((1.0, 0.0, 5.0))
    moving = planned(name, frame, elsewhere)
    assert planned(name, frame, frame.camera)[:2] != moving[:2]
    assert plan_frame(load_preset(name), frame, frame.camera, only_kept=True)[:2] == moving[:2]
    colour_alone = Frame(colour=frame.colour, index=1, found=frame.found)
    known = planned(name, colour_alone, colour_alone.camera)
    assert known[:2] == planned(name, colour_alone, elsewhere)[:2]  # nothing tells that a camera stands


@pytest.mark.parametrize("name", ["fsr3-like", "bevy"])
def test_a_published_preset_knows_no_holds(name: str) -> None:
    frame = seen(1, 0)
    assert planned(name, frame, frame.camera)[:2] == planned(name, frame, make_camera((1.0, 0.0, 5.0)))[:2]


def test_without_recursion_the_ring_alone_is_shown() -> None:
    frame, preset = seen(1, 0), load_preset("gather-8").replace(recursion="none")
    assert plan_frame(preset, frame, frame.camera).choices.history is HistoryKind.FRAMES


@pytest.mark.parametrize("effects", [FOUND, OWN], ids=["nothing", "own"])
@GATHERS
def test_its_samples_add_up(name: str, effects: frozenset[Effect]) -> None:
    """Of 48 frames the mean errs less than half as much as that of the ring, which holds 9 or 17."""
    errors = []
    for hold in (1, 48):
        preset = override(load_preset(name), {"current_filter": "none"})
        frames = (seen(index, moved, effects) for index, moved in enumerate(places(hold)))
        *_, image = Resolver(preset, "numpy").images(frames)
        errors.append(error(image, WALK - 1))
    assert errors[1] < (17 / 48) ** 0.5 * errors[0]


def test_the_ring_takes_its_frames_for_what_comes_after() -> None:
    preset = load_preset("gather-8").replace(history_frames=3)
    frames = [seen(index, moved) for index, moved in enumerate(places(5, after=2))]
    resolver, beside = Resolver(preset, "numpy"), Resolver(preset, "numpy")
    recursions = []
    for frame in frames[:-2]:
        resolver.resolve(frame)
        assert resolver.plan is not None
        recursions.append(resolver.plan.choices.recursion)
    assert recursions == WALK * [Recursion.NONE] + 5 * [Recursion.STANDING]
    for frame in frames[-5:-2]:
        beside.keep(frame)
    for frame in frames[-2:]:
        assert np.array_equal(bits(resolver.resolve(frame)), bits(beside.resolve(frame)))


def test_a_ring_shows_its_samples_until_it_is_full() -> None:
    resolver, shown = Resolver(load_preset("gather-8").replace(history_frames=3), "numpy"), []
    for index in range(6):
        resolver.resolve(replace(seen(index + 4, 0), cut=index == 0))
        assert resolver.last is not None
        shown.append("ring" in resolver.last.arguments)
    assert shown == [True, True, True, False, False, False]


def test_frames_of_the_history_count_from_where_it_began() -> None:
    past = Past.of(seen(1, 0), previous=Past.of(seen(0, 0)))
    assert (past.held, frames_held(seen(2, 0), past), frames_held(seen(2, 1), past)) == (2, 3, 1)


def test_frames_that_were_only_kept_begin_none() -> None:
    """Nothing holds their mean, so the ring shows what comes after them."""
    preset = load_preset("gather-8")
    resolver = Resolver(preset, "numpy")
    for index in range(4):
        resolver.keep(seen(index, 0))
    resolver.resolve(seen(4, 0))
    assert resolver.plan is not None
    assert (resolver.plan.choices.history, resolver.plan.choices.recursion) == (HistoryKind.FRAMES, Recursion.NONE)
    resolver.resolve(seen(5, 0))
    assert resolver.plan.choices.recursion is Recursion.STANDING


@pytest.mark.parametrize("effects", [FOUND, OWN], ids=["nothing", "own"])
@pytest.mark.parametrize("name", ["default", "gather-8", "gather-8+8"])
def test_the_strict_kernels_are_their_twins(name: str, effects: frozenset[Effect]) -> None:
    def images(device: str | None) -> Iterable[Image]:
        frames = (seen(index, moved, effects) for index, moved in enumerate(places(12, after=3)))
        return Resolver(name, device, strict=True).images(frames)

    for ours, theirs in zip(images(None), images("numpy"), strict=True):
        assert np.array_equal(bits(ours), bits(theirs))
