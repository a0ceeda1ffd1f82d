"""A box passes by a wall: which of the wall's pixels ask least of a change of light, and which have no history, by the
places of the box alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from tests.last_frame import last_planes
from tests.sequence_factory import make_camera

WIDTH, HEIGHT, WALL, BOX = 48, 20, 8.0, 2.0
FOCAL = HEIGHT / 2 / np.tan(np.radians(60.0) / 2)  # pixels
CAMERA = frozenset({Effect.CAMERA, Effect.DISOCCLUSION, Effect.ILLUMINATION})


def frames(step: float, box_step: float, half: float = 4.0) -> tuple[list[Frame], list[np.ndarray]]:
    """Two frames of ever brighter light, the camera ``step`` wall pixels apart and the box ``box_step``, and where each
    shows the box, [H, W]."""
    texture = np.random.default_rng(0).uniform(0.2, 0.8, (HEIGHT, WIDTH, 3)).astype(np.float32)
    (y, x), made, boxes = np.mgrid[:HEIGHT, :WIDTH], [], []
    for index in range(2):
        box = (np.abs(x - (20.3 + index * box_step)) < half) & (y > 5) & (y < 14)
        camera = make_camera((-index * step * WALL / FOCAL, 0.0, 5.0), WIDTH / HEIGHT)
        depth = np.where(box, BOX, WALL).astype(np.float32)
        made.append(Frame(index, texture * 2.0**index, depth=depth, camera=camera, effects=CAMERA))
        boxes.append(box)
    return made, boxes


def counts(
    made: list[Frame], passing_t: float = 1e6, covered_share: float = 1.0, edge_samples: float = 1e6
) -> np.ndarray:
    """The counts that the last frame leaves, [H, W]."""
    tests = {"passing_t": passing_t, "disocclusion_t": 1e6, "illumination_t": 1e6, "behind_t": 1e6}
    settings = {**tests, "covered_share": covered_share, "edge_samples": edge_samples}
    resolver = Resolver(override(load_preset(), settings))
    for frame in made:
        resolver.resolve(frame)
    return np.asarray(last_planes(resolver, "output_count")[0])


@pytest.mark.parametrize("step", [0.3, -1.6, 2.75])
def test_least_is_asked_where_a_box_was_in_the_four_texels_or_the_corners(step: float) -> None:
    made, boxes = frames(step, step * WALL / BOX)
    before, now = (np.pad(box, 8, mode="edge") for box in boxes)
    asked = counts(made, 0.125) < counts(made, 1e6)
    expected = np.zeros((HEIGHT, WIDTH), bool)
    for y, x in np.ndindex(HEIGHT, WIDTH):
        place = x - step  # moved as the wall
        row, column = y + 8, int(np.floor(place)) + 8
        four, around = before[row : row + 2, column : column + 2], before[row - 1 : row + 3, column - 1 : column + 3]
        passed = four.any() or around[[0, 0, 3, 3], [0, 3, 0, 3]].any()
        seen = -0.5 <= place <= WIDTH - 0.5 and not four.all() and not now[y + 7 : y + 10, x + 7 : x + 10].any()
        expected[y, x] = passed and seen
    assert expected.sum() > 10
    assert np.array_equal(asked, expected)


def test_what_moves_by_less_than_a_quarter_pixel_has_not_passed() -> None:
    for step, passes in ((0.08, False), (0.09, True)):  # of the wall; the box moves four times as far
        made, _ = frames(step, -1.0)  # by the jitter, say
        assert (counts(made, 0.125) < counts(made, 1e6)).any() == passes


def test_what_moves_with_a_surface_by_vectors_of_its_own_has_not_passed() -> None:
    """Steps of one rigid thing before a camera that hardly moves; and a still wall whose vectors are the camera's."""
    for step, motion, passes in ((0.02, -4.0, False), (1.5, -1.5, True)):
        made, _ = frames(step, -motion if not passes else step * WALL / BOX)
        vectors = np.zeros((HEIGHT, WIDTH, 2), np.float32)
        vectors[..., 0] = motion
        made = [replace(frame, motion=vectors, effects=CAMERA | {Effect.MOTION}) for frame in made]
        assert (counts(made, 0.125) < counts(made, 1e6)).any() == passes


