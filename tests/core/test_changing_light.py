"""Light that changes where nothing moves: the test for it, what it does to a picture, and when it is planned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.core.bands import BandedResolver
from cltaa.core.build import Build, Steps, settings_record
from cltaa.core.constants import CONSTANTS, PAD_X, PAD_Y
from cltaa.core.debug import View
from cltaa.core.parameters import BoxSpace, Choices, Illumination, Rectify, Settings
from cltaa.core.plan import plan_frame
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.debug import DebugViews
from cltaa.reference.illumination import IlluminationResult, illumination_test, stored_change
from cltaa.reference.real import Run
from cltaa.reference.sampling import Footprint
from tests.kernels.hard_planes import padded
from tests.last_frame import last_planes
from tests.sequence_factory import make_camera, make_frame

WIDTH, HEIGHT = 40, 30
BUILD = Build(choices=Choices(box_space=BoxSpace.RGB), steps=Steps(exposure=False))
LIT = frozenset({Effect.ILLUMINATION})
NONE = 1.0 + 2.0**-22  # divisors below it are 1


def in_light(
    now: Any, then: Any, before: float, held: float = 1.0, *, threshold: float | None = None, **settings: Any
) -> IlluminationResult:
    """What ``held`` samples count for, [H, W], and the change, where nothing moves; ``before`` is the last one."""
    layout = Layout(WIDTH, HEIGHT)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    still = np.zeros((HEIGHT, WIDTH), np.float32)
    place = Footprint(y + PAD_Y, x + PAD_X, still, still)
    record = settings_record(Settings(**settings))
    change, counts = padded(np.full((1, HEIGHT, WIDTH), before, np.float32), layout)[0], np.full_like(still, held)
    return illumination_test(
        counts,
        np.full_like(still, record["illumination_t"] if threshold is None else threshold),
        padded(now, layout),
        None,
        padded(then, layout),
        change,
        place,
        Run(BUILD, layout, settings=record),
    )


def divisors(now: Any, then: Any, before: float = 0.0, **settings: Any) -> Any:
    """What counts are divided by."""
    return 1.0 / in_light(now, then, before, **settings).samples


def test_the_illumination_change_is_students_t() -> None:
    random = np.random.default_rng(0)
    then = random.uniform(0.2, 1.0, (3, HEIGHT, WIDTH)).astype(np.float32)
    now = (then + random.normal(0.005, 0.02, then.shape)).astype(np.float32)
    found = divisors(now, then, illumination_floor=0.0)
    windows = np.lib.stride_tricks.sliding_window_view(now.astype(np.float64) - then, (3, 3), axis=(1, 2))
    t = np.abs(windows.mean((-1, -2))) / (windows.std((-1, -2)) / 3)
    # Differences of values below 1 are off by 2^-24; of nine of them the deviation is hardly below 0.005 here.
    assert np.allclose(found[1:-1, 1:-1], np.maximum(t.max(0) / Settings().illumination_t, 1.0) ** 2, rtol=2e-4)
    assert 0.05 < (found < NONE).mean() < 0.95


def test_the_threshold_divides_the_illumination_change() -> None:
    noisy = np.random.default_rng(1).normal(0.5, 0.1, (3, HEIGHT, WIDTH)).astype(np.float32)
    brighter, settings = np.float32(1.1) * noisy, Settings()
    elsewhere = divisors(brighter, noisy)
    changed = elsewhere > NONE
    assert changed.any()
    for threshold in (settings.disocclusion_t, settings.passing_t):
        there = divisors(brighter, noisy, threshold=threshold)
        assert np.allclose(there[changed], (settings.illumination_t / threshold) ** 2 * elsewhere[changed], rtol=1e-5)
        assert (there >= elsewhere).all()


def test_light_that_falls_is_asked_for_falling_t_times_as_much() -> None:
    noisy = np.random.default_rng(1).normal(0.5, 0.1, (3, HEIGHT, WIDTH)).astype(np.float32)
    for threshold in (None, Settings().disocclusion_t):
        for light, factor in ((1.2, 1.0), (0.8, 2.0)):
            once, asked = (
                divisors(np.float32(light) * noisy, noisy, threshold=threshold, falling_t=t) for t in (1.0, 2.0)
            )
            changed = asked > NONE
            assert changed.any()
            assert np.allclose(once[changed], factor**2 * asked[changed], rtol=1e-5)


def test_one_frame_counts_for_largest_t_at_most() -> None:
    noisy = np.random.default_rng(1).normal(0.5, 0.1, (3, HEIGHT, WIDTH)).astype(np.float32)
    for light in (1.2, 0.8):
        free, bounded = (divisors(np.float32(light) * noisy, noisy, largest_t=t) for t in (2.0**50, 4.0))
        assert (free > (4.0 / 2.6) ** 2).mean() > 0.5
        assert np.allclose(bounded, np.minimum(free, (4.0 / 2.6) ** 2), rtol=1e-5)


def test_what_the_jitter_makes_is_no_change_and_what_a_lamp_makes_is() -> None:
    random = np.random.default_rng(1)
    then = np.full((3, HEIGHT, WIDTH), 0.5, np.float32)
    noisy = np.broadcast_to(random.normal(0.5, 0.1, (HEIGHT, WIDTH)), then.shape).astype(np.float32)
    assert (divisors(noisy, then) > 2.0).mean() < 0.02  # t > 4 with 8 degrees of freedom: 0.4 %; 0.9 % seen
    # An edge that the jitter moves by half a pixel: three of nine samples differ, t = 2.1 and less with the floor.
    edge = then.copy()
    edge[:, :, 20] = 0.9
    assert divisors(edge, then).max() < 1.1
    assert divisors(1.2 * noisy, noisy).min() > 1.4


def test_a_difference_that_nobody_sees_is_none() -> None:
    flat = np.full((3, HEIGHT, WIDTH), 0.5, np.float32)
    settings = Settings()
    seen = np.float32(settings.illumination_t * settings.illumination_floor)
    assert (divisors(flat * (1 + 0.9 * seen), flat) < NONE).all()
    assert (divisors(flat * (1 + 1.2 * seen), flat) > NONE).all()


def test_illumination_that_returns_is_no_change_and_one_that_continues_is_more() -> None:
    noisy = np.random.default_rng(1).normal(0.5, 0.1, (3, HEIGHT, WIDTH)).astype(np.float32)
    brighter, darker = np.float32(1.1) * noisy, np.float32(0.9) * noisy  # by themselves t is 2.3 to 4.8
    assert (divisors(brighter, noisy, -5.0) < NONE).all()
    assert (divisors(darker, noisy, 5.0) < NONE).all()
    for now, before in ((brighter, 5.0), (darker, -5.0)):
        assert (divisors(now, noisy, before) > divisors(now, noisy) + 1.0).all()
        assert (np.sign(in_light(now, noisy, before).change) == np.sign(before)).all()


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_change_is_kept_as_it_is_up_to_a_limit(real: Any) -> None:
    most = CONSTANTS["MOST_CHANGE"].value
    changes = np.array([[0.0, -0.3, 1.0, 100.0, -(2.0**50), 1e-35]], real)
    assert stored_change(changes).tolist() == [[0.0, real(-0.3), 1.0, most, -most, 0.0]]


def textured(index: int, light: float, effects: frozenset[Effect] = LIT) -> Frame:
    """A texture of two colours a pixel, either of which the jitter may find; light is on all of it."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=effects)
    found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    colour = light * np.where(found, two[0], two[1])
    return replace(frame, colour=colour.astype(np.float32), depth=np.full_like(frame.depth, 5.0))


