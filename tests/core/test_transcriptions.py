"""The transcriptions themselves, where the answer can be worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.frame import Frame
from tests.core.transcriptions import babylon, simvx, vireo
from tests.core.transcriptions.graphics import Array, velocity_buffer
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame

VIREO = [vireo.ARTICLE, vireo.SOURCE]


def flat(index: int, value: float, *, motion: tuple[float, float] | None = None, alpha: float | None = None) -> Frame:
    """A frame of one grey, whose every pixel moved by ``motion``."""
    frame = make_frame(index, camera=make_camera(), effects=None)
    return replace(
        frame,
        colour=np.full_like(frame.colour, value),
        motion=None if motion is None else np.broadcast_to(np.array(motion, np.float32), (HEIGHT, WIDTH, 2)).copy(),
        alpha=None if alpha is None else np.full_like(frame.depth, alpha),
    )


def board(index: int, **changes: object) -> Frame:
    """A chess board of 0 and 1: grey 0.5 lies inside every 3x3 box, and any grey within sigma, almost 0.5, of 4/9."""
    frame = flat(index, 0.0)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    frame.colour[:] = ((x + y) % 2)[..., None]
    return replace(frame, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("constants", VIREO)
def test_vireo_at_rest_keeps_the_share_of_the_article(constants: vireo.Constants) -> None:
    frame = board(1)
    resolved = vireo.resolve([flat(0, 0.5), frame], constants)[1]
    assert np.allclose(resolved, frame.colour + (0.5 - frame.colour) * constants.rest, atol=1e-15)


@pytest.mark.parametrize("constants", VIREO)
def test_vireo_in_motion_follows_the_length_in_uv(constants: vireo.Constants) -> None:
    motion = (0.25, -0.125)
    share = np.hypot(motion[0] / WIDTH, motion[1] / HEIGHT) * constants.velocity_scale
    assert share < 1
    frame = board(1, motion=flat(1, 0.0, motion=motion).motion)
    resolved = vireo.resolve([flat(0, 0.5), frame], constants)[1]
    weight = constants.rest + (constants.moving - constants.rest) * share
    assert np.allclose(resolved, frame.colour + (0.5 - frame.colour) * weight, atol=1e-15)


@pytest.mark.parametrize("constants", VIREO)
def test_vireo_weighs_the_current_frame_by_what_it_clamped(constants: vireo.Constants) -> None:
    past, frame = 1.1, board(1)
    resolved = vireo.resolve([flat(0, past), frame], constants)[1]
    dark = (frame.colour == 0.0)[..., 0]
    dark[[0, -1]] = dark[:, [0, -1]] = False  # edges repeat, which changes the counts
    # Four of the nine are 1: the history is cut to mean + sigma.
    cut = 4 / 9 + np.sqrt(4 / 9 - (4 / 9) ** 2)
    given_way = constants.clamp_scale * (np.float64(np.float32(past)) - cut)
    assert 0 < given_way < 1
    weight = constants.rest + (constants.moving - constants.rest) * given_way
    assert np.allclose(resolved[dark], cut * weight, atol=1e-14)


@pytest.mark.parametrize("position", [0.5, 7.25, 3.999])
def test_catmull_rom_is_exact_on_quadratics(position: float) -> None:
    x = np.arange(12) + 0.5
    image = np.stack([x**2 / 100 - x / 10] * 3, axis=-1)[None].repeat(3, 0)
    at = np.full((1, 1), position + 2)
    sampled = vireo.catmull_rom(image, at, np.full((1, 1), 1.5))[0, 0, 0]
    assert sampled == pytest.approx((position + 2) ** 2 / 100 - (position + 2) / 10, abs=1e-14)


@pytest.mark.parametrize("resolve", [lambda f: vireo.resolve(f, vireo.SOURCE), simvx.resolve])
def test_off_screen_is_the_current_texel(resolve: object) -> None:
    assert callable(resolve)
    random = make_frame(1, camera=make_camera(), effects=None)
    frame = replace(random, motion=flat(1, 0.0, motion=(3.5, 0.0)).motion)
    resolved: Array = resolve([flat(0, 0.5), frame])[1]
    fresh = (resolved == frame.colour).all(-1)
    # h = x + 0.5 + 3.5: exactly at the border it is still inside.
    assert list(np.flatnonzero(fresh.all(0))) == list(range(WIDTH - 3, WIDTH))
    assert not fresh[:, : WIDTH - 3].any()


def test_babylon_seeds_its_box_with_nought_and_one() -> None:
    bright = babylon.resolve([flat(0, 2.0), flat(1, 3.0)], "reproject-clamp")[1]
    assert np.allclose(bright, 2.0 + 0.05 * 1.0)  # 2 lies in [1, 3]; a true least would have made it 3
    dark = babylon.resolve([flat(0, -0.5), flat(1, -1.0)], "reproject-clamp")[1]
    assert np.allclose(dark, -0.5 + 0.05 * -0.5)  # -0.5 lies in [-1, 0]
    seen = babylon.resolve([flat(0, 0.2, alpha=0.5), flat(1, 0.2, alpha=0.25)], "reproject-clamp")[1][..., 3]
    assert np.allclose(seen, 0.25)  # alpha has a box of its own


def test_babylon_ignores_what_left_the_screen() -> None:
    resolved = babylon.resolve([flat(0, 0.5), flat(1, 0.25, motion=(3.0 * WIDTH, 0.0))], "reproject")[1]
    assert np.allclose(resolved, 0.5 + 0.05 * (0.25 - 0.5))


def test_babylon_switches_off_while_the_camera_moves() -> None:
    moved = replace(flat(1, 0.25), camera=make_camera((0.1, 0.0, 5.0)))
    stopped = replace(flat(2, 0.75), camera=moved.camera)
    resolved = babylon.resolve([flat(0, 0.5), moved, stopped], "disable-on-camera-move")
    assert np.array_equal(resolved[1], moved.colour)
    assert np.allclose(resolved[2], 0.25 + 0.05 * 0.5)
    assert np.allclose(babylon.resolve([flat(0, 0.5), moved], "accumulate")[1], 0.5 + 0.05 * (0.25 - 0.5))


def test_simvx_blends_one_tenth() -> None:
    frame = board(1)
    assert np.allclose(simvx.resolve([flat(0, 0.5), frame])[1], frame.colour + (0.5 - frame.colour) * 0.9, atol=1e-15)


def test_simvx_takes_fast_motion_for_the_sentinel() -> None:
    previous = flat(0, 0.5)
    for share, believed in ((0.74, True), (0.75, False)):
        x, _ = simvx.history_position(flat(1, 0.5, motion=(share * WIDTH, 0.0)), previous)
        centres = np.arange(WIDTH) + 0.5
        assert np.allclose(x, centres + (share * WIDTH if believed else 0.0), atol=1e-5)


def test_simvx_puts_the_sky_at_a_finite_distance() -> None:
    previous = flat(0, 0.5)
    near, far, step = 0.1, 100.0, 0.5
    frame = replace(flat(1, 0.5), camera=make_camera((step, 0.0, 5.0)))
    frame.depth[:] = np.inf
    # Reverse-Z depth 1e-3 of a camera with these planes: d = near (far - Z) / (Z (far - near)).
    distance = near * far / (1e-3 * (far - near) + near)
    x, _ = simvx.history_position(frame, previous)
    focal = frame.camera.view_to_clip[0, 0]
    assert np.allclose(x - (np.arange(WIDTH) + 0.5), focal * step / distance * WIDTH / 2, atol=1e-9)


def test_the_velocity_is_that_of_the_jittered_sample() -> None:
    previous, step, depth = flat(0, 0.5), 0.5, 4.0
    sideways = replace(flat(1, 0.5), camera=make_camera((step, 0.0, 5.0)))
    sideways.depth[:] = depth
    sideways.depth[0] = np.inf
    velocity = velocity_buffer(sideways, previous)
    focal = sideways.camera.view_to_clip[0, 0]
    assert np.allclose(velocity[1:, :, 0], focal * step / depth * WIDTH / 2, atol=1e-12)
    assert np.allclose(velocity[0], 0.0, atol=1e-12)  # a direction does not move when the camera only shifts
    forward = replace(sideways, camera=make_camera((0.0, 0.0, 4.0)))
    velocity = velocity_buffer(forward, previous)
    from_middle = np.arange(WIDTH) + 0.5 + forward.jitter_px[0] - WIDTH / 2
    assert np.allclose(velocity[1:, :, 0], from_middle * (depth / (depth + 1.0) - 1.0), atol=1e-12)


def test_the_jitter_covers_what_each_source_covers() -> None:
    cases = ((vireo.jitter_px, 16, 0.25), (babylon.jitter_px, 8, 0.5), (simvx.jitter_px, 8, 0.5))
    for jitter_px, period, reach in cases:
        offsets = np.array([jitter_px(index) for index in range(2 * period)])
        assert np.array_equal(offsets[:period], offsets[period:])
        assert len({tuple(offset) for offset in offsets}) == period
        assert 0.8 * reach < np.abs(offsets).max() < reach
    assert np.allclose(simvx.jitter_px(0), (1 / 4 - 1 / 2, 2 / 3 - 1 / 2))  # index 2 comes first
