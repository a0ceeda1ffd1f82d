"""Headers that say what cannot be: the attribute and the test that it failed are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Matrix
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_sequence
from tests.io.test_bad_input import attributes, planes, refusal
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_camera, make_frame, read_frame

NAN, INF, EYE = float("nan"), float("inf"), np.eye(4)
VIEW = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [3.0, 2.0, 1.0, 1.0]])  # as in a file: row vectors
CLIP = make_frame().camera.view_to_clip.T.copy()


def perspective(near: float, far: float) -> Matrix:
    """An OpenGL projection as a file holds it, for planes that need not make sense."""
    scale = 1.0 / np.tan(np.radians(30.0))
    with np.errstate(all="ignore"):
        depth = [np.float64(far + near) / (near - far), np.float64(2 * far * near) / (near - far)]
    rows = [[scale * HEIGHT / WIDTH, 0, 0, 0], [0, scale, 0, 0], [0, 0, *depth], [0, 0, -1, 0]]
    return np.array(rows, np.float64).T.copy()


def with_entry(matrix: Matrix, row: int, column: int, value: float) -> Matrix:
    copy = matrix.copy()
    copy[row, column] = value
    return copy


def written(folder: Path, **changes: object) -> Path:
    write_image(folder / "a.0000.exr", planes(), attributes(**changes))
    return folder / "a.0000.exr"


CASES: list[tuple[dict[str, object], str]] = [
    ({"worldToView": None}, "attribute is missing (expected cltaa:worldToView"),
    ({"viewToClip": None}, "attribute is missing (expected cltaa:viewToClip"),
    ({"jitterPx": None}, "attribute is missing (expected cltaa:jitterPx"),
    ({"worldToView": "identity"}, "worldToView is wrong (expected M44d, found 'identity'"),
    ({"viewToClip": 60.0}, "viewToClip is wrong"),
    ({"worldToView": np.eye(3)}, "expected M44d, found float64[3, 3]"),
    ({"worldToView": with_entry(VIEW, 3, 0, NAN)}, "worldToView holds NaN or infinity; write the frame again"),
    ({"worldToView": np.zeros((4, 4))}, "found inf); write the frame again"),
    ({"worldToView": with_entry(VIEW, 1, 1, 0.0)}, "worldToView cannot be inverted"),
    ({"worldToView": np.ones((4, 4))}, "worldToView cannot be inverted"),
    ({"viewToClip": np.diag([1.0, 1.0, 0.0, 1.0])}, "viewToClip cannot be inverted"),
    ({"viewToClip": with_entry(CLIP, 0, 0, 0.0)}, "viewToClip cannot be inverted"),
    ({"viewToClip": perspective(5.0, 5.0)}, "viewToClip holds NaN or infinity"),  # near = far
    ({"viewToClip": perspective(0.0, 100.0)}, "viewToClip cannot be inverted"),  # near = 0
    ({"viewToClip": perspective(0.1, INF)}, "viewToClip holds NaN or infinity"),  # inf / inf
    ({"viewToClip": np.diag([1.0, 1.0, -1.0, -1.0])}, "viewToClip has a wrong last row"),
    ({"jitterPx": np.array([0.0, 2.5])}, "jitterPx is no jitter"),
    ({"jitterPx": np.array([-2.001, 0.0])}, "jitterPx is no jitter"),
    ({"jitterPx": np.array([NAN, 0.0])}, "jitterPx is no jitter"),
    ({"jitterPx": np.array([0.0, -INF])}, "jitterPx is no jitter"),
    ({"jitterPx": "0.25 0.25"}, "jitterPx is wrong"),
    ({"jitterPx": 0.25}, "jitterPx is wrong (expected V2d"),
    ({"jitterPx": np.zeros(3)}, "jitterPx is wrong (expected V2d"),
    ({"cut": 2}, "cltaa:cut is wrong (expected 0 or 1, found 2)"),
    ({"cut": -1}, "cltaa:cut is wrong"),
    ({"cut": "yes"}, "cltaa:cut is wrong"),
    ({"frame": "first"}, "cltaa:frame is wrong"),
    ({"frame": 0.5}, "cltaa:frame is wrong (expected a whole number, found 0.5)"),
    ({"exposure": 0.0}, "no exposure"),
    ({"exposure": -1.0}, "no exposure"),
    ({"exposure": NAN}, "no exposure"),
    ({"exposure": INF}, "no exposure"),
    ({"exposure": 1e300}, "no exposure"),
    ({"exposure": 5e-324}, "no exposure"),
    ({"exposure": "bright"}, "cltaa:exposure is wrong"),
    ({"effects": "camera,teleport"}, "found 'camera,teleport'"),
    ({"effects": 7}, "cltaa:effects is wrong"),
    ({"scene": 3}, "cltaa:scene is wrong"),
    ({"scene": np.zeros(2)}, "cltaa:scene is wrong"),
]


def test_wrong_attribute_is_named(tmp_path: Path) -> None:
    for changes, message in CASES:
        line = refusal(written(tmp_path, **changes))
        assert message in line, changes
        assert len(line) < 500, changes


def test_text_of_a_megabyte_is_not_repeated_in_the_message(tmp_path: Path) -> None:
    for name in ("effects", "worldToView"):
        line = refusal(written(tmp_path, **{name: "x" * 2**20}))
        assert name in line
        assert len(line) < 500


@pytest.mark.parametrize("clip", [perspective(100.0, 0.1), perspective(0.1, 1e30), perspective(-0.1, -100.0)])
def test_near_and_far_planes_do_not_reach_the_resolve(clip: Matrix) -> None:
    """Near beyond far is a reversed device depth. ``Z`` is a distance, so the planes cannot matter, and do not."""

    def resolved(view_to_clip: Matrix) -> np.ndarray:
        resolver = Resolver(device="numpy")
        for index in range(3):
            camera = Camera(make_camera((0.1 * index, 0.0, 5.0)).world_to_view, view_to_clip)
            image = resolver.resolve(make_frame(index, camera=camera))
        return image

    np.testing.assert_array_equal(bits(resolved(clip.T)), bits(resolved(perspective(0.1, 100.0).T)))


@pytest.mark.parametrize("name", ["a.0012.exr", "shot_v02_0012.exr", "frame-12.exr", "a12.exr", "0012.exr"])
def test_frame_number_comes_from_the_name_where_the_header_has_none(tmp_path: Path, name: str) -> None:
    written(tmp_path, frame=None).rename(tmp_path / name)
    assert open_sequence(tmp_path).frame(12).index == 12


def test_what_need_not_be_there(tmp_path: Path) -> None:
    frame = read_frame(written(tmp_path, frame=None, cut=None, exposure=None, scene=None, effects=None))
    assert (frame.index, frame.cut, frame.exposure, frame.scene, frame.effects) == (0, False, 1.0, "", None)
