"""The reference is the mean of its samples, and that mean goes to the covered area."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa_capture.jitter import jitter_sequence
from tests.capture.analytic_scenes import HEIGHT, PIXELS, WHITE, WIDTH, drawing, instant, place, quad, scene

SNAP = 1.0 / 256.0  # pixels; the rasteriser's vertex grid
SLOPE = 0.3  # radians
FINE = 64  # samples a side for the covered area: an edge of a pixel is off by at most 1/64 of a column's height


def turned_edge() -> np.ndarray:
    """Pose of a big square whose left edge runs through the picture's centre at a slant."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(SLOPE), -np.sin(SLOPE)], [np.sin(SLOPE), np.cos(SLOPE)]]
    return np.asarray(turn @ place(60.0, 0.0, 0.0))


def covered_area() -> np.ndarray:
    """Share of every pixel right of that edge, exact along x: the mean over rows of a clipped distance."""
    y = (np.arange(HEIGHT * FINE) + 0.5) / FINE - HEIGHT / 2.0  # down
    edge = y * np.tan(SLOPE)  # x of the edge at this height; y is down, so it leans to the right below
    x = np.arange(WIDTH) - WIDTH / 2.0
    share = np.clip(x[None, :] + 1.0 - edge[:, None], 0.0, 1.0)
    return np.asarray(share.reshape(HEIGHT, FINE, WIDTH).mean(axis=1))


def test_reference_is_the_mean_of_its_samples() -> None:
    now = instant(turned_edge())
    offsets = jitter_sequence("hammersley:16")
    with drawing(scene(lambda _: now, (quad(60.0), WHITE))) as renderer:
        reference = renderer.draw_reference(now, offsets)
        samples = [renderer.draw(now, now, (x, y)).colour for x, y in offsets.tolist()]
    assert np.array_equal(reference, np.mean(samples, axis=0, dtype=np.float64).astype(np.float32))


@pytest.mark.parametrize("count", [16, 64])
def test_upright_edge_is_integrated_to_one_over_n(count: int) -> None:
    now = instant(place(4.37, 0.0, 0.0))  # right edge at 8.37 pixels from the centre
    with drawing(scene(lambda _: now, (quad(4.0), WHITE))) as renderer:
        reference = renderer.draw_reference(now, jitter_sequence(f"hammersley:{count}"))
    row = reference[HEIGHT // 2, WIDTH // 2 :, 0]
    expected = np.clip(8.37 - np.arange(WIDTH // 2), 0.0, 1.0) - np.clip(0.37 - np.arange(WIDTH // 2), 0.0, 1.0)
    assert np.abs(row - expected).max() <= 1.0 / count + SNAP


def test_slanted_edge_converges_to_the_covered_area() -> None:
    now, area = instant(turned_edge()), covered_area()
    errors = {}
    with drawing(scene(lambda _: now, (quad(60.0), WHITE))) as renderer:
        for count in (1, 4, 16, 64, 256):
            reference = renderer.draw_reference(now, jitter_sequence(f"hammersley:{count}"))[..., 0]
            errors[count] = np.abs(reference - area)
    border = (area > 0.0) & (area < 1.0)
    for count, error in errors.items():
        # A line crosses at most 2 sqrt(N) of the sqrt(N) x sqrt(N) boxes that hold one sample each.
        assert error[~border].max() <= SNAP
        assert error.max() <= 2.0 / np.sqrt(count) + SNAP
    rms = [float(np.sqrt((errors[count][border] ** 2).mean())) for count in (4, 16, 64)]
    # Stratified samples of an edge: the error falls faster than the 1/sqrt(N) of random ones.
    assert rms[1] < rms[0] / 2.0
    assert rms[2] < rms[1] / 2.0


def test_pattern_has_no_shift() -> None:
    # An edge at the middle of a pixel is covered by one half exactly, in x and in y.
    assert PIXELS.half_height * 2.0 == HEIGHT
    now = instant(place(4.5, -4.5, 0.0))
    with drawing(scene(lambda _: now, (quad(4.0), WHITE))) as renderer:
        reference = renderer.draw_reference(now, jitter_sequence("hammersley:64"))[..., 0]
    assert reference[HEIGHT // 2 + 3, WIDTH // 2] == 0.5
    assert reference[HEIGHT // 2, WIDTH // 2 + 3] == 0.5
