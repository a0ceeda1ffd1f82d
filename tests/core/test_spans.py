"""Temporal windows: where light may change, each pixel is resolved from the one that its latest samples support.

What they are worth is shown by the oracle, whose bits the device has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.build import Build
from cltaa.core.parameters import HistoryKind, Illumination, Rectify
from cltaa.core.plan import plan_frame
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.reference.real import Array
from tests.kernels.test_resolve import hard_frames
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 40, 30
LIT = frozenset({Effect.ILLUMINATION})
ALL = frozenset(Effect)


def lit(index: int, light: float, motion_px: float) -> Frame:
    """A texture of two colours a pixel, either of which the jitter may find; light is on all of it, and stays where it
    is whatever the motion says."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=make_camera(), effects=LIT | {Effect.MOTION})
    found = np.random.default_rng(index).random((HEIGHT, WIDTH, 1)) < 0.5
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    colour = (light * np.where(found, two[0], two[1])).astype(np.float32)
    motion = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    motion[..., 0] = motion_px
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0), motion=motion)


def errors(preset: str, lights: list[float], motion_px: float = 0.0) -> list[float]:
    """Root mean square error of each frame."""
    resolver = Resolver(override(load_preset(preset), {"current_filter": "none"}), "numpy")
    two = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3))
    resolved = [resolver.resolve(lit(index, light, motion_px)) for index, light in enumerate(lights)]
    return [float(np.sqrt(np.mean((i - k * two.mean(0)) ** 2))) for i, k in zip(resolved, lights, strict=True)]


def test_a_lamp_that_goes_on_is_followed() -> None:
    lights = [1.0] * 20 + [1.5] * 8
    windows, tested = errors("gather-48", lights), errors("default", lights)
    assert windows[19] < 1.1 * tested[19]
    assert windows[22] < 0.9 * tested[22]  # 0.071 and 0.086: four frames that agree


def test_what_moves_along_itself_is_resolved_where_it_stands() -> None:
    windows, followed = errors("gather-48", [1.0] * 24, 1.5), errors("default", [1.0] * 24, 1.5)
    assert windows[23] < 0.5 * followed[23]  # 0.022 and 0.067


def veiled(reactivity: float, frames: int = 24) -> tuple[Array, Array]:
    """The last frame of a texture under a mask of one ``reactivity``, drawn and resolved, as a camera sees it that all
    but stands."""
    resolver = Resolver(override(load_preset("gather-48"), {"current_filter": "none"}), "numpy")
    for index in range(frames):
        mask = np.full((HEIGHT, WIDTH), reactivity, np.float32)
        seen = replace(lit(index, 1.0, 0.0), camera=make_camera((1e-7 * index, 0.0, 5.0)), effects=ALL)
        frame = replace(seen, reactive=mask, motion=None)
        resolved = resolver.resolve(frame)
    return frame.colour, resolved


def test_temporal_windows_under_a_reactive_mask_of_half_are_still_means() -> None:
    truth = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3)).mean(0)
    bare, half = (float(np.sqrt(np.mean((veiled(share)[1] - truth) ** 2))) for share in (0.0, 0.5))
    assert half < 1.5 * bare  # 0.028 and 0.025; 0.046 if each window gave up as much of its samples


def test_a_reactive_mask_of_one_shows_the_current_frame() -> None:
    drawn, resolved = veiled(1.0)
    assert resolved == pytest.approx(drawn, rel=1e-5)


def test_samples_from_before_a_transparent_surface_are_used_once_it_has_left() -> None:
    resolver = Resolver(override(load_preset("gather-48"), {"current_filter": "none"}), "numpy")
    truth = np.random.default_rng(99).uniform(0.2, 0.6, (2, HEIGHT, WIDTH, 3)).mean(0)
    errors = []
    for index in range(30):
        covered = 20 <= index < 28
        mask = np.full((HEIGHT, WIDTH), 0.4 * covered, np.float32)
        frame = lit(index, 0.6 if covered else 1.0, 0.0)
        resolved = resolver.resolve(replace(frame, reactive=mask, effects=ALL, motion=None))
        errors.append(float(np.sqrt(np.mean((resolved - truth) ** 2))))
    assert errors[28] < 1.2 * errors[19]  # 0.0194 and 0.0187, and 0.12 where the samples under the pane count


