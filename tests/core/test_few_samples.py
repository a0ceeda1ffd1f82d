"""The current filter: its weights, and where samples are few; the width of the box where nothing moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.build import Build, settings_record
from cltaa.core.parameters import BoxSpace, Choices, CurrentFilter, Settings
from cltaa.core.plan import plan_frame
from cltaa.core.planes import Layout
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.record import Past, axis_weights, frame_record
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.reference.neighbourhood import Statistics
from cltaa.reference.real import Run
from cltaa.reference.rectify import rectify
from cltaa.reference.reprojection import Motion
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

SOMETHING = frozenset({Effect.DISOCCLUSION, Effect.SKY})


def few(history: str, **changes: object) -> Preset:
    values = {"history": history, "weighting": "none", "rectify": "none", "reject": "none", "resampling_penalty": 0.0}
    return override(load_preset(), {**values, **changes})


def dotted(index: int, **changes: Any) -> Frame:
    """Black but for one white texel, sampled at the pixels' centres by a camera that stands."""
    frame = make_frame(index, camera=make_camera(), effects=SOMETHING, jitter_px=(0.0, 0.0))
    colour = np.zeros_like(frame.colour)
    colour[10, 12] = 1.0
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0), **changes)


def test_jitter_weighs_the_corners_that_it_leads_to() -> None:
    """Left and up: what is drawn to the right of a sample and below it lies nearer to its pixel's centre."""
    frame, preset = dotted(1, jitter_px=(-0.25, -0.1)), few("accumulated", filter_use="always")
    record = frame_record(frame, Past.of(dotted(0)), Layout(WIDTH, HEIGHT), plan_frame(preset, frame, frame.camera))
    across, down = record["right_weight"] / record["left_weight"], record["below_weight"] / record["above_weight"]
    assert across > 1.1 * down > 1.1


@pytest.mark.parametrize("history", ["accumulated", "frames"])
@pytest.mark.parametrize("beyond", [1.0, 3.0, 8.0])
def test_the_filter_has_the_share_of_one_sample_and_fades_sooner(history: str, beyond: float) -> None:
    resolver = Resolver(few(history, filter_samples=beyond), "numpy")
    side = np.exp(-np.float32(resolver.preset.settings.filter_falloff))
    middle = 1 / (1 + 2 * side) ** 2
    kept = 0.0
    for number in range(1, 9):
        value = resolver.resolve(dotted(number - 1))[10, 12, 0]
        # The recurrent image keeps what the filter took of each sample: 1/n of the n-th, and less beyond the setting.
        # Beside a ring, a quarter of the setting counts where light is not known to change.
        later = max(beyond / 4, 1.0) if history == "frames" else beyond
        share = min(1 / number, later / number**2) if number > 1 else 1.0
        kept += share
        # Kept samples are filtered anew in each frame: nothing adds up.
        taken = share if history == "frames" else kept / number
        assert abs(value - (1 - (1 - middle) * taken)) < 1e-6


@pytest.mark.parametrize("history", ["accumulated", "frames"])
def test_after_a_cut_a_frame_is_the_filter_alone(history: str) -> None:
    resolver = Resolver(few(history), "numpy")
    side = np.exp(-np.float32(resolver.preset.settings.filter_falloff))
    resolver.resolve(dotted(0))
    assert abs(resolver.resolve(dotted(1, cut=True))[10, 12, 0] - 1 / (1 + 2 * side) ** 2) < 1e-6


def test_a_pixel_that_comes_into_view_is_the_filter_alone() -> None:
    resolver = Resolver(few("accumulated", reject="depth"), "numpy")
    resolver.resolve(dotted(0))
    nearer = dotted(1)
    resolved = resolver.resolve(replace(nearer, depth=np.full_like(nearer.depth, 2.0)))
    side = np.exp(-resolver.preset.settings.filter_falloff)
    weights = np.array([side, 1, side]) / (1 + 2 * side)
    assert np.abs(resolved[9:12, 11:14, 0] - np.outer(weights, weights)).max() < 1e-6


def test_a_highlight_does_not_leak_through_the_filter() -> None:
    resolver = Resolver(few("accumulated", weighting="luminance"), "numpy")
    frames = [dotted(index, effects=SOMETHING | {Effect.HDR}) for index in range(3)]
    for frame in frames:
        resolved = resolver.resolve(replace(frame, colour=frame.colour * np.float32(1e4)))
    # Without the two weights the filter alone would give the pixel beside 1e4 / 3 times 0.1.
    assert resolved[10, 13, 0] < 0.1


@pytest.mark.parametrize(("gamma", "moved"), [(1.0, 2.0), (2.0, 1.0), (3.0, 0.0), (8.0, 0.0)])
def test_the_box_of_extremes_is_widened_by_gamma(gamma: float, moved: float) -> None:
    layout = Layout(1, 1)
    one = np.ones((1, 1), np.float32)
    zero = 0 * one
    near = Statistics(*(np.stack([v * one] * 3) for v in (0.0, 1.0, -1.0, 1.0)))
    build = Build(choices=Choices(box_space=BoxSpace.RGB))
    still = Motion(zero, zero, one, zero, one > 0)
    history = np.stack((3 * one, zero, -3 * one))
    found = rectify(
        history, 0 * history, near, still, gamma * one, Run(build, layout, settings=settings_record(Settings()))
    )
    assert [float(v[0, 0]) for v in found.change] == [-moved, 0.0, moved]


Kernel = Callable[[np.ndarray], np.ndarray]
FALLOFF = 1.7
KERNELS: dict[str, Kernel] = {
    "none": lambda _: np.array([0.0, 1.0, 0.0]),
    "bilinear": lambda d: np.maximum(0.0, 1.0 - d),
    "gaussian": lambda d: np.exp(-FALLOFF * d**2),
    # As FSR writes it.
    "lanczos": lambda d: np.where(d < 2, (25 / 16 * (0.4 * d**2 - 1) ** 2 - 9 / 16) * (0.25 * d**2 - 1) ** 2, 0.0),
}


@pytest.mark.parametrize("kind", CurrentFilter)
def test_weights_are_shares_of_the_kernel_at_each_sample(kind: CurrentFilter) -> None:
    choices, settings = Choices(current_filter=kind), Settings(filter_falloff=FALLOFF)
    for jitter in (-0.45, 0.0, 0.3, 1.4):
        values = KERNELS[kind](np.abs(np.array([-1.0, 0.0, 1.0]) + jitter))
        before, _, after = values / values.sum()
        # A dozen roundings of doubles of the order of 1.
        assert axis_weights(jitter, choices, settings) == pytest.approx((before, after), rel=0, abs=16 * 2.0**-52)