def errors(illumination: str, step: int, count: int) -> list[float]:
    """Root mean square error of each frame of a texture whose light rises by half in frame ``step``."""
    resolver = Resolver(override(load_preset(), {"illumination": illumination}), "numpy")
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    lights = [1.0 if index < step else 1.5 for index in range(count)]
    resolved = [resolver.resolve(textured(index, light)) for index, light in enumerate(lights)]
    return [
        float(np.sqrt(np.mean((image - light * two.mean(0)) ** 2)))
        for image, light in zip(resolved, lights, strict=True)
    ]


def test_a_lamp_that_lights_up_is_followed_and_steady_light_keeps_its_history() -> None:
    tested, ignored = errors("test", 12, 16), errors("static", 12, 16)
    assert tested[11] < 1.05 * ignored[11]
    assert tested[14] < 0.75 * ignored[14]


def stored_counts(lights: list[float], **settings: float) -> Any:
    """The counts and the illumination changes that frames of a texture under these lights leave, [2, H, W]."""
    resolver = Resolver(override(load_preset(), settings), "numpy")
    for index, light in enumerate(lights):
        resolver.resolve(textured(index, light))
    assert (DebugViews(resolver, [View.COUNT]).layers()["debug.count"] >= 1.0).all()
    return last_planes(resolver, "output_count")


