"""Each margin of the detector by a case that lies on either side of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from cltaa.frame import Camera, Frame
from cltaa.lab.check.depth import check_depth
from cltaa.lab.check.hypotheses import SURE, Affine, Finding
from cltaa.lab.check.jitter import check_jitter, check_mean, settled_shifts
from cltaa.lab.check.motion import check_motion
from cltaa.lab.check.registration import Fit, Shot
from cltaa.lab.check.report import check_frames
from tests.lab.check.conftest import Scene
from tests.lab.check.mistakes import MISTAKES, full_motion
from tests.sequence_factory import make_camera, make_frame

SIZE = HEIGHT, WIDTH = 48, 64


def names(found: Sequence[Finding]) -> list[str]:
    return [finding.name for finding in found]


def of_depth(depth: np.ndarray) -> Frame:
    return replace(make_frame(0, width=WIDTH, height=HEIGHT), depth=depth.astype(np.float32), motion=None)


@pytest.mark.parametrize(("share", "found"), [(0.65, []), (0.95, ["depth-inverse"])])
def test_surfaces_that_bend_like_a_reciprocal_must_be_most_of_the_picture(share: float, found: list[str]) -> None:
    """Depth grows evenly over some rows, as over a plane only 1/Z does; the other rows are planes."""
    x, y = np.linspace(0.0, 1.0, WIDTH), np.linspace(0.0, 0.3, HEIGHT)[:, None]
    even, plane = 3.0 + x + y, 1.0 / (0.3 + 0.4 * x + 0.1 * y)
    depth = np.where(np.arange(HEIGHT)[:, None] < share * HEIGHT, even, plane)
    assert names(check_depth([of_depth(depth)])) == found


@pytest.mark.parametrize(("sky", "name"), [(1.0, "depth-device"), (0.0, "depth-inverse")])
@pytest.mark.parametrize("below", ["nearer", "farther"])
def test_the_sky_tells_which_way_a_depth_buffer_runs(sky: float, name: str, below: str) -> None:
    """Whatever the lower rows hold: under a ceiling they are the far ones."""
    rise = np.linspace(0.2, 0.8, HEIGHT)[:, None] + np.linspace(0.0, 0.1, WIDTH)
    towards = rise if (below == "nearer") == (sky == 0.0) else rise[::-1].copy()
    towards[20:23] = sky
    assert names(check_depth([of_depth(towards)])) == [name]


@pytest.mark.parametrize(("nearer_below", "name"), [(True, "depth-device"), (False, "depth-inverse")])
def test_without_a_sky_the_lower_rows_are_the_near_ones(nearer_below: bool, name: str) -> None:
    rise = np.linspace(0.2, 0.8, HEIGHT)[:, None] + np.linspace(0.0, 0.1, WIDTH)
    assert names(check_depth([of_depth(rise[::-1] if nearer_below else rise)])) == [name]


OFFSETS = np.array([(-0.5, 0.2), (0.3, -0.4), (0.1, 0.5), (-0.2, -0.3), (0.5, 0.1), (-0.4, 0.4), (0.2, -0.5)])


def judged(declared: np.ndarray, measured: np.ndarray) -> list[str]:
    """What frames ``measured`` apart say of a jitter ``declared``."""
    return names(check_jitter(before_a_camera_that_travels(declared, np.diff(measured, axis=0))))


def before_a_camera_that_travels(declared: np.ndarray, measured: np.ndarray) -> Shot:
    """Frames of a jitter ``declared``, between which shifts of ``measured`` were found."""
    frames = [
        replace(make_frame(index, camera=make_camera((0.1 * index, 0.0, 5.0))), jitter_px=(float(x), float(y)))
        for index, (x, y) in enumerate(declared)
    ]
    fits: list[Fit | None] = [Fit(shift, np.eye(2), 0.1) for shift in measured]
    return Shot(frames, (frames[0].width, frames[0].height), shifts=(fits, True))


@pytest.mark.parametrize(("share", "borne_out"), [(0.6, True), (0.4, False)])
def test_a_jitter_that_shifts_follow_settles_them_whatever_drifts(share: float, borne_out: bool) -> None:
    changes = np.diff(OFFSETS, axis=0)
    measured = share * changes + [1.0, 0.0]
    fits, _ = settled_shifts(before_a_camera_that_travels(OFFSETS, measured))
    assert np.array_equal([fit.shift for fit in fits if fit], changes if borne_out else measured)


@pytest.mark.parametrize(("size", "found"), [(0.05, []), (1.0, ["jitter-absent"])])
def test_jitter_too_small_to_measure_is_not_judged(size: float, found: list[str]) -> None:
    assert judged(size * OFFSETS, 0.0 * OFFSETS) == found


@pytest.mark.parametrize(("share", "sure"), [(0.1, True), (0.3, False)])
def test_shifts_that_noise_shortens_are_not_taken_for_none(share: float, sure: bool) -> None:
    frames = [replace(make_frame(place), jitter_px=(x, y)) for place, (x, y) in enumerate(OFFSETS.tolist())]
    fits: list[Fit | None] = [Fit(at, np.eye(2), 0.1, judge=np.hypot) for at in share * np.diff(OFFSETS, axis=0)]
    (found,) = check_jitter(Shot(frames, (frames[0].width, frames[0].height), shifts=(fits, True)))
    assert (found.name, found.confidence >= SURE) == ("jitter-absent", sure)


@pytest.mark.parametrize(("tilt", "sure"), [(0.1, False), (0.4, True)])
def test_a_sign_that_changes_less_than_the_error_is_a_question(tilt: float, sure: bool) -> None:
    """Of a jitter that hardly moves in x the other axis speaks for both signs."""
    declared = OFFSETS * [tilt, 1.0]
    measured = np.diff(declared, axis=0) * [-1.0, 1.0] + 0.1 * np.resize([1.0, -1.0], (6, 1)) * [0.0, 1.0]
    shot = before_a_camera_that_travels(declared, measured)
    apart = [partial(lambda at, x, y: float(np.hypot(x - at[0], y - at[1])), at) for at in measured]
    fits: list[Fit | None] = [Fit(at, np.eye(2), 0.1, judge=judge) for at, judge in zip(measured, apart, strict=True)]
    (found,) = check_jitter(Shot(shot.frames, shot.window, shifts=(fits, True)))
    assert (found.name, found.confidence >= SURE) == ("jitter-x-negated", sure)


@pytest.mark.parametrize(
    ("shift", "times", "found"),
    [((0.0, 0.0), 1, []), ((0.0, 0.0), 2, ["jitter-biased"]), ((-0.1, 0.0), 1, ["jitter-biased"])],
)
def test_a_jitter_within_the_pixel_is_biased_only_over_its_whole_period(
    shift: tuple[float, float], times: int, found: list[str]
) -> None:
    """The first half of a Hammersley set lies to one side."""
    half = np.stack([(np.arange(8) + 0.5) / 16 - 0.5, OFFSETS[[0, 1, 2, 3, 4, 5, 6, 0], 1]], -1) + shift
    frames = [replace(make_frame(place), jitter_px=(x, y)) for place, (x, y) in enumerate([*half.tolist()] * times)]
    assert names(check_mean(Shot(frames, (frames[0].width, frames[0].height)))) == found


@pytest.mark.parametrize(("size", "found"), [(0.05, []), (1.0, ["jitter-late"])])
@pytest.mark.parametrize("delay", [1, 2])  # of which 5 and 4 pairs tell, the fewest that do
def test_nor_is_its_delay(size: float, found: list[str], delay: int) -> None:
    assert judged(size * OFFSETS, size * np.roll(OFFSETS, delay, axis=0)) == found


@pytest.mark.parametrize(("late", "found"), [(0.24, ["jitter-late"]), (0.28, [])])
def test_a_delay_is_named_where_it_is_clearly_smoother(
    late: float, found: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def scatter(jitter: np.ndarray) -> float:
        """Of the jitter as declared 0.3, which is little enough to be told."""
        known = np.isfinite(jitter).all(1)
        same = [np.array_equal(np.roll(OFFSETS, by, axis=0)[known], jitter[known]) for by in (0, 1)]
        return 0.3 if same[0] else late if same[1] else 1.0

    likeness = SimpleNamespace(scatter=scatter, sureness=lambda *_: SURE)
    monkeypatch.setattr("cltaa.lab.check.jitter.measure_likeness", lambda _: likeness)
    assert judged(OFFSETS, OFFSETS) == found


class Noting(Affine):
    """Vectors as they are; remembers of which pixels they were."""

    asked: ClassVar[list[set[tuple[float, ...]]]] = []

    def __call__(self, declared: np.ndarray) -> np.ndarray:
        self.asked.append({*map(tuple, declared.T.tolist())})
        return declared


@pytest.mark.parametrize(("columns", "few"), [(3, True), (20, False)])
def test_vectors_whose_few_judges_chose_them_are_a_question(columns: int, few: bool) -> None:
    there = np.zeros((72, 128, 1), bool)
    there[18:54, 80 : 80 + columns] = True
    wrong = [replace(each, motion=np.where(there, np.asarray(each.motion), np.nan)) for each in drifting(0.5, -0.5)]
    (found,) = [one for one in check_frames(wrong) if one.name.startswith("motion")]
    assert found.name.endswith("negated")
    assert (found.confidence >= SURE, found.question) == (not few, few)


def test_vectors_are_judged_by_other_pixels_than_those_that_choose() -> None:
    random, width, height = np.random.default_rng(0), 128, 72
    colour = random.random((height, width, 3), np.float32)
    frames = [
        replace(
            make_frame(index, width=width, height=height, camera=make_camera(), jitter_px=(0.0, 0.0)),
            colour=colour,
            depth=np.full((height, width), 4, np.float32),
            motion=random.uniform(-1, 1, (height, width, 2)).astype(np.float32),  # of each pixel another
        )
        for index in range(2)
    ]
    noting = Noting(np.eye(2))
    Noting.asked = []
    check_motion(Shot(frames, (width, height)), ([None], False), {"": noting})
    chosen, judged = Noting.asked[0], Noting.asked[-1]
    assert chosen
    assert judged
    assert not chosen & judged


@pytest.mark.parametrize(("size", "found"), [(0.05, ["jitter-none"]), (0.5, ["jitter-missing"])])
def test_nor_is_it_missed(size: float, found: list[str]) -> None:
    assert judged(0.0 * OFFSETS, size * OFFSETS) == found


def test_a_picture_without_jitter_is_no_mistake() -> None:
    still = before_a_camera_that_travels(0.0 * OFFSETS, np.diff(0.05 * OFFSETS, axis=0))
    assert not any(finding.mistake for finding in check_jitter(still))


def test_shifts_that_fine_patterns_shorten_are_not_taken_for_half_a_jitter() -> None:
    assert judged(OFFSETS, -0.7 * OFFSETS) == ["jitter-negated"]
    assert judged(OFFSETS, -0.5 * OFFSETS) == ["jitter-scaled-0.5-negated"]


def drifting(speed: float, declared: float) -> list[Frame]:
    """Waves whose right half moves right by up to ``speed`` pixels a frame, where vectors say up to ``declared``."""
    y, x = np.mgrid[:72, :128].astype(np.float64)
    frames = []
    for index in range(8):
        share = np.where(y < 36, 1.0, 0.7) * (x >= 64)
        at = x - index * speed * share
        light = 0.5 + 0.2 * np.sin(at / 2.5) + 0.2 * np.sin(y / 3)
        frame = make_frame(index, width=128, height=72, jitter_px=(0.0, 0.0), camera=make_camera())
        motion = np.where((x >= 64)[..., None], share[..., None] * np.array([-declared, 0.0]), np.nan)
        frames.append(
            replace(
                frame,
                colour=np.repeat(light[..., None], 3, -1).astype(np.float32),
                motion=motion.astype(np.float32),
                depth=(1.0 / (0.2 + 0.001 * x)).astype(np.float32),
                reactive=None,
            )
        )
    return frames


@pytest.mark.parametrize(("speed", "found"), [(0.02, []), (0.5, ["motion-negated"])])
def test_vectors_too_short_to_matter_are_not_judged(speed: float, found: list[str]) -> None:
    assert [name for name in names(check_frames(drifting(speed, -speed))) if name.startswith("motion")] == found
    assert [name for name in names(check_frames(drifting(speed, speed))) if name.startswith("motion")] == []


@pytest.mark.parametrize("name", ["conveyor", "sparks"])
@pytest.mark.parametrize("mistake", ["motion-jittered", "motion-jittered-reversed"])
def test_jitter_in_vectors_that_all_move_or_all_rest_is_no_mistake_of_the_jitter(
    mistake: str, name: str, small: Scene
) -> None:
    """Before a belt that fills the picture its shift is measured through the vectors, and is not there."""
    frames = small(name) if name == "conveyor" else full_motion(small(name))
    found = check_frames(MISTAKES[mistake].plant(frames))
    assert [finding.name for finding in found if finding.mistake] == [mistake]


def along_a_wall(count: int = 12) -> list[Frame]:
    """Soft waves on a wall across the view and on a floor before it, seen by a jittered camera that slides along."""
    (height, width), waves = (72, 128), np.random.default_rng(6).normal(0, 1, (8, 3))
    clip = make_camera(aspect=width / height).view_to_clip
    y, x = np.mgrid[:height, :width] + 0.5
    frames = []
    for index in range(count):
        place, jitter = np.array([0.07, 0.02, 0.03]) * index, OFFSETS[index % len(OFFSETS)].tolist()
        across = ((x + jitter[0]) / width * 2 - 1) / clip[0, 0]
        up = (1 - (y + jitter[1]) / height * 2) / clip[1, 1]
        floor = np.where(up < 0, (-1.5 - place[1]) / np.minimum(up, -1e-9), np.inf)
        depth = np.minimum(floor, 6.0 + place[2])
        right, far = place[0] + across * depth, np.where(floor > depth, place[1] + up * depth, 9 + place[2] - depth)
        light = (sum(np.cos(1.5 * (a * right + b * far) + c) / 16 for a, b, c in waves) + 0.5) ** 2
        camera = Camera(make_camera(tuple(place)).world_to_view, clip)
        frames.append(
            replace(
                make_frame(index, width=width, height=height, jitter_px=tuple(jitter), camera=camera),
                colour=np.repeat(light[..., None], 3, -1).astype(np.float32),
                depth=depth.astype(np.float32),
                reactive=None,
                motion=None,
            )
        )
    return frames


def test_a_column_that_moves_out_of_a_small_picture_is_no_sign_of_slower_motion() -> None:
    assert names(check_frames(along_a_wall())) == []
    stored = []
    for frame in along_a_wall():
        by_z, constant = frame.camera.view_to_clip[2, 2:]  # OpenGL's clip space, from -1
        stored.append(replace(frame, depth=(0.5 + 0.5 * (constant / frame.depth - by_z)).astype(np.float32)))
    assert [finding.fix for finding in check_frames(stored)] == [{"depth": {"kind": "device"}}]
