"""Light that changes where nothing moves: the test for it, what it does to a picture, and when it is planned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.build import Build, Steps, settings_record
from cltaa.constants import PAD_X, PAD_Y
from cltaa.debug import DebugViews
from cltaa.frames import Effect, Frame
from cltaa.layout import Layout
from cltaa.params import BoxSpace, Choices, LightChange, Settings
from cltaa.planning import plan_frame
from cltaa.presets import load_preset, override
from cltaa.reference.light import change_of_light
from cltaa.reference.sampling import Footprint
from cltaa.resolve import Resolver
from cltaa.views import View
from tests.kernels.hard_planes import padded
from tests.sequence_factory import make_camera, make_frame

WIDTH, HEIGHT = 40, 30
BUILD = Build(choices=Choices(box_space=BoxSpace.RGB), steps=Steps(exposure=False))
LIT = frozenset({Effect.SHADING})


def signed_divisors(now: Any, then: Any, went: float, **settings: Any) -> Any:
    """What the counts are divided by, [H, W], where nothing moves and light ``went`` up or down the frame before."""
    layout = Layout(WIDTH, HEIGHT)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    still = np.zeros((HEIGHT, WIDTH), np.float32)
    place = Footprint(y + PAD_Y, x + PAD_X, still, still)
    record = settings_record(Settings(**settings))
    count = padded(np.full((1, HEIGHT, WIDTH), went), layout)[0]
    return change_of_light(padded(now, layout), padded(then, layout), count, place, BUILD, layout, record, record)


def divisors(now: Any, then: Any, **settings: Any) -> Any:
    """The same where light goes on, whichever way."""
    return np.maximum(*(np.abs(signed_divisors(now, then, went, **settings)) for went in (7.0, -7.0)))


def test_it_is_students_t() -> None:
    random = np.random.default_rng(0)
    then = random.uniform(0.2, 1.0, (3, HEIGHT, WIDTH)).astype(np.float32)
    now = (then + random.normal(0.005, 0.02, then.shape)).astype(np.float32)
    found = divisors(now, then, change_floor=0.0)
    windows = np.lib.stride_tricks.sliding_window_view(now.astype(np.float64) - then, (3, 3), axis=(1, 2))
    t = np.abs(windows.mean((-1, -2))) / (windows.std((-1, -2)) / 3)
    # Differences of values below 1 are off by 2^-24; of nine of them the deviation is hardly below 0.005 here.
    assert np.allclose(found[1:-1, 1:-1], np.maximum(t.max(0) / Settings().change_t, 1.0), rtol=1e-4)
    assert 0.05 < (found == 1.0).mean() < 0.95


def test_what_the_jitter_makes_is_no_change_and_what_a_lamp_makes_is() -> None:
    random = np.random.default_rng(1)
    then = np.full((3, HEIGHT, WIDTH), 0.5, np.float32)
    noisy = np.broadcast_to(random.normal(0.5, 0.1, (HEIGHT, WIDTH)), then.shape).astype(np.float32)
    assert (divisors(noisy, then) > 2.0).mean() < 0.02  # t > 4 with 8 degrees of freedom: 0.4 %; 0.9 % seen
    # An edge that the jitter moves by half a pixel: three of nine samples differ, t = 2.1 and less with the floor.
    edge = then.copy()
    edge[:, :, 20] = 0.9
    assert divisors(edge, then).max() < 1.1
    assert divisors(1.2 * noisy, noisy).min() > 2.0


def test_a_difference_that_nobody_sees_is_none() -> None:
    flat = np.full((3, HEIGHT, WIDTH), 0.5, np.float32)
    settings = Settings()
    seen = np.float32(settings.change_t * settings.change_floor)
    assert (divisors(flat * (1 + 0.9 * seen), flat) == 1.0).all()
    assert (divisors(flat * (1 + 1.2 * seen), flat) > 1.0).all()


def test_what_goes_back_where_it_came_from_is_no_change() -> None:
    noisy = np.random.default_rng(1).normal(0.5, 0.1, (3, HEIGHT, WIDTH)).astype(np.float32)
    assert signed_divisors(1.2 * noisy, noisy, 7.0).min() > 2.0
    assert signed_divisors(0.8 * noisy, noisy, -7.0).max() < -2.0
    assert (signed_divisors(1.2 * noisy, noisy, -7.0) == 1.0).all()
    assert (signed_divisors(0.8 * noisy, noisy, 7.0) == -1.0).all()


def textured(index: int, light: float, effects: frozenset[Effect] = LIT) -> Frame:
    """A texture of two colours a pixel, either of which the jitter may find; light is on all of it."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=effects)
    found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    colour = light * np.where(found, two[0], two[1])
    return replace(frame, colour=colour.astype(np.float32), depth=np.full_like(frame.depth, 5.0))