def test_light_that_goes_on_is_followed_and_light_that_alternates_a_little_is_not() -> None:
    rising, falling = ([1.3 ** (way * index) for index in range(10)] for way in (1, -1))
    flickering = [1.0, 1.3] * 5
    assert np.median(stored_counts(flickering)[0]) > 8.5  # of ten frames; 8.9
    assert np.median(stored_counts(flickering, illumination_decay=0.0)[0]) < 7.6  # by each frame alone; 7.3
    assert np.median(stored_counts([1.0, 1.6] * 5)[0]) < 6.0  # a lamp that blinks is followed; 4.2
    for lights, way in ((rising, 1.0), (falling, -1.0)):
        going, change = stored_counts(lights)
        assert (way * change > 0).mean() > 0.95
        assert np.median(going) < 4.0


def test_where_history_may_be_wrong_it_is_tested() -> None:
    for effects, tested in [
        ({Effect.CAMERA, Effect.DISOCCLUSION}, False),
        ({Effect.CAMERA, Effect.THIN}, True),
        ({Effect.DISOCCLUSION, Effect.THIN}, False),  # which stands
        ({Effect.MOTION}, True),
        ({Effect.ILLUMINATION}, True),
        ({Effect.REACTIVE, Effect.HDR}, True),
        (None, True),
    ]:
        frame = make_frame(1, camera=make_camera(), effects=None if effects is None else frozenset(effects))
        plan = plan_frame(load_preset(), frame, make_camera((1.0, 0.0, 5.0)))
        assert (plan.choices.illumination is Illumination.TEST) == tested, effects
        assert (plan.choices.rectify, plan.settings.resampling_penalty) == (Rectify.NONE, 0.8), effects


@pytest.mark.parametrize("word", ["effects", "found"])
def test_gathered_samples_past_thin_things_have_one_window(word: str) -> None:
    """What a resampled history blurs there, they hold as it was."""
    for effects, window in [({Effect.CAMERA, Effect.THIN}, False), ({Effect.CAMERA, Effect.ILLUMINATION}, True)]:
        frame = make_frame(1, camera=make_camera(), effects=None)
        known: dict[str, Any] = {word: frozenset(effects)}
        plan = plan_frame(load_preset("gather-8"), replace(frame, **known), make_camera((1.0, 0.0, 5.0)))
        assert plan.choices.illumination is (Illumination.WINDOW if window else Illumination.STATIC), effects


@pytest.mark.parametrize(("effects", "scale"), [(LIT, 1.0), (None, 1.0), (frozenset({Effect.CAMERA}), 1.5)])
def test_without_the_test_the_box_alone_tells_and_is_narrow(effects: frozenset[Effect] | None, scale: float) -> None:
    frame = make_frame(1, camera=make_camera(), effects=effects)
    boxed = override(load_preset("fast"), {"box_scale_static": 1.5, "box_scale_moving": 1.5})
    planned = plan_frame(boxed, frame, frame.camera).settings
    assert (planned.box_scale_static, planned.box_scale_moving) == (scale, scale)


def changes_read(resolver: Resolver) -> Any:
    """The illumination changes that the last frame read, [H, W]."""
    return last_planes(resolver, "history_count")[1]


@pytest.mark.parametrize("own", [False, True], ids=["shared", "own"])
def test_after_a_frame_without_the_test_no_change_is_read(own: bool) -> None:
    """Where a device has memory of its own too, of which the host has older copies."""
    launcher = DeviceLauncher()
    launcher.stages = launcher.stages or own
    launcher.device.shares_memory = launcher.shares_memory = not launcher.stages
    resolver, beside = Resolver(device=launcher), Resolver(strict=True, device="numpy")
    banded = BandedResolver(band_rows=7)
    for index in range(8):
        frame = textured(index, 1.0, LIT if index in (2, 5, 6) else frozenset({Effect.DISOCCLUSION}))
        image = resolver.resolve(frame)
        if index in (2, 5):
            assert (changes_read(resolver) == 0.0).all()
            assert (last_planes(resolver, "output_count")[0] > index).mean() > 0.99
        if index == 6:
            assert np.median(np.abs(changes_read(resolver))) > 0.2
        assert np.allclose(image, beside.resolve(frame), rtol=1e-4, atol=1e-5)
        assert (image == banded.resolve(replace(frame, colour=frame.colour.copy(), depth=frame.depth.copy()))).all()


def test_a_resolver_that_was_put_back_knows_whether_counts_hold_changes(tmp_path: Path) -> None:
    for effects in (LIT, frozenset({Effect.DISOCCLUSION})):
        resolver, other, checkpoints = Resolver(), Resolver(), Checkpoints(tmp_path, str(effects))
        for index in range(3):
            resolver.resolve(textured(index, 1.0, effects))
        checkpoints.save(resolver, "inputs")
        assert checkpoints.restore(other, dict.fromkeys(range(9), "inputs")) == 2
        after = textured(3, 1.2)
        assert (resolver.resolve(after) == other.resolve(after)).all()
        assert (changes_read(resolver) == changes_read(other)).all()
