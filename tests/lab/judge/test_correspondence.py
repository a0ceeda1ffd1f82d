"""Where surfaces were and what came into view, against rays that are cast through both cameras."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.frame import Camera, Frame
from cltaa.lab.judge.correspondence import correspondence
from tests.numerics.exact_cameras import displacement_of, orthographic, perspective, rotation, view_at
from tests.sequence_factory import make_camera, make_frame

HEIGHT, WIDTH = 54, 72
Y, X = np.mgrid[:HEIGHT, :WIDTH] + 0.5
CLIPS = {"perspective": perspective(WIDTH / HEIGHT), "parallel": orthographic(4.0, 3.0)}
SLANT = np.array([1.0, 0.7, 1.0])  # of the wall: so steep that the next pixel is off by more than the slack of depth
Places = NDArray[np.float64]


def look(camera: Camera, x: Places, y: Places) -> tuple[Places, NDArray[np.bool_]]:
    """Distance of what is seen at pixels ``x``, ``y``, and where it is a card in front of a slanting wall."""
    back = np.linalg.inv(camera.view_to_clip @ camera.world_to_view)
    ends = []
    for z in (-1.0, 0.5):
        end = np.einsum("ij,jhw->ihw", back, np.stack([2 * x / WIDTH - 1, 1 - 2 * y / HEIGHT, z + 0 * x, 1 + 0 * x]))
        ends.append(end[:3] / end[3])
    start, along = ends[0], ends[1] - ends[0]
    wall = start - along * (8.0 + np.tensordot(SLANT, start, 1)) / np.tensordot(SLANT, along, 1)
    card = start - along * (4.0 + start[2]) / along[2]  # z = -4
    on_card = (np.abs(card[0] - 0.3) < 0.9) & (np.abs(card[1] + 0.1) < 0.6)
    place = np.where(on_card, card, wall)
    view = camera.world_to_view
    return -(np.einsum("j,jhw->hw", view[2, :3], place) + view[2, 3]), on_card


def drawn(index: int, camera: Camera, jitter: tuple[float, float]) -> Frame:
    depth, _ = look(camera, X + jitter[0], Y + jitter[1])
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=camera, jitter_px=jitter)
    return replace(frame, depth=depth.astype(np.float32))


@pytest.mark.parametrize("lens", CLIPS)
def test_a_camera_that_moves_in_sees_the_same_and_what_a_card_hid(lens: str) -> None:
    """So far in that everything is nearer by more than the slack of depth."""
    now = Camera(view_at(np.array([2.0, 0.1, 0.0]), rotation((0.05, -1, 0.1), 15.0)), CLIPS[lens])
    before = Camera(view_at(np.array([0.0, 0.0, 1.2]), np.eye(3)), CLIPS[lens])
    frame, jitter = drawn(1, now, (0.3, -0.2)), (0.3, -0.2)
    found = correspondence(frame, drawn(0, before, (-0.25, 0.4)))

    px, py = X + jitter[0] - WIDTH / 2, Y + jitter[1] - HEIGHT / 2
    near: Any = -frame.depth if frame.camera.orthographic else 1 / frame.depth
    u, v, _ = displacement_of(px, py, near, now, before, WIDTH, HEIGHT)
    # Inverse depth is rounded to float32 on both sides, and nothing moves by more than the picture.
    np.testing.assert_allclose(found.motion, np.stack([u, v], -1).astype(float), rtol=0, atol=2.0**-23 * WIDTH)
    assert np.abs(u).max() > 5

    x, y = found.x + jitter[0], found.y + jitter[1]
    _, on_card = look(now, X + jitter[0], Y + jitter[1])
    around = np.array([look(before, x + dx, y + dy)[1] for dx in (-2, 0, 2) for dy in (-2, 0, 2)])
    sure = around.all(0) | ~around.any(0)  # of what stood there, as the nearest sample is off by a pixel and jitter
    inside = (found.x >= 0) & (found.y >= 0) & (found.x < WIDTH) & (found.y < HEIGHT)
    hidden = around.any(0) & ~on_card
    np.testing.assert_array_equal(found.same[sure], (inside & ~hidden)[sure])
    np.testing.assert_array_equal(found.disoccluded[sure], (inside & hidden)[sure])
    assert (inside & hidden & sure).sum() > 20
    assert (~inside).any()

    padded = np.pad(on_card, 1)
    beside = np.array([padded[i : i + HEIGHT, j : j + WIDTH] for i in range(3) for j in range(3)]).any(0)
    np.testing.assert_array_equal(found.edge, beside & ~on_card)


def test_what_was_behind_the_camera_came_from_nowhere() -> None:
    frame, before = (make_frame(index, camera=make_camera((0.0, 0.0, 5.0 - 3.0 * (1 - index)))) for index in (1, 0))
    found = correspondence(*(replace(each, depth=np.full_like(each.depth, 2.0)) for each in (frame, before)))
    assert not (found.same | found.disoccluded).any()


def test_what_leaves_a_picture_of_one_pixel_was_nowhere() -> None:
    camera = make_camera()
    gone = replace(camera, world_to_view=view_at(np.array([100.0, 100.0, 0.0]), np.eye(3)))
    now, before = (make_frame(index, width=1, height=1, camera=each) for index, each in ((1, camera), (0, gone)))
    found = correspondence(replace(now, depth=np.full((1, 1), 4, np.float32)), before)
    assert (found.same.item(), found.row.item(), found.column.item()) == (False, 0, 0)