@pytest.mark.parametrize(
    ("step", "box_step", "own"),
    # The last box moves by itself, before a camera whose own motion would not have taken it past the wall.
    [(0.6, 2.4, False), (-1.6, -6.4, False), (2.75, 11.0, False), (1.4, -1.0, True), (0.05, 3.0, True)],
    ids=["slow", "back", "fast", "against-the-camera", "by-itself"],
)
def test_what_the_box_stood_instead_of_has_no_history(step: float, box_step: float, own: bool) -> None:
    """It covered over a quarter of the place of the history, and one of the corners around."""
    made, boxes = frames(step, box_step)
    if own:  # the wall's vectors and the box's
        vectors = [np.stack([np.where(box, -box_step, -step), np.zeros((HEIGHT, WIDTH))], -1) for box in boxes]
        effects = CAMERA | {Effect.MOTION}
        made = [
            replace(frame, motion=motion.astype(np.float32), effects=effects)
            for frame, motion in zip(made, vectors, strict=True)
        ]
    before, now = (np.pad(box, 12, mode="edge") for box in boxes)
    begun = (counts(made, 1e6, 0.25) == 1.0) & (counts(made, 1e6) > 1.0)
    expected = np.zeros((HEIGHT, WIDTH), bool)
    for y, x in np.ndindex(HEIGHT, WIDTH):
        place = x - step  # moved as the wall
        row, column, share = y + 12, int(np.floor(place)) + 12, place - np.floor(place)
        around = before[row - 1 : row + 3, column - 1 : column + 3]
        covered = around[1, 1:3] @ [1 - share, share] > 0.25
        instead = covered and around[[0, 0, 3, 3], [0, 3, 0, 3]].any()
        # Among vectors a texel of no weight does not say that the wall was seen: the place lies in a row.
        read = around[1, 1:3] if own else around[1:3, 1:3]
        seen = -0.5 <= place <= WIDTH - 0.5 and not read.all()
        expected[y, x] = instead and seen and not now[y + 11 : y + 14, x + 11 : x + 14].any()
    assert expected.sum() > 3
    assert np.array_equal(begun, expected)


@pytest.mark.parametrize("moved", [(3, 0), (-3, 0), (0, 3), (0, -3)])
def test_the_pixel_that_a_spark_leaves_is_reset_in_every_direction(moved: tuple[int, int]) -> None:
    """Beside it the wall was seen, but no weight of what the wall's pixel reads lies there."""
    (wall, _), _ = frames(0.0, 0.0, half=0.0)
    made = []
    for index in range(2):
        at = 9 + index * moved[1], 20 + index * moved[0]
        depth, motion = wall.depth.copy(), np.zeros((HEIGHT, WIDTH, 2), np.float32)
        depth[at], motion[at] = BOX, (-moved[0], -moved[1])
        made.append(replace(wall, index=index, depth=depth, motion=motion, effects=CAMERA | {Effect.MOTION}))
    assert [tuple(at) for at in np.argwhere(counts(made) == 1.0)] == [(9, 20)]


@pytest.mark.parametrize("step", [0.3, -1.6, 2.75, 0.08])
def test_an_edge_counts_for_few_samples_where_what_is_behind_it_moved(step: float) -> None:
    """Of a box, not of a wire; by less than a quarter pixel it has not."""
    made, boxes = frames(step, step * WALL / BOX)
    before, now = (np.pad(box, 16, mode="edge") for box in boxes)
    few, expected = counts(made, edge_samples=0.5) < counts(made), np.zeros((HEIGHT, WIDTH), bool)
    for y, x in np.ndindex(HEIGHT, WIDTH):
        place, around = x - step * WALL / BOX, now[y + 15 : y + 18, x + 15 : x + 18]  # moved as the box
        row, column = y + 16, int(np.floor(place)) + 16
        there = before[row - 1 : row + 3, column - 1 : column + 3]
        edge = around.any() and not around.all() and -0.5 <= place <= WIDTH - 0.5
        expected[y, x] = edge and there[1:3, 1:3].any() and there[[0, 0, 3, 3], [0, 3, 0, 3]].any()
    assert expected.sum() > 10
    assert np.array_equal(few, expected & (abs(step) * (WALL / BOX - 1) >= 0.25))
    wire, _ = frames(step, step * WALL / BOX, half=0.5)
    assert np.array_equal(counts(wire, edge_samples=0.5), counts(wire))


def test_a_wire_takes_no_history_away() -> None:
    made, boxes = frames(0.6, 2.4, half=0.5)  # a column of texels, which covers .6 of the places left of it
    assert boxes[0].any(axis=0).sum() == 1
    assert np.array_equal(counts(made, 1e6, 0.25), counts(made, 1e6))
