"""What README promises of a resolve: where nothing is declared, where no effect is, and where each one is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.parameters import Tonemap
from cltaa.core.presets import load_preset, override, preset_names
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from tests.core.standing import panned
from tests.sequence_factory import EVERY_CHANNEL, any_bits, make_camera, make_frame

WIDTH, HEIGHT = 20, 12
PRESETS = pytest.mark.parametrize("name", preset_names())


def declared(name: str) -> list[frozenset[Effect] | None]:
    """What may be declared that bears on a preset: the plan of a published one leaves nothing out."""
    return [None, frozenset()] if load_preset(name).published else [None, frozenset(), frozenset(Effect)]


def images_of(name: str, frames: list[Frame]) -> list[Image]:
    resolver = Resolver(load_preset(name), "numpy")
    return [image for frame in frames for image in resolver.feed(frame)] + resolver.flush()


@PRESETS
@pytest.mark.filterwarnings("ignore::cltaa.core.frame_checks.MeaninglessNumbers")  # of alpha beyond 0 to 1
def test_any_bits_give_a_finite_result(name: str) -> None:
    for effects in declared(name):
        rng, frames = np.random.default_rng(0), []
        for number in range(3):
            frame = make_frame(number, width=WIDTH, height=HEIGHT, effects=effects, **EVERY_CHANNEL)
            wild: dict[str, Any] = {
                each: any_bits(rng, getattr(frame, each)) for each in ("colour", "depth", *EVERY_CHANNEL)
            }
            frames.append(replace(frame, **wild))
        assert all(np.isfinite(image).all() for image in images_of(name, frames)), effects


def constant(number: int, level: float, effects: frozenset[Effect] | None) -> Frame:
    """A frame of one colour and alpha before a camera that stands."""
    frame = make_frame(0, width=WIDTH, height=HEIGHT, alpha=True, effects=effects, camera=make_camera())
    colour = np.full_like(frame.colour, level) * np.array([1.0, 0.5, 3.0], np.float32)
    jitter = (number * 0.7548776662) % 1 - 0.5, (number * 0.5698402910) % 1 - 0.5
    alpha = np.full_like(frame.depth, 0.37)
    return replace(frame, index=number, colour=colour, alpha=alpha, jitter_px=jitter)


@PRESETS
def test_a_constant_image_keeps_its_bits(name: str) -> None:
    """But where a preset tonemaps, which rounds twice a frame and adds nothing up."""
    exact = load_preset(name).choices.tonemap is Tonemap.NONE
    for effects in declared(name):
        frames = [constant(number, 0.3, effects) for number in range(10)]
        for frame, image in zip(frames, images_of(name, frames), strict=True):
            np.testing.assert_allclose(image[..., :3], frame.colour, 0.0 if exact else 2.0**-20, err_msg=str(effects))
            assert np.array_equal(image[..., 3], np.full_like(frame.depth, 0.37)), effects


@pytest.mark.parametrize("effects", [None, frozenset(Effect) - {Effect.NOISE}], ids=["nothing", "all"])
@pytest.mark.parametrize("name", ["default", "fast", "basic"])
def test_history_moves_by_whole_pixels_without_loss(name: str, effects: frozenset[Effect] | None) -> None:
    """A picture that the camera pans over: where all history is the picture's, so is the result, but for the filter.

    Among noise the box of ``fast`` is narrow, and moves the history of an edge.
    """
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    frames, camera = [], make_camera()
    for number in range(6):
        base = make_frame(number, width=WIDTH, height=HEIGHT, effects=effects, camera=camera, jitter_px=(0.0, 0.0))
        light = 1.0 + 0.25 * np.floor((x + number) / 3) + 0.125 * y
        colour = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
        frames.append(replace(base, colour=colour, depth=np.full_like(base.depth, 4.0)))
        camera = panned(camera, 1, WIDTH)
    resolver = Resolver(override(load_preset(name), {"current_filter": "none"}), "numpy")
    resolved = [resolver.resolve(frame) for frame in frames][-1]
    inside = np.s_[2:-2, 2:-8]
    np.testing.assert_array_equal(resolved[inside], frames[-1].colour[inside])


@pytest.mark.parametrize(
    ("effects", "samples"), [(None, 25), (frozenset(), 31), (frozenset({Effect.DISOCCLUSION}), 25)]
)
def test_the_default_counts_all_samples_only_where_nothing_is_declared_to_change(
    effects: frozenset[Effect] | None, samples: int
) -> None:
    """After 30 frames a brighter one counts for one of 31 samples, or of 25: 24 of the history and itself."""
    step = 1e-3
    frames = [constant(number, 0.5 if number < 30 else 0.5 + step, effects) for number in range(31)]
    image = images_of("default", frames)[-1]
    assert (image[..., 0] - 0.5).mean() / step == pytest.approx(1 / samples, rel=2e-3)
