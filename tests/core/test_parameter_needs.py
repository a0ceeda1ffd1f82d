"""The table of what a parameter needs: without that it changes no bit of any result, and with it some."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

from cltaa.commands.options import assigned
from cltaa.core.parameter_needs import NEEDS, unmet
from cltaa.core.parameters import Choices, Settings
from cltaa.core.plan import CHANGING_LIGHT
from cltaa.core.presets import FIELDS, Preset, load_preset, override, words_of
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.io.preset_file import read_preset
from tests.sequence_factory import make_frame

FRAMES = 5
SIZE: dict[str, Any] = {"width": 15, "height": 11}
# Each key of the table has an effect in one of these, and most have none in another.
POOL = "accumulate", "basic", "bevy", "default", "fast", "fsr3-like", "gather-8", "vireo-article"
CHANGED: dict[str, tuple[dict[str, Any], ...]] = {
    "default": ({"fireflies": "clamp", "firefly_threshold": 1.0},),
    "basic": ({"anti_flicker": "difference"}, {"box_scale_static": 0.5}),
    "fast": ({"tonemap": "peak"},),
}
# What frames of noise do not show: features of less than a pixel, occluders, light that falls, the sky at a depth of
# its own, cameras that turn, pixels that stand still.
RARE = {
    *("covered_share", "disocclusion_t", "falling_t", "ray_through", "recursion", "refuted_samples", "sky_below"),
    "subpixel_frames",
}


@cache
def frames() -> tuple[Frame, ...]:
    """Frames of which no plan leaves out a step: light that changes, a camera that slides, no effect declared."""
    one, made = make_frame(0, motion=True, alpha=True, effects=None, **SIZE), []
    for index in range(FRAMES):
        other = make_frame(index, **SIZE)
        jitter = (0.75 * index) % 1 - 0.5, (0.57 * index) % 1 - 0.5
        colour = one.colour * np.float32(1 + index) + other.colour
        made.append(replace(one, index=index, colour=colour, camera=other.camera, jitter_px=jitter))
    return tuple(made)


def resolved(preset: Preset) -> bytes:
    return b"".join(image.tobytes() for image in Resolver(preset, "numpy").images(frames()))


def others(key: str) -> list[Any]:
    """Values of a parameter, far apart."""
    if FIELDS[key] is Choices:
        return words_of(key)
    hint: Any = get_type_hints(Settings, include_extras=True)[key]
    low, high = hint.__metadata__[0].ge, min(hint.__metadata__[0].le, 50.0)
    return [int(low) + 1, int(high)] if hint.__origin__ is int else [low, 0.1 * high, high]


def lacks(preset: Preset, key: str) -> bool:
    return any(unmet(key, preset.choices, preset.settings))


def test_a_parameter_without_what_it_needs_changes_no_bit_and_else_some() -> None:
    shown: set[str] = set()
    for name in POOL:
        for over in ({}, *CHANGED.get(name, ())):
            preset = override(load_preset(name), over)
            base = resolved(preset)
            for key in NEEDS:
                if lacks(preset, key):
                    changed = override(preset, {key: others(key)[-1]})
                    assert resolved(changed) == base, (name, over, key)
                elif key not in shown | RARE and any(resolved(override(preset, {key: v})) != base for v in others(key)):
                    shown.add(key)
    assert shown == NEEDS.keys() - RARE


@pytest.mark.parametrize("key", ["illumination_t", "illumination_decay", "largest_t"])
def test_parameters_of_the_illumination_test_have_an_effect_in_a_box_among_noise(key: str) -> None:
    noisy = [replace(frame, effects=frozenset({Effect.CAMERA, Effect.NOISE, *CHANGING_LIGHT})) for frame in frames()]

    def image(preset: Preset) -> bytes:
        return list(Resolver(preset, "numpy").images(noisy))[-1].tobytes()

    boxed = load_preset("basic")
    assert not lacks(boxed, key)
    assert any(image(override(boxed, {key: value})) != image(boxed) for value in others(key))


UNUSED = r"blend_weight changes nothing in preset default \(expected accumulate other than count, found accumulate = "
UNUSED += r"count\); set that too, or leave it out"


def test_a_parameter_without_effect_is_told(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=f"^--set: {UNUSED}"):
        assigned(load_preset(), ("blend_weight=0.2",))
    with pytest.warns(UserWarning, match=f"^Preset.replace: {UNUSED}") as told:
        load_preset().replace(blend_weight=0.2)
    assert [warning.filename for warning in told] == [__file__]
    load_preset().replace(blend_weight=0.2, accumulate="exponential")  # whose warning would be an error
    path = tmp_path / "a.toml"
    path.write_text("blend_weight = 0.2")
    with pytest.warns(UserWarning, match=f"a.toml: {UNUSED}") as told:
        read_preset(path)
    assert [warning.filename for warning in told] == [__file__]