def test_a_transparent_surface_that_comes_and_leaves_has_the_bits_of_the_twin() -> None:
    """More frames are kept than the latest: all of them stand in for those where the mask makes these unlike."""
    preset, shares = (
        override(load_preset("gather-48"), {"history_frames": 9}),
        np.linspace(0.0, 1.0, WIDTH, dtype=np.float32),
    )
    device, twin = Resolver(preset, strict=True), Resolver(preset, "numpy")
    for index in range(13):
        mask = np.tile(shares, (HEIGHT, 1)) * (8 <= index < 11)
        frame = replace(lit(index, 1.0 - 0.3 * (8 <= index < 11), 1.5), reactive=mask, effects=ALL)
        assert (bits(device.resolve(frame)) == bits(twin.resolve(frame))).all(), index


def declared(count: int) -> Iterator[Frame]:
    return (replace(frame, effects=ALL) for frame in hard_frames(count=count))


def test_strict_kernels_of_one_lane_are_their_twins() -> None:
    """As a GPU's; those of a CPU's lanes are held to theirs above."""
    preset = override(load_preset("gather-48"), {"history_frames": 9})
    device, twin = Resolver(preset, build=Build(strict=True, lanes=1, rows=7)), Resolver(preset, "numpy")
    for frame in declared(10):
        resolved = device.resolve(frame)
        assert np.isfinite(resolved).all()
        assert (bits(resolved) == bits(twin.resolve(frame))).all()


def test_a_channel_for_another_gives_the_bits_of_a_new_resolver() -> None:
    """As many channels as before keep as much of a frame, but windows with alpha have a plane more."""
    masked = [make_frame(index, reactive=True, effects=ALL) for index in range(2)]
    seen_through = [make_frame(index, alpha=True, effects=ALL) for index in range(2, 5)]
    resolver, anew = Resolver("gather-48", "numpy"), Resolver("gather-48", "numpy")
    for frame in masked:
        resolver.resolve(frame)
    for frame in seen_through:
        np.testing.assert_array_equal(bits(resolver.resolve(frame)), bits(anew.resolve(frame)))


def test_every_step_gives_the_same_bits() -> None:
    planned, every = (Resolver("gather-48", "numpy", every_step=every) for every in (False, True))
    for index in range(5):
        frame = make_frame(index, camera=make_camera((0.1 * (index > 2), 0.0, 5.0)), effects=LIT | {Effect.CAMERA})
        assert (bits(planned.resolve(frame)) == bits(every.resolve(frame))).all()


@pytest.mark.parametrize(
    ("tier", "effects", "expected"),
    [
        ("gather-48", {Effect.ILLUMINATION}, (HistoryKind.FRAMES, Illumination.WINDOW, Rectify.NONE)),
        ("gather-48", {Effect.REACTIVE, Effect.CAMERA}, (HistoryKind.FRAMES, Illumination.WINDOW, Rectify.NONE)),
        ("gather-48", {Effect.CAMERA}, (HistoryKind.FRAMES, Illumination.STATIC, Rectify.NONE)),
        ("gather-48", None, (HistoryKind.FRAMES, Illumination.WINDOW, Rectify.NONE)),
        ("gather-8", {Effect.ILLUMINATION}, (HistoryKind.FRAMES, Illumination.WINDOW, Rectify.NONE)),
        ("gather-8", None, (HistoryKind.FRAMES, Illumination.WINDOW, Rectify.NONE)),
    ],
)
def test_windows_are_mixed_where_light_may_change(
    tier: str, effects: set[Effect] | None, expected: tuple[object, ...]
) -> None:
    frame = make_frame(1, camera=make_camera(), effects=None if effects is None else frozenset(effects))
    choices = plan_frame(load_preset(tier), frame, make_camera((1.0, 0.0, 5.0))).choices
    assert (choices.history, choices.illumination, choices.rectify) == expected
