"""Failure modes of jitter: docs/numerics.md, F9."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.cli import main
from cltaa.core.frame_checks import LARGEST_JITTER
from cltaa.core.parameters import CurrentFilter
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.frame import Camera, Effect
from cltaa.io.exr_write import write_frame
from tests.numerics.exact_cameras import perspective
from tests.sequence_factory import make_frame

SIZE, PERIOD = (24, 36), 64


def scene(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """A slanted bar pattern with hard edges, in pixels from the top left corner."""
    return ((0.31 * x + 0.17 * y) % 1.9 > 0.8).astype(np.float32)


def at(jitter: tuple[float, float], shift: float = 0.0) -> NDArray[np.float32]:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    return np.repeat(scene(x + 0.5 + jitter[0] + shift, y + 0.5 + jitter[1])[..., None], 3, -1).astype(np.float32)


def truth() -> NDArray[np.float32]:
    grid = (np.arange(32) + 0.5) / 32 - 0.5
    mean: NDArray[np.float32] = np.mean([at((a, b)) for a in grid for b in grid], axis=0)
    return mean


def sequence() -> list[tuple[float, float]]:
    from cltaa_capture.jitter import halton

    points = halton(PERIOD)
    return [(float(a), float(b)) for a, b in points - points.mean(axis=0)]


def error_of(matrices: Callable[[tuple[float, float]], tuple[float, float]], drawn: bool = True) -> float:
    """RMSE against the truth where the matrices move by ``matrices(jitter)`` pixels and samples by the jitter."""
    clip = perspective(SIZE[1] / SIZE[0])
    preset = override(
        load_preset(), {"rectify": "none", "reject": "none", "sample_limit": 2.0**20, "resampling_penalty": 0.0}
    )
    resolver = Resolver(preset, "numpy")
    for index, jitter in enumerate(sequence()):
        moved = clip.copy()
        across, down = matrices(jitter)
        moved[0, 2] += 2 * across / SIZE[1]
        moved[1, 2] -= 2 * down / SIZE[0]
        frame = make_frame(index, width=SIZE[1], height=SIZE[0], effects=frozenset({Effect.CAMERA}))
        colour = at(jitter if drawn else (0.0, 0.0))
        resolved = resolver.resolve(
            replace(frame, colour=colour, depth=np.full(SIZE, 4.0, np.float32), camera=Camera(np.eye(4), moved))
        )
    inside = np.s_[4:-4, 4:-4]
    return float(np.sqrt(np.mean((resolved[inside] - truth()[inside]) ** 2)))


def test_f9_jitter_that_is_absent_or_left_in_the_matrices_shows() -> None:
    correct = error_of(lambda _: (0.0, 0.0))
    absent = error_of(lambda _: (0.0, 0.0), drawn=False)
    wrong = {
        "left in": error_of(lambda j: j),
        "taken out twice": error_of(lambda j: (-j[0], -j[1])),
        "y upside down": error_of(lambda j: (0.0, 2 * j[1])),
    }
    assert correct < absent / 4
    assert {name: error for name, error in wrong.items() if error <= 3 * correct} == {}


def test_f9_a_biased_sequence_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As what it is, and as a problem where no centred pattern of an engine has such a mean."""
    from cltaa_capture.jitter import halton

    raw = halton(8) - 0.5
    assert np.abs(raw.mean(axis=0)).max() > 1e-3
    for name, points in (("raw", raw), ("centred", raw - raw.mean(axis=0)), ("corner", raw + 0.5)):
        (tmp_path / name).mkdir()
        for index in range(17):
            jitter = (float(points[index % 8][0]), float(points[index % 8][1]))
            write_frame(tmp_path / name / f"a.{index:04d}.exr", make_frame(index, jitter_px=jitter))
        assert main(["inspect", str(tmp_path / name)]) == (65 if name == "corner" else 0)
        assert ("not centred: the image is shifted by it" in " ".join(capsys.readouterr().out.split())) == (
            name != "centred"
        )


@pytest.mark.parametrize("kind", list(CurrentFilter))
def test_f9_the_largest_jitter_leaves_a_filter_a_sample(kind: CurrentFilter) -> None:
    """At 2 pixels the nearest of three samples is one pixel away, where two of the filters are 0."""
    resolver = Resolver(override(load_preset(), {"current_filter": kind.value, "filter_use": "always"}), "numpy")
    largest = float(np.nextafter(LARGEST_JITTER, 0.0))
    for index, jitter in enumerate([(largest, -largest), (-1.0, 1.0)]):
        assert np.isfinite(resolver.resolve(make_frame(index, jitter_px=jitter))).all()
    with pytest.raises(DataError, match="no jitter"):
        resolver.resolve(make_frame(2, jitter_px=(0.0, LARGEST_JITTER)))