def errors(light_change: str, step: int, count: int) -> list[float]:
    """Root mean square error of each frame of a texture whose light rises by half in frame ``step``."""
    resolver = Resolver(override(load_preset(), {"light_change": light_change}), "numpy")
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    lights = [1.0 if index < step else 1.5 for index in range(count)]
    resolved = [resolver.resolve(textured(index, light)) for index, light in enumerate(lights)]
    return [
        float(np.sqrt(np.mean((image - light * two.mean(0)) ** 2)))
        for image, light in zip(resolved, lights, strict=True)
    ]


def test_a_lamp_that_goes_on_is_followed_and_what_stands_is_not_forgotten() -> None:
    tested, ignored = errors("test", 12, 16), errors("ignore", 12, 16)
    assert tested[11] < ignored[11]  # 0.0246 and 0.0259
    assert tested[14] < 0.75 * ignored[14]  # 0.082 and 0.122


def stored_counts(lights: list[float]) -> Any:
    """The counts that frames of a texture under these lights leave, [H, W]."""
    resolver = Resolver(load_preset(), "numpy")
    for index, light in enumerate(lights):
        resolver.resolve(textured(index, light))
    assert resolver.last is not None
    assert (DebugViews(resolver, [View.COUNT]).layers()["debug.count"] >= 1.0).all()
    with resolver.last.arguments["output_count"].mapped(write=False) as count:
        return Layout(WIDTH, HEIGHT).inside(count)[0].copy()


def test_light_that_goes_on_is_followed_and_light_that_alternates_is_not() -> None:
    rising, falling = ([1.3 ** (way * index) for index in range(10)] for way in (1, -1))
    alternating = stored_counts([1.0, 1.6] * 5)
    assert np.median(np.abs(alternating)) > 9.0  # of ten frames; 1.4 by a test of one frame alone
    for lights, way in ((rising, 1.0), (falling, -1.0)):
        going = stored_counts(lights)
        assert (way * going > 0).mean() > 0.95
        assert np.median(np.abs(going)) < 4.0


@pytest.mark.parametrize(
    ("effects", "tested", "still", "moving"),
    [
        ({Effect.CAMERA}, False, 1.5, 1.25),
        ({Effect.SHADING}, True, 16.0, 1.0),
        ({Effect.REACTIVE, Effect.HDR}, True, 16.0, 1.0),
        (None, False, 1.0, 1.0),
    ],
)
def test_where_light_may_change_it_is_tested_for(
    effects: set[Effect] | None, *, tested: bool, still: float, moving: float
) -> None:
    frame = make_frame(1, camera=make_camera(), effects=None if effects is None else frozenset(effects))
    default, plan = load_preset().settings, plan_frame(load_preset(), frame, frame.camera)
    planned = plan.settings
    assert (plan.choices.light_change is LightChange.TEST) == tested
    assert (planned.gamma_still, planned.gamma_moving) == (still, moving)
    assert planned.resample_cost == (default.changing_cost if tested else default.resample_cost)


def test_without_the_test_the_box_alone_tells_and_is_narrow() -> None:
    frame = make_frame(1, camera=make_camera(), effects=LIT)
    planned = plan_frame(override(load_preset(), {"light_change": "ignore"}), frame, frame.camera).settings
    assert (planned.gamma_still, planned.gamma_moving) == (1.0, 1.0)
