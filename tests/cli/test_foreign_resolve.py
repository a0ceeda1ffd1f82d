"""``cltaa resolve`` on files of other writers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_images
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_frame


def test_blender_frames_without_matrices_are_resolved_by_vectors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_blender(tmp_path / "in", [make_frame(index, motion=True, effects=None) for index in range(3)])
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    said = capsys.readouterr().err
    assert "profile blender: header attribute Software is Blender 5.0.1" in said
    assert "no matrices: motion vectors alone" in said
    assert len(open_images(tmp_path / "out")) == 3


def test_nothing_but_still_colour_is_averaged(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pictures = [np.full((8, 8), 0.5, np.float32) + rng.normal(0, 0.01, (8, 8)).astype(np.float32) for _ in range(8)]
    (tmp_path / "in").mkdir()
    for index, picture in enumerate(pictures):
        write_image(tmp_path / "in" / f"a.{index:04d}.exr", dict.fromkeys("RGB", picture))
    assert main(["resolve", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    last = open_images(tmp_path / "out").image(7)[..., 0]
    assert np.std(last) < 0.7 * np.std(pictures[7])  # a mean of 8 would leave 0.35 of it, rectification a little more
