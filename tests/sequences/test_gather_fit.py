"""What gathered samples are fitted to: planes, and two surfaces at a depth edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.frames import Camera, Effect, Frame
from cltaa.params import Preset, override
from cltaa.presets import load_preset
from cltaa.resolve import Resolver
from tests.kernels.test_resolve import differing, hard_frames
from tests.sequence_factory import make_camera, make_frame

PLACES = [(0.0, 0.0), (0.4, 0.1), (-0.3, 0.45), (0.25, 0.35), (0.45, -0.1)]  # not centred: they mean (0.16, 0.16)


def gathering(fit: str, **changes: object) -> Preset:
    values = {"history_of": "samples", "frames_kept": 7, "gather_fit": fit, "current_filter": "none", **changes}
    return override(load_preset(), {"weighting": "none", **values})


@pytest.mark.parametrize("fit", ["plane", "layers"])
@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("changes", [{}, {"rectify": "none", "reject": "none", "weighting": "none"}])
def test_strict_kernel_is_its_twin(fit: str, lanes: int, changes: dict[str, object]) -> None:
    assert differing({"history_of": "samples", "gather_fit": fit, **changes}, list(hard_frames(count=4)), lanes, 7) == 0


def ramp(index: int) -> Frame:
    """Red rises to the right and green downwards, sampled where the jitter says."""
    jitter = PLACES[index % len(PLACES)]
    frame = make_frame(index, camera=make_camera(), effects=frozenset({Effect.CAMERA}), jitter_px=jitter)
    y, x = np.mgrid[: frame.depth.shape[0], : frame.depth.shape[1]] / 16.0
    colour = np.stack([x + jitter[0] / 16, y + jitter[1] / 16, np.full_like(x, 0.5)], axis=-1).astype(np.float32)
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0))


@pytest.mark.parametrize(("fit", "off"), [("mean", 0.16 / 16), ("plane", 0.0), ("layers", 0.0)])
def test_a_ramp_is_found_at_the_centre_wherever_the_samples_lie(fit: str, off: float) -> None:
    resolver = Resolver(gathering(fit, fit_ridge=2.0**-6, frames_kept=4), "numpy")
    for index in range(5):
        resolved = resolver.resolve(ramp(index))
    y, x = np.mgrid[: resolved.shape[0], : resolved.shape[1]] / 16.0
    error = np.abs(resolved - np.stack([x, y, np.full_like(x, 0.5)], axis=-1))
    # The places spread least along one diagonal, by 0.10: there the ridge of 1/64 holds 13 % of the slope back.
    assert error.max() <= max(off * 1.01, 0.14 * 2**0.5 * 0.16 / 16)
    assert error[..., :2].min() >= off * 0.99


def bar_before_stripes(index: int, x: int) -> Frame:
    """A white bar at column x, a step further left than in the frame before, and a still wall of coloured columns."""
    frame = make_frame(index, motion=True, camera=make_camera(), effects=frozenset({Effect.MOTION, Effect.UNCOVER}))
    colour, depth = np.zeros_like(frame.colour), np.full_like(frame.depth, 5.0)
    motion = np.full((*depth.shape, 2), np.nan, np.float32)
    colour[:, :, 0] = (np.arange(colour.shape[1]) * 5 % 8)[None, :] / 8
    colour[:, x : x + 3], depth[:, x : x + 3], motion[:, x : x + 3] = 1.0, 2.0, (1.0, 0.0)
    return replace(frame, colour=colour, depth=depth, motion=motion, jitter_px=(0.0, 0.0))


@pytest.mark.parametrize(("fit", "clean"), [("plane", False), ("layers", True)])
def test_the_wall_beside_a_moving_bar_is_not_smeared(fit: str, *, clean: bool) -> None:
    resolver = Resolver(gathering(fit), "numpy")
    for index in range(6):
        frame = bar_before_stripes(index, 14 - index)
        resolved = resolver.resolve(frame)
    beside = 14 - 5 - 1  # not covered in any frame so far
    wrong = np.abs(resolved[:, beside] - frame.colour[:, beside]).max()
    assert wrong < 1e-6 if clean else wrong > 0.05


def test_samples_from_afar_count_only_where_they_lie_in_the_pixel() -> None:
    def zoomed(index: int) -> Frame:
        near = make_camera()
        clip = near.view_to_clip.copy()
        clip[[0, 1], [0, 1]] *= 2.0**index
        camera = Camera(near.world_to_view, clip)
        return make_frame(index, camera=camera, effects=frozenset({Effect.CAMERA}), jitter_px=(0.0, 0.0))

    # Sizes are odd. One frame at half the size shows a pixel of even column and row (from the middle) at a sample, and
    # one of odd ones half-way between two samples there: a whole pixel of now.
    changed = {}
    for reach in (0.6, 1.01):
        resolver = Resolver(gathering("plane", reject="none", fit_reach=reach), "numpy")
        for index in range(2):
            frame = zoomed(index)
            resolved = resolver.resolve(frame)
        changed[reach] = float((resolved != frame.colour).any(-1).mean())
    assert 0.2 < changed[0.6] < 0.3
    assert changed[1.01] > 0.9
