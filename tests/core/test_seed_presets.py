"""The seed presets against transcriptions of their articles and shaders that share no code with the stages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from cltaa.core.presets import preset_names
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from tests.core.transcriptions import babylon, bevy, godot, simvx, vireo
from tests.core.transcriptions.graphics import Array
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

Transcription = Callable[[list[Frame]], list[Array]]

SEEDS: dict[str, Transcription] = {
    "vireo-article": partial(vireo.resolve, constants=vireo.ARTICLE),
    "vireo-source": partial(vireo.resolve, constants=vireo.SOURCE),
    "simvx": simvx.resolve,
    "bevy": bevy.resolve,
    "godot": godot.resolve,
    **{f"babylon-{mode}": partial(babylon.resolve, mode=mode) for mode in babylon.MODES},
}

# The bound, for colours up to 1. float32 rounds colour at 6e-8, and a history position in a picture this wide
# at 2e-6 px: motion below is therefore dyadic where the colours are noise, and the colours smooth where it is not.
TOLERANCE = 1e-6
FRAMES = 6


def smooth(index: int) -> Image:
    """[H, W, 3] of 0.1 to 0.9 that changes by less than 0.1 a pixel and a little every frame."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    waves = [np.sin(0.13 * x * (k + 1) / 2 + 0.21 * y / (k + 1) + 0.5 * index + k) for k in range(3)]
    return (0.5 + 0.4 * np.stack(waves, axis=-1)).astype(np.float32)


def noise(index: int, *, own: bool, alpha: bool = False) -> Frame:
    """Random colours up to 1 before a still camera, with motion in eighths of a pixel up to 5 px, or none."""
    frame = make_frame(index, alpha=alpha, camera=make_camera(), effects=None)
    steps = np.random.default_rng(index).integers(-40, 41, (HEIGHT, WIDTH, 2))
    return replace(
        frame, colour=frame.colour * np.float32(0.25), motion=(steps / 8).astype(np.float32) if own else None
    )


def moving_camera(index: int) -> Frame:
    """Smooth colours, rough depth and sky before a camera that moves; a third of the pixels have motion too."""
    camera = make_camera((0.11 * index, -0.05 * index, 5.0 - 0.2 * index))
    frame = make_frame(index, motion=True, camera=camera, effects=None)
    assert frame.motion is not None
    frame.motion[np.random.default_rng(index).random((HEIGHT, WIDTH)) > 1 / 3] = np.nan
    return replace(frame, colour=smooth(index))


def declared_still(index: int) -> Frame:
    return replace(noise(index, own=False), effects=frozenset({Effect.SKY}))


def grey(index: int) -> Frame:
    """Chroma is exactly 0 there, so that a box is flat in two channels."""
    frame = moving_camera(index)
    return replace(frame, colour=np.repeat(frame.colour[..., :1], 3, axis=2))


def cut_in_the_middle(index: int) -> Frame:
    return replace(noise(index, own=True), cut=index == FRAMES // 2)


CASES: dict[str, Callable[[int], Frame]] = {
    "still": partial(noise, own=False),
    "alpha": partial(noise, own=True, alpha=True),
    "camera and own motion": moving_camera,
    "declared still": declared_still,
    "grey": grey,
    "cut": cut_in_the_middle,
}


def worst_difference(name: str, frames: list[Frame], device: str | None) -> float:
    resolver = Resolver(name, device)
    expected = SEEDS[name](frames)
    return max(float(np.abs(resolver.resolve(f) - e).max()) for f, e in zip(frames, expected, strict=True))


def test_every_seed_is_a_preset() -> None:
    assert set(SEEDS) <= set(preset_names())


@pytest.mark.parametrize("name", sorted(SEEDS))
def test_the_oracle_is_the_article(name: str) -> None:
    for case, frame in CASES.items():
        frames = [frame(index) for index in range(FRAMES)]
        assert worst_difference(name, frames, "numpy") <= TOLERANCE, case


@pytest.mark.parametrize(("name", "case"), [("godot", "camera and own motion"), ("vireo-source", "alpha")])
def test_the_device_is_the_article(name: str, case: str) -> None:
    """Of two presets: a strict build is the oracle, and a fast one lies within the bounds of tests/numerics."""
    frames = [CASES[case](index) for index in range(FRAMES)]
    assert worst_difference(name, frames, None) <= TOLERANCE


# The way back from a tonemap multiplies what is rounded by the square of the light.
@pytest.mark.parametrize("name", sorted(set(SEEDS) - {"bevy", "godot"}))
def test_highlights_follow_the_article(name: str) -> None:
    frames = [replace(f, colour=f.colour * 64) for f in (noise(index, own=True) for index in range(FRAMES))]
    assert worst_difference(name, frames, "numpy") <= 64 * TOLERANCE
