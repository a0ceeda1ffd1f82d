"""What gathered samples are fitted to, which of them count, and sub-pixel features that the current ones may miss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame
from cltaa.reference.gather_fit import SampleSums, fit_at_centre
from cltaa.reference.real import quiet
from tests.last_frame import last_planes
from tests.sequence_factory import make_camera, make_frame

PLACES = [(0.0, 0.0), (0.4, 0.1), (-0.3, 0.45), (0.25, 0.35), (0.45, -0.1)]  # not centred: they mean (0.16, 0.16)


def gathering(**changes: object) -> Preset:
    values = {"history": "frames", "history_frames": 7, "current_filter": "none", **changes}
    return override(load_preset(), {"weighting": "none", "illumination": "static", **values})


def ramp(index: int) -> Frame:
    """Red rises to the right and green downwards, sampled where the jitter says."""
    jitter = PLACES[index % len(PLACES)]
    frame = make_frame(index, camera=make_camera(), effects=frozenset({Effect.DISOCCLUSION}), jitter_px=jitter)
    y, x = np.mgrid[: frame.depth.shape[0], : frame.depth.shape[1]] / 16.0
    colour = np.stack([x + jitter[0] / 16, y + jitter[1] / 16, np.full_like(x, 0.5)], axis=-1).astype(np.float32)
    return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0))


def test_a_ramp_is_found_at_the_centre_wherever_the_samples_lie() -> None:
    resolver = Resolver(gathering(fit_ridge=2.0**-6, history_frames=4), "numpy")
    for index in range(5):
        resolved = resolver.resolve(ramp(index))
    y, x = np.mgrid[: resolved.shape[0], : resolved.shape[1]] / 16.0
    error = np.abs(resolved - np.stack([x, y, np.full_like(x, 0.5)], axis=-1))
    # The places spread least along one diagonal, by 0.10: there the ridge of 1/64 holds 13 % of the slope back.
    assert error.max() <= 0.14 * 2**0.5 * 0.16 / 16


def test_distant_samples_count_only_within_the_pixel() -> None:
    def zoomed(index: int) -> Frame:
        near = make_camera()
        clip = near.view_to_clip.copy()
        clip[[0, 1], [0, 1]] *= 2.0**index
        camera = Camera(near.world_to_view, clip)
        return make_frame(index, camera=camera, effects=frozenset({Effect.DISOCCLUSION}), jitter_px=(0.1, 0.1))

    # Sizes are odd. One frame at half the size, its samples moved by 0.2 pixels of now, shows a pixel of even column
    # and row (from the middle) 0.2 pixels from a sample, and one of odd ones 0.8 pixels from one.
    changed = {}
    for reach in (0.6, 0.9):
        resolver = Resolver(gathering(reject="none", fit_reach=reach), "numpy")
        for index in range(2):
            frame = zoomed(index)
            resolved = resolver.resolve(frame)
        changed[reach] = float((resolved != frame.colour).any(-1).mean())
    assert 0.2 < changed[0.6] < 0.3
    assert changed[0.9] > 0.9


def test_a_sample_beside_the_pixel_counts_by_how_near_it_lies() -> None:
    # A step of red half-way across the image, and a jitter of 0.4 pixels: of the column beside the step, whose own
    # sample lies to the right of its centre, the one to the left lies 0.6 pixels from it.
    def step(index: int) -> Frame:
        frame = make_frame(index, camera=make_camera(), effects=frozenset({Effect.DISOCCLUSION}), jitter_px=(0.4, 0.0))
        colour = np.zeros_like(frame.colour)
        colour[:, 10:] = 1.0
        return replace(frame, colour=colour, depth=np.full_like(frame.depth, 5.0))

    preset = gathering(fit_reach=0.75, fit_ridge=2.0**20, rectify="none", history_frames=3)
    resolver = Resolver(preset, "numpy")
    for index in range(4):
        resolved = resolver.resolve(step(index))
    # Windows of 0.7 and 0.3; the frame of now holds one sample that counts wholly. The ridge leaves a mean.
    expected = np.where(np.arange(resolved.shape[1]) < 10, 0.0, 1.0)
    expected[10] = (1 + 3 * 0.7) / (1 + 3)
    inner = (slice(1, -1), slice(1, -1))
    assert np.abs(resolved[..., 0] - expected)[inner].max() < 1e-5


def approaching(index: int, z: float) -> Frame:
    """A thing of one random colour a pixel that fills the image and comes closer, hardly moving in it."""
    frame = make_frame(index, motion=True, camera=make_camera(), effects=frozenset({Effect.MOTION}))
    depth, motion = np.full_like(frame.depth, z), np.full((*frame.depth.shape, 2), 2.0**-7, np.float32)
    return replace(frame, depth=depth, motion=motion, jitter_px=(0.0, 0.0))


def test_what_comes_closer_by_itself_keeps_its_samples() -> None:
    # 4 % a frame: within the 5 % of the depth test from one frame to the next, and far outside from the first on.
    resolver = Resolver(gathering(history_frames=7), "numpy")
    for index in range(8):
        resolver.resolve(approaching(index, 5.0 * 1.04 ** (7 - index)))
    assert (last_planes(resolver, "output_count")[0] == 8).all()


def test_weights_whose_squares_are_0_are_fitted_without_a_warning() -> None:
    weight = np.full((1, 1), 1e-30, np.float32)  # of a sample of luminance 1e30
    place = np.full_like(weight, 0.25)
    gathered = SampleSums(np.zeros_like(weight))
    gathered.add(np.stack([place] * 3), weight, place, place, np.ones((1, 1), bool))
    settings = np.array([(0.1,)], [("fit_ridge", np.float32)])[0]
    with quiet:  # as all that gathers is called; a warning would fail the test
        fit = fit_at_centre(gathered, np.ones_like(weight), settings)
    assert not np.isfinite(fit.x).any()


def wire(index: int) -> Frame:
    """A white wire that every other frame's samples hit, before a black wall."""
    frame = make_frame(index, camera=make_camera(), effects=frozenset({Effect.DISOCCLUSION, Effect.THIN}))
    colour, depth = np.zeros_like(frame.colour), np.full_like(frame.depth, 5.0)
    if index % 2 == 0:
        colour[:, 10], depth[:, 10] = 1.0, 2.0
    return replace(frame, colour=colour, depth=depth, jitter_px=(0.0, 0.0))


@pytest.mark.parametrize(("subpixel_frames", "share"), [(1, 0.5), (0, 0.0)])
def test_a_wire_that_this_frame_misses_is_still_there(subpixel_frames: int, share: float) -> None:
    resolver = Resolver(gathering(subpixel_frames=subpixel_frames), "numpy")
    for index in range(8):  # the last one misses it
        resolved = resolver.resolve(wire(index))
    assert resolved[:, 10] == pytest.approx(share, abs=1e-6)
    assert (np.delete(resolved, 10, axis=1) == 0.0).all()
    hit = resolver.resolve(wire(8))
    assert hit[:, 10] == pytest.approx(0.5, abs=1e-6)


def test_a_surface_wider_than_a_line_is_not_restored_once_it_has_left() -> None:
    resolver = Resolver(gathering(), "numpy")
    for index in range(6):
        frame = wire(1)
        colour, depth = frame.colour.copy(), frame.depth.copy()
        if index < 5:
            colour[4:9, 6:12], depth[4:9, 6:12] = 1.0, 2.0
        resolved = resolver.resolve(replace(frame, index=index, colour=colour, depth=depth))
    assert (resolved[5:8, 7:11] == 0.0).all()
