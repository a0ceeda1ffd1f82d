"""Failure modes of depth, matrices and motion as files hold them: docs/numerics.md, F5, F7 and F8."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.cli import main
from cltaa.core.frame_checks import RIGID_WITHIN, _check_matrix, _is_rigid, check_camera
from cltaa.errors import DataError
from cltaa.frame import Camera
from cltaa.io.exr_frame import frame_attributes
from cltaa.io.exr_write import write_frame, write_image
from tests.numerics.exact_cameras import perspective, rotation, view_at
from tests.sequence_factory import HEIGHT, WIDTH, make_camera, make_frame, read_frame

TURN = rotation((0.3, 1.0, -0.2), 25.0)


def header(**changes: object) -> dict[str, object]:
    return frame_attributes(make_frame()) | changes


def planes(**changes: NDArray[Any]) -> dict[str, NDArray[Any]]:
    return {name: np.ones((HEIGHT, WIDTH), np.float32) for name in "RGBZ"} | changes


AWAY = np.diag([1.0, 1.0, -1.0, 1.0])


def broken(name: str, change: Callable[[NDArray[np.float64]], object]) -> dict[str, object]:
    sound = np.array(header()[name], np.float64)
    changed = change(sound.T.copy())
    assert isinstance(changed, np.ndarray)
    return {name: np.ascontiguousarray(changed.T)}


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("worldToView", lambda m: m * np.nan, "holds NaN or infinity"),
        ("viewToClip", lambda m: np.where(m == m[1, 1], np.inf, m), "holds NaN or infinity"),
        ("viewToClip", lambda m: m * np.diag([1, 0, 1, 1]), r"cannot be inverted.*expected \|M inv\(M\) - I\| < 1e-06"),
        ("worldToView", lambda m: m.T, "has a wrong last row.*; it is transposed: of files cltaa check names"),
        ("viewToClip", lambda m: m.T, "has a wrong last row.*; it is transposed: of files cltaa check names"),
        ("viewToClip", lambda m: m @ AWAY, "has a wrong last row.*; it is of a camera along .z: of files"),
        ("viewToClip", lambda m: (m @ AWAY).T, "has a wrong last row.*; it is transposed, and of a camera along .z:"),
        ("viewToClip", lambda m: -m, "has a wrong last row.*; it is of a camera along .z: of files"),
        ("viewToClip", lambda m: np.diag([1, 1, 1, 2]) @ m, "has a wrong last row.*; check whether it is transposed"),
        ("worldToView", lambda m: AWAY @ m, "mirrors the world.*flip its z row"),
        ("worldToView", lambda m: np.diag([1e-110, 1e-110, 1e-110, 1]) @ m, "scales beyond use .*; use another unit"),
        ("worldToView", lambda m: np.diag([1e110, 1e110, 1e110, 1]) @ m, "scales beyond use.*found inf"),
        ("viewToClip", lambda m: np.diag([1e-170, 1e-170, 1, 1]) @ m, "scales beyond use.*found 0"),
    ],
)
def test_f7_a_wrong_matrix_is_named_with_the_test_that_it_failed(
    tmp_path: Path, name: str, change: Callable[[NDArray[np.float64]], object], says: str
) -> None:
    path = tmp_path / "shot.0007.exr"
    write_image(path, planes(), header(**broken(f"cltaa:{name}", change)))
    with pytest.raises(DataError, match=rf"shot\.0007\.exr.*cltaa:{name} {says}"):
        read_frame(path)


def test_f7_a_sound_camera_at_ten_thousand_kilometres_passes(tmp_path: Path) -> None:
    camera = Camera(view_at(np.array([6e6, -5e6, 6e6]), TURN), perspective(1.6))
    write_frame(tmp_path / "a.0000.exr", make_frame(camera=camera))
    assert np.array_equal(read_frame(tmp_path / "a.0000.exr").camera.world_to_view, camera.world_to_view)


@pytest.mark.parametrize("matrix", ["world_to_view", "view_to_clip"])
def test_f7_no_number_of_a_camera_may_be_nan(matrix: str) -> None:
    for place in np.ndindex(4, 4):
        camera = make_camera((1.0, 2.0, 3.0))
        getattr(camera, matrix)[place] = np.nan
        with pytest.raises(DataError, match=rf"camera\.{matrix} holds NaN or infinity"):
            check_camera(camera)


def test_f7_a_view_that_only_turns_and_moves_passes_the_whole_check() -> None:
    """And no other counts as one: scaled, sheared, mirrored, with another last row, or too far away."""
    for distance in (1.0, 1e3, 0.5 * RIGID_WITHIN):
        view = view_at(distance * np.array([0.6, -0.4, 0.6]), TURN)
        assert _is_rigid(*view.tolist()), distance
        _check_matrix("view", view.tobytes(), view.dtype, is_view=True)
        sheared = np.eye(4) + 1e-5 * np.eye(4, k=1)
        for change in (np.diag([2, 1, 1, 1]), sheared, np.diag([1, 1, -1, 1]), np.diag([1, 1, 1, 2])):
            assert not _is_rigid(*(change @ view).tolist()), change
    assert not _is_rigid(*view_at(np.array([0.0, 0.0, 2 * RIGID_WITHIN]), TURN).tolist())


def test_f7_a_camera_changed_in_place_is_checked_again() -> None:
    camera = make_camera()
    for _ in range(2):
        check_camera(camera)
    camera.world_to_view[2] *= -1
    for _ in range(2):
        with pytest.raises(DataError, match=r"shot\.0007\.exr.*frame 7.*mirrors the world"):
            check_camera(camera, path=Path("shot.0007.exr"), frame=7)


def test_f8_half_motion_is_as_wrong_as_halves_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    true = np.random.default_rng(34).uniform(-256, 256, (2, HEIGHT, WIDTH)).astype(np.float32)
    true[:, 3] = 0.0
    path = tmp_path / "a.0000.exr"
    half = {f"backward.{axis}": plane.astype(np.float16) for axis, plane in zip("uv", true, strict=True)}
    write_image(path, planes(**half), header(**{"cltaa:frame": 0, "cltaa:effects": "motion"}))
    read = read_frame(path).motion
    assert read is not None
    error = np.abs(np.moveaxis(read, -1, 0) - true)
    assert (error <= np.abs(true) * 2.0**-11).all()
    assert error[:, 3].max() == 0.0
    assert error.max() > 2.0**-5  # and no better: inspect says so
    main(["inspect", str(tmp_path)])
    assert "half precision" in capsys.readouterr().out
